//! Steady lights by closed forms, and against the projector that does the same.

use std::f64::consts::PI;

use serde_json::json;
use turbid_contract::payload::{Lamp, Profile, Scene, Shape};
use turbid_contract::{Known, LayerKind, Problems, StageRow};
use turbid_render::RenderStage;

use crate::setup::*;

fn lit_by(mut scene: Scene, lights: &[Lamp]) -> Scene {
    scene.projector = None;
    scene.lights = lights.iter().enumerate().map(|(i, lamp)| (format!("l{i}"), lamp.clone())).collect();
    scene
}

fn tiny_view() -> Scene {
    scene(&[], vec![lambertian(FLOOR, 0.7)], rig(300.0, 0.0, 0.001, 1, 100.0))
}

/// rho E / pi with E = I cos / d^2 below a point or in a cone (nothing beside it), E = P / A cos in a beam; all paths score the
/// same. Several lights add up, whole in every frame beside the half or the fringe of the projector.
#[test]
fn a_lambertian_plane_under_each_light() {
    let position = [30.0, -40.0, 120.0];
    // cos = 120 / 130.
    let (cos, d2) = (120.0 / 130.0, 130.0 * 130.0);
    let omega = 2.0 * PI * (1.0 - (10f64).to_radians().cos());
    let spot = |look_at, power| Lamp::Spot { position, look_at, angle_deg: 20.0, power: vec![power] };
    let beam = |look_at| Lamp::Collimated { position, look_at, diameter: 8.0, power: vec![3.0] };
    let cases = [
        (Lamp::Point { position, power: vec![2.0] }, 2.0 / (4.0 * PI) * cos / d2),
        // Its axis 9 degrees beside the point seen, then 11.
        (
            spot([130.0 * (9f64).to_radians().tan() * 0.8, 130.0 * (9f64).to_radians().tan() * 0.6, 0.0], 2.0),
            2.0 / omega * cos / d2,
        ),
        (spot([130.0 * (11f64).to_radians().tan() * 0.8, 130.0 * (11f64).to_radians().tan() * 0.6, 0.0], 2.0), 0.0),
        (beam([0.0; 3]), 3.0 / (16.0 * PI) * cos),
        (beam([4.5, 0.0, 0.0]), 0.0),
    ];
    let (mut lamps, mut sum) = (Vec::new(), 0.0);
    for (lamp, e) in cases {
        let (mean, se) = dc(&lit_by(tiny_view(), std::slice::from_ref(&lamp)), 8, 1);
        let expected = 0.7 * e / PI;
        // 1 um of pixel, f32.
        assert!((mean - expected).abs() <= 2e-5 * expected, "{lamp:?}: {mean}, {expected}");
        assert!(se <= 1e-5 * expected, "{lamp:?}: {se}");
        sum += expected;
        lamps.push(lamp);
    }
    let projected = 0.7 * 5.0 / 1e4 / PI;
    let mut both = lit_by(tiny_view(), &lamps);
    both.projector = tiny_view().projector;
    let ports = run(&both, &json!({"f_x": [0, 0.1], "phases": 4, "samples": 8}), 1);
    for layer in ports["frames"].layers.iter().filter(|l| l.info.name == "radiance") {
        let phase = layer.info.phase_rad.unwrap();
        let pattern = if layer.info.f_x_per_mm == Some(0.0) { 0.5 } else { 0.5 * (1.0 + phase.cos()) };
        let expected = pattern * projected + sum;
        let seen = f64::from(layer.data[(0, 0)]);
        // The fringe turns by 3e-4 over half the pixel.
        assert!((seen - expected).abs() < 4e-4 * projected + 2e-5 * sum, "{:?}: {seen}, {expected}", layer.info);
    }
    let white = f64::from(ports["white"].layers[0].data[(0, 0)]);
    assert!((white / (projected + sum) - 1.0).abs() < 2e-5);
    // Every frame's standard error follows from the covariance of all responses; here there is none to speak of.
    let se = ports["frames"].find("radiance_se", Some(0.1)).unwrap().data[(0, 0)];
    assert!(f64::from(se) < 4e-4 * projected);
}

