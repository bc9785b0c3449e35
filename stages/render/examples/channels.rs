//! What sharing paths saves: `cargo run --release -p turbid-render --example channels [paths per pixel]`.
//!
//! Channels that differ in absorption, by one walk and by one each: CPU seconds, and the variance per path of M_DC and M_AC over mean^2
//! (relative variance). The gain at equal error is (sum of seconds x relative variance apart) / (seconds together x the largest relative variance): what images of the same error cost. Camera 500 mm
//! straight above, projector at (35, 0, 500), f_x = 0.1, 64 x 64 pixels, g = 0.8, n = 1, one core.

use glam::{DVec2, DVec3};
use turbid_optics::solid::Solid;
use turbid_optics::view::View;
use turbid_render::camera::Camera;
use turbid_render::channels::{Channels, Group};
use turbid_render::lamp::Steady;
use turbid_render::level::named;
use turbid_render::light::{Carrier, Light};
use turbid_render::moments::Moments;
use turbid_render::packet;
use turbid_render::path::{Nee, Setting, Walker};
use turbid_render::projected_images::ProjectedImages;
use turbid_render::world::{Body, Material, World};

/// Channels that lanes hold.
const MOST: usize = 16;

fn main() {
    let paths: u32 = std::env::args().nth(1).map_or(32, |n| n.parse().expect("a number of paths"));
    let view = |position: [f64; 3], field: f64| {
        View::new(position.into(), DVec3::ZERO, DVec3::Y, DVec2::splat(field)).expect("not along y")
    };
    let camera = Camera { view: view([0.0, 0.0, 500.0], 64.0), columns: 64, rows: 64 };
    let lights = vec![Light::new(view([35.0, 0.0, 500.0], 256.0), 5.0, false); MOST];
    let steady = vec![Steady::NONE; MOST];
    let carriers = [Carrier::new(0.1, 0.0)];
    let slab = || Body { solid: Solid::Slab { bottom: -2000.0, top: 0.0 }, material: 1 };
    let ball = || Body { solid: Solid::Ellipsoid { center: DVec3::ZERO, radii: DVec3::splat(20.0) }, material: 2 };
    // mu_s, mu_a of the slab in all channels, of the dome where there is one.
    let mut scenes = vec![
        ("half-space, mu_a .01 .025 .06".to_owned(), 4.236, vec![0.01, 0.025, 0.06], None),
        ("half-space, mu_a .025 .1 .4".to_owned(), 4.236, vec![0.025, 0.1, 0.4], None),
        ("half-space, mu_a .001 .01 .1".to_owned(), 20.0, vec![0.001, 0.01, 0.1], None),
        ("dome, mu_a .025 .05 .1 and .1 .05 .2".to_owned(), 4.236, vec![0.025, 0.05, 0.1], Some([0.1, 0.05, 0.2])),
    ];
    for count in [2, 4, 8, MOST] {
        let mu_a = (0..count).map(|i| 0.02 * 4.0_f64.powf(i as f64 / (count - 1) as f64)).collect();
        scenes.push((format!("half-space, {count} of mu_a .02 to .08"), 4.236, mu_a, None));
    }
    for (name, mu_s, slab_mu_a, dome_mu_a) in scenes {
        let count = slab_mu_a.len();
        let world = |c: usize| {
            let medium = |mu_a| Material::medium(mu_a, mu_s, turbid_optics::PhaseFunction::henyey_greenstein(0.8), 1.0);
            let mut materials = vec![Material::VOID, medium(slab_mu_a[c])];
            materials.extend(dome_mu_a.map(|mu_a: [f64; 3]| medium(mu_a[c])));
            let bodies = if dome_mu_a.is_some() { vec![ball(), slab()] } else { vec![slab()] };
            World { bodies, materials, textures: Vec::new() }
        };
        let worlds: Vec<World> = (0..count).map(world).collect();
        let all = Channels { worlds: &worlds, lights: &lights[..count], steady: &steady[..count] };
        let run = |group: &Group| {
            let setting = Setting {
                world: &group.world,
                camera: &camera,
                light: &lights[0],
                steady: &steady[0],
                carriers: &carriers,
                projected_images: &ProjectedImages::NONE,
                key: [1, 2],
                channel: 0,
                nee: Nee::Line,
                shared: group.shared.as_ref(),
            };
            let mut walker = Walker::new(setting, named(&std::env::var("TURBID_SIMD").unwrap_or_default()));
            let mut moments = vec![Moments::new(camera.pixels(), 3); group.channels.len()];
            let (began, pixels, batch) = (cpu_seconds(), 1024, 8);
            for first in (0..camera.pixels()).step_by(pixels) {
                for sample in (0..paths).step_by(batch) {
                    let samples = sample..paths.min(sample + batch as u32);
                    packet::walk(&mut walker, first..first + pixels, samples.clone());
                    for path in 0..pixels * samples.len() {
                        for (c, moments) in moments.iter_mut().enumerate() {
                            moments.add(first + path / samples.len(), walker.response_in(path, c));
                        }
                    }
                }
            }
            let relative_variance =
                moments.iter().map(|m| relative_variance(m, &camera, &carriers[0], paths)).collect::<Vec<_>>();
            (cpu_seconds() - began, relative_variance, walker.take_flights() as f64)
        };
        let (together, shared, flights) = run(&Group::of(all, (0..count).collect()));
        let apart: Vec<_> = (0..count).map(|c| run(&Group::of(all, vec![c]))).collect();
        let (seconds, flown) = apart.iter().fold((0.0, 0.0), |sum, a| (sum.0 + a.0, sum.1 + a.2));
        println!(
            "{name}: together {together:.2} s at {:.0} M flights/s, apart {seconds:.2} s at {:.0}",
            1e-6 * flights / together,
            1e-6 * flown / seconds
        );
        for (what, of) in [("M_DC", 0), ("M_AC", 1)] {
            let own: Vec<f64> = apart.iter().map(|a| a.1[0][of]).collect();
            let ours: Vec<f64> = shared.iter().map(|relative_variance| relative_variance[of]).collect();
            let cost: f64 = apart.iter().zip(&own).map(|(a, relative_variance)| a.0 * relative_variance).sum();
            let worst = ours.iter().copied().fold(0.0, f64::max);
            println!(
                "  {what}: rv together {ours:.2?}, apart {own:.2?}; gain at equal error {:.2}",
                cost / (together * worst)
            );
        }
    }
}

