//! Patterns that come by the port: images over the projector's field.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

use serde_json::{Value, json};
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Distortion, Pattern, Payload, Scene, Shape};
use turbid_contract::{Artifact, Ctx, Error, ImageStack, Known, LayerInfo, Problems, StageRow};
use turbid_render::RenderStage;

use crate::setup::*;
use crate::surfaces::{Image, coverage_of, tube};

pub fn show(
    scene: &Scene,
    pattern: &Pattern,
    params: &Value,
    seed: u64,
) -> Result<BTreeMap<&'static str, ImageStack>, Error> {
    let host = MemoryHost::new(seed, &["covariance", "white"], 2);
    let input = input(scene.clone()).with("pattern", pattern.clone());
    let ports = StageRow::of::<RenderStage>().run(params, &input, Ctx::new(&host))?;
    let stack = |artifact| if let Artifact::Images(stack) = artifact { stack } else { panic!("images were expected") };
    Ok(ports.into_iter().map(|(name, artifact)| (name, stack(artifact))).collect())
}

/// Three phases of a sinusoid over a field of `lit` mm, sampled at the centres of n x n pixels, and half of white.
pub fn sinusoids(lit: f64, n: usize, f_x: f64) -> Pattern {
    let mut stack = ImageStack::new(n, n);
    for k in 0..4 {
        let (f, phase) = if k == 3 { (0.0, 0.0) } else { (f_x, TAU * f64::from(k) / 3.0) };
        let mut info = LayerInfo::value("pattern", "1").with_f_x(f);
        info.phase_rad = Some(phase);
        info.orientation_deg = (k < 3).then_some(0.0);
        let value = |(_, column): (usize, usize)| {
            let x = lit * ((column as f64 + 0.5) / n as f64 - 0.5);
            let modulation = if k == 3 { 0.0 } else { (TAU * f_x * x + phase).cos() };
            (0.5 * (1.0 + modulation)) as f32
        };
        stack.push(info, Array2::from_shape_fn((n, n), value));
    }
    Pattern(stack)
}

/// Under images `auto` fits smooth surfaces, where they are sinusoids; under square waves, as under few paths that go where the error is, it is `path` bit for bit.
#[test]
fn auto_fits_surfaces_under_sinusoids_only() {
    let objects = vec![object(Shape::Slab { top: 0.0, bottom: -40.0 }, "m", 0)];
    let tissue = scene(&[("m", medium(0.05, 4.0, 0.8))], objects, rig(200.0, 20.0, 12.0, 16, 60.0));
    let pattern = sinusoids(60.0, 400, 0.05);
    let mut square = pattern.clone();
    for layer in &mut square.0.layers[..3] {
        layer.data.mapv_inplace(|v| f32::from(u8::from(v > 0.5)));
    }
    let shown = |pattern: &Pattern, method: &str, allocate: &str| {
        let params = json!({"samples": 64, "method": method, "allocate": allocate});
        show(&tissue, pattern, &params, 1).unwrap().remove("frames").unwrap()
    };
    let by_paths = shown(&pattern, "path", "even");
    assert_ne!(shown(&pattern, "auto", "even"), by_paths);
    assert_eq!(shown(&pattern, "auto", "even"), shown(&pattern, "fit", "even"));
    assert_eq!(shown(&pattern, "auto", "adaptive"), shown(&pattern, "path", "adaptive"));
    assert_eq!(shown(&square, "auto", "even").layers, shown(&square, "path", "even").layers);
}

