//! Fits on smooth surfaces: right, with errors that can be trusted, and pixels by their own paths elsewhere.

use serde_json::json;
use turbid_contract::payload::{Lamp, Scene, Shape};
use turbid_contract::{ImageStack, LayerKind};

use crate::setup::*;

const SIDE: u32 = 24;

fn tissue() -> turbid_contract::payload::Object {
    object(FLOOR, "m", 0)
}

fn with(objects: Vec<turbid_contract::payload::Object>, field: f64) -> Scene {
    let media = [("m", medium(0.05, 5.0, 0.8)), ("n", medium(0.051, 5.0, 0.8)), ("dark", medium(0.3, 4.0, 0.8))];
    let (camera, mut projector) = rig(300.0, 0.0, field, SIDE, 200.0);
    projector.position = [25.0, 0.0, 300.0];
    scene(&media, objects, (camera, projector))
}

/// Half a ball of 30 mm on tissue, seen from above.
fn dome() -> Scene {
    with(vec![tissue(), object(Shape::Sphere { diameter: 30.0, center: [0.0; 3] }, "dark", 1)], 44.0)
}

/// An ellipsoid of 24 mm flush with the tissue around.
fn lesion() -> Scene {
    let dark = Shape::Spheroid { diameters: [24.0, 24.0, 16.0], center: [0.0; 3] };
    let mut air = object(Shape::Box { size: [200.0, 200.0, 30.0], center: [0.0, 0.0, 15.0] }, "air", 2);
    air.medium = None;
    with(vec![tissue(), object(dark, "dark", 1), air], 44.0)
}

/// Down a bore of 20 mm, lit along it.
pub fn tube() -> Scene {
    let tube = Shape::Tube { inner_diameter: 20.0, outer_diameter: 60.0, center: [0.0; 2], bottom: -120.0, top: 0.0 };
    let mut scene = with(vec![object(tube, "dark", 0)], 20.0);
    scene.camera.as_mut().unwrap().position = [0.0, 0.0, 110.0];
    let projector = scene.projector.as_mut().unwrap();
    (projector.position, projector.field) = ([0.0, 0.0, 100.0], [20.0; 2]);
    scene
}

/// Of every pixel M_DC and M_AC, with their variances.
pub struct Image {
    values: [Vec<f64>; 2],
    variances: [Vec<f64>; 2],
}

impl Image {
    pub fn of(frames: &ImageStack, covariance: &ImageStack) -> Self {
        let shots: Vec<_> =
            frames.layers.iter().filter(|l| l.info.kind == LayerKind::Value).map(|l| l.pixels()).collect();
        let cov = |i: u32, j: u32| {
            let layer = covariance.layers.iter().find(|l| l.info.pair == Some([i, j])).unwrap();
            layer.pixels()
        };
        let (dd, rr, ri, ii) = (cov(0, 0), cov(1, 1), cov(1, 2), cov(2, 2));
        let mut image = Self { values: Default::default(), variances: Default::default() };
        for p in 0..shots[0].len() {
            let [a, b, c] = [0, 1, 2].map(|k| f64::from(shots[k][p]));
            let (re, im) = ((2.0 * a - b - c) / 3.0, (c - b) / 3f64.sqrt());
            let m = re.hypot(im);
            let [rr, ri, ii] = [&rr, &ri, &ii].map(|l| f64::from(l[p]));
            image.values[0].push((a + b + c) / 3.0);
            image.variances[0].push(f64::from(dd[p]));
            image.values[1].push(m);
            image.variances[1].push((re * re * rr + 2.0 * re * im * ri + im * im * ii) / (m * m));
        }
        image
    }
}

fn image(scene: &Scene, method: &str, samples: u32, seed: u64) -> Image {
    let params = json!({"f_x": [0.05], "samples": samples, "method": method});
    let ports = run(scene, &params, seed);
    Image::of(&ports["frames"], &ports["covariance"])
}

/// Of M_DC or M_AC over the pixels that are fitted.
pub struct Coverage {
    /// Of z scores.
    pub mean: f64,
    pub sd: f64,
    /// The largest part of the mean error over seeds of any pixel that noise does not explain (3.5 standard deviations of that mean, and of the reference), in stated
    /// standard errors.
    pub bias: f64,
    /// Fitted by any of the seeds.
    pub pixels: usize,
}

/// Of `seeds` fits of `samples` paths per pixel against `long` ones.
fn coverage(scene: &Scene, samples: u32, seeds: u64, long: u32) -> [Coverage; 2] {
    coverage_of(&|method, samples, seed| image(scene, method, samples, seed), samples, seeds, long)
}

