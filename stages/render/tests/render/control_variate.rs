//! Control variates and differences from them against every pixel by its own paths.

use serde_json::json;
use turbid_contract::payload::{Medium, Object, Scene, Shape, Specular, Surface};
use turbid_contract::{ImageStack, LayerKind};

use crate::setup::*;

const SIDE: u32 = 16;

/// Over every pixel, rim and straddling ones too, the image with control variates equals the one without within noise: the rms of z over
/// 256 pixels of four correlated layers is 1 +- 0.1, none is above 4.5 and the mean within 0.2 (its sigma is below 0.07, and skewed noise shifts it by 0.06); and
/// there is less noise. Frames at f_x = 0 and 0.1.
#[test]
fn differences_from_control_variates_are_unbiased() {
    let ball = |z: f64, r: f64| Shape::Sphere { diameter: 2.0 * r, center: [0.3, 0.1, z] };
    let lid = object(Shape::Box { size: [18.0, 18.0, 9.0], center: [0.0, 0.0, 4.5] }, "air", 2);
    // The last is absorbed so weakly that deep paths are roulettes.
    for (name, extra, mu_a, n, gain) in [
        ("dome", vec![object(ball(0.0, 1.5), "core", 1)], 0.05, 1.0, 1.5),
        ("flush", vec![object(ball(0.0, 3.0), "core", 1), lid], 0.05, 1.0, 2.0),
        ("buried", vec![object(ball(-2.5, 2.0), "core", 1)], 0.05, 1.0, 2.0),
        ("pale, buried", vec![object(ball(-2.5, 2.0), "core", 1)], 0.002, 1.0, 1.2),
        ("wet, buried", vec![object(ball(-2.5, 2.0), "core", 1)], 0.05, 1.4, 1.5),
    ] {
        let of = |mu_a, mu_s| Medium { n, ..medium(mu_a, mu_s, 0.8) };
        let media = [("m", of(mu_a, 2.5)), ("core", of(0.2, 4.0)), ("air", medium(0.0, 0.0, 0.0))];
        let objects = [vec![object(FLOOR, "m", 0)], extra].concat();
        let (mut camera, projector) = rig(200.0, 20.0, 12.0, SIDE, 300.0);
        camera.specular = Some(Specular::Exclude);
        let scene = scene(&media, objects, (camera, projector));
        let render = |method: &str, seed: u64| {
            let params = json!({"f_x": [0, 0.1], "samples": 1024, "method": method});
            run(&scene, &params, seed).remove("frames").unwrap()
        };
        let (with_control, alone) = (render("auto", 1), render("path", 2));
        assert!(with_control.attributes.contains_key("sharing"), "{name}: a stand-in was taken");
        let (mut scores, mut variances) = (Vec::new(), [0.0; 2]);
        for (a, b) in layers(&with_control).zip(layers(&alone)) {
            for (at, &value) in a.0.indexed_iter() {
                let of = |x: f32| f64::from(x) * f64::from(x);
                variances = [variances[0] + of(a.1[at]), variances[1] + of(b.1[at])];
                scores.push(f64::from(value - b.0[at]) / (of(a.1[at]) + of(b.1[at])).sqrt());
            }
        }
        let n = scores.len() as f64;
        let mean = scores.iter().sum::<f64>() / n;
        let rms = (scores.iter().map(|z| z * z).sum::<f64>() / n).sqrt();
        let worst = scores.iter().fold(0.0, |worst: f64, z| worst.max(z.abs()));
        println!("{name}: z {mean:.3}, {rms:.3}, {worst:.2}; variance / {:.1}", variances[1] / variances[0]);
        assert!(mean.abs() < 0.2 && (rms - 1.0).abs() < 0.1 && worst < 4.5, "{name}: z {mean} {rms} {worst}");
        assert!(variances[1] > gain * variances[0], "{name}: {variances:?}");
    }
}

