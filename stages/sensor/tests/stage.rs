//! The stage as the engine calls it: what it does to frames, their masks, standard errors and covariance.

use serde_json::{Value, json};
use turbid_contract::kit::Inputs;
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Covariance, Frames, MaskReason};
use turbid_contract::{Ctx, ImageStack, Known, LayerInfo, LayerKind, MemoryHost, Payload, Problems, StageRow};
use turbid_sensor::Sensor;

#[path = "stage/forms.rs"]
mod forms;

const N: usize = 64;
const PHASES: usize = 3;

/// A white frame and three of a fringe of contrast 0.4 on a slope from `low` to `high`; standard errors `se`.
fn frames(low: f32, high: f32, se: f32) -> Frames {
    let mut stack = ImageStack::new(N, N);
    let level = |row: usize| low + (high - low) * row as f32 / (N - 1) as f32;
    let mut errors = Vec::new();
    let mut push = |f_x: f64, phase: f64| {
        let mut info = LayerInfo::value("radiance", "W mm^-2 sr^-1").with_f_x(f_x);
        if f_x > 0.0 {
            (info.phase_rad, info.orientation_deg) = (Some(phase), Some(0.0));
        }
        let data = Array2::from_shape_fn((N, N), |(row, column)| {
            let turn = 2.0 * std::f64::consts::PI * f_x * column as f64 + phase;
            level(row) * if f_x > 0.0 { (1.0 + 0.4 * libm::cos(turn)) as f32 } else { 1.0 }
        });
        info.mean_se = (se > 0.0).then_some(f64::from(se) / N as f64);
        errors.push((info.standard_error(), Array2::from_elem((N, N), se)));
        stack.push(info, data);
    };
    push(0.0, 0.0);
    (0..PHASES).for_each(|k| push(0.1, 2.0 * std::f64::consts::PI * k as f64 / PHASES as f64));
    if se > 0.0 {
        errors.into_iter().for_each(|(info, data)| stack.push(info, data));
    }
    Frames(stack)
}

fn sense(params: &Value, inputs: Inputs, seed: u64) -> (ImageStack, Option<ImageStack>, MemoryHost) {
    let host = MemoryHost { seed, wanted: vec!["covariance".into()], ..MemoryHost::default() };
    let outputs = StageRow::of::<Sensor>().run(params, &inputs, Ctx::new(&host)).unwrap();
    let find = |port: &str| outputs.iter().find(|(name, _)| *name == port).map(|(_, artifact)| artifact.clone());
    let Frames(frames) = Frames::from_artifact(find("frames").unwrap()).unwrap();
    (frames, find("covariance").map(|a| Covariance::from_artifact(a).unwrap().0), host)
}

fn alone(frames: Frames) -> Inputs {
    Inputs::none().with("frames", frames)
}

/// A camera with nothing in it hands frames on; its layers say what theirs said.
#[test]
fn an_ideal_camera_is_transparent() {
    let ideal = frames(1e-6, 2e-6, 1e-8);
    let (seen, ..) = sense(&json!({"full_scale": 1e-5}), alone(ideal.clone()), 1);
    for (a, b) in ideal.0.layers.iter().zip(&seen.layers) {
        assert_eq!(a.info, b.info);
        // Once to a share of the range and back, in f64.
        assert!(a.data.iter().zip(&b.data).all(|(a, b)| (a / b - 1.0).abs() < 2e-7));
    }
}

/// Residuals of noisy frames against their own standard errors: sd 1 and none beyond 4.5, in every frame; a seed is a world.
#[test]
fn standard_errors_are_those_of_the_noise() {
    let params = json!({"full_scale": 4e-6, "full_well": 8000, "read_noise": 6, "black": 0.05, "bits": 10});
    let ideal = frames(1e-7, 2e-6, 0.0);
    let (seen, ..) = sense(&params, alone(ideal.clone()), 5);
    for k in 0..=PHASES {
        let (truth, value, se) = (&ideal.0.layers[k].data, &seen.layers[k].data, &seen.layers[PHASES + 1 + k].data);
        let z: Vec<f64> =
            (0..N * N).map(|i| (i / N, i % N)).map(|at| f64::from((value[at] - truth[at]) / se[at])).collect();
        let sd = (z.iter().map(|z| z * z).sum::<f64>() / z.len() as f64).sqrt();
        // 4096 pixels: the sampled sd is known to 1.1 %.
        assert!((sd - 1.0).abs() < 0.045 && z.iter().all(|z| z.abs() < 5.0), "frame {k}: {sd}");
        let mean: f64 = z.iter().sum::<f64>() / N as f64;
        assert!(mean.abs() < 4.0, "frame {k}: mean off by {mean} standard errors");
    }
    let again = sense(&params, alone(ideal.clone()), 5).0;
    assert_eq!(again, seen);
    assert_ne!(sense(&params, alone(ideal), 6).0.layers[0], seen.layers[0]);
}

