//! Textured surfaces by closed forms: places on every shape, area means, the truth layer.

use std::f64::consts::{FRAC_PI_2, PI};

use turbid_contract::payload::{Lamp, Motif, Object, Picture, Profile, Scene, Shape, Surface, Texture};

use crate::setup::*;

fn textured(shape: Shape, motif: Motif, origin: [f64; 2]) -> Object {
    painted(shape, Texture { low: 0.1, high: 0.9, origin, motif })
}

fn painted(shape: Shape, texture: Texture) -> Object {
    Object { shape, medium: None, priority: 0, surface: Surface::Textured(texture) }
}

/// A camera at `from` that sees a micrometre around `target`, and a lamp beside it.
fn looking_at(object: Object, from: [f64; 3], target: [f64; 3], lamp: [f64; 3]) -> Scene {
    let (mut camera, projector) = rig(10.0, 0.0, 1e-3, 1, 10.0);
    (camera.position, camera.look_at) = (from, target);
    let mut scene = scene(&[], vec![object], (camera, projector));
    scene.projector = None;
    scene.lights = [("lamp".to_owned(), Lamp::Point { position: lamp, power: vec![4.0 * PI] })].into();
    scene
}

/// rho(u, v) cos / (pi d^2) under a point light of 1 W/sr, at places whose surface coordinates are known by hand: radiance and truth. A
/// micrometre of pixel turns waves of 2 mm by 3e-3 rad over half of it, and surfaces as dark as 1e-5 light each other in a bore by no more than 1e-3 of it.
#[test]
fn each_shape_under_a_point_light() {
    let wave = |orientation_deg| Motif::Sinusoid { period: 2.0, orientation_deg };
    let (low, high) = (1e-6, 9e-6);
    let rho = |s: f64| low + (high - low) * 0.5 * (1.0 + (PI * s).cos());
    let tube = Shape::Tube { inner_diameter: 20.0, outer_diameter: 30.0, top: 0.0, bottom: -100.0, center: [1.0, 2.0] };
    let ball = Shape::Sphere { diameter: 10.0, center: [1.0, 0.0, 0.0] };
    let upright = Shape::Cylinder { diameter: 8.0, length: 6.0, center: [0.0, 0.0, 1.0], axis: [0.0, 0.0, 1.0] };
    let (s, c) = (0.6f64, 0.8f64);
    // Shape, wave, from where, the place, its normal, s there.
    let cases = [
        (FLOOR, 0.0, [3.0, 4.0, 50.0], [1.3, -2.0, 0.0], [0.0, 0.0, 1.0], 1.3),
        (FLOOR, 90.0, [3.0, 4.0, 50.0], [1.3, -2.4, 0.0], [0.0, 0.0, 1.0], -2.4),
        // Down the bore: u from its mouth, v = radius x azimuth.
        (tube.clone(), 0.0, [1.0, 2.0, 40.0], [11.0, 2.0, -30.3], [-1.0, 0.0, 0.0], 30.3),
        (tube, 90.0, [1.0, 2.0, 40.0], [1.0 + 10.0 * c, 2.0 + 10.0 * s, -30.3], [-c, -s, 0.0], 10.0 * s.atan2(c)),
        // 60 degrees from the pole; a quarter around.
        (
            ball.clone(),
            0.0,
            [40.0, 0.0, 30.0],
            [1.0 + 5.0 * (PI / 6.0).cos(), 0.0, 2.5],
            [(PI / 6.0).cos(), 0.0, 0.5],
            5.0 * PI / 3.0,
        ),
        (ball, 90.0, [5.0, 6.0, 30.0], [1.0, 5.0 * c, 5.0 * s], [0.0, c, s], 5.0 * FRAC_PI_2),
        // Its upper end: x and y.
        (upright, 45.0, [2.0, 2.0, 30.0], [1.5, 0.7, 4.0], [0.0, 0.0, 1.0], 2.2 * 0.5f64.sqrt()),
        (
            Shape::Box { size: [4.0, 6.0, 8.0], center: [0.0, 1.0, 0.0] },
            0.0,
            [40.0, 9.0, 5.0],
            [2.0, 2.3, -1.0],
            [1.0, 0.0, 0.0],
            2.3,
        ),
    ];
    for (shape, orientation, from, target, normal, at) in cases {
        let lamp: [f64; 3] = std::array::from_fn(|i| 0.5 * (from[i] + target[i]) + [0.3, -0.2, 0.1][i]);
        let texture = Texture { low, high, origin: [0.25, 0.0], motif: wave(orientation) };
        let scene = looking_at(painted(shape.clone(), texture), from, target, lamp);
        let to_lamp: [f64; 3] = std::array::from_fn(|i| lamp[i] - target[i]);
        let d2: f64 = to_lamp.iter().map(|x| x * x).sum();
        let cos = to_lamp.iter().zip(normal).map(|(a, b)| a * b).sum::<f64>() / d2.sqrt();
        // The origin counts along s, too.
        let rho = rho(at - 0.25 * f64::to_radians(orientation).cos());
        let expected = rho * cos / (PI * d2);
        let ports = run(&scene, &serde_json::json!({"f_x": [0], "samples": 8}), 1);
        let radiance = f64::from(ports["frames"].find("radiance", Some(0.0)).unwrap().data[(0, 0)]);
        assert!(
            (radiance - expected).abs() < 4e-3 * high * cos / (PI * d2),
            "{shape:?} {target:?}: {radiance} {expected}"
        );
        let truth = f64::from(ports["truth"].find("albedo", None).unwrap().data[(0, 0)]);
        assert!((truth - rho).abs() < 1e-6 * high, "{shape:?} {target:?}: {truth} {rho}");
    }
}

