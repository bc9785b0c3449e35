//! Media whose phase function has a narrow lobe: few paths see what makes the image, and standard errors know it or say that they do not.

use serde_json::json;
use turbid_contract::payload::{Medium, Scene, Shape};
use turbid_contract::{Known, Problem, Problems, StageRow};
use turbid_render::RenderStage;

use crate::setup::*;

/// A half-space of mu_a = 0.02 and mu_s' = 1 mm^-1, of which `pixels` x `pixels` alike are seen.
pub fn half_space(g: f64, pixels: u32) -> Scene {
    let tissue = medium(0.02, 1.0 / (1.0 - g), g);
    scene(&[("tissue", tissue)], vec![object(FLOOR, "tissue", 0)], rig(500.0, 35.0, 2.0, pixels, 128.0))
}

/// What many images of one scene say of their errors.
#[derive(Debug)]
pub struct Found {
    /// Share of pixels whose standard error is unknown.
    pub unknown: f64,
    /// Of the others, the share within two standard errors, and how many there are.
    pub within: f64,
    pub n: u32,
    /// Mean over all pixels, unknown or not, with the standard error of all images.
    pub mean: f64,
    pub mean_se: f64,
}

/// `seeds` images of a scene whose pixels are alike, so that the truth is the mean over all: known sqrt(pixels x seeds) times as well as a pixel.
pub fn found(scene: &Scene, samples: u32, seeds: u64) -> Found {
    let (mut values, mut errors, mut flags) = (Vec::new(), Vec::new(), Vec::new());
    for seed in 0..seeds {
        let params = json!({"f_x": [0], "samples": samples, "method": "path"});
        let frames = &run_on(&MemoryHost::new(seed + 100, &[], 2), scene, &params).unwrap()["frames"];
        let layer = frames.find("radiance", None).unwrap();
        values.extend(layer.data.iter().map(|&x| f64::from(x)));
        errors.extend(frames.standard_error(&layer.info).unwrap().data.iter().map(|&x| f64::from(x)));
        match frames.se_unknown(&layer.info) {
            Some(flagged) => flags.extend(flagged.data.iter().map(|&x| x == 1.0)),
            None => flags.resize(values.len(), false),
        }
    }
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let squares: f64 = values.iter().map(|x| (x - mean) * (x - mean)).sum();
    let known: Vec<usize> = (0..values.len()).filter(|&i| !flags[i]).collect();
    let within = known.iter().filter(|&&i| (values[i] - mean).abs() <= 2.0 * errors[i]).count();
    Found {
        unknown: 1.0 - known.len() as f64 / count,
        within: within as f64 / known.len().max(1) as f64,
        n: known.len() as u32,
        mean,
        mean_se: squares.sqrt() / count,
    }
}

/// From either side: 95.4 % within 2 %, the room for means that are not normal, and 4 standard errors of the share. Variances are pooled over `groups` groups of
/// pixels whose errors of the standard error are common: each is known to 18 % at worst, by which the share changes by up to 0.04 a group.
pub fn holds(found: &Found, groups: f64) -> bool {
    let room = 0.02 + 4.0 * (0.954 * 0.046 / f64::from(found.n) + 0.04 * 0.04 / groups).sqrt();
    (found.within - 0.954).abs() < room
}

/// After 64 paths of 16 x 16 pixels two standard errors hold the truth as often as they say, from g = 0.8 to 0.995, and nothing is left unknown. Without weight windows a
/// pixel's own paths hold it in 93, 86, 73, 49 and 21 % of cases.
#[test]
fn errors_hold_the_truth_under_narrow_lobes() {
    for (g, seeds) in [(0.8, 8), (0.9, 8), (0.95, 8), (0.98, 6), (0.995, 4)] {
        let found = found(&half_space(g, 16), 64, seeds);
        println!("g = {g}: {found:?}");
        assert!(found.unknown == 0.0 && holds(&found, seeds as f64), "g = {g}: {found:?}");
    }
}

/// Weight windows hold the variance of a path: of M_DC 1.6 of the squared mean at g = 0.8 and 10 at 0.995, where 2600 times is what paths without them have. Six standard
/// errors of a sampled variance, of a kurtosis of 100, are 0.47 of it.
#[test]
fn variance_grows_little_with_g() {
    for (g, expected) in [(0.9, 1.74), (0.95, 2.6), (0.98, 6.9), (0.995, 10.4)] {
        let found = found(&half_space(g, 16), 64, 1);
        let n = 64.0 * 256.0;
        let variance = (found.mean_se / found.mean).powi(2) * n;
        assert!(variance < expected * (1.0 + 6.0 * f64::sqrt(100.0 / n)), "g = {g}: {variance}");
    }
}