/// The same of images by method, paths per pixel and seed.
pub fn coverage_of(image: &dyn Fn(&str, u32, u64) -> Image, samples: u32, seeds: u64, long: u32) -> [Coverage; 2] {
    let truth = image("path", long, 4711);
    let fits: Vec<Image> = (0..seeds).map(|seed| image("fit", samples, seed)).collect();
    let paths: Vec<Image> = (0..seeds).map(|seed| image("path", samples, seed)).collect();
    [0, 1].map(|k| {
        let (mut sum, mut squares, mut count, mut bias, mut pixels) = (0.0, 0.0, 0.0_f64, 0.0_f64, 0);
        for p in 0..truth.values[k].len() {
            let (mut off, mut variance, mut n) = (0.0, 0.0, 0.0_f64);
            for (fit, path) in fits.iter().zip(&paths) {
                if fit.values[k][p] != path.values[k][p] {
                    let own = fit.values[k][p] - truth.values[k][p];
                    let z = own / (fit.variances[k][p] + truth.variances[k][p]).sqrt();
                    (sum, squares, count) = (sum + z, squares + z * z, count + 1.0);
                    (off, variance, n) = (off + own, variance + fit.variances[k][p], n + 1.0);
                }
            }
            if n > 0.0 {
                let noise = 3.5 * (variance / n / n + truth.variances[k][p]).sqrt();
                bias = bias.max(((off / n).abs() - noise) / (variance / n).sqrt());
                pixels += 1;
            }
        }
        let mean = sum / count;
        Coverage { mean, sd: (squares / count - mean * mean).sqrt(), bias, pixels }
    })
}

/// Over 20 seeds z scores of all pixels that are fitted have the standard deviation 1, but for what the bounds of misfit add, and a mean of less than a third.
/// (24 x 24 pixels of 64 paths against 6144: a dome on tissue, and a bore all around.)
#[test]
fn errors_hold_on_domes_and_in_tubes() {
    for (what, scene, least) in [("dome", dome(), 200), ("tube", tube(), 120)] {
        for (k, c) in coverage(&scene, 64, 20, 6144).iter().enumerate() {
            let (mean, sd, pixels) = (c.mean, c.sd, c.pixels);
            assert!((0.7..1.15).contains(&sd) && mean.abs() < 0.33, "{what}, {k}: mean {mean}, sd {sd}");
            assert!(pixels >= least, "{what}: {pixels} of 576 pixels are fitted");
        }
    }
}

/// Where surfaces are almost smooth the errors hold, too: mu_a is larger by 1e-3 mm^-1 on one side; a ball lies 2 mm under the surface; a block throws a shadow.
/// No pixel is off by more than the stated error, as far as 8 seeds tell.
#[test]
fn what_is_almost_smooth_does_not_hide() {
    let half =
        |x: f64, medium: &str| object(Shape::Box { size: [500.0, 1000.0, 500.0], center: [x, 0.0, -250.0] }, medium, 0);
    let step = with(vec![half(-250.0, "m"), half(250.0, "n")], 44.0);
    let sunk = with(vec![tissue(), object(Shape::Sphere { diameter: 8.0, center: [3.0, 2.0, -6.0] }, "dark", 1)], 44.0);
    let block = lambertian(Shape::Box { size: [4.0, 4.0, 60.0], center: [12.0, 0.0, 30.0] }, 0.3);
    let mut shadow = with(vec![tissue(), block], 44.0);
    shadow.projector.as_mut().unwrap().position = [200.0, 0.0, 250.0];
    for (what, scene) in [("step", step), ("sunk", sunk), ("shadow", shadow)] {
        for (k, c) in coverage(&scene, 128, 8, 4096).iter().enumerate() {
            let (mean, sd, bias, pixels) = (c.mean, c.sd, c.bias, c.pixels);
            assert!(pixels > 100, "{what}: {pixels} pixels are fitted");
            assert!(sd < 1.2 && mean.abs() < 0.33, "{what}, {k}: mean {mean}, sd {sd}");
            assert!(bias < 1.0, "{what}, {k}: a pixel is off by {bias} standard errors");
        }
    }
}

