//! Cameras of every kind, and the projector's lens, by closed forms on a Lambertian floor.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};
use serde_json::json;
use turbid_contract::payload::{Aperture, Camera, Distortion, Lamp, Profile, Projection, Shape};
use turbid_optics::view::View;

use crate::setup::*;

/// All that a camera can be, looking down on the origin, slanted.
fn cameras() -> Vec<Camera> {
    let (mut plain, _) = rig(300.0, 0.0, 120.0, 8, 400.0);
    plain.position = [60.0, -40.0, 300.0];
    let distortion = Some(Distortion { k1: -0.3, k2: 0.1, p1: 2e-3, p2: -1e-3, k3: 0.0 });
    let aperture = Some(Aperture { diameter: 9.0, focus: 250.0 });
    vec![
        plain.clone(),
        Camera { distortion, ..plain.clone() },
        Camera { aperture, ..plain.clone() },
        Camera { aperture, distortion, ..plain.clone() },
        Camera { projection: Projection::Orthographic, ..plain.clone() },
        Camera { projection: Projection::Fisheye, field: [900.0; 2], ..plain },
    ]
}

/// A pixel is a mean of radiances: in a white furnace every camera reads that of the sky, exactly.
#[test]
fn every_camera_reads_radiance() {
    for camera in cameras() {
        let (_, projector) = rig(300.0, 0.0, 120.0, 8, 400.0);
        let ball = Shape::Sphere { diameter: 60.0, center: [0.0, 0.0, 10.0] };
        let mut s = scene(&[], vec![lambertian(FLOOR, 1.0), lambertian(ball, 1.0)], (camera, projector));
        s.objects.get_mut("b").unwrap().priority = 1;
        s.projector = None;
        s.lights = [("sky".to_owned(), Lamp::Ambient { radiance: vec![0.5] })].into();
        let frames = &run(&s, &json!({"f_x": [0], "samples": 8}), 1)["frames"];
        assert!(frames.layers[0].data.iter().all(|&x| x == 0.5), "{:?}: {:?}", s.camera, frames.layers[0].data);
    }
}

/// A pixel under a fringe has the phase of the place that its centre sees: M_AC exp(i phase) of a fringe 100 pixels long, averaged
/// over the pixel, is (rho E / 2 pi) exp(i 2 pi f x) to 1e-3, and to 5 sigma of the jitter inside it.
#[test]
fn pixels_see_the_places_that_the_lens_says() {
    for camera in cameras().into_iter().filter(|c| c.projection != Projection::Fisheye) {
        let (_, mut projector) = rig(300.0, 0.0, 120.0, 8, 1000.0);
        projector.position = [0.0, 0.0, 1e5];
        let n = 8;
        let (f, pitch, samples) = (1.0 / 1500.0, 15.0, 256.0);
        let s = scene(&[], vec![lambertian(FLOOR, 1.0)], (camera.clone(), projector));
        let ports = run(&s, &json!({"f_x": [f], "phases": 4, "samples": samples as u32}), 2);
        let layers: Vec<_> = ports["frames"].layers.iter().filter(|l| l.info.name == "radiance").collect();
        let view = View::new(camera.position.into(), DVec3::ZERO, DVec3::Y, DVec2::splat(120.0)).unwrap();
        let half = 5.0 / 1e6 / PI / 2.0;
        for (row, column) in [(0, 0), (3, 4), (7, 7), (2, 7)] {
            let place = view.plane_point((column as f64 + 0.5) / n as f64, (row as f64 + 0.5) / n as f64);
            // Its own way from the distorted place to the ideal one: fixed point iteration.
            let d = view.distance();
            let (x_d, y_d) = (place.x / d, -place.y / d);
            let (mut x, mut y) = (x_d, y_d);
            if let Some(l) = camera.distortion {
                for _ in 0..200 {
                    let r2 = x * x + y * y;
                    let s = 1.0 + l.k1 * r2 + l.k2 * r2 * r2;
                    let dx = 2.0 * l.p1 * x * y + l.p2 * (r2 + 2.0 * x * x);
                    let dy = l.p1 * (r2 + 2.0 * y * y) + 2.0 * l.p2 * x * y;
                    (x, y) = ((x_d - dx) / s, (y_d - dy) / s);
                }
            }
            let [a, b, c, e] = [0, 1, 2, 3].map(|k: usize| f64::from(layers[k].data[(row, column)]));
            let (re, im) = (0.5 * (a - c), 0.5 * (e - b));
            let expected = 2.0 * PI * f * x * d;
            let (re0, im0) = (half * expected.cos(), half * expected.sin());
            // Half the width of the pixel, and of the blur of the aperture (radius 4.5 x 0.3 mm), as a phase.
            let spread = 2.0 * PI * f * (pitch + 2.7) / 12f64.sqrt() / f64::sqrt(samples);
            let off = (re - re0).hypot(im - im0) / half;
            assert!(off < 1e-3 + 5.0 * spread, "{camera:?}: pixel ({row}, {column}) off by {off}");
        }
    }
}