/// Where nothing absorbs, light from all sides looks the same everywhere: exactly, path by path, whatever scatters.
#[test]
fn a_white_furnace_is_even() {
    let media = [("milk", medium(0.0, 3.0, 0.8)), ("fog", medium(0.0, 0.2, -0.5))];
    let objects = vec![
        object(Shape::Slab { top: 0.0, bottom: -2.0 }, "milk", 0),
        object(Shape::Sphere { diameter: 3.0, center: [2.0, 1.0, -1.0] }, "fog", 1),
        lambertian(Shape::Box { size: [2.0, 2.0, 3.0], center: [-2.0, -2.0, 1.6] }, 1.0),
    ];
    let furnace =
        lit_by(scene(&media, objects, rig(60.0, 0.0, 12.0, 6, 40.0)), &[Lamp::Ambient { radiance: vec![0.25] }]);
    let ports = run(&furnace, &json!({"f_x": [0], "samples": 16}), 3);
    let images = ports["frames"].layers.iter().filter(|layer| layer.info.kind != LayerKind::Condition);
    for layer in images {
        let expected = if layer.info.name == "radiance" { 0.25 } else { 0.0 };
        assert!(layer.data.iter().all(|&x| x == expected), "{:?}: {:?}", layer.info, layer.data);
    }
}

/// Seen through an absorber, the sky is dimmed by exp(-mu_a d); a grey floor shows rho times it.
#[test]
fn the_sky_through_an_absorber() {
    let ambient = [Lamp::Ambient { radiance: vec![2.0] }];
    let slab = object(Shape::Slab { top: 0.0, bottom: -3.0 }, "dye", 0);
    let view = rig(1000.0, 0.0, 0.001, 1, 100.0);
    let dimmed = lit_by(scene(&[("dye", medium(0.2, 0.0, 0.0))], vec![slab], view.clone()), &ambient);
    let floor = lit_by(scene(&[], vec![lambertian(FLOOR, 0.7)], view), &ambient);
    for (scene, share) in [(dimmed, (-0.6f64).exp()), (floor, 0.7)] {
        let (mean, se) = dc(&scene, 40_000, 1);
        assert!((mean - 2.0 * share).abs() < 4.5 * se + 1e-6, "{mean} +- {se}, {}", 2.0 * share);
        // Paths live or die: the variance is that of a coin.
        let coin = 2.0 * (share * (1.0 - share) / 40_000.0).sqrt();
        assert!((se / coin - 1.0).abs() < 0.05, "{se} {coin}");
    }
}

