//! Flights per second of one core, bare and with next-event estimation, by vector width; and what odd scenes leave of it.
//!
//! `cargo bench -p turbid-render --bench kernel [-- v4] [-- mesh]`: of some widths only, and of rows with a word in their name. CPU time, best of three; a flight ends at a collision, at a boundary or by absorption.
//! Beside half-spaces the algorithm of MCML in C (`photons.c`, where there is a C compiler `cc`), bare too.

use std::process::Command;

use glam::{DVec2, DVec3};
use turbid_optics::solid::{Mesh, Solid};
use turbid_optics::view::View;
use turbid_render::camera::Camera;
use turbid_render::lamp::Steady;
use turbid_render::level::named;
use turbid_render::light::{Carrier, Light};
use turbid_render::packet;
use turbid_render::path::{Nee, Setting, Walker};
use turbid_render::projected_images::ProjectedImages;
use turbid_render::world::{Body, Material, World};

#[allow(dead_code, reason = "not all of them are needed here")]
#[path = "../../optics/tests/shapes/mod.rs"]
mod shapes;

const LEVELS: [&str; 3] = ["baseline", "v3", "v4"];

fn main() {
    println!("M flights/s on one core; flights per path");
    println!("{:46} {:>9} {:>9} {:>9}", "", "baseline", "v3", "v4");
    let (m1, m2, m3) = (medium(0.1, 5.0), medium(0.025, 4.236), medium(0.001, 20.0));
    for (name, tissue) in [("(100, 5000)", m1), ("(25, 4236)", m2), ("(1, 20000)", m3)] {
        row(&format!("half-space {name}, bare"), &half_space(tissue), false);
        row(&format!("half-space {name}"), &half_space(tissue), true);
        row_in_c(&format!("half-space {name}, MCML in C"), &tissue);
    }
    let tumour = Material { mu_a: 0.096, mu_s: 3.721, ..m2 };
    let ball = |radii: [f64; 3]| Solid::Ellipsoid { center: DVec3::ZERO, radii: radii.into() };
    let cut = Solid::Box { low: DVec3::new(-100.0, -100.0, 0.0), high: DVec3::new(100.0, 100.0, 30.0) };
    let floor = || Solid::Slab { bottom: -2000.0, top: 0.0 };
    row("(25, 4236), half-embedded spheroid of 40 mm", &world(&[(ball([20.0; 3]), tumour), (floor(), m2)]), true);
    let lesion = [(cut, Material::VOID), (ball([18.0, 18.0, 12.0]), tumour), (floor(), m2)];
    row("(25, 4236), spheroid cut level", &world(&lesion), true);
    let layers = [(Solid::Slab { bottom: -1.0, top: 0.0 }, tumour), (Solid::Slab { bottom: -2000.0, top: -1.0 }, m2)];
    row("(25, 4236) under 1 mm of another", &world(&layers), true);
    let vessel = |k: usize| Solid::Ellipsoid {
        center: DVec3::new(8.0 * (k % 4) as f64 - 12.0, 8.0 * (k / 4) as f64 - 12.0, -3.0),
        radii: DVec3::splat(2.0),
    };
    for count in [3, 15, 16] {
        let balls = (0..count).map(|k| (vessel(k), tumour)).chain([(floor(), m2)]).collect::<Vec<_>>();
        row(&format!("(25, 4236), {count} balls of 4 mm in it"), &world(&balls), true);
    }
    let tube = Solid::tube(40.0, 50.0, DVec2::ZERO, -100.0, 0.0);
    row("(25, 4236), tube of 40 mm bore, 5 mm wall", &world(&[(tube, m2)]), true);
    let white = Solid::Box { low: DVec3::new(-5.0, -5.0, 0.0), high: DVec3::new(5.0, 5.0, 5.0) };
    row("(25, 4236), white block on it", &world(&[(white, Material::lambertian(0.8)), (floor(), m2)]), true);
    let (vertices, triangles) = shapes::icosphere(20.0, DVec3::ZERO, 6);
    let facets = || Solid::Mesh(Mesh::new(&vertices, &triangles).into());
    row("(25, 4236), sphere of 40 mm, bare", &world(&[(ball([20.0; 3]), m2)]), false);
    row("(25, 4236), sphere of 40 mm", &world(&[(ball([20.0; 3]), m2)]), true);
    row("same as a mesh of 81,920 triangles, bare", &world(&[(facets(), m2)]), false);
    row("same as a mesh of 81,920 triangles", &world(&[(facets(), m2)]), true);
    row("(25, 4236), that mesh half embedded", &world(&[(facets(), tumour), (floor(), m2)]), true);
    row("(1, 20000), mesh of 81,920 triangles", &world(&[(facets(), m3)]), true);
}

