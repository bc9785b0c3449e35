//! What a path costs and how much it varies: `cargo run --release -p turbid-render --example cost [paths per pixel] [part of a name]`.
//!
//! Camera 500 mm straight above, projector at (35, 0, 500), f_x = 0.1 across the pixels, slab of 2 m, g = 0.8, n = 1 but where said, one core.
//! relative variance = variance per path / mean^2 (for M_AC of the component along the mean phase), so 1e4 relative variance paths give 1 %.

use glam::{DVec2, DVec3};
use turbid_optics::solid::{Mesh, Solid};
use turbid_optics::view::View;
use turbid_render::camera::Camera;
use turbid_render::lamp::Steady;
use turbid_render::level::named;
use turbid_render::light::{Carrier, Light};
use turbid_render::moments::Moments;
use turbid_render::packet;
use turbid_render::path::{Nee, Setting, Walker};
use turbid_render::projected_images::ProjectedImages;
use turbid_render::world::{Body, Material, World};

#[allow(dead_code, reason = "not all of them are needed here")]
#[path = "../../optics/tests/shapes/mod.rs"]
mod shapes;

fn main() {
    let paths: u32 = std::env::args().nth(1).map_or(64, |n| n.parse().expect("a number of paths"));
    let view = |position: [f64; 3], field: f64| {
        View::new(position.into(), DVec3::ZERO, DVec3::Y, DVec2::splat(field)).expect("not along y")
    };
    let camera = Camera { view: view([0.0, 0.0, 500.0], 64.0), columns: 64, rows: 64 };
    let light = Light::new(view([35.0, 0.0, 500.0], 256.0), 5.0, false);
    let carriers = [Carrier::new(0.1, 0.0)];
    println!(
        "medium, estimator: flights/path, ns/flight, M flights/s, rv DC, rv AC, s to 1 % DC, AC (of these pixels, 2 cores)"
    );
    let media = [
        ("M1 (100, 5000)", 100.0, 5000.0),
        ("M1 (100, 5000), n = 1.4", 100.0, 5000.0),
        ("M2 (25, 4236)", 25.0, 4236.0),
        ("M2 with a lesion", 25.0, 4236.0),
        ("M2 with a dome", 25.0, 4236.0),
        ("M2 with a dome, n = 1.4", 25.0, 4236.0),
        ("M2 with a dome of 1280 facets, n = 1", 25.0, 4236.0),
        ("M2 with a dome of 81,920 facets, n = 1", 25.0, 4236.0),
        ("M2 with a dome of 1280 facets, n = 1.4", 25.0, 4236.0),
        ("M2 with a dome of 81,920 facets, n = 1.4", 25.0, 4236.0),
        ("M2 with a spheroid", 25.0, 4236.0),
        ("M2 with a spheroid, n = 1.4", 25.0, 4236.0),
        ("M3 (1, 20000)", 1.0, 20000.0),
    ];
    let only = std::env::args().nth(2).unwrap_or_default();
    let which = std::env::args().nth(3);
    for (name, a_rho, s_rho) in media.into_iter().filter(|medium| medium.0.contains(&only)) {
        let n = if name.ends_with("n = 1.4") { 1.4 } else { 1.0 };
        let medium =
            Material::medium(a_rho / 1000.0, s_rho / 1000.0, turbid_optics::PhaseFunction::henyey_greenstein(0.8), n);
        let lesion = Material { mu_a: 0.096, mu_s: 3.721, ..medium };
        let mut bodies = vec![Body { solid: Solid::Slab { bottom: -2000.0, top: 0.0 }, material: 1 }];
        if name.ends_with("lesion") {
            // A spheroid cut level with the surface by a void box.
            let spheroid = Solid::Ellipsoid { center: DVec3::ZERO, radii: DVec3::new(18.0, 18.0, 12.0) };
            let cut = Solid::Box { low: DVec3::new(-100.0, -100.0, 0.0), high: DVec3::new(100.0, 100.0, 30.0) };
            bodies.insert(0, Body { solid: spheroid, material: 2 });
            bodies.insert(0, Body { solid: cut, material: 0 });
        }
        if name.contains("spheroid") {
            // 40 x 40 x 80 mm, half embedded.
            let polyp = Solid::Ellipsoid { center: DVec3::ZERO, radii: DVec3::new(20.0, 20.0, 40.0) };
            bodies.insert(0, Body { solid: polyp, material: 2 });
        }
        if name.contains("dome") {
            // A sphere of 40 mm, half embedded.
            let facets = |levels| {
                let (vertices, triangles) = shapes::icosphere(20.0, DVec3::ZERO, levels);
                Solid::Mesh(Mesh::new(&vertices, &triangles).into())
            };
            let solid = if name.contains("81,920") {
                facets(6)
            } else if name.contains("1280") {
                facets(3)
            } else {
                Solid::Ellipsoid { center: DVec3::ZERO, radii: DVec3::splat(20.0) }
            };
            bodies.insert(0, Body { solid, material: 2 });
        }
        let world = World { bodies, materials: vec![Material::VOID, medium, lesion], textures: Vec::new() };
        for nee in
            [Nee::Point, Nee::Line].into_iter().filter(|nee| which.as_ref().is_none_or(|w| format!("{nee:?}") == **w))
        {
            let setting = Setting {
                world: &world,
                camera: &camera,
                light: &light,
                steady: &Steady::NONE,
                carriers: &carriers,
                projected_images: &ProjectedImages::NONE,
                key: [1, 2],
                channel: 0,
                nee,
                shared: None,
            };
            let mut walker = Walker::new(setting, named(&std::env::var("TURBID_SIMD").unwrap_or_default()));
            let mut moments = Moments::new(camera.pixels(), 3);
            let began = cpu_seconds();
            // As the stage walks them.
            let (pixels, batch) = (1024, 8);
            for first in (0..camera.pixels()).step_by(pixels) {
                for sample in (0..paths).step_by(batch) {
                    let samples = sample..paths.min(sample + batch as u32);
                    packet::walk(&mut walker, first..first + pixels, samples.clone());
                    for path in 0..pixels * samples.len() {
                        moments.add(first + path / samples.len(), walker.response(path));
                    }
                }
            }
            let seconds = cpu_seconds() - began;
            let flights = walker.take_flights() as f64;
            let total = camera.pixels() as f64 * f64::from(paths);
            // By the distance of a pixel from the middle, mm.
            let raised = name.contains("dome") || name.contains("spheroid");
            let regions: &[(&str, f64, f64)] = if raised {
                &[("dome", 0.0, 18.0), ("rim", 18.0, 26.0), ("surround", 26.0, 99.0)]
            } else {
                &[("all", 0.0, 99.0)]
            };
            for &(region, from, to) in regions {
                // Pooled over its pixels: mean variance over mean square.
                let (mut v_dc, mut m_dc, mut v_ac, mut m_ac, mut n) = (0.0, 0.0, 0.0, 0.0, 0.0);
                for pixel in 0..camera.pixels() {
                    let (x, y) = ((pixel % 64) as f64 - 31.5, (pixel / 64) as f64 - 31.5);
                    if !(from..to).contains(&x.hypot(y)) {
                        continue;
                    }
                    let m = |i| moments.mean(pixel, i, paths);
                    let c = |i, j| moments.covariance(pixel, i, j, paths) * f64::from(paths);
                    v_dc += c(0, 0);
                    m_dc += m(0);
                    // The mean phase: on a flat surface that of the carrier at the pixel; else as found.
                    let (sin, cos) = if raised {
                        let modulus = m(1).hypot(m(2)).max(f64::MIN_POSITIVE);
                        (m(2) / modulus, m(1) / modulus)
                    } else {
                        carriers[0].at(DVec3::new(x, 0.0, 0.0))
                    };
                    v_ac += cos * cos * c(1, 1) + 2.0 * sin * cos * c(1, 2) + sin * sin * c(2, 2);
                    m_ac += cos * m(1) + sin * m(2);
                    n += 1.0;
                }
                let (relative_variance_dc, relative_variance_ac) =
                    (v_dc / n / (m_dc / n).powi(2), v_ac / n / (m_ac / n).powi(2));
                // At the mean time of a path, whichever region.
                let seconds_to = |relative_variance: f64| n * relative_variance * 1e4 * seconds / total / 2.0;
                println!(
                    "{name}, {nee:?}, {region} ({n} px): {:.1}, {:.1}, {:.1}, {relative_variance_dc:.2}, {relative_variance_ac:.2}, {:.1}, {:.1}; means {:.5e} {:.5e}",
                    flights / total,
                    1e9 * seconds / flights,
                    1e-6 * flights / seconds,
                    seconds_to(relative_variance_dc),
                    seconds_to(relative_variance_ac),
                    m_dc / n,
                    m_ac / n,
                );
            }
        }
    }
}

/// Seconds that this thread has had a core, so that other work on the machine does not count (Linux; 0 elsewhere).
fn cpu_seconds() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    text.split(' ').next().and_then(|ns| ns.parse::<f64>().ok()).unwrap_or(0.0) * 1e-9
}