/// Sampled sinusoids do what the projector's own do: on a Lambertian floor to (2 pi f pitch)^2 / 8 of linear interpolation, also
/// through a lens that distorts; below tissue within the noise, with the same standard errors.
#[test]
fn sampled_sinusoids_are_sinusoids() {
    let (lit, f_x, n) = (60.0, 0.05, 400);
    let pattern = sinusoids(lit, n, f_x);
    let interpolation = (TAU * f_x * lit / n as f64).powi(2) / 8.0;
    let params = json!({"f_x": [f_x, 0], "samples": 16});
    for distortion in [None, Some(Distortion { k1: 0.2, ..Distortion::default() })] {
        let (camera, mut projector) = rig(200.0, 20.0, 12.0, 3, lit);
        projector.distortion = distortion;
        let floor = scene(&[], vec![lambertian(FLOOR, 0.8)], (camera, projector));
        let (a, b) = (show(&floor, &pattern, &json!({"samples": 16}), 1).unwrap(), run(&floor, &params, 1));
        assert_eq!(a["white"], b["white"]);
        let full = f64::from(b["white"].layers[0].data[(1, 1)]);
        assert_eq!(a["frames"].layers.len(), b["frames"].layers.len());
        for (a, b) in a["frames"].layers.iter().zip(&b["frames"].layers) {
            assert_eq!((&a.info.name, a.info.f_x_per_mm), (&b.info.name, b.info.f_x_per_mm));
            for (x, y) in a.data.iter().zip(&b.data) {
                assert!(f64::from(x - y).abs() < full * (interpolation + 1e-6), "{:?}: {x} {y}", a.info);
            }
        }
    }
    let objects = vec![object(Shape::Slab { top: 0.0, bottom: -40.0 }, "m", 0)];
    let tissue = scene(&[("m", medium(0.05, 4.0, 0.8))], objects, rig(200.0, 20.0, 2.0, 1, lit));
    let a = show(&tissue, &pattern, &json!({"samples": 6000}), 1).unwrap();
    let b = run(&tissue, &json!({"f_x": [f_x, 0], "samples": 6000}), 2);
    let ((dc_a, m_a, se_a), (dc_b, m_b, se_b)) = (amplitude(&a, f_x), amplitude(&b, f_x));
    let z = (m_a - m_b) / f64::hypot(se_a, se_b);
    assert!(z.abs() < 4.5, "M_AC {m_a} +- {se_a}, {m_b} +- {se_b}");
    assert!((dc_a / dc_b - 1.0).abs() < 0.2, "{dc_a} {dc_b}");
    // Standard errors of 6000 paths with tails: a few percent each.
    assert!((se_a / se_b - 1.0).abs() < 0.25, "{se_a} {se_b}");
}

/// Fringes that are uniform along the wall of a bore, as images of three phases: fits to the wall are right, and their errors as those of carriers are (`surfaces.rs`); and the frames without a
/// fringe beside them are those of the same fit.
#[test]
fn fringes_along_a_wall_are_fitted() {
    let (scene, n, f_x) = (tube(), 400, 0.05);
    let mut stack = ImageStack::new(n, n);
    for k in 0..4 {
        let (f, phase) = if k == 3 { (0.0, 0.0) } else { (f_x, TAU * f64::from(k) / 3.0) };
        let mut info = LayerInfo::value("pattern", "1").with_f_x(f);
        info.phase_rad = Some(phase);
        let value = |(row, column): (usize, usize)| {
            let [x, y] = [column, row].map(|i| 20.0 * ((i as f64 + 0.5) / n as f64 - 0.5));
            // The ray by (x, y) on z = 0, from 100 mm above, meets the wall, 10 mm from the axis, as deep.
            let depth = 1000.0 / x.hypot(y).max(1.0) - 100.0;
            let modulation = if k == 3 { 0.0 } else { (TAU * f_x * depth + phase).cos() };
            (0.5 * (1.0 + modulation)) as f32
        };
        stack.push(info, Array2::from_shape_fn((n, n), value));
    }
    let pattern = Pattern(stack);
    let image = |method: &str, samples: u32, seed: u64| {
        let ports = show(&scene, &pattern, &json!({"samples": samples, "method": method}), seed).unwrap();
        let (fringe, even) = (&ports["frames"].layers[..6], &ports["frames"].layers[6]);
        let mean = |p: usize| (0..3).map(|k| fringe[2 * k].pixels()[p] / 3.0).sum::<f32>();
        // f32 values of some digits.
        assert!((0..576).all(|p| (even.pixels()[p] - mean(p)).abs() <= 1e-4 * mean(p)), "{method}");
        Image::of(&ports["frames"], &ports["covariance"])
    };
    for (k, c) in coverage_of(&image, 64, 12, 4096).iter().enumerate() {
        let (mean, sd, pixels) = (c.mean, c.sd, c.pixels);
        assert!((0.7..1.2).contains(&sd) && mean.abs() < 0.33, "{k}: mean {mean}, sd {sd}");
        assert!(pixels >= 120, "{pixels} of 576 pixels are fitted");
    }
}