/// The photon transfer curve: over even light from 0.1 to 65 % of the range, mean and variance of 4096 pixels in electrons are those of shot noise, read noise
/// and rounding, x W + r^2 + step^2 / 12. A sampled variance is known to sqrt(2 / 4095) = 2.2 %, the mean to 1 / 64 of a standard deviation; 4.5 of each.
#[test]
fn the_photon_transfer_curve_is_that_of_the_model() {
    let (well, read, black, bits) = (10_000.0, 5.0, 0.02, 12);
    let step = well / (1.0 - black) / f64::from((1 << bits) - 1);
    let params = json!({"full_scale": 1.0, "full_well": well, "read_noise": read, "black": black, "bits": bits});
    println!("level  electrons  variance  model");
    for level in [0.001, 0.01, 0.1, 0.3, 0.65] {
        let (seen, ..) = sense(&params, alone(frames(level, level, 0.0)), 3);
        let electrons: Vec<f64> = seen.layers[0].data.iter().map(|&v| f64::from(v) * well).collect();
        let n = electrons.len() as f64;
        let mean = electrons.iter().sum::<f64>() / n;
        let variance = electrons.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / (n - 1.0);
        let light = f64::from(level) * well;
        let model = light + read * read + step * step / 12.0;
        println!("{level:5}  {mean:9.2}  {variance:8.2}  {model:8.2}");
        assert!((variance / model - 1.0).abs() < 4.5 * (2.0 / (n - 1.0)).sqrt(), "{level}: {variance} for {model}");
        assert!((mean - light).abs() < 4.5 * (model / n).sqrt(), "{level}: {mean} for {light}");
    }
}

/// One clipped value spoils the sinusoid: the pixel is masked in all frames of its wavelength, and holds 0.
#[test]
fn saturated_pixels_are_masked() {
    let ideal = frames(1e-6, 2e-6, 1e-8);
    let (seen, covariance, host) = sense(&json!({"full_scale": 2e-6, "bits": 8}), alone(ideal.clone()), 1);
    let mask = seen.layers.last().unwrap();
    assert_eq!(mask.info.kind, LayerKind::Mask);
    let covariance = covariance.unwrap();
    let mut saturated = 0;
    for at in (0..N * N).map(|i| (i / N, i % N)) {
        // The last half step rounds up to full.
        let clipped = ideal.0.layers[..=PHASES].iter().any(|l| l.data[at] >= 2e-6 * (1.0 - 0.5 / 255.0));
        assert_eq!(mask.data[at], if clipped { MaskReason::Saturated.code() } else { 0.0 });
        if clipped {
            saturated += 1;
            assert!(seen.layers[..2 * (PHASES + 1)].iter().all(|l| l.data[at] == 0.0));
            assert!(covariance.layers.iter().all(|l| l.data[at] == 0.0));
        }
    }
    assert!(saturated > 0);
    let share = host.measures.lock().unwrap()["saturated"];
    assert!((share - 100.0 * f64::from(saturated) / (N * N) as f64).abs() < 1e-9);
    assert!(host.warnings.lock().unwrap()[0].contains("saturated in some frame"));
    // One stop less, and nothing saturates.
    let (dark, ..) = sense(&json!({"full_scale": 2e-6, "bits": 8, "exposure": -1}), alone(ideal), 1);
    assert!(dark.layers.iter().all(|l| l.info.kind != LayerKind::Mask));
}