/// A cone that covers the view from the projector's place, and a beam from where a distant flat projector stands, show what the
/// projector does: z over all pixels, in turbid scenes with two bodies, by the queue and one by one.
#[test]
fn lamps_do_what_the_projector_does() {
    let media = [("m", medium(0.05, 4.0, 0.8)), ("core", medium(0.4, 3.0, 0.5)), ("pale", medium(0.002, 6.0, 0.6))];
    let slab = |m| object(Shape::Slab { top: 0.0, bottom: -50.0 }, m, 0);
    let ball = || object(Shape::Sphere { diameter: 4.0, center: [1.0, 0.0, -0.5] }, "core", 1);
    let block = || lambertian(Shape::Box { size: [2.0, 2.0, 1.0], center: [-2.0, 1.0, 0.5] }, 0.7);
    let mut scores = Vec::new();
    for objects in [vec![slab("m"), ball()], vec![slab("pale")], vec![slab("m"), ball(), block()]] {
        for far in [false, true] {
            let (camera, mut projector) = rig(60.0, 20.0, 8.0, 4, 60.0);
            let lamp = if far {
                projector.position = [0.0, 1e6, 2e6];
                projector.field = [600.0; 2];
                projector.power = vec![3.6e5];
                // 1 W mm^-2 on the plane, by a beam 600 mm across it.
                let cos = 2.0 / 5f64.sqrt();
                let power = PI * 300.0 * 300.0 / cos;
                Lamp::Collimated {
                    position: [0.0, 500.0, 1000.0],
                    look_at: [0.0; 3],
                    diameter: 600.0,
                    power: vec![power],
                }
            } else {
                projector.profile = Profile::UniformIntensity;
                let p = projector.position;
                let omega = solid_angle(60.0, 20.0, 60.0);
                // All that the field holds and more; the light beside the field reaches no pixel within the noise.
                let power = 5.0 / omega * 4.0 * PI;
                Lamp::Point { position: p, power: vec![power] }
            };
            // Nothing outside the field: a black frame lets the point light through where the projector shines.
            let projected = scene(&media, objects.clone(), (camera, projector));
            let lamp = lit_by(projected.clone(), &[lamp]);
            let samples = 1500;
            // Other seeds for every scene: the same paths would make the scores of scenes alike.
            let seed = scores.len() as u64;
            let a = run(&projected, &json!({"f_x": [0], "samples": samples}), seed + 1);
            let b = run(&lamp, &json!({"f_x": [0], "samples": samples}), seed + 2);
            let layer =
                |ports: &std::collections::BTreeMap<&'static str, turbid_contract::ImageStack>,
                 port: &str,
                 name: &str| { ports[port].find(name, None).unwrap().data.mapv(f64::from) };
            let (a, a_se) = (layer(&a, "white", "radiance"), layer(&a, "white", "radiance_se"));
            let (b, b_se) = (layer(&b, "frames", "radiance"), layer(&b, "frames", "radiance_se"));
            scores.extend((0..16).map(|i| {
                let i = (i / 4, i % 4);
                (a[i] - b[i]) / f64::hypot(a_se[i], b_se[i])
            }));
        }
    }
    let n = scores.len() as f64;
    let mean = scores.iter().sum::<f64>() / n;
    let rms = (scores.iter().map(|z| z * z).sum::<f64>() / n).sqrt();
    let worst = scores.iter().fold(0.0, |w: f64, z| w.max(z.abs()));
    // 96 independent pixels: the mean spreads by 0.1, the rms by 0.07.
    assert!(
        mean.abs() < 0.4 && (0.75..1.3).contains(&rms) && worst < 4.5,
        "mean {mean}, rms {rms}, worst {worst}: {scores:?}"
    );
}

/// Of a square field seen from `h` above and `off` beside its middle, by Simpson on 60 x 60 steps.
fn solid_angle(side: f64, off: f64, h: f64) -> f64 {
    let n = 60;
    let weight = |i: i32| if i == 0 || i == n { 1.0 } else { f64::from(2 + 2 * (i % 2)) };
    let at = |i: i32| side * (f64::from(i) / f64::from(n) - 0.5);
    let cells = (0..=n).flat_map(|i| (0..=n).map(move |j| (i, j)));
    cells
        .map(|(i, j)| {
            let r2 = at(i).powi(2) + (at(j) - off).powi(2) + h * h;
            weight(i) * weight(j) * (side / f64::from(n) / 3.0).powi(2) * h / r2.powf(1.5)
        })
        .sum()
}

/// Without a projector there is no pattern, and without any light nothing to see.
#[test]
fn scenes_without_a_projector() {
    let said = |scene: &Scene, f_x: f64| {
        let mut problems = Problems::default();
        let artifact = turbid_contract::Payload::into_artifact(scene.clone());
        let known = Known::with("scene", artifact);
        StageRow::of::<RenderStage>().check(&json!({"f_x": [f_x], "samples": 64}), &known, &mut problems);
        problems.into_parts().0
    };
    let lamp = lit_by(tiny_view(), &[Lamp::Ambient { radiance: vec![1.0] }]);
    assert!(said(&lamp, 0.0).is_empty());
    let fringes = said(&lamp, 0.1);
    assert!(
        fringes.len() == 1 && fringes[0].path == "f_x.0" && fringes[0].message.contains("no projector"),
        "{fringes:?}"
    );
    let dark = said(&lit_by(tiny_view(), &[]), 0.0);
    assert!(dark.len() == 1 && dark[0].message.contains("all would be dark"), "{dark:?}");
}
