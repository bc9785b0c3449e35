//! Media and rigs at the ends of their ranges, against closed forms and the transport solver.

use std::f64::consts::PI;

use serde_json::json;
use turbid_contract::payload::{Lamp, Medium, Scene, Shape, Specular};
use turbid_optics::henyey_greenstein::density;
use turbid_optics::rte::reflectance;

use crate::setup::*;

const LIT: f64 = 100.0;

/// One pixel of 1 um that looks from `degrees` off the normal at a slab of `medium`, lit from 1 m above, 30 mm aside.
fn slab(medium: Medium, thickness: f64, degrees: f64) -> Scene {
    let (mut camera, projector) = rig(1000.0, 30.0, 0.001, 1, LIT);
    let angle = degrees.to_radians();
    camera.position = [1000.0 * angle.sin(), 0.0, 1000.0 * angle.cos()];
    scene(&[("m", medium)], vec![object(Shape::Slab { top: 0.0, bottom: -thickness }, "m", 0)], (camera, projector))
}

/// Slabs of 1e-6 mean free paths scatter once: L = mu_s t p E / (cos_view cos_light), for |g| up to 0.99, mu_s over ten decades,
/// albedo 1 - 1e-9 and views of up to 85 degrees. Light scattered twice is some tau ln(1 / tau) = 2e-5 of the whole along a slab, more
/// by the ratio of p sideways to p back: below 1e-3 for the phase functions here.
#[test]
fn thin_slabs_scatter_once() {
    for (mu_s, g, degrees) in [
        (1e-6, 0.0, 0.0),
        (1.0, 0.9, 0.0),
        (1.0, -0.99, 0.0),
        (1.0, 0.99, 0.0),
        (1e4, 0.0, 0.0),
        (1.0, 0.0, 85.0),
        (1.0, 0.5, 85.0),
    ] {
        let (mu_a, thickness) = (1e-9 * mu_s, 1e-6 / mu_s);
        let (mean, se) = dc(&slab(medium(mu_a, mu_s, g), thickness, degrees), 20_000, 5);
        let angle = f64::to_radians(degrees);
        let d = f64::hypot(1000.0, 30.0);
        let cos_light = 1000.0 / d;
        let p = density(g, -angle.cos() * cos_light);
        let expected = 0.5 * mu_s * thickness * p * 5.0 / (LIT * LIT) / (cos_light * angle.cos());
        assert!(
            (mean - expected).abs() < 4.5 * se + 1e-3 * expected,
            "mu_s = {mu_s}, g = {g}, {degrees} degrees: {mean:e} +- {se:e}, expected {expected:e}"
        );
        assert!(se < 0.02 * expected, "mu_s = {mu_s}, g = {g}, {degrees} degrees: {se:e} of {expected:e}");
    }
}

/// Thick slabs against the solver's camera reflectance pi L / E under parallel light: albedo 1 - 1e-9 at 1e4 mean free paths of 0.1 um,
/// g = 0.99 and n from 1 to 2.5. At 1 m and 1.7 degrees light and view differ from parallel and normal by 0.3 % at most.
#[test]
fn thick_slabs_match_the_transport_solver() {
    for (mu_a, mu_s, g, n, thickness, samples) in [
        (1e-5, 1e4, 0.0, 1.0, 1.0, 2_000),
        (0.1, 5.0, 0.0, 1.2, 200.0, 20_000),
        (0.1, 5.0, 0.0, 1.8, 200.0, 20_000),
        (0.1, 5.0, 0.0, 2.5, 200.0, 20_000),
        (0.01, 100.0, 0.99, 1.0, 100.0, 4_000),
    ] {
        let solved = turbid_optics::Medium {
            mu_a,
            mu_s_prime: mu_s * (1.0 - g),
            phase: turbid_optics::PhaseFunction::henyey_greenstein(g),
            n,
        };
        let name = format!("mu_a = {mu_a}, mu_s = {mu_s}, g = {g}, n = {n}");
        let expected = match reflectance(&solved, Some(thickness), 0.0) {
            Ok(found) => found.camera,
            Err(error) => panic!("{name}: {error}"),
        };
        let (radiance, se) = dc(&slab(Medium { n, ..medium(mu_a, mu_s, g) }, thickness, 0.0), samples, 9);
        let scale = 2.0 * PI * LIT * LIT / 5.0;
        let (found, se) = (scale * radiance, scale * se);
        assert!((found - expected).abs() < 4.0 * se + 3e-3 * expected, "{name}: {found} +- {se}, expected {expected}");
    }
}