/// Pixels that are not fitted are those of `method: path`, bit for bit, and the run says how many are; the bytes are the same on one thread and on three.
#[test]
fn pixels_stay_where_nothing_is_fitted() {
    let frames = |method: &str, threads: usize| {
        let host = MemoryHost::new(5, &["covariance"], threads);
        let ports = run_on(&host, &dome(), &json!({"f_x": [0.05], "samples": 64, "method": method})).unwrap();
        (ports, host.measures.into_inner().unwrap())
    };
    let ((fit, measures), (path, _)) = (frames("fit", 1), frames("path", 1));
    let differ = |p: usize| fit["frames"].layers[0].pixels()[p] != path["frames"].layers[0].pixels()[p];
    let fitted = (0..576).filter(|&p| differ(p)).count();
    assert!((measures["pixels fitted"] - 100.0 * fitted as f64 / 576.0).abs() < 1e-9, "{fitted}: {measures:?}");
    assert!(fitted > 200 && fitted < 576 && measures.contains_key("order of the fit: b"), "{measures:?}");
    for (a, b) in fit["frames"].layers.iter().zip(&path["frames"].layers) {
        let own = (0..576).filter(|&p| !differ(p));
        own.for_each(|p| assert_eq!(a.pixels()[p], b.pixels()[p], "{:?} at {p}", a.info));
    }
    assert_eq!(fit, frames("fit", 3).0);
}

/// `auto` gives what `fit` does, bit for bit, where fits serve more pixels than control variates (a dome), and where there are none of these (a ball): all that is said
/// here of `fit` holds of it, after few paths, too. Over a lesion flush with the skin control variates go on where fits end, and where paths go to where the error is
/// nothing is fitted.
#[test]
fn auto_fits_surfaces() {
    let ball = with(vec![object(Shape::Sphere { diameter: 70.0, center: [0.0, 0.0, -35.0] }, "m", 0)], 30.0);
    for (what, scene) in [("dome", dome()), ("ball", ball)] {
        let frames = |params: serde_json::Value| {
            let host = MemoryHost::new(5, &["covariance"], 2);
            let ports = run_on(&host, &scene, &params).unwrap();
            (ports, host.measures.into_inner().unwrap().get("pixels fitted").copied())
        };
        for samples in [8, 64] {
            let of = |method: &str| frames(json!({"f_x": [0.05], "samples": samples, "method": method}));
            let (auto, fitted) = of("auto");
            assert!(fitted.is_some_and(|fitted| fitted > 20.0), "{what}: {fitted:?} %");
            assert!((auto, fitted) == of("fit"), "{what}, {samples} paths");
        }
        let (_, fitted) = frames(json!({"f_x": [0.05], "samples": 64, "allocate": "adaptive"}));
        assert_eq!(fitted, None, "{what}");
    }
    let host = MemoryHost::new(5, &[], 2);
    run_on(&host, &lesion(), &json!({"f_x": [0.05], "samples": 64})).unwrap();
    let measures = host.measures.into_inner().unwrap();
    assert!(measures["pixels by difference"] > 90.0 && !measures.contains_key("pixels fitted"), "{measures:?}");
}

/// The error of an image mean is that of its pixels' sum, which fits share: over 24 seeds z of the mean over the image has a mean square of 1, within 5 sqrt(2 / 24) and
/// what the bounds add.
#[test]
fn means_over_the_image_have_their_errors() {
    let scene = dome();
    let mean = |method: &str, samples: u32, seed: u64| {
        let frames = &run(&scene, &json!({"f_x": [0], "samples": samples, "method": method}), seed)["frames"];
        let layer = &frames.layers[0];
        (layer.data.mapv(f64::from).mean().unwrap(), layer.info.mean_se.unwrap())
    };
    let (truth, truth_se) = mean("path", 4096, 99);
    let squares = (0..24).map(|seed| {
        let (value, se) = mean("fit", 64, seed);
        ((value - truth) / se.hypot(truth_se)).powi(2)
    });
    let mean_square = squares.sum::<f64>() / 24.0;
    assert!((0.2..2.1).contains(&mean_square), "{mean_square}");
}

/// So is that of the mean over the pixels of the tissue around the dome which are fitted, though noisier ones at its rim are not: the same bound.
#[test]
fn means_over_what_is_fitted_have_their_errors() {
    let scene = dome();
    let frame = |method: &str, samples: u32, seed: u64| {
        run(&scene, &json!({"f_x": [0], "samples": samples, "method": method}), seed).remove("frames").unwrap()
    };
    let truth = frame("path", 4096, 99);
    let middle = 0.5 * f64::from(SIDE) - 0.5;
    // mm from the middle of the dome.
    let away = |i: usize| 44.0 / f64::from(SIDE) * ((i % 24) as f64 - middle).hypot((i / 24) as f64 - middle);
    let mut squares = Vec::new();
    for seed in 0..24 {
        let (fit, path) = (frame("fit", 64, seed), frame("path", 64, seed));
        let [fitted, own, long] = [&fit, &path, &truth].map(|frames| frames.layers[0].pixels());
        let counts = |i: usize| away(i) > 18.0 && fitted[i] != own[i];
        let pixels = || (0..fitted.len()).filter(|&i| counts(i));
        assert!(pixels().count() > 100);
        let off = pixels().map(|i| f64::from(fitted[i] - long[i])).sum::<f64>() / pixels().count() as f64;
        let mean_se = |frames: &ImageStack| {
            let info = &frames.layers[0].info;
            let se = frames.standard_error(info).unwrap().pixels();
            frames.sharing(info).mean_se(&se, counts).unwrap()
        };
        squares.push((off / mean_se(&fit).hypot(mean_se(&truth))).powi(2));
    }
    let mean_square = squares.iter().sum::<f64>() / squares.len() as f64;
    assert!((0.2..2.1).contains(&mean_square), "{mean_square}");
}