fn medium(mu_a: f64, mu_s: f64) -> Material {
    Material::medium(mu_a, mu_s, turbid_optics::PhaseFunction::henyey_greenstein(0.8), 1.0)
}

fn half_space(tissue: Material) -> World {
    world(&[(Solid::Slab { bottom: -2000.0, top: 0.0 }, tissue)])
}

/// Highest priority first.
fn world(parts: &[(Solid, Material)]) -> World {
    let mut world = World { bodies: Vec::new(), materials: vec![Material::VOID], textures: Vec::new() };
    for (solid, material) in parts.iter().cloned() {
        let known = world.materials.iter().position(|m| *m == material);
        world.bodies.push(Body { solid, material: known.unwrap_or(world.materials.len()) });
        if known.is_none() {
            world.materials.push(material);
        }
    }
    world
}

/// Whether a row is asked for.
fn is_asked(name: &str) -> bool {
    let words: Vec<String> =
        std::env::args().skip(1).filter(|a| !a.starts_with("--") && !LEVELS.contains(&&a[..])).collect();
    words.is_empty() || words.iter().any(|word| name.contains(word))
}

/// Flights of photons from a narrow beam, by `photons.c`.
fn row_in_c(name: &str, tissue: &Material) {
    if !is_asked(name) {
        return;
    }
    let program = std::env::temp_dir().join(format!("turbid-photons-{}", std::process::id()));
    let source = concat!(env!("CARGO_MANIFEST_DIR"), "/benches/photons.c");
    let made = Command::new("cc").args(["-O3", "-march=native", "-o"]).arg(&program).args([source, "-lm"]).status();
    if !made.is_ok_and(|status| status.success()) {
        println!("{name:46} there is no C compiler `cc`");
        return;
    }
    let words = [tissue.mu_a, tissue.mu_s, tissue.phase.g(), 20_000.0].map(|x| x.to_string());
    let (mut best, mut per_photon) = (0.0, 0.0);
    for _ in 0..3 {
        let output = Command::new(&program).args(&words).output().expect("it was just made").stdout;
        let text = String::from_utf8_lossy(&output);
        let numbers: Vec<f64> = text.split_whitespace().map(|word| word.parse().expect("a number")).collect();
        best = f64::max(best, 1e-6 * numbers[0] / numbers[1]);
        per_photon = numbers[0] / 20_000.0;
    }
    std::fs::remove_file(&program).expect("it was just made");
    println!("{name:46} {best:9.1}   {per_photon:.1}");
}

fn row(name: &str, world: &World, lit: bool) {
    if !is_asked(name) {
        return;
    }
    let view = |position: [f64; 3], field: f64| {
        View::new(position.into(), DVec3::ZERO, DVec3::Y, DVec2::splat(field)).expect("not along y")
    };
    let camera = Camera { view: view([0.0, 0.0, 500.0], 64.0), columns: 64, rows: 64 };
    let light = if lit { Light::new(view([35.0, 0.0, 500.0], 256.0), 5.0, false) } else { Light::none() };
    let carriers = [Carrier::new(0.1, 0.0)];
    print!("{name:46}");
    let samples = if world.materials.iter().any(|m| m.mu_s > 10.0) { 8 } else { 32 };
    let mut per_path = 0.0;
    let asked: Vec<String> = std::env::args().collect();
    let only = |level: &&str| asked.iter().any(|a| a == level) || !LEVELS.iter().any(|l| asked.iter().any(|a| a == l));
    for level in LEVELS.iter().filter(|level| only(level)) {
        let setting = Setting {
            world,
            camera: &camera,
            light: &light,
            steady: &Steady::NONE,
            carriers: &carriers,
            projected_images: &ProjectedImages::NONE,
            key: [1, 2],
            channel: 0,
            nee: Nee::Line,
            shared: None,
        };
        let mut walker = Walker::new(setting, named(level));
        let mut best = 0.0;
        for _ in 0..3 {
            let began = cpu_seconds();
            for first in (0..4096).step_by(1024) {
                packet::walk(&mut walker, first..first + 1024, 0..samples);
            }
            let flights = walker.take_flights() as f64;
            best = f64::max(best, 1e-6 * flights / (cpu_seconds() - began));
            per_path = flights / (4096.0 * f64::from(samples));
        }
        print!(" {best:9.1}");
    }
    println!("   {per_path:.1}");
}

/// Seconds that this thread has had a core, so that other work on the machine does not count (Linux; 0 elsewhere).
fn cpu_seconds() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    text.split(' ').next().and_then(|ns| ns.parse::<f64>().ok()).unwrap_or(0.0) * 1e-9
}