/// Without a given covariance that of (dc, re, im) is white noise's: s^2/3, 2 s^2/3, 2 s^2/3; with one it is the given and the camera's own.
#[test]
fn covariance_adds_up() {
    let params = json!({"full_scale": 4e-6, "full_well": 8000});
    let se = 3e-8;
    let flat = || frames(1e-6, 1e-6, se);
    let (_, covariance, _) = sense(&params, alone(flat()), 1);
    let covariance = covariance.unwrap();
    assert_eq!(covariance.attributes["quantities"].as_array().unwrap().len(), 4);
    let at = |stack: &ImageStack, pair: [u32; 2]| {
        f64::from(stack.layers.iter().find(|l| l.info.pair == Some(pair)).unwrap().data[(3, 3)])
    };
    // Shot noise of the three frames at that pixel: variance = light x full scale / full well.
    let light: Vec<f64> = flat().0.layers[1..=PHASES].iter().map(|l| f64::from(l.data[(3, 3)])).collect();
    let shot: Vec<f64> = light.iter().map(|l| l * 4e-6 / 8000.0).collect();
    let own = f64::from(se) * f64::from(se);
    let dc = shot.iter().map(|s| s + own).sum::<f64>() / 9.0;
    assert!((at(&covariance, [1, 1]) / dc - 1.0).abs() < 1e-6);
    let re: f64 = (0..PHASES)
        .map(|k| {
            let weight = 2.0 / 3.0 * libm::cos(2.0 * std::f64::consts::PI * k as f64 / PHASES as f64);
            weight * weight * (shot[k] + own)
        })
        .sum();
    assert!((at(&covariance, [2, 2]) / re - 1.0).abs() < 1e-6);
    assert_eq!(at(&covariance, [0, 1]), 0.0);
    // The render's covariance knows one M_DC; two fringes share it.
    let mut given = ImageStack::new(N, N);
    for (i, j) in (0..3_u32).flat_map(|i| (i..3).map(move |j| (i, j))) {
        let mut info = LayerInfo::new("cov", LayerKind::Covariance, "W^2 mm^-4 sr^-2");
        info.pair = Some([i, j]);
        given.push(info, Array2::from_elem((N, N), 1e-14 * (1.0 + (i + 3 * j) as f32)));
    }
    let part = |part: &str, f_x: f64| json!({"part": part, "f_x_per_mm": f_x, "orientation_deg": 0.0});
    let listed = json!([part("dc", 0.0), part("re", 0.1), part("im", 0.1)]);
    given.attributes.insert("quantities".into(), listed);
    let inputs = Inputs::none().with("frames", flat()).with("covariance", Covariance(given));
    let covariance = sense(&params, inputs, 1).1.unwrap();
    let shot_dc = shot.iter().sum::<f64>() / 9.0;
    assert!((at(&covariance, [1, 1]) / (1e-14 + shot_dc) - 1.0).abs() < 1e-6);
    // M_DC of the white frame against re: the given alone, 1 + 3 of it.
    assert!((at(&covariance, [0, 2]) / 4e-14 - 1.0).abs() < 1e-6);
}

/// Vignetting and pixels unlike each other: a dark field and a flat field of the same camera take them out, whatever the frame;
/// what is left is noise. The numbers are what the camera writes, saturated pixels included.
#[test]
fn dark_and_flat_fields_undo_the_pixels() {
    let camera = |more: Value| {
        let mut params = json!({
            "full_scale": 4e-6, "black": 0.05, "bits": 16, "full_well": 1e9,
            "vignetting": 0.3, "response_spread": 0.02, "dark_spread": 0.004
        });
        params.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        params
    };
    let read = |params: &Value, ideal: Frames, seed: u64| {
        let host = MemoryHost { seed, wanted: vec!["numbers".into()], ..MemoryHost::default() };
        let outputs = StageRow::of::<Sensor>().run(params, &alone(ideal), Ctx::new(&host)).unwrap();
        let numbers = outputs.into_iter().find(|(name, _)| *name == "numbers").unwrap().1;
        Frames::from_artifact(numbers).unwrap().0.layers[0].data.clone()
    };
    let ideal = frames(5e-7, 2e-6, 0.0);
    let frame = read(&camera(json!({})), ideal.clone(), 1);
    // 2^-30 of the light is none.
    let dark = read(&camera(json!({"exposure": -30})), ideal.clone(), 2);
    let flat = read(&camera(json!({})), frames(3e-6, 3e-6, 0.0), 3);
    assert!(frame.iter().all(|v| v.fract() == 0.0));
    let (mut raw, mut squares, mut worst) = (0.0_f64, 0.0, 0.0_f64);
    let range = 0.95 * 65535.0;
    for at in (0..N * N).map(|i| (i / N, i % N)) {
        let truth = f64::from(ideal.0.layers[0].data[at]);
        let above = |image: &Array2<f32>| f64::from(image[at] - dark[at]);
        let found = above(&frame) / above(&flat) * 3e-6;
        // Relative variance of a difference to the dark field: electrons, and two numbers rounded.
        let noise = |image: &Array2<f32>| {
            let light = above(image) / range;
            (light / 1e9 + 2.0 / 12.0 / (range * range)) / (light * light)
        };
        let z = (found / truth - 1.0) / (noise(&frame) + noise(&flat)).sqrt();
        (squares, worst) = (squares + z * z, worst.max(z.abs()));
        raw = raw.max((above(&frame) / range * 4e-6 / truth - 1.0).abs());
    }
    let sd = (squares / (N * N) as f64).sqrt();
    // The sampled sd of 4096 pixels is known to 1.1 %.
    assert!(raw > 0.3 && (sd - 1.0).abs() < 0.055 && worst < 4.5, "raw {raw}, sd {sd}, worst {worst}");
    let other = read(&camera(json!({"exposure": -30, "camera": 7})), ideal.clone(), 2);
    assert_ne!(other, dark);
    let bright = read(&camera(json!({"exposure": 4})), ideal, 1);
    assert!(bright.iter().all(|&v| v <= 65535.0) && bright.iter().any(|&v| v == 65535.0));
}