/// No bias: the mean over all pixels, unknown errors or not, is that of the transport solver within 3 standard errors of the paths and the solver's own bound for
/// this rig, nearly normal from 2 m away.
#[test]
fn the_mean_is_right_under_narrow_lobes() {
    for (g, samples, seeds) in [(0.95, 64, 4), (0.98, 64, 4), (0.995, 64, 2)] {
        let mut scene = half_space(g, 16);
        scene.camera.as_mut().unwrap().position = [0.0, 0.0, 2000.0];
        scene.projector.as_mut().unwrap().position = [0.0, 20.0, 2000.0];
        let params = json!({"f_x": [0], "samples": 2, "method": "rte"});
        let solved = &run_on(&MemoryHost::new(1, &[], 2), &scene, &params).unwrap()["frames"];
        let layer = solved.find("radiance", None).unwrap();
        let (truth, bound) = (layer.data.mapv(f64::from).mean().unwrap(), layer.info.mean_se.unwrap());
        let found = found(&scene, samples, seeds);
        println!("g = {g}: {} of the truth, {found:?}, bound {}", found.mean / truth, bound / truth);
        assert!((found.mean - truth).abs() < 3.0 * f64::hypot(found.mean_se, bound), "g = {g}: {truth:e}, {found:?}");
        assert!(found.mean_se < 0.06 * truth, "g = {g}: {found:?}");
    }
}

/// A ball that refracts: its paths have no weight windows.
fn ball(g: f64, pixels: u32) -> Scene {
    let tissue = Medium { n: 1.4, ..medium(0.5, 1.0 / (1.0 - g), g) };
    let shape = Shape::Sphere { diameter: 10.0, center: [0.0, 0.0, -5.0] };
    scene(&[("tissue", tissue)], vec![object(shape, "tissue", 0)], rig(500.0, 35.0, 2.0, pixels, 128.0))
}

/// Where the image holds too few paths for the lobe nothing is known of errors, and it is said: 256 and 512 paths with weight windows (of the 800 that it takes), 512 at
/// g = 0.98 without (of 12,000). The values stay; `mean_se` is left out.
#[test]
fn too_few_paths_say_so() {
    for (scene, samples) in [(half_space(0.995, 4), 16), (half_space(0.98, 4), 32), (ball(0.98, 8), 8)] {
        let params = json!({"f_x": [0, 0.1], "samples": samples, "method": "path"});
        let frames = &run_on(&MemoryHost::new(5, &[], 2), &scene, &params).unwrap()["frames"];
        for layer in frames.layers.iter().filter(|l| l.info.name == "radiance") {
            let flags = frames.se_unknown(&layer.info).expect("errors are unknown");
            assert!(flags.data.iter().all(|&flag| flag == 1.0), "{samples}");
            assert!(layer.info.mean_se.is_none() && layer.data.iter().all(|x| x.is_finite()));
        }
    }
    // A fit has all of the image's paths, and they are too few as well.
    let fitted = &run_on(
        &MemoryHost::new(5, &[], 2),
        &half_space(0.995, 8),
        &json!({"f_x": [0], "samples": 8, "method": "fit"}),
    );
    let frames = &fitted.as_ref().unwrap()["frames"];
    assert!(frames.se_unknown(&frames.find("radiance", None).unwrap().info).is_some());
}

/// A lobe that no lamp shines into makes no light rare: under a sky alone nothing is unknown.
#[test]
fn a_sky_needs_no_lobe() {
    let mut scene = half_space(0.995, 4);
    scene.projector = None;
    scene.lights = [("sky".to_owned(), turbid_contract::payload::Lamp::Ambient { radiance: vec![1.0] })].into();
    let found = found(&scene, 64, 2);
    assert_eq!(found.unknown, 0.0, "{found:?}");
}

/// `check` says what g costs where paths have no weight windows, and where they are too few; `plan` from where the lobe is narrower than usual.
#[test]
fn check_and_plan_say_what_g_costs() {
    let (warnings, needs) = said(&half_space(0.98, 16), 64);
    assert!(warnings.is_empty() && needs.contains("g = 0.98 of tissue takes about 6 times"), "{warnings:?} {needs}");
    let (warnings, _) = said(&half_space(0.98, 4), 16);
    assert!(warnings.len() == 1 && warnings[0].message.contains("unknown"), "{warnings:?}");
    let (warnings, needs) = said(&ball(0.98, 16), 64);
    assert!(warnings.len() == 1 && warnings[0].path == "samples", "{warnings:?}");
    assert!(needs.contains("g = 0.98 of tissue takes about 100 times"), "{needs}");
    let (warnings, needs) = said(&half_space(0.8, 16), 64);
    assert!(warnings.is_empty() && !needs.contains("g = "), "{warnings:?} {needs}");
}

/// What `check` says of lobes, and all that `plan` does.
pub fn said(scene: &Scene, samples: u32) -> (Vec<Problem>, String) {
    let row = StageRow::of::<RenderStage>();
    let params = json!({"f_x": [0], "samples": samples});
    let known = known(scene);
    let mut problems = Problems::default();
    row.check(&params, &known, &mut problems);
    let warnings = problems.into_parts().1;
    let needs = (row.prepare)(&params).unwrap().plan(&known).needs;
    (warnings.into_iter().filter(|w| w.message.contains("so narrow a lobe")).collect(), needs.join("; "))
}

fn known(scene: &Scene) -> Known {
    use turbid_contract::payload::Payload;
    let mut known = Known::default();
    known.insert("scene", scene.clone().into_artifact());
    known
}
