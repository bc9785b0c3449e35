//! What the stage promises: continuation, threads, stopping, errors that can be trusted, mistakes that are named.

use std::sync::Mutex;

use serde_json::{Value, json};
use turbid_contract::payload::{Lamp, Medium, Payload, Scene, Shape, Surface};
use turbid_contract::{Artifact, ImageStack, Known, LayerKind, Problem, Problems, StageRow};
use turbid_render::RenderStage;

use crate::setup::*;

/// A ball on a slab, in two channels if asked for.
fn ball_on_slab(pixels: u32) -> Scene {
    let media = [("m", medium(0.1, 4.0, 0.8)), ("core", medium(0.5, 4.0, 0.8))];
    let objects =
        vec![object(FLOOR, "m", 0), object(Shape::Sphere { diameter: 6.0, center: [0.0, 0.0, -1.0] }, "core", 1)];
    scene(&media, objects, rig(200.0, 20.0, 16.0, pixels, 60.0))
}

fn everything(host: &MemoryHost, params: &Value) -> Vec<(&'static str, ImageStack)> {
    run_on(host, &ball_on_slab(20), params).unwrap().into_iter().collect()
}

const ALL: [&str; 3] = ["covariance", "truth", "white"];

/// A run continued from 10, 16, 50 or 64 samples, on any number of threads and in any order of tiles, gives the bytes of a
/// fresh one; also where neither count is a multiple of the batch.
#[test]
fn continued_and_threaded_runs_give_the_same_bytes() {
    let params = |n: u32| json!({"f_x": [0, 0.1], "samples": n});
    let fresh = everything(&MemoryHost::new(4, &ALL, 1), &params(99));
    assert_eq!(everything(&MemoryHost::new(4, &ALL, 3), &params(99)), fresh);
    let host = MemoryHost::new(4, &ALL, 2);
    for n in [10, 16, 50, 64] {
        everything(&host, &params(n));
    }
    let kept: Vec<u64> = host.checkpoints.lock().unwrap().keys().copied().collect();
    assert_eq!(kept, [8, 16, 48, 64]);
    assert_eq!(everything(&host, &params(99)), fresh);
    // A shorter run after a longer one, and another seed.
    assert_eq!(everything(&host, &params(50)), everything(&MemoryHost::new(4, &ALL, 1), &params(50)));
    assert_ne!(everything(&MemoryHost::new(5, &ALL, 1), &params(99)), fresh);
}

/// What is wanted beside the frames does not change them; damaged checkpoints are passed over with a warning.
#[test]
fn ports_do_not_depend_on_each_other() {
    let params = json!({"f_x": [0.1], "samples": 16});
    let all = everything(&MemoryHost::new(1, &ALL, 2), &params);
    let alone = everything(&MemoryHost::new(1, &[], 2), &params);
    assert_eq!(alone.len(), 1);
    assert!(all.contains(&alone[0]));
    let host = MemoryHost::new(1, &ALL, 2);
    host.checkpoints.lock().unwrap().insert(8, vec![1, 2, 3]);
    assert_eq!(everything(&host, &params), all);
    assert_eq!(host.warnings.lock().unwrap().len(), 1);
}

