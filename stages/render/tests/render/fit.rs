//! The smooth fit of laterally uniform scenes: right, with errors that can be trusted, and only where it holds.

use serde_json::{Value, json};
use turbid_contract::payload::{Scene, Shape, Specular};
use turbid_contract::{ImageStack, Layer, LayerKind, Problems, StageRow};
use turbid_render::{Params, RenderStage};

use crate::kernel::known;
use crate::setup::*;

/// A half-space under a rig at 300 mm that looks and shines obliquely, lit 12 / mu_eff beyond the view.
fn oblique(pixels: u32) -> Scene {
    let (mut camera, mut projector) = rig(300.0, 0.0, 40.0, pixels, 140.0);
    camera.position = [-60.0, 30.0, 300.0];
    projector.position = [80.0, 20.0, 250.0];
    scene(&[("m", medium(0.1, 5.0, 0.8))], vec![object(FLOOR, "m", 0)], (camera, projector))
}

fn params(method: &str, samples: u32) -> Value {
    json!({"f_x": [0, 0.1], "orientation_deg": [0, 70], "samples": samples, "method": method})
}

fn values(stack: &ImageStack) -> Vec<(&Layer, &Layer)> {
    let pairs = stack.layers.windows(2).filter(|w| w[0].info.kind == LayerKind::Value);
    pairs.map(|w| (&w[0], &w[1])).collect()
}

/// A Lambertian floor has no noise but that of the jitter within the pixel: the fit is E rho / pi times the pattern averaged over
/// the pixel, sin(pi f w) / (pi f w), at every pixel, and agrees with the path tracer in its own standard errors.
#[test]
fn a_lambertian_floor_is_fitted_exactly() {
    let (rho, w) = (0.7, 2.5);
    let (mut camera, mut projector) = rig(300.0, 0.0, 16.0 * w, 16, 140.0);
    camera.position = [-60.0, 30.0, 300.0];
    projector.position = [80.0, 20.0, 250.0];
    let scene = scene(&[], vec![lambertian(FLOOR, rho)], (camera, projector));
    let frames = &run(&scene, &json!({"f_x": [0, 0.1], "samples": 64, "method": "fit"}), 1)["frames"];
    let half = 0.5 * rho * 5.0 / (140.0 * 140.0) / std::f64::consts::PI;
    let x = std::f64::consts::PI * 0.1 * w;
    let mut scores = 0.0;
    for (value, se) in values(frames) {
        for (at, &got) in value.data.indexed_iter() {
            let place = (at.1 as f64 + 0.5) * w - 8.0 * w;
            let phase = 2.0 * std::f64::consts::PI * 0.1 * place + value.info.phase_rad.unwrap();
            let fringe = if value.info.f_x_per_mm == Some(0.0) { 0.0 } else { x.sin() / x * phase.cos() };
            let off = f64::from(got) - half * (1.0 + fringe);
            // The jitter of 16384 paths leaves some 1e-3 of the fringe.
            assert!(off.abs() < 5.0 * f64::from(se.data[at]) + 1e-6 * half, "{:?} at {at:?}: {off:e}", value.info);
            scores += f64::from(se.data[at]) / half / frames.layers.len() as f64 / 256.0;
        }
    }
    assert!(scores < 2e-3, "mean standard error {scores}");
}

/// Fits of few paths against pixels of many: z over all pixels and layers of 24 fits of 64 paths per pixel, whose errors a
/// long run of 4096 hardly adds to. All pixels of a fit share six coefficients per response, so the scores count as 24 x 6 x 5 = 720
/// at most: their mean square is 1 within 5 sqrt(2 / 720) + the 2 % of the long run.
#[test]
fn fits_agree_with_pixels_within_their_errors() {
    agree(&oblique(12));
}

/// The same where the slab refracts.
#[test]
fn fits_agree_with_pixels_at_refracting_slabs() {
    let mut scene = oblique(12);
    scene.media.get_mut("m").unwrap().n = 1.4;
    scene.camera.as_mut().unwrap().specular = Some(Specular::Exclude);
    agree(&scene);
}