/// Half-spaces of g = -0.99, whose peak is 0.01 rad wide and turns light back at every collision. Hemispherical reflectance against the
/// discrete-ordinates table (optics' tests/reference): by photons of a beam, and as what a camera sees under light from all
/// sides, which is the same number by reciprocity. On the peak itself, where camera and light stand in one place 1 km away, against the solver.
#[test]
fn backward_peaks_are_followed() {
    // Albedo, n, reflectance without the specular part, its error.
    let rows = [
        (0.9, 1.0, 0.619_314, 5e-6),
        (0.9999, 1.0, 0.977_702, 1e-6),
        (0.9, 1.4, 0.589_811, 6e-5),
        (0.99, 2.5, 0.612, 1e-3),
    ];
    let mut scores = Vec::new();
    for (i, (albedo, n, expected, error)) in rows.into_iter().enumerate() {
        let half_space = |rig| {
            let m = Medium { n, ..medium(1.0 - albedo, albedo, -0.99) };
            let mut s = scene(&[("m", m)], vec![object(Shape::Slab { top: 0.0, bottom: -1000.0 }, "m", 0)], rig);
            s.camera.as_mut().unwrap().specular = Some(Specular::Exclude);
            s
        };
        let mut add = |what: &str, found: f64, se: f64, expected: f64, error: f64| {
            let z = (found - expected) / se.hypot(error);
            assert!(z.abs() < 4.5, "{what}, albedo {albedo}, n {n}: {found} +- {se}, expected {expected}");
            assert!(se < 0.02 * expected, "{what}, albedo {albedo}, n {n}: {se} of {expected}");
            scores.push(z);
        };
        let (_, _, share, se) = power(&beam_on(half_space(rig(60.0, 0.0, 4.0, 1, 9.0))), 10_000, i as u64 + 1)[0];
        let reflex: f64 = (n - 1.0) / (n + 1.0);
        add("photons", share, se, expected + reflex * reflex, error);
        let mut under_sky = half_space(rig(60.0, 0.0, 0.001, 1, 9.0));
        under_sky.projector = None;
        under_sky.lights = [("sky".to_owned(), Lamp::Ambient { radiance: vec![1.0] })].into();
        let (seen, se) = dc(&under_sky, 10_000, i as u64 + 11);
        add("sky", seen, se, expected, error);
        let lit = 200.0;
        let (seen, se) = dc(&half_space(rig(1e6, 0.0, 0.001, 1, lit)), 10_000, i as u64 + 21);
        let solved = turbid_optics::Medium {
            mu_a: 1.0 - albedo,
            mu_s_prime: 1.99 * albedo,
            phase: turbid_optics::PhaseFunction::henyey_greenstein(-0.99),
            n,
        };
        let on_peak = reflectance(&solved, None, 0.0).expect("the solver takes g = -0.99").camera;
        let scale = 2.0 * PI * lit * lit / 5.0;
        add("peak", scale * seen, scale * se, on_peak, 1e-4 * on_peak);
    }
    let mean = scores.iter().sum::<f64>() / scores.len() as f64;
    assert!(mean.abs() < 4.0 / (scores.len() as f64).sqrt(), "{scores:?}");
}

/// The image is that of the same scene at the origin, wherever it stands: z within 4.5 over the mean of an image, also where mean
/// free paths of 0.1 um are too short for f32 lanes.
#[test]
fn the_place_of_a_scene_does_not_show() {
    for mu_s in [5.0, 1e4] {
        let here = slab(medium(0.02 * mu_s, mu_s, 0.5), 50.0, 10.0);
        let mut there = here.clone();
        let by = [1000.0, -700.0, 900.0];
        let moved = |place: [f64; 3]| [0, 1, 2].map(|i| place[i] + by[i]);
        let camera = there.camera.as_mut().unwrap();
        (camera.position, camera.look_at) = (moved(camera.position), moved(camera.look_at));
        let projector = there.projector.as_mut().unwrap();
        (projector.position, projector.look_at) = (moved(projector.position), moved(projector.look_at));
        there.objects.get_mut("a").unwrap().shape = Shape::Slab { top: by[2], bottom: by[2] - 50.0 };
        let ((a, se_a), (b, se_b)) = (dc(&here, 20_000, 1), dc(&there, 20_000, 2));
        let se = se_a.hypot(se_b);
        assert!((a - b).abs() < 4.5 * se, "mu_s = {mu_s}: {a:e} and {b:e} +- {se:e}");
        assert!(se < 0.05 * a, "mu_s = {mu_s}: {se:e} of {a:e}");
    }
}

/// Where light would not leave, an error says so and what helps; an empty world and a medium without anything in it are black.
#[test]
fn endless_paths_are_refused_and_nothing_is_black() {
    let endless = slab(medium(0.0, 1e4, 0.0), 1e6, 0.0);
    let host = MemoryHost::new(1, &[], 1);
    let refused = run_on(&host, &endless, &json!({"f_x": [0], "samples": 64})).unwrap_err().to_string();
    assert!(refused.contains("flights") && refused.contains("thinner"), "{refused}");
    let empty = scene(&[], vec![], rig(1000.0, 30.0, 8.0, 1, LIT));
    let refused = run_on(&host, &empty, &json!({"f_x": [0], "samples": 64})).unwrap_err().to_string();
    assert!(refused.contains("no object"), "{refused}");
    assert_eq!(dc(&slab(medium(0.0, 0.0, 0.0), 10.0, 0.0), 64, 1), (0.0, 0.0));
}
