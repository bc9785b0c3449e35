//! Paths that go to where the error is.

use serde_json::{Value, json};
use turbid_contract::ImageStack;
use turbid_contract::payload::{Scene, Shape};

use crate::setup::*;

/// Looking down a tube: from the bright rim to the dim middle the noise of a path grows many times.
fn tube(pixels: u32) -> Scene {
    let shape = Shape::Tube { inner_diameter: 20.0, outer_diameter: 60.0, center: [0.0; 2], top: 0.0, bottom: -150.0 };
    let (mut camera, mut projector) = rig(110.0, 0.0, 20.0, pixels, 20.0);
    (camera.position[2], projector.position[2]) = (110.0, 100.0);
    projector.position[1] = 0.5;
    scene(&[("m", medium(0.1, 5.0, 0.8))], vec![object(shape, "m", 0)], (camera, projector))
}

/// A ball half embedded in a slab: pixels beside it have control variates.
fn dome() -> Scene {
    let media = [("m", medium(0.05, 2.5, 0.8)), ("core", medium(0.2, 4.0, 0.8))];
    let ball = Shape::Sphere { diameter: 3.0, center: [0.3, 0.1, 0.0] };
    scene(&media, vec![object(FLOOR, "m", 0), object(ball, "core", 1)], rig(200.0, 20.0, 12.0, 12, 300.0))
}

fn frames(host: &MemoryHost, scene: &Scene, params: &Value) -> ImageStack {
    run_on(host, scene, params).unwrap().remove("frames").unwrap()
}

fn measure(host: &MemoryHost, name: &str) -> f64 {
    host.measures.lock().unwrap()[name]
}

/// A run that is continued, wherever it stopped, is a fresh one: on any number of threads, with control variates and without.
#[test]
fn continued_and_threaded_runs_give_the_same_bytes() {
    for (scene, method) in [(tube(12), "path"), (dome(), "auto")] {
        let params = |n: u32| json!({"f_x": [0, 0.1], "samples": n, "allocate": "adaptive", "method": method});
        let fresh = frames(&MemoryHost::new(4, &[], 1), &scene, &params(300));
        let host = MemoryHost::new(4, &[], 3);
        for n in [10, 48, 70, 128, 200, 256] {
            frames(&host, &scene, &params(n));
        }
        let kept: Vec<u64> = host.checkpoints.lock().unwrap().keys().copied().collect();
        assert_eq!(kept, [8, 48, 64, 128, 200, 256]);
        assert_eq!(frames(&host, &scene, &params(300)), fresh, "{method}");
        assert_eq!(frames(&host, &scene, &params(200)), frames(&MemoryHost::new(4, &[], 2), &scene, &params(200)));
    }
}

/// As long as all paths are even, they are those of an even run.
#[test]
fn up_to_the_first_test_paths_are_even() {
    let of = |allocate: &str| {
        let params = json!({"f_x": [0.1], "samples": 64, "method": "path", "allocate": allocate});
        frames(&MemoryHost::new(1, &[], 2), &tube(12), &params)
    };
    assert_eq!(of("adaptive"), of("even"));
}

/// At as many paths on average the worst pixels come out better where a sixth of the image needs six times the paths of the rest (fringes that
/// light blurs in a medium of long mean free paths), and what they exceed the median by is less than half of what it was. Not nothing: pixels at
/// the border are judged by both sides, and the stated errors themselves scatter.
#[test]
fn the_error_becomes_even() {
    let media = [("m", medium(0.05, 5.0, 0.8)), ("clear", medium(0.05, 1.5, 0.8))];
    let part = Shape::Box { size: [4.0, 40.0, 30.0], center: [10.0, 0.0, -15.0] };
    let objects = vec![object(FLOOR, "m", 0), object(part, "clear", 1)];
    let scene = scene(&media, objects, rig(300.0, 20.0, 24.0, 24, 200.0));
    let errors = |allocate: &str| {
        let host = MemoryHost::new(1, &[], 2);
        let params = json!({"f_x": [0.1], "samples": 512, "method": "path", "allocate": allocate});
        frames(&host, &scene, &params);
        [measure(&host, "error: m_ac per pixel"), measure(&host, "error: m_ac per pixel, 95th percentile")]
    };
    let (even, adaptive) = (errors("even"), errors("adaptive"));
    println!("median, 95th percentile: even {even:?}, adaptive {adaptive:?}");
    let excess = |of: [f64; 2]| of[1] / of[0] - 1.0;
    assert!(adaptive[1] < even[1] && excess(adaptive) < 0.5 * excess(even), "{adaptive:?}, {even:?}");
}

/// A target is met at 64 2^k paths on average, and continued runs stop where a fresh one does.
#[test]
fn error_target_stops_where_a_fresh_run_would() {
    let params = json!({"f_x": [0.05], "target_error": 0.1, "method": "path", "allocate": "adaptive"});
    let host = MemoryHost::new(2, &[], 2);
    let fresh = frames(&host, &tube(12), &params);
    let n = fresh.attributes["samples"].as_u64().unwrap();
    assert!(n >= 128 && n.is_power_of_two(), "{n}");
    assert!(measure(&host, "error: m_ac per pixel") <= 10.0);
    let long = MemoryHost::new(2, &[], 2);
    frames(&long, &tube(12), &json!({"f_x": [0.05], "samples": 2 * n, "method": "path", "allocate": "adaptive"}));
    assert_eq!(frames(&long, &tube(12), &params), fresh);
}

/// Means over 60 seeds of short runs, dim and skewed pixels among them, against a long even run. Some 130 pixels see something, and
/// their three phases share paths: the mean of the z scores is known to 0.09, their rms to 0.05. So a bias as large as 0.04 standard
/// errors of one run would be seen (a mean of 0.3).
#[test]
fn it_is_unbiased() {
    let scene = tube(12);
    let seeds = 60;
    let adaptive = json!({"f_x": [0.05], "samples": 256, "method": "path", "allocate": "adaptive"});
    let runs: Vec<ImageStack> = (0..seeds).map(|s| frames(&MemoryHost::new(s, &[], 2), &scene, &adaptive)).collect();
    let truth = json!({"f_x": [0.05], "samples": 16_384, "method": "path"});
    let truth = frames(&MemoryHost::new(1 << 20, &[], 2), &scene, &truth);
    let mut scores = Vec::new();
    for (i, layer) in truth.layers.iter().enumerate().filter(|(_, l)| l.info.name == "radiance") {
        for (at, &expected) in layer.data.indexed_iter() {
            let values: Vec<f64> = runs.iter().map(|r| f64::from(r.layers[i].data[at])).collect();
            let n = seeds as f64;
            let mean = values.iter().sum::<f64>() / n;
            let spread = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (n - 1.0) / n;
            let own = f64::from(truth.layers[i + 1].data[at]);
            if spread > 0.0 {
                scores.push((mean - f64::from(expected)) / (spread + own * own).sqrt());
            }
        }
    }
    let n = scores.len() as f64;
    let mean = scores.iter().sum::<f64>() / n;
    let rms = (scores.iter().map(|z| z * z).sum::<f64>() / n).sqrt();
    let worst = scores.iter().fold(0.0, |worst: f64, z| worst.max(z.abs()));
    println!("{n} scores: mean {mean:.3}, rms {rms:.3}, worst {worst:.2}");
    assert!(mean.abs() < 0.3 && (rms - 1.0).abs() < 0.15 && worst < 4.5, "{mean} {rms} {worst}");
}