/// Over whole periods the image has the mean of the pattern, times E / 2 pi of the flat field at half the pattern: a checker, and a
/// picture that is repeated. 4 standard errors; pixel by pixel the truth is the albedo at the centre.
#[test]
fn area_means_and_truth() {
    let grey: Vec<u16> = (0..12).map(|i| 5000 * i).collect();
    let mean = grey.iter().map(|&g| f64::from(g) / 65535.0).sum::<f64>() / 12.0;
    let picture = Motif::Image { picture: Picture { columns: 4, rows: 3, grey }, size: Some([4.0, 3.0]) };
    for (motif, mean) in [(Motif::Checker { side: 1.0 }, 0.5), (picture, mean)] {
        let (camera, mut projector) = rig(500.0, 20.0, 12.0, 36, 100.0);
        projector.profile = Profile::Flat;
        let scene = scene(&[], vec![textured(FLOOR, motif.clone(), [0.0, 0.0])], (camera, projector));
        let ports = run(&scene, &serde_json::json!({"f_x": [0], "samples": 64}), 3);
        let layer = ports["frames"].find("radiance", Some(0.0)).unwrap();
        let (found, se) = (layer.data.mapv(f64::from).mean().unwrap(), layer.info.mean_se.unwrap());
        let expected = (0.1 + 0.8 * mean) * 5.0 / 1e4 / (2.0 * PI);
        assert!((found - expected).abs() < 4.0 * se + 1e-6 * expected, "{motif:?}: {found} +- {se}, {expected}");
        if let Motif::Checker { .. } = motif {
            // Three pixels a square, the first square at (-6, 5) to (-5, 6): floor(u) + floor(v) = -1.
            let truth = &ports["truth"].find("albedo", None).unwrap().data;
            for ((row, column), &albedo) in truth.indexed_iter() {
                let expected = if (row / 3 + column / 3) % 2 == 0 { 0.1 } else { 0.9 };
                assert_eq!(albedo, expected, "row {row}, column {column}");
            }
        }
    }
}