fn agree(scene: &Scene) {
    let long = run(scene, &params("path", 4096), 1000).remove("frames").unwrap();
    let (mut sum, mut squares, mut count, mut worst) = (0.0, 0.0, 0.0, 0.0_f64);
    let mut means = Vec::new();
    for seed in 0..24 {
        let fit = run(scene, &params("fit", 64), seed).remove("frames").unwrap();
        for ((value, se), (truth, truth_se)) in values(&fit).into_iter().zip(values(&long)) {
            for (at, &x) in value.data.indexed_iter() {
                let (off, se) =
                    (f64::from(x - truth.data[at]), f64::from(se.data[at]).hypot(f64::from(truth_se.data[at])));
                let z = off / se;
                (sum, squares, count) = (sum + z, squares + z * z, count + 1.0);
                worst = worst.max(z.abs());
            }
            let mean = |l: &Layer| l.data.mapv(f64::from).mean().unwrap();
            let se = value.info.mean_se.unwrap().hypot(truth.info.mean_se.unwrap());
            means.push((mean(value) - mean(truth)) / se);
        }
    }
    let mean_square = squares / count;
    assert!((mean_square - 1.0).abs() < 5.0 * (2.0_f64 / 720.0).sqrt() + 0.02, "mean square {mean_square}");
    assert!((sum / count).abs() < 0.2, "mean {}", sum / count);
    assert!(worst < 4.8, "worst {worst}");
    // Layers share paths: 24 fits count at least.
    let mean_square = means.iter().map(|z| z * z).sum::<f64>() / means.len() as f64;
    assert!((mean_square - 1.0).abs() < 5.0 * (2.0_f64 / 24.0).sqrt() / 2.0, "of the image means {mean_square}");
}

/// The covariance port holds what the errors of the frames say: Var of frame k = (1, cos, -sin) Cov (1, cos, -sin) with the
/// covariance of (M_DC, re, im). f32 of either: 1e-5.
#[test]
fn covariances_are_those_of_the_frames() {
    let ports = run(&oblique(12), &json!({"f_x": [0.1], "samples": 32, "method": "fit"}), 3);
    let cov = |i: u32, j: u32, at| {
        let pair = Some([i.min(j), i.max(j)]);
        f64::from(ports["covariance"].layers.iter().find(|l| l.info.pair == pair).unwrap().data[at])
    };
    for (value, se) in values(&ports["frames"]) {
        let phase = value.info.phase_rad.unwrap();
        let weights = [1.0, phase.cos(), -phase.sin()];
        for (at, &se) in se.data.indexed_iter() {
            let pairs = (0..9).map(|k| (k / 3, k % 3));
            let variance: f64 = pairs.map(|(i, j)| weights[i] * weights[j] * cov(i as u32, j as u32, at)).sum();
            let off = variance.sqrt() / f64::from(se) - 1.0;
            assert!(off.abs() < 1e-5, "phase {phase} at {at:?}: {off:e}");
        }
    }
    // All pixels share their errors: a mean over n pixels is as noisy as that of n / 6, order 2 having six terms (a fifth off where
    // the light falls off over the image).
    let design_effect = ports["frames"].attributes["sharing"].as_f64().unwrap();
    assert!((design_effect / (144.0 / 6.0) - 1.0).abs() < 0.2, "{design_effect}");
}

/// A large image is fitted from a lattice of its pixels: the same light as a small one of the same field, whose blur is larger.
#[test]
fn large_images_cost_no_more_than_small_ones() {
    let small = run(&oblique(64), &json!({"f_x": [0], "samples": 16, "method": "fit"}), 1);
    let host = MemoryHost::new(2, &[], 2);
    let large = run_on(&host, &oblique(200), &json!({"f_x": [0], "samples": 16, "method": "fit"})).unwrap();
    let (small, large) = (&small["frames"], &large["frames"]);
    let at = |stack: &ImageStack, layer: usize, (x, y): (f64, f64)| {
        let (rows, columns) = stack.layers[layer].data.dim();
        f64::from(stack.layers[layer].data[((y * rows as f64) as usize, (x * columns as f64) as usize)])
    };
    for place in [(0.0, 0.0), (0.5, 0.5), (0.99, 0.2), (0.0, 0.99)] {
        let se = at(small, 1, place).hypot(at(large, 1, place));
        let off = at(small, 0, place) - at(large, 0, place);
        // Places agree to a small pixel of 0.6 mm: 2e-3 of the light.
        assert!(off.abs() < 4.5 * se + 2e-3 * at(small, 0, place), "{place:?}: {off:e} +- {se:e}");
        let ratio = at(small, 1, place) / at(large, 1, place);
        assert!((0.7..1.4).contains(&ratio), "errors at {place:?}: {ratio}");
    }
}