/// Where most pixels see a rough dome, which has no control variate and no fit, those of the others are not worth their time: the image is that of paths alone,
/// bit for bit. At a smaller dome they are where paths go to where the error is: what is saved beside it goes to the dome.
#[test]
fn control_variates_are_taken_where_they_pay() {
    let media = [("m", medium(0.05, 2.5, 0.8)), ("core", Medium { n: 1.1, ..medium(0.2, 4.0, 0.8) })];
    let dome = |diameter: f64, surface: Surface| {
        let ball = Object { surface, ..object(Shape::Sphere { diameter, center: [0.0; 3] }, "core", 1) };
        scene(&media, vec![object(FLOOR, "m", 0), ball], rig(200.0, 20.0, 16.0, 24, 300.0))
    };
    let render = |scene: &Scene, method: &str, allocate: &str| {
        let host = MemoryHost::new(1, &[], 2);
        let params = json!({"f_x": [0, 0.1], "samples": 256, "method": method, "allocate": allocate});
        let frames = run_on(&host, scene, &params).unwrap().remove("frames").unwrap();
        let measures = host.measures.lock().unwrap();
        (frames, measures["flights"], measures["error: m_ac per pixel, 95th percentile"])
    };
    let large = dome(15.0, Surface::Rough(0.4));
    let (alone, flights, _) = render(&large, "path", "even");
    let (with_control, with_pilot, _) = render(&large, "auto", "even");
    assert!(with_control == alone, "the pilot must not show");
    // Of 256 paths 16 are walked in control variates, too, by a third of the pixels.
    assert!(with_pilot > flights && with_pilot < 1.06 * flights, "{with_pilot}, {flights}");
    let [alone, with_control] = ["path", "auto"].map(|method| render(&dome(5.0, Surface::Smooth), method, "adaptive"));
    println!(
        "adaptive, flights and error: alone {:?}, beside {:?}",
        (alone.1, alone.2),
        (with_control.1, with_control.2)
    );
    assert!(with_control.0.attributes.contains_key("sharing"));
    assert!(with_control.1 * with_control.2 * with_control.2 < alone.1 * alone.2 * alone.2);
}

/// Standard errors of differences against the spread over 60 seeds, near and far from what makes the difference: pooled over all pixels
/// their ratio is 1 (a sampled deviation over 60 seeds of 144 pixels and four layers of half as many independent ones is
/// known to 1 %; rare events and the choice by neighbours are allowed 8 %).
#[test]
fn errors_of_differences_are_the_spread() {
    let media = [("m", medium(0.05, 2.5, 0.8)), ("core", medium(0.2, 4.0, 0.8))];
    let core = object(Shape::Sphere { diameter: 3.0, center: [1.0, 0.5, -2.5] }, "core", 1);
    let scene: Scene = scene(&media, vec![object(FLOOR, "m", 0), core], rig(200.0, 20.0, 12.0, 12, 300.0));
    let params = json!({"f_x": [0, 0.1], "samples": 128, "method": "auto"});
    let seeds = 60;
    let images: Vec<ImageStack> = (0..seeds).map(|s| run(&scene, &params, s).remove("frames").unwrap()).collect();
    let (mut spread, mut stated) = (0.0, 0.0);
    for layer in 0..layers(&images[0]).count() {
        let of: Vec<_> = images.iter().map(|stack| layers(stack).nth(layer).unwrap()).collect();
        for at in (0..12).flat_map(|r| (0..12).map(move |c| (r, c))) {
            let values: Vec<f64> = of.iter().map(|l| f64::from(l.0[at])).collect();
            let mean = values.iter().sum::<f64>() / seeds as f64;
            let scale = mean * mean;
            spread += values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (seeds - 1) as f64 / scale;
            stated += of.iter().map(|l| f64::from(l.1[at]).powi(2)).sum::<f64>() / seeds as f64 / scale;
        }
    }
    let ratio = (stated / spread).sqrt();
    println!("stated / spread {ratio:.3}");
    assert!((ratio - 1.0).abs() < 0.08, "stated standard errors are {ratio} times the spread");
}

type Plane = turbid_contract::ndarray::Array2<f32>;

/// Radiance layers, with their standard errors.
fn layers(stack: &ImageStack) -> impl Iterator<Item = (&Plane, &Plane)> {
    let pairs = stack.layers.windows(2).filter(|w| w[0].info.kind == LayerKind::Value);
    pairs.map(|w| (&w[0].data, &w[1].data))
}