/// Row 0 is the field's upper side, column 0 its left; layers without f_x are frames like others.
#[test]
fn pictures_stand_upright() {
    let n = 16;
    let mut stack = ImageStack::new(n, n);
    // Bright in the upper left quarter; a second layer dark but for the lower right one.
    stack.push(
        LayerInfo::value("pattern", "1"),
        Array2::from_shape_fn((n, n), |(r, c)| f32::from(u8::from(r < 8 && c < 8))),
    );
    stack.push(
        LayerInfo::value("pattern", "1"),
        Array2::from_shape_fn((n, n), |(r, c)| 0.25 * f32::from(u8::from(r >= 8 && c >= 8))),
    );
    let floor = scene(&[], vec![lambertian(FLOOR, 0.8)], rig(200.0, 20.0, 20.0, 4, 40.0));
    let frames = &show(&floor, &Pattern(stack), &json!({"samples": 4}), 1).unwrap()["frames"];
    let full = (0.8 * 5.0 / 1600.0 / PI) as f32;
    // The middle pixels touch the edges of the quarters.
    for (layer, place, share) in [(0, (0, 0), 1.0), (2, (3, 3), 0.25)] {
        for (row, column) in [(0, 0), (0, 3), (3, 0), (3, 3)] {
            let x = frames.layers[layer].data[(row, column)];
            let expected = if (row, column) == place { share * full } else { 0.0 };
            assert!((x - expected).abs() <= 1e-5 * full, "layer {layer} at ({row}, {column}): {x}, {expected}");
        }
    }
}

#[test]
fn wrong_patterns_are_named() {
    let floor = scene(&[], vec![lambertian(FLOOR, 0.8)], rig(200.0, 20.0, 20.0, 2, 40.0));
    let good = sinusoids(40.0, 8, 0.05);
    let said =
        |scene: &Scene, pattern: &Pattern, params: Value| show(scene, pattern, &params, 1).unwrap_err().to_string();
    let mut bright = good.clone();
    bright.0.layers[1].data[(2, 3)] = 1.5;
    let text = said(&floor, &bright, json!({"samples": 2}));
    assert!(text.contains("layer 1") && text.contains("1.5 at row 2, column 3") && text.contains("[0, 1]"), "{text}");
    let mut hole = good.clone();
    hole.0.layers[0].data[(0, 0)] = f32::NAN;
    assert!(said(&floor, &hole, json!({"samples": 2})).contains("NaN at row 0"));
    let text = said(&floor, &Pattern(ImageStack::new(8, 8)), json!({"samples": 2}));
    assert!(text.contains("no layers"), "{text}");
    for (f_x, words) in [(json!([0.05]), "4 layers"), (json!([0.04, 0]), "f_x = 0.04 mm^-1 at 0 deg asks for 3 frames")]
    {
        let text = said(&floor, &good, json!({"f_x": f_x, "samples": 2}));
        assert!(text.contains(words) && text.contains("the pattern says them"), "{text}");
    }
    assert!(show(&floor, &good, &json!({"f_x": [0, 0.05], "samples": 2}), 1).is_ok());
    let text = said(&floor, &sinusoids(40.0, 80, 0.06), json!({"samples": 2}));
    assert!(text.contains("f_x = 0.06 mm^-1 is beyond what the camera's pixels"), "{text}");
    let mut fine = floor.clone();
    fine.projector.as_mut().unwrap().pixels = Some([8, 9]);
    let text = said(&fine, &good, json!({"samples": 2}));
    assert!(text.contains("8 x 8 pixels, the projector has 8 x 9"), "{text}");
    let mut unlit = floor;
    unlit.projector = None;
    unlit.lights = [("sky".to_owned(), turbid_contract::payload::Lamp::Ambient { radiance: vec![1.0] })].into();
    let known = Known {
        artifacts: [("scene".to_owned(), turbid_contract::Shared::new(unlit.into_artifact()))].into(),
        connected: vec!["scene".to_owned(), "pattern".to_owned()],
        ..Known::default()
    };
    let mut problems = Problems::default();
    StageRow::of::<RenderStage>().check(&json!({"samples": 64}), &known, &mut problems);
    let found = problems.into_parts().0;
    assert!(found.len() == 1 && found[0].message.contains("no projector to show it"), "{found:?}");
}