/// A distorting projector: at an ideal radius r (in units of the distance) the floor has the pattern of r (1 + k1 r^2), and the
/// irradiance of that place times the change of area (1 + k1 r^2)(1 + 3 k1 r^2); with uniform intensity that is I h / R^3 there.
#[test]
fn a_distorting_projector_moves_pattern_and_flux() {
    let (k1, h, lit, f) = (-0.15, 100.0, 120.0, 0.013);
    for (profile, (x, y)) in
        [(Profile::Flat, (21.0, -33.0)), (Profile::UniformIntensity, (40.0, 30.0)), (Profile::Flat, (0.0, 0.0))]
    {
        let (mut camera, mut projector) = rig(500.0, 0.0, 0.001, 1, lit);
        (camera.look_at, camera.position) = ([x, y, 0.0], [x, y, 400.0]);
        projector.position = [0.0, 0.0, h];
        projector.profile = profile;
        projector.distortion = Some(Distortion { k1, ..Distortion::default() });
        let s = scene(&[], vec![lambertian(FLOOR, 0.8)], (camera, projector));
        let ports = run(&s, &json!({"f_x": [f], "phases": 4, "orientation_deg": [90], "samples": 8}), 1);
        let r2 = (x * x + y * y) / h / h;
        let there = (x * (1.0 + k1 * r2), y * (1.0 + k1 * r2));
        let e0 = match profile {
            Profile::Flat => 5.0 / lit / lit,
            Profile::UniformIntensity => {
                // Solid angle of a square seen from above its middle.
                let omega = 4.0 * (lit * lit / (4.0 * h * (0.5 * lit * lit + h * h).sqrt())).atan();
                5.0 / omega * h / (there.0 * there.0 + there.1 * there.1 + h * h).powf(1.5)
            }
        };
        let e = e0 * (1.0 + k1 * r2) * (1.0 + 3.0 * k1 * r2);
        let full = 0.8 * e / PI;
        for layer in ports["frames"].layers.iter().filter(|l| l.info.name == "radiance") {
            let expected = 0.5 * (1.0 + (2.0 * PI * f * there.1 + layer.info.phase_rad.unwrap()).cos());
            let off = f64::from(layer.data[(0, 0)]) / full - expected;
            assert!(off.abs() < 1e-4, "{profile:?} at ({x}, {y}): off by {off:e}");
        }
    }
}

/// An edge out of focus: of the disc of confusion, radius A / 2 (distance - focus) / focus, the part beyond the edge is white.
#[test]
fn an_edge_out_of_focus_is_a_cut_disc() {
    let white = lambertian(Shape::Box { size: [200.0, 400.0, 10.0], center: [100.0, 0.0, -5.0] }, 0.9);
    for (diameter, focus) in [(8.0, 400.0), (6.0, 750.0)] {
        let radius = 0.5 * diameter * (500.0_f64 - focus).abs() / focus;
        for a in [-0.8, -0.3, 0.0, 0.6, 1.1] {
            let (mut camera, mut projector) = rig(500.0, 0.0, 0.001, 1, 100.0);
            (camera.look_at, camera.position) = ([a * radius, 0.0, 0.0], [a * radius, 0.0, 500.0]);
            camera.aperture = Some(Aperture { diameter, focus });
            // From beyond the edge, so that the side of the box is dark.
            projector.position = [30.0, 0.0, 500.0];
            let (mean, se) = dc(&scene(&[], vec![white.clone()], (camera, projector)), 20_000, 4);
            let t: f64 = f64::clamp(a, -1.0, 1.0);
            let share = ((-t).acos() + t * (1.0 - t * t).sqrt()) / PI;
            let expected = 0.5 * 0.9 * 5.0 / 1e4 / PI * share;
            assert!((mean - expected).abs() < 4.5 * se + 1e-5 * expected, "{a}: {mean} +- {se}, {expected}");
        }
    }
}

/// Truth at the pixel centres of parallel and of fisheye rays: the floor's depth along the axis, and where the sky begins.
#[test]
fn truth_of_parallel_and_fisheye_rays() {
    let (mut camera, projector) = rig(200.0, 0.0, 90.0, 9, 300.0);
    camera.position = [0.0, -150.0, 200.0];
    camera.projection = Projection::Orthographic;
    let s = scene(&[], vec![lambertian(FLOOR, 0.5)], (camera, projector.clone()));
    let truth = &run(&s, &json!({"f_x": [0], "samples": 2}), 1)["truth"];
    for (row, column) in [(0, 0), (4, 4), (8, 3)] {
        let y = 10.0 * (4.0 - row as f64);
        // (hit - position) . forward, forward = (0, 150, -200) / 250.
        let depth = ((y + 150.0) * 150.0 + 200.0 * 200.0) / 250.0;
        let seen = f64::from(truth.find("depth", None).unwrap().data[(row, column)]);
        assert!((seen / depth - 1.0).abs() < 1e-6, "({row}, {column}): {seen}, {depth}");
        assert!(f64::from(truth.find("height", None).unwrap().data[(row, column)]).abs() < 1e-12);
    }
    // 20 mm above the floor, 40 mm per rad: the image is 3.6 rad wide, with the horizon at pi / 2.
    let (mut camera, _) = rig(20.0, 0.0, 72.0, 9, 300.0);
    camera.projection = Projection::Fisheye;
    let s = scene(&[], vec![lambertian(FLOOR, 0.5)], (camera, projector));
    let truth = &run(&s, &json!({"f_x": [0], "samples": 2}), 1)["truth"];
    for (row, column) in (0..9).flat_map(|r| (0..9).map(move |c| (r, c))) {
        let angle = f64::hypot(row as f64 - 4.0, column as f64 - 4.0) * 8.0 / 20.0;
        let at = |name: &str| f64::from(truth.find(name, None).unwrap().data[(row, column)]);
        let floor = angle < PI / 2.0;
        assert_eq!(at("mask") == 0.0, floor, "({row}, {column}) at {angle} rad");
        if floor {
            assert!((at("depth") - 20.0).abs() < 1e-4, "({row}, {column}): {}", at("depth"));
        }
    }
}