fn samples_of(ports: &[(&'static str, ImageStack)]) -> u64 {
    ports.iter().find(|p| p.0 == "frames").unwrap().1.attributes["samples"].as_u64().unwrap()
}

/// An error target stops at 64 2^k samples, where the error is below it and one test earlier was not; a run that could
/// continue from far beyond stops at the same place with the same bytes.
#[test]
fn error_target_stops_where_a_fresh_run_would() {
    let host = MemoryHost::new(2, &[], 2);
    let target = 0.03;
    let params = json!({"f_x": [0.1], "target_error": target});
    let fresh = everything(&host, &params);
    let n = samples_of(&fresh);
    assert!(n >= 128 && n.is_power_of_two(), "{n}");
    assert!(host.measures.lock().unwrap()["error: m_ac per pixel"] <= 100.0 * target);
    let before = MemoryHost::new(2, &[], 2);
    everything(&before, &json!({"f_x": [0.1], "samples": n / 2}));
    assert!(before.measures.lock().unwrap()["error: m_ac per pixel"] > 100.0 * target);
    let long = MemoryHost::new(2, &[], 2);
    everything(&long, &json!({"f_x": [0.1], "samples": 2 * n}));
    assert_eq!(everything(&long, &params), fresh);
    let capped = everything(&MemoryHost::new(2, &[], 2), &json!({"f_x": [0.1], "target_error": 1e-6, "samples": 70}));
    assert_eq!(samples_of(&capped), 70);
}

/// A run that is told to stop keeps what it has, says how many samples that is, and a run of that many has its bytes.
#[test]
fn time_limit_is_a_sample_count_in_disguise() {
    let mut host = MemoryHost::new(3, &[], 2);
    host.patience = Mutex::new(Some(5));
    let stopped = everything(&host, &json!({"f_x": [0.1], "samples": 100_000, "max_seconds": 1}));
    let n = samples_of(&stopped);
    assert!((8..100_000).contains(&n), "{n}");
    assert_eq!(host.measures.lock().unwrap()["samples"], n as f64);
    assert_eq!(everything(&MemoryHost::new(3, &[], 1), &json!({"f_x": [0.1], "samples": n})), stopped);
}

/// The standard errors of all layers, and of their means, are the spread over seeds, those of pixels wider by 5 / 64 (so that intervals of
/// 64 paths hold the truth as often as they say): pooled over pixels and layers, 40 seeds of 400 pixels fix the ratio of
/// variances to 2 % (layers share paths), that of the means over 7 layers to 25 %.
#[test]
fn standard_errors_are_the_spread_over_seeds() {
    let params = json!({"f_x": [0, 0.1], "samples": 64, "method": "path"});
    let seeds = 40;
    let runs: Vec<ImageStack> =
        (0..seeds).map(|s| everything(&MemoryHost::new(100 + s, &[], 2), &params).remove(0).1).collect();
    let n = seeds as f64;
    let (mut spread, mut claimed, mut mean_spread, mut mean_claimed) = (0.0, 0.0, 0.0, 0.0);
    for (i, layer) in runs[0].layers.iter().enumerate().filter(|(_, l)| l.info.kind == LayerKind::Value) {
        for at in layer.data.indexed_iter().map(|(at, _)| at) {
            let values: Vec<f64> = runs.iter().map(|r| f64::from(r.layers[i].data[at])).collect();
            let mean = values.iter().sum::<f64>() / n;
            spread += values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
            claimed += runs.iter().map(|r| f64::from(r.layers[i + 1].data[at]).powi(2)).sum::<f64>() / n;
        }
        let means: Vec<f64> = runs.iter().map(|r| r.layers[i].data.mapv(f64::from).mean().unwrap()).collect();
        let mean = means.iter().sum::<f64>() / n;
        mean_spread += means.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
        mean_claimed += runs.iter().map(|r| r.layers[i].info.mean_se.unwrap().powi(2)).sum::<f64>() / n;
    }
    let (ratio, mean_ratio) = ((spread / claimed).sqrt(), (mean_spread / mean_claimed).sqrt());
    let expected = 1.0 / (1.0 + 5.0 / 64.0);
    assert!((ratio - expected).abs() < 0.06, "spread / standard error = {ratio}");
    assert!((mean_ratio - 1.0).abs() < 0.4, "the same of the means = {mean_ratio}");
}

/// A box cut into two boxes of one medium is one box: the same paths, but for rounding at the cut.
#[test]
fn a_cut_through_one_medium_is_not_there() {
    let m = || medium(0.1, 5.0, 0.8);
    let whole = Shape::Box { size: [20.0, 20.0, 10.0], center: [0.0, 0.0, -5.0] };
    let half = |x: f64| Shape::Box { size: [10.0, 20.0, 10.0], center: [x, 0.0, -5.0] };
    let view = || rig(100.0, 10.0, 12.0, 6, 40.0);
    let one = scene(&[("m", m())], vec![object(whole, "m", 0)], view());
    let two =
        scene(&[("m", m()), ("twin", m())], vec![object(half(-5.0), "m", 0), object(half(5.0), "twin", 0)], view());
    let params = json!({"f_x": [0.1], "samples": 64});
    let [one, two] = [one, two].map(|s| run(&s, &params, 9));
    for (a, b) in one["frames"].layers.iter().zip(&two["frames"].layers) {
        for (x, y) in a.data.iter().zip(&b.data) {
            assert!((x - y).abs() <= 1e-5 * x.abs(), "{:?}: {x} {y}", a.info);
        }
    }
}

/// Each channel is the scene with that channel's coefficients, and where one absorbs least, its paths are those that it has alone (`auto`
/// takes control variates for all of them or none); a channel's layers carry its wavelength.
#[test]
fn channels_are_scenes_of_their_own() {
    let mut s = ball_on_slab(8);
    s.wavelengths_nm = vec![530.0, 635.0];
    for m in s.media.values_mut() {
        m.mu_a = vec![m.mu_a[0], 3.0 * m.mu_a[0]];
        m.mu_s = vec![m.mu_s[0]; 2];
    }
    s.projector.as_mut().unwrap().power = vec![5.0, 2.5];
    let both = run(&s, &json!({"f_x": [0], "samples": 64, "method": "path"}), 1);
    let alone = run(&ball_on_slab(8), &json!({"f_x": [0], "samples": 64, "method": "path"}), 1);
    let of = |w: f64| both["frames"].layers.iter().find(|l| l.info.wavelength_nm == Some(w)).unwrap();
    assert_eq!(of(530.0).data, alone["frames"].layers[0].data);
    let dim = of(635.0).data.sum();
    assert!(dim < 0.8 * 0.5 * of(530.0).data.sum());
    // Powers of two scale every bit.
    s.projector.as_mut().unwrap().power = vec![5.0, 5.0];
    let bright = &run(&s, &json!({"f_x": [0], "samples": 64, "method": "path"}), 1)["frames"];
    let bright = bright.layers.iter().find(|l| l.info.wavelength_nm == Some(635.0)).unwrap();
    assert_eq!(bright.data, of(635.0).data.mapv(|x| 2.0 * x));
    assert_eq!(both["covariance"].attributes["quantities"].as_array().unwrap().len(), 2);
}

/// Truth at pixel centres: a pixel in the middle of the ball, one on the slab, one beside everything.
#[test]
fn truth_is_what_stands_at_the_pixel_centres() {
    let mut s = ball_on_slab(33);
    let slab = Shape::Slab { top: 0.0, bottom: -2000.0 };
    assert_eq!(s.objects["a"].shape, slab);
    s.objects.get_mut("a").unwrap().shape = Shape::Box { size: [12.0, 12.0, 10.0], center: [0.0, 0.0, -5.0] };
    let truth = &run(&s, &json!({"f_x": [0], "samples": 2}), 1)["truth"];
    let at = |name: &str, row: usize, column: usize| f64::from(truth.find(name, None).unwrap().data[(row, column)]);
    let expect = |place: (usize, usize), expected: [f64; 8]| {
        let names = ["mu_a", "mu_s_prime", "height", "depth", "normal_z", "object", "mask", "normal_x"];
        for (name, expected) in names.into_iter().zip(expected) {
            let value = at(name, place.0, place.1);
            assert!(
                (value - expected).abs() < 1e-5 * (1.0 + expected.abs()),
                "{name} at {place:?}: {value}, {expected}"
            );
        }
    };
    // The ball's top is at z = 2, the camera at 200.
    expect((16, 16), [0.5, 0.8, 2.0, 198.0, 1.0, 1.0, 0.0, 0.0]);
    expect((16, 6), [0.1, 0.8, 0.0, 200.0, 1.0, 0.0, 0.0, 0.0]);
    expect((16, 0), [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    // Towards +x and +y the normals of the ball lean that way.
    assert!(at("normal_x", 16, 18) > 0.2 && at("normal_y", 14, 16) > 0.2);
    assert_eq!(truth.attributes["objects"], json!(["a", "b"]));
}

fn check(scene: &Scene, params: &Value) -> Vec<Problem> {
    let mut known = Known::default();
    known.insert("scene", scene.clone().into_artifact());
    let mut problems = Problems::default();
    StageRow::of::<RenderStage>().check(params, &known, &mut problems);
    problems.into_parts().0
}

#[test]
fn mistakes_are_named() {
    let good = ball_on_slab(20);
    assert_eq!(check(&good, &json!({"f_x": [0, 0.1], "samples": 64})), []);
    let with = |change: &dyn Fn(&mut Scene)| {
        let mut s = good.clone();
        change(&mut s);
        s
    };
    let ok = json!({"f_x": [0, 0.1], "samples": 64});
    let table: Vec<(Scene, Value, &str, &[&str])> = vec![
        (good.clone(), json!({"f_x": [], "samples": 64}), "f_x", &["empty"]),
        (good.clone(), json!({"f_x": [-0.1], "samples": 64}), "f_x.0", &["-0.1 mm^-1", ">= 0"]),
        (good.clone(), json!({"f_x": [0.1, 0.1], "samples": 64}), "f_x.1", &["twice"]),
        (good.clone(), json!({"f_x": [0, 0.7], "samples": 64}), "f_x.1", &["0.7 mm^-1", "camera's pixels", "0.625"]),
        (good.clone(), json!({"f_x": ["0.1 mm"], "samples": 64}), "f_x.0", &["dimension length"]),
        (good.clone(), json!({"f_x": [0.1], "phases": 2, "samples": 64}), "phases", &["phases = 2", ">= 3"]),
        (good.clone(), json!({"f_x": [0.1], "samples": 0}), "samples", &["samples = 0", ">= 2"]),
        (good.clone(), json!({"f_x": [0.1], "samples": -1}), "samples", &["-1"]),
        (good.clone(), json!({"f_x": [0.1]}), "samples", &["when to stop", "target_error"]),
        (good.clone(), json!({"f_x": [0.1], "target_error": 0}), "target_error", &["0", "(0, 1)"]),
        (good.clone(), json!({"f_x": [0.1], "max_seconds": 0}), "max_seconds", &["0 s", "> 0"]),
        (
            with(&|s| {
                s.lights.insert("lamp".to_owned(), Lamp::Ambient { radiance: vec![1e-6] });
            }),
            json!({"f_x": [0.1], "samples": 4, "method": "fit"}),
            "method",
            &["no part of the image can be fitted", "lights other than the projector"],
        ),
        (
            good.clone(),
            json!({"f_x": [0.1], "samples": 4, "method": "rte"}),
            "method",
            &["transport solver", "bounded sideways"],
        ),
        (good.clone(), json!({"f_x": [0.1], "samples": 4, "method": "magic"}), "method", &["magic", "`path`"]),
        (good.clone(), json!({"f_x": [0.1], "samples": 4, "orientation_deg": []}), "orientation_deg", &["empty"]),
        (good.clone(), json!({"f_x": [0.1], "samples": 4, "orientation_deg": [0, 0]}), "orientation_deg.1", &["twice"]),
        (
            good.clone(),
            json!({"f_x": [0.1], "sample": 4}),
            "sample",
            &["there is no key `sample`", "did you mean `samples`?"],
        ),
        (with(&|s| s.camera = None), ok.clone(), "scene", &["no camera"]),
        (with(&|s| s.projector = None), ok.clone(), "scene", &["no projector"]),
        (
            with(&|s| s.projector.as_mut().unwrap().pixels = Some([10, 1000])),
            ok.clone(),
            "f_x.1",
            &["projector's pixels", "0.083"],
        ),
        (
            with(&|s| {
                s.media.get_mut("m").unwrap().n = 1.4;
                s.objects.get_mut("b").unwrap().surface = Surface::Rough(0.2);
                s.media.insert("other".to_owned(), Medium { n: 1.5, ..medium(0.1, 1.0, 0.0) });
                s.objects.get_mut("b").unwrap().medium = Some("other".to_owned());
            }),
            ok.clone(),
            "",
            &["smooth and rough walls", "rough surface"],
        ),
        (
            with(&|s| {
                s.objects.get_mut("b").unwrap().surface = Surface::Mirror;
                s.media.insert("other".to_owned(), Medium { n: 1.5, ..medium(0.1, 1.0, 0.0) });
                let slab = s.objects.get_mut("a").unwrap();
                (slab.medium, slab.surface) = (Some("other".to_owned()), Surface::Rough(0.2));
            }),
            ok.clone(),
            "",
            &["curved", "rough walls", "slabs and boxes"],
        ),
        (
            with(&|s| {
                s.media.insert("m".to_owned(), medium(0.0, 1e6, 0.0));
            }),
            ok.clone(),
            "",
            &["flights", "hardly absorbed"],
        ),
    ];
    for (scene, params, path, words) in table {
        let mistakes = check(&scene, &params);
        let found = mistakes.iter().find(|m| {
            let text = m.to_string();
            m.path == path && words.iter().all(|w| text.contains(w))
        });
        assert!(found.is_some(), "nothing at `{path}` with {words:?}, but {mistakes:?}");
    }
}

/// Along y the pixels are as fine as along x: the limit follows the orientation.
#[test]
fn resolution_is_judged_along_the_fringe() {
    let mut s = ball_on_slab(20);
    s.camera.as_mut().unwrap().pixels = [20, 200];
    let at = |o: f64| check(&s, &json!({"f_x": [0.7], "orientation_deg": [o], "samples": 64})).len();
    assert_eq!((at(0.0), at(90.0), at(30.0)), (1, 0, 0));
}

#[test]
fn plan_says_what_is_left_out() {
    let mut known = Known::default();
    known.insert("scene", ball_on_slab(20).into_artifact());
    let plan = (StageRow::of::<RenderStage>().prepare)(&json!({"f_x": [0.1], "samples": 64})).unwrap().plan(&known);
    assert!(plan.method.unwrap().starts_with("path"));
    assert!(plan.needs.iter().any(|n| n == "several media"));
    assert!(plan.left_out.iter().any(|n| n == "BVH") && plan.left_out.iter().any(|n| n == "Lambertian surfaces"));
    assert!(plan.seconds.unwrap() > 0.0 && plan.bytes.unwrap() > 0);
}

/// What is shown of a render meanwhile: the frames of a shorter one where pixels have paths of their own or share a fit, without standard errors;
/// with control variates something like them. It changes nothing.
#[test]
fn what_there_is_so_far_is_shown() {
    let slab = || scene(&[("m", medium(0.1, 4.0, 0.8))], vec![object(FLOOR, "m", 0)], rig(200.0, 20.0, 16.0, 20, 60.0));
    for (scene, more, near) in [
        (ball_on_slab(20), json!({"method": "path"}), 1e-6),
        (ball_on_slab(20), json!({"method": "path", "allocate": "adaptive"}), 1e-6),
        (ball_on_slab(20), json!({}), 0.2),
        (slab(), json!({"method": "fit"}), 1e-6),
    ] {
        let params = |samples: u32| {
            let mut params = json!({"f_x": [0, 0.1], "samples": samples});
            params.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
            params
        };
        let host = MemoryHost { looks_on: true, ..MemoryHost::new(4, &[], 1) };
        let watched = run_on(&host, &scene, &params(200)).unwrap();
        assert_eq!(watched, run_on(&MemoryHost::new(4, &[], 1), &scene, &params(200)).unwrap());
        let seen = host.seen.into_inner().unwrap();
        let (port, done, Artifact::Images(last)) = seen.last().expect("something was shown") else { panic!("images") };
        assert_eq!((port.as_str(), *done), ("frames", 128.0));
        let shorter = run_on(&MemoryHost::new(4, &[], 1), &scene, &params(128)).unwrap();
        let shorter = &shorter["frames"];
        assert_eq!(last.pixel_pitch_mm(), shorter.pixel_pitch_mm());
        let values = shorter.layers.iter().filter(|layer| layer.info.kind == LayerKind::Value);
        assert_eq!(last.layers.len(), values.clone().count());
        for (shown, made) in last.layers.iter().zip(values) {
            let apart = shown.data.iter().zip(&made.data).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
            let size = made.data.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>();
            assert!(apart <= near * near * size, "{more}: {apart} of {size}");
        }
    }
}
