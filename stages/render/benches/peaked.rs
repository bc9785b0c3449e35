//! What a path under a narrow peak of scattering brings, how often two standard errors hold the truth, and where errors are unknown:
//! `cargo bench -p turbid-render --bench peaked [-- g ..]`. A path at g = 0.995 makes 60 times the flights of one at 0.8: bring time.

use glam::{DVec2, DVec3};
use turbid_optics::solid::Solid;
use turbid_optics::view::View;
use turbid_render::camera::Camera;
use turbid_render::lamp::Steady;
use turbid_render::level::named;
use turbid_render::light::Light;
use turbid_render::packet;
use turbid_render::path::{Nee, Setting, Walker};
use turbid_render::projected_images::ProjectedImages;
use turbid_render::world::{Body, Material, World};

#[path = "../tests/render/peaked.rs"]
#[allow(dead_code, unused_imports, reason = "its tests are not run here")]
mod peaked;
#[path = "../tests/render/setup.rs"]
#[allow(dead_code, reason = "scenes and hosts that the tests share")]
mod setup;

/// Of so many paths each.
const PATHS: u32 = 1 << 17;

/// The same half-space by its paths: relative variance and kurtosis of M_DC, flights and us of a path.
fn paths(g: f64) -> [f64; 4] {
    let view = |x: f64, field: f64| {
        let position = DVec3::new(x, 0.0, 500.0);
        View::new(position, DVec3::ZERO, DVec3::Y, DVec2::splat(field)).expect("not along y")
    };
    let camera = Camera { view: view(0.0, 2.0), columns: 16, rows: 16 };
    let light = Light::new(view(35.0, 128.0), 1.0, false);
    let world = World {
        bodies: vec![Body { solid: Solid::Slab { bottom: -2000.0, top: 0.0 }, material: 1 }],
        materials: vec![
            Material::VOID,
            Material::medium(0.02, 1.0 / (1.0 - g), turbid_optics::PhaseFunction::henyey_greenstein(g), 1.0),
        ],
        textures: Vec::new(),
    };
    let setting = Setting {
        world: &world,
        camera: &camera,
        light: &light,
        steady: &Steady::NONE,
        carriers: &[],
        projected_images: &ProjectedImages::NONE,
        key: [7, 0],
        channel: 0,
        nee: Nee::Line,
        shared: None,
    };
    let mut walker = Walker::new(setting, named(""));
    let began = std::time::Instant::now();
    let mut seen = Vec::with_capacity(PATHS as usize);
    for sample in (0..PATHS / 256).step_by(32) {
        packet::walk(&mut walker, 0..256, sample..sample + 32);
        seen.extend((0..256 * 32).map(|path| walker.response(path)[0]));
    }
    let (n, us) = (seen.len() as f64, 1e6 * began.elapsed().as_secs_f64());
    let mean = seen.iter().sum::<f64>() / n;
    let moment = |k: i32| seen.iter().map(|x| (x - mean).powi(k)).sum::<f64>() / n;
    let (second, fourth) = (moment(2), moment(4));
    [second / (mean * mean), fourth / (second * second), walker.take_flights() as f64 / n, us / n]
}

fn main() {
    let asked: Vec<f64> = std::env::args().skip(1).filter_map(|g| g.parse().ok()).collect();
    let lobes = if asked.is_empty() { vec![0.8, 0.9, 0.95, 0.98, 0.995] } else { asked };
    println!("g: relative variance, kurtosis, flights and us of a path (wall time, one thread)");
    for &g in &lobes {
        println!("{g}: {}", paths(g).map(|x| format!("{x:.3}")).join(", "));
    }
    println!("g, paths, images of 16 x 16: within 2 se of the others (%), unknown (%), relative error of the mean (%)");
    for g in lobes {
        for (samples, images) in [(64, 40), (256, 16), (1024, 8)] {
            // A path at g = 0.995 makes 12 times the flights of one at 0.98.
            let images = if g > 0.99 { images / 4 } else { images };
            let found = peaked::found(&peaked::half_space(g, 16), samples, images);
            println!(
                "{g}, {samples}, {images}: {:.1}, {:.1}, {:.1}",
                100.0 * found.within,
                100.0 * found.unknown,
                100.0 * found.mean_se / found.mean
            );
        }
    }
}