/// Of M_DC, and of M_AC along the carrier's phase at each pixel: mean variance per path over mean^2.
fn relative_variance(moments: &Moments, camera: &Camera, carrier: &Carrier, paths: u32) -> [f64; 2] {
    let mut sums = [[0.0; 2]; 2];
    for pixel in 0..camera.pixels() {
        let x = (pixel % 64) as f64 - 31.5;
        let (sin, cos) = carrier.at(DVec3::new(x, 0.0, 0.0));
        let m = |i| moments.mean(pixel, i, paths);
        let c = |i, j| moments.covariance(pixel, i, j, paths) * f64::from(paths);
        sums[0] = [sums[0][0] + c(0, 0), sums[0][1] + m(0)];
        sums[1][0] += cos * cos * c(1, 1) + 2.0 * sin * cos * c(1, 2) + sin * sin * c(2, 2);
        sums[1][1] += cos * m(1) + sin * m(2);
    }
    let n = camera.pixels() as f64;
    sums.map(|[variance, mean]| variance / n / (mean / n).powi(2))
}

/// Seconds that this thread has had a core, so that other work on the machine does not count (Linux; 0 elsewhere).
fn cpu_seconds() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    text.split(' ').next().and_then(|ns| ns.parse::<f64>().ok()).unwrap_or(0.0) * 1e-9
}
