//! Error against run time of fitted images: `cargo run --release -p turbid-render --example fit [seeds]`.
//!
//! Camera 500 mm straight above, projector at (35, 0, 500), field 64 mm, 64 x 64 pixels, lit 256 mm, f_x = 0.1, 3 phases, slab of
//! 2 m, g = 0.8, n = 1, one thread. Errors of M_AC against a fit of 4096 paths per pixel.

use std::collections::BTreeMap;

use serde_json::{Value, json};
use turbid_contract::kit::Inputs;
use turbid_contract::payload::{Camera, Medium, Object, Profile, Projection, Projector, Scene, Shape, Surface};
use turbid_contract::{Artifact, Ctx, ImageStack, LayerKind, MemoryHost, StageRow};
use turbid_render::RenderStage;

fn scene(a_rho: f64, s_rho: f64) -> Scene {
    let medium = Medium {
        mu_a: vec![a_rho / 1000.0],
        mu_s: vec![s_rho / 1000.0],
        phase: turbid_contract::payload::PhaseFunction::HenyeyGreenstein(0.8),
        n: 1.0,
    };
    let block = Object {
        shape: Shape::Slab { top: 0.0, bottom: -2000.0 },
        medium: Some("m".to_owned()),
        priority: 0,
        surface: Surface::Smooth,
    };
    let camera = Camera {
        position: [0.0, 0.0, 500.0],
        look_at: [0.0; 3],
        up: [0.0, 1.0, 0.0],
        field: [64.0; 2],
        pixels: [64; 2],
        specular: None,
        projection: Projection::Pinhole,
        distortion: None,
        aperture: None,
    };
    let projector = Projector {
        position: [35.0, 0.0, 500.0],
        look_at: [0.0; 3],
        up: [0.0, 1.0, 0.0],
        field: [256.0; 2],
        power: vec![5.0],
        profile: Profile::UniformIntensity,
        pixels: None,
        distortion: None,
    };
    Scene {
        wavelengths_nm: Vec::new(),
        media: BTreeMap::from([("m".to_owned(), medium)]),
        objects: BTreeMap::from([("block".to_owned(), block)]),
        camera: Some(camera),
        projector: Some(projector),
        lights: BTreeMap::new(),
        detectors: BTreeMap::new(),
    }
}

/// M_AC of every pixel, the host with its measures, and CPU seconds.
fn render(scene: &Scene, stop: Value, seed: u64) -> (Vec<f64>, BTreeMap<String, f64>, f64) {
    let host = MemoryHost { seed, ..MemoryHost::default() };
    let mut params = json!({"f_x": [0.1], "phases": 3, "method": "auto"});
    params.as_object_mut().expect("an object").extend(stop.as_object().expect("an object").clone());
    let began = cpu_seconds();
    let ports =
        StageRow::of::<RenderStage>().run(&params, &Inputs::none().with("scene", scene.clone()), Ctx::new(&host));
    let seconds = cpu_seconds() - began;
    let Some((_, Artifact::Images(frames))) = ports.expect("it renders").into_iter().next() else {
        panic!("frames come first")
    };
    (amplitude(&frames), host.measures.into_inner().expect("no holder panics"), seconds)
}

fn amplitude(frames: &ImageStack) -> Vec<f64> {
    let shots: Vec<_> = frames.layers.iter().filter(|l| l.info.kind == LayerKind::Value).map(|l| l.pixels()).collect();
    let pixel = |i: usize| {
        let [a, b, c] = [0, 1, 2].map(|k| f64::from(shots[k][i]));
        let (x, y, z) = (a - b, b - c, c - a);
        2f64.sqrt() / 3.0 * (x * x + y * y + z * z).sqrt()
    };
    (0..shots[0].len()).map(pixel).collect()
}

fn main() {
    let seeds: u64 = std::env::args().nth(1).map_or(20, |n| n.parse().expect("a number of seeds"));
    println!(
        "medium, target %: paths/pixel, CPU s, order; error % of M_AC: claimed median, rms over pixels, corners, mean"
    );
    for (a_rho, s_rho) in [(100.0, 5000.0), (25.0, 4236.0), (1.0, 20000.0)] {
        let scene = scene(a_rho, s_rho);
        let (truth, _, _) = render(&scene, json!({"samples": 4096}), 999);
        for target in [0.01, 0.004] {
            let (mut all, mut corners, mut mean, mut seconds, mut claimed) = (0.0, 0.0, 0.0, 0.0, 0.0);
            let mut measures = BTreeMap::new();
            for seed in 0..seeds {
                let (m_ac, measured, s) = render(&scene, json!({"target_error": target}), seed);
                let off = |i: usize| m_ac[i] / truth[i] - 1.0;
                all += (0..4096).map(|i| off(i).powi(2)).sum::<f64>() / 4096.0;
                corners += [0, 63, 4032, 4095].map(|i| off(i).powi(2)).iter().sum::<f64>() / 4.0;
                mean += (0..4096).map(off).sum::<f64>() / 4096.0;
                seconds += s;
                claimed += measured["error: m_ac per pixel"];
                measures = measured;
            }
            let n = seeds as f64;
            println!(
                "({a_rho}, {s_rho}), {}: {}, {:.3}, {}; {:.2}, {:.2}, {:.2}, {:+.3}",
                100.0 * target,
                measures["samples"],
                seconds / n,
                measures["order of the fit"],
                claimed / n,
                100.0 * (all / n).sqrt(),
                100.0 * (corners / n).sqrt(),
                100.0 * mean / n,
            );
        }
    }
}

/// Seconds that this thread has had a core, so that other work on the machine does not count (Linux; 0 elsewhere).
fn cpu_seconds() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    text.split(' ').next().and_then(|ns| ns.parse::<f64>().ok()).unwrap_or(0.0) * 1e-9
}