/// Where a scene is not laterally uniform `auto` says why, and goes by surfaces as `fit` does; where it is, `auto` is the fit of the whole image.
#[test]
fn a_fit_of_the_whole_image_is_not_taken_where_it_would_lie() {
    let good = oblique(12);
    let with = |change: &dyn Fn(&mut Scene)| {
        let mut s = good.clone();
        change(&mut s);
        s
    };
    let table: Vec<(Scene, &str)> = vec![
        (
            with(&|s| {
                s.objects.get_mut("a").unwrap().shape = Shape::Box { size: [900.0; 3], center: [0.0, 0.0, -450.0] }
            }),
            "bounded sideways",
        ),
        (with(&|s| s.projector.as_mut().unwrap().field = [45.0; 2]), "lit field reaches"),
        (with(&|s| s.projector.as_mut().unwrap().field = [35.0; 2]), "ends within what is seen"),
        (with(&|s| s.camera.as_mut().unwrap().position = [600.0, 0.0, 300.0]), "oblique"),
        (
            with(&|s| {
                let camera = s.camera.as_mut().unwrap();
                (camera.field, camera.pixels) = ([40.0, 10.0], [12, 3]);
            }),
            "fewer than 4 pixels",
        ),
        (
            with(&|s| {
                s.objects.get_mut("a").unwrap().shape = Shape::Slab { top: 0.0, bottom: -2.0 };
                s.objects.insert("b".to_owned(), object(Shape::Slab { top: -3.0, bottom: -90.0 }, "m", 0));
            }),
            "gap",
        ),
        (
            with(&|s| {
                s.media.insert("clear".to_owned(), medium(0.01, 0.0, 0.0));
                s.objects.insert("b".to_owned(), object(Shape::Slab { top: -3.0, bottom: -9.0 }, "clear", 1));
            }),
            "clear layer",
        ),
        (
            with(&|s| {
                s.media.insert("m".to_owned(), medium(1e-4, 5.0, 0.8));
            }),
            "% of the light",
        ),
    ];
    for (scene, words) in table {
        let planned = |method: &str| {
            let job = (StageRow::of::<RenderStage>().prepare)(&params(method, 8)).unwrap();
            job.plan(&known(&scene)).method.unwrap()
        };
        assert!(planned("auto").contains(words), "`{words}` is not in: {}", planned("auto"));
        assert!(planned("fit").contains("where it holds"), "{}", planned("fit"));
        let frames = |method: &str| {
            run_on(&MemoryHost::new(1, &[], 1), &scene, &params(method, 8)).unwrap().remove("frames").unwrap()
        };
        assert_eq!(frames("auto"), frames("fit"), "{words}");
    }
    let frames = |method: &str| run(&good, &params(method, 8), 1).remove("frames").unwrap();
    assert_eq!(frames("auto"), frames("fit"));
    assert_ne!(frames("auto"), frames("path"));
}

/// Continued fits have the bytes of fresh ones, and a target is met where it is first tested after enough paths.
#[test]
fn fits_continue_and_stop() {
    let run_on = |host: &MemoryHost, params: &Value| run_on(host, &oblique(16), params).unwrap();
    let host = MemoryHost::new(4, &["covariance"], 2);
    run_on(&host, &params("fit", 24));
    let fresh = run_on(&MemoryHost::new(4, &["covariance"], 1), &params("fit", 99));
    assert_eq!(run_on(&host, &params("fit", 99)), fresh);
    let host = MemoryHost::new(4, &[], 2);
    let done = run_on(&host, &json!({"f_x": [0.1], "target_error": 0.01, "method": "fit"}));
    assert!(host.measures.lock().unwrap()["error: m_ac per pixel"] <= 1.0);
    let n = done["frames"].attributes["samples"].as_u64().unwrap();
    let half = MemoryHost::new(4, &[], 2);
    run_on(&half, &json!({"f_x": [0.1], "samples": n / 2, "method": "fit"}));
    assert!(half.measures.lock().unwrap()["error: m_ac per pixel"] > 1.0);
    assert_eq!(run_on(&half, &json!({"f_x": [0.1], "target_error": 0.01, "method": "fit"})), done);
}

/// What is lit by projected images the transport solver does not give, and who asks it for them hears so from `check`, not from the frames; every other method does.
#[test]
fn the_solver_refuses_projected_images() {
    for (method, patterned, refused) in
        [("rte", true, true), ("rte", false, false), ("fit", true, false), ("auto", true, false), ("path", true, false)]
    {
        let params: Params = serde_json::from_value(json!({"f_x": [0], "samples": 64, "method": method})).unwrap();
        let mut problems = Problems::default();
        params.check(patterned, &mut problems);
        let errors = problems.into_parts().0;
        let found: Vec<&str> = errors.iter().map(|p| p.path.as_str()).collect();
        assert_eq!(found, if refused { vec!["method"] } else { vec![] }, "{method}, patterned {patterned}: {errors:?}");
    }
}
