//! `mean_se`, the standard error of an image's mean: how often it holds the truth, in seven kinds of scenes.

use serde_json::{Value, json};
use turbid_contract::payload::Scene;

use crate::coverage::{scenes, tube};
use crate::peaked::half_space;
use crate::setup::*;

const SEEDS: u64 = 200;

/// Mean and `mean_se` of every frame, seed after seed.
fn means(scene: &Scene, params: &Value) -> Vec<Vec<(f64, f64)>> {
    let of = |seed: u64| {
        let frames = &run_on(&MemoryHost::new(seed, &[], 2), scene, params).unwrap()["frames"];
        let values = frames.layers.iter().filter(|l| l.info.name == "radiance");
        values.map(|l| (l.data.mapv(f64::from).mean().unwrap(), l.info.mean_se.expect("it is known"))).collect()
    };
    (0..SEEDS).map(of).collect()
}

/// Lambertian surfaces alone, which pass light on to each other.
fn opaque() -> Scene {
    use turbid_contract::payload::Shape;
    let block = Shape::Box { size: [4.0, 8.0, 3.0], center: [2.0, 0.0, 1.5] };
    let objects = vec![lambertian(FLOOR, 0.7), lambertian(block, 0.9)];
    let mut scene = scene(&[], objects, rig(500.0, 35.0, 16.0, 8, 140.0));
    scene.objects.get_mut("b").unwrap().priority = 1;
    scene
}

/// Deviations from the mean of all seeds, over the stated error and sqrt(1 - 1 / seeds), have the mean square 1 within 4 sqrt(2 / seeds), and two errors hold 95.4 % of
/// them, both from either side within 4 standard errors of a share of so many, and 2 % for means that are not normal. Where kurtoses are some hundreds, the mean square has its own
/// scatter: in a tube and under lobes of g = 0.95 it is another 0.1.
#[test]
fn errors_of_the_mean_hold_the_truth() {
    let path = |samples: u32| json!({"f_x": [0, 0.1], "samples": samples, "method": "path"});
    let [half, spheroid, block] = scenes(8).map(|(_, scene)| scene);
    let cases = [
        ("half-space, path", half.clone(), path(16)),
        ("half-space, fit", half, json!({"f_x": [0, 0.1], "samples": 16, "method": "fit"})),
        ("spheroid, with stand-ins", spheroid, json!({"f_x": [0, 0.1], "samples": 32})),
        ("white block on tissue", block, path(16)),
        ("opaque", opaque(), path(16)),
        ("tube", tube(8), path(64)),
        ("g = 0.95", half_space(0.95, 8), path(128)),
    ];
    let mut failed = Vec::new();
    for (name, scene, params) in cases {
        let found = means(&scene, &params);
        for frame in 0..found[0].len() {
            let n = SEEDS as f64;
            let mean = found.iter().map(|f| f[frame].0).sum::<f64>() / n;
            let z = |f: &Vec<(f64, f64)>| (f[frame].0 - mean) / f[frame].1 / (1.0 - 1.0 / n).sqrt();
            let square = found.iter().map(|f| z(f).powi(2)).sum::<f64>() / n;
            let within = found.iter().filter(|f| z(f).abs() <= 2.0).count() as f64 / n;
            println!("{name}, frame {frame}: mean square {square:.2}, within two {within:.3}");
            let rare = if matches!(name, "tube" | "g = 0.95") { 0.1 } else { 0.0 };
            let normal = (square - 1.0).abs() < rare + 4.0 * (2.0 / n).sqrt();
            if !normal || (within - 0.954).abs() > 0.02 + 4.0 * (0.954 * 0.046 / n).sqrt() {
                failed.push(format!("{name}, frame {frame}: {square} {within}"));
            }
        }
    }
    assert!(failed.is_empty(), "{failed:?}");
}