#[test]
fn every_mistake_has_its_field() {
    for (params, message) in [
        (json!({"bits": 0}), "bits: bits = 0 bits must lie in [1, 24]"),
        (json!({"gamma": 0}), "gamma: gamma = 0 must lie in [0.1, 10]"),
        (json!({"black": 1}), "black: black = 1 must lie in [0, 0.9]"),
        (json!({"full_scale": 0}), "full_scale: full_scale = 0 W mm^-2 sr^-1 must be a finite number > 0"),
        (json!({"read_noise": 3}), "how many fill the range is not given"),
        (json!({"exposure": 99}), "exposure: exposure = 99 stops must lie in [-30, 30]"),
        (json!({"vignetting": 1}), "vignetting: vignetting = 1 must lie in [0, 0.99]"),
        (json!({"iso": 100}), "iso: there is no key `iso` here (known: `exposure`"),
    ] {
        let mut problems = Problems::default();
        StageRow::of::<Sensor>().check(&params, &Known::default(), &mut problems);
        let found: Vec<String> = problems.into_parts().0.iter().map(ToString::to_string).collect();
        assert!(found.iter().any(|p| p.contains(message)), "{params}: {found:?}");
    }
    let host = MemoryHost::default();
    let dark = StageRow::of::<Sensor>().run(&json!({}), &alone(frames(0.0, 0.0, 0.0)), Ctx::new(&host));
    assert!(dark.unwrap_err().to_string().contains("no pixel is above 0"));
}

/// What an ideal frame does not know of its noise the camera does not know either: the flag stays with its pixel, and under defocus goes to those of which it
/// makes more than a tenth. A saturated pixel has no flag, as it has no value.
#[test]
fn unknown_errors_are_passed_on() {
    let mut ideal = frames(1e-6, 2e-6, 1e-8);
    let info = ideal.0.layers[2].info.clone();
    let mut flags = Array2::zeros((N, N));
    (flags[(5, 6)], flags[(60, 7)]) = (1.0, 1.0);
    ideal.0.push(info.se_unknown(), flags.clone());
    ideal.0.layers[2].data[(60, 7)] = 1.0;
    let flagged = |params: Value| {
        let (seen, ..) = sense(&params, alone(ideal.clone()), 1);
        let values = seen.layers.iter().filter(|l| l.info.kind == LayerKind::Value);
        let found: Vec<_> = values.filter_map(|l| seen.se_unknown(&l.info)).collect();
        assert_eq!(found.len(), 1, "of one frame only");
        (found[0].data.clone(), seen.se_unknown(&seen.layers[2].info).is_some())
    };
    flags[(60, 7)] = 0.0;
    assert_eq!(flagged(json!({"full_scale": 1e-5, "bits": 12})), (flags, true));
    let (blurred, _) = flagged(json!({"full_scale": 1e-5, "defocus_px": 0.7}));
    let count = blurred.sum();
    assert!(blurred[(5, 6)] == 1.0 && (2.0..=9.0).contains(&count), "{count} pixels");
}