/// A target is met by the error of the fit: after fewer paths than pixels by their own need, and a run that is continued has the bytes of a fresh one.
#[test]
fn targets_are_met_by_the_fit() {
    let scene = with(vec![object(Shape::Sphere { diameter: 70.0, center: [0.0, 0.0, -35.0] }, "m", 0)], 30.0);
    let run = |host: &MemoryHost, stop: serde_json::Value| {
        let mut params = json!({"f_x": [0.05], "method": "fit"});
        params.as_object_mut().unwrap().extend(stop.as_object().unwrap().clone());
        run_on(host, &scene, &params).unwrap()
    };
    let host = MemoryHost::new(2, &[], 2);
    let done = run(&host, json!({"target_error": 0.03}));
    let n = done["frames"].attributes["samples"].as_u64().unwrap();
    // By its own paths a pixel's relative variance is some 3 for each: 3000 paths.
    assert!(n <= 512 && host.measures.lock().unwrap()["error: m_ac per pixel"] <= 3.0, "{n}");
    let half = MemoryHost::new(2, &[], 1);
    run(&half, json!({"samples": n / 2}));
    assert_eq!(run(&half, json!({"target_error": 0.03})), done);
}

/// Of two channels that share paths and many fringes every frame is right where it is fitted: z of all of them against a long run has a root mean square of 1, within
/// what one seed and its few functions leave open.
#[test]
fn channels_and_fringes_are_fitted_alike() {
    let mut scene = dome();
    scene.wavelengths_nm = vec![530.0, 635.0];
    for m in scene.media.values_mut() {
        (m.mu_a, m.mu_s) = (vec![m.mu_a[0], 0.4 * m.mu_a[0]], vec![m.mu_s[0]; 2]);
    }
    scene.projector.as_mut().unwrap().power = vec![5.0, 2.0];
    let frames = |method: &str, samples: u32, seed: u64| {
        let params = json!({"f_x": [0, 0.03, 0.06], "orientation_deg": [0, 60], "samples": samples, "method": method});
        run(&scene, &params, seed).remove("frames").unwrap()
    };
    let (fit, path, long) = (frames("fit", 64, 3), frames("path", 64, 3), frames("path", 2048, 8));
    for (k, layer) in fit.layers.iter().enumerate().filter(|(_, l)| l.info.kind == LayerKind::Value) {
        let at = |stack: &ImageStack, layer: usize, p: usize| f64::from(stack.layers[layer].pixels()[p]);
        let fitted: Vec<usize> = (0..576).filter(|&p| at(&fit, k, p) != at(&path, k, p)).collect();
        let z = |p: usize| (at(&fit, k, p) - at(&long, k, p)) / at(&fit, k + 1, p).hypot(at(&long, k + 1, p));
        let rms = (fitted.iter().map(|&p| z(p) * z(p)).sum::<f64>() / fitted.len() as f64).sqrt();
        assert!(fitted.len() > 80 && (0.5..1.5).contains(&rms), "{:?}: {} pixels, {rms}", layer.info, fitted.len());
    }
}

/// Where nothing can be fitted who asks for it hears so.
#[test]
fn lamps_and_apertures_are_refused() {
    let mut lit = dome();
    lit.lights.insert("lamp".to_owned(), Lamp::Point { position: [0.0, 0.0, 90.0], power: vec![1.0] });
    let mut blurred = dome();
    blurred.camera.as_mut().unwrap().aperture =
        Some(turbid_contract::payload::Aperture { diameter: 4.0, focus: 300.0 });
    for (scene, words) in [(lit, "lights other than the projector"), (blurred, "aperture")] {
        let params = json!({"f_x": [0.05], "samples": 8, "method": "fit"});
        let refused = run_on(&MemoryHost::new(1, &[], 1), &scene, &params).unwrap_err().to_string();
        assert!(refused.contains(words), "`{words}` is not in: {refused}");
    }
}
