//! Closed forms, conservation and symmetry.

use std::f64::consts::PI;

use serde_json::json;
use turbid_contract::LayerKind;
use turbid_contract::payload::{Camera, Medium, Object, Profile, Projector, Shape, Specular};
use turbid_optics::henyey_greenstein::density;

use crate::setup::*;

/// Irradiance of `rig` at pattern value 1 on the plane z = 0: the flat profile spreads its power evenly.
fn irradiance(lit: f64) -> f64 {
    5.0 / (lit * lit)
}

/// A Lambertian plane has radiance rho E / pi, and under a sinusoid that times its value at the pixel. The flat profile makes
/// every path score the same; pixels of 1 um see one phase of the fringe. 1e-6 is the rounding to f32.
#[test]
fn lambertian_plane_has_radiance_rho_e_over_pi() {
    let (rho, f_x, lit) = (0.7, 0.1, 100.0);
    let (mut camera, projector) = rig(500.0, 30.0, 0.001, 1, lit);
    camera.look_at = [3.0, -2.0, 0.0];
    camera.position = [40.0, 25.0, 300.0];
    let ports = run(
        &scene(&[], vec![lambertian(FLOOR, rho)], (camera, projector)),
        &json!({"f_x": [0, f_x], "phases": 4, "orientation_deg": [0, 30], "samples": 8}),
        1,
    );
    let full = rho * irradiance(lit) / PI;
    let mut frames = 0;
    for layer in ports["frames"].layers.iter().filter(|l| l.info.name == "radiance") {
        let info = &layer.info;
        let o = info.orientation_deg.unwrap_or(0.0).to_radians();
        let phase = 2.0 * PI * info.f_x_per_mm.unwrap() * (3.0 * o.cos() - 2.0 * o.sin()) + info.phase_rad.unwrap();
        let pattern = if info.f_x_per_mm == Some(0.0) { 0.5 } else { 0.5 * (1.0 + phase.cos()) };
        // The fringe turns by 2 pi f_x 0.5 um over half the pixel.
        let tolerance = 1e-6 + 2.0 * PI * f_x * 0.0005;
        let off = f64::from(layer.data[(0, 0)]) / full - pattern;
        assert!(off.abs() < tolerance, "{info:?}: off by {off:e}");
        frames += 1;
    }
    assert_eq!(frames, 1 + 2 * 4);
    let white = f64::from(ports["white"].layers[0].data[(0, 0)]);
    assert!((white / full - 1.0).abs() < 1e-6);
    // The same plane under uniform intensity I = P / Omega: E = I h / R^3 below the pattern value 1.
    let (camera, mut projector) = rig(500.0, 30.0, 0.001, 1, lit);
    projector.profile = Profile::UniformIntensity;
    let (radiance, _) = dc(&scene(&[], vec![lambertian(FLOOR, rho)], (camera, projector)), 8, 1);
    // Omega of a rectangle by Simpson over its plane: h / r^3 is smooth, 40 x 40 steps leave 1e-9.
    let n = 40;
    let mut omega = 0.0;
    for (i, j) in (0..=n).flat_map(|i| (0..=n).map(move |j| (i, j))) {
        let weight = |i: i32| if i == 0 || i == n { 1.0 } else { f64::from(2 + 2 * (i % 2)) };
        let at = |i: i32| lit * (f64::from(i) / f64::from(n) - 0.5);
        let r2 = at(i).powi(2) + (at(j) - 30.0).powi(2) + 500f64.powi(2);
        omega += weight(i) * weight(j) * (lit / f64::from(n) / 3.0).powi(2) * 500.0 / r2.powf(1.5);
    }
    let e = 5.0 / omega * 500.0 / (30f64.powi(2) + 500f64.powi(2)).powf(1.5);
    assert!((radiance / (0.5 * rho * e / PI) - 1.0).abs() < 2e-6, "{radiance} {e}");
}

/// A layer that only absorbs dims a Lambertian floor by exp(-mu_a (way down + way up)), exactly and without noise; void
/// carved into it does not. A pure absorber alone is black.
#[test]
fn absorbers_follow_beer_lambert() {
    let layer = || Shape::Slab { top: 0.0, bottom: -4.0 };
    let floor = || Shape::Slab { top: -4.0, bottom: -10.0 };
    let media = [("dye", medium(0.3, 0.0, 0.8)), ("air", medium(0.0, 0.0, 0.0))];
    let view = rig(1000.0, 0.0, 0.001, 1, 100.0);
    let hole = object(Shape::Box { size: [9.0, 9.0, 1.5], center: [0.0, 0.0, -2.0] }, "air", 1);
    let bare = dc(&scene(&[], vec![lambertian(floor(), 0.6)], view.clone()), 8, 1).0;
    for (objects, thickness) in
        [(vec![object(layer(), "dye", 0)], 4.0_f64), (vec![object(layer(), "dye", 0), hole], 2.5)]
    {
        let mut objects: Vec<Object> = objects;
        objects.push(lambertian(floor(), 0.6));
        // Paths die in the layer one by one: by analog absorption exp(-1.2) of them reach the floor.
        let (mean, se) = dc(&scene(&media, objects, view.clone()), 40_000, 1);
        let expected = bare * (-2.0 * 0.3 * thickness).exp();
        assert!((mean - expected).abs() < 4.5 * se + 1e-6 * expected, "{thickness}: {mean} +- {se}, {expected}");
    }
    let (mean, se) = dc(&scene(&media, vec![object(layer(), "dye", 0)], view), 64, 1);
    assert_eq!((mean, se), (0.0, 0.0));
}

/// With an albedo of 1e-7 what is seen is single scattering: the integral of mu_s p exp(-mu_t (way in + way out)) I / D^2
/// along the camera's ray (Simpson), for a tilted light near by. Twice scattered light adds less than 1e-6.
#[test]
fn single_scattering_is_the_integral_along_the_ray() {
    let mu_t = 0.8;
    for (g, thickness) in [(0.8, 2000.0), (-0.7, 0.5), (0.0, 3.0)] {
        let slab = Shape::Slab { top: 0.0, bottom: -thickness };
        let (camera, projector) = rig(60.0, 35.0, 0.001, 1, 300.0);
        let scene = scene(&[("m", medium(mu_t, 1e-7 * mu_t, g))], vec![object(slab, "m", 0)], (camera, projector));
        let (mean, se) = dc(&scene, 20_000, 3);
        let n = 40_000;
        let depth = thickness.min(40.0 / mu_t);
        let mut sum = 0.0;
        for i in 0..=n {
            let s = depth * f64::from(i) / f64::from(n);
            let weight = if i == 0 || i == n { 1.0 } else { f64::from(2 + 2 * (i % 2)) };
            let (dy, dz) = (35.0, 60.0 + s);
            let d = f64::hypot(dy, dz);
            // Flat profile: I = E h^2 / cos^3.
            let intensity = irradiance(300.0) * 60.0 * 60.0 / (dz / d).powi(3);
            let way_in = s * d / dz;
            // The camera's ray goes down; light comes from the direction (0, dy, dz) / d.
            let p = density(g, -dz / d);
            sum += weight * p * (-mu_t * (s + way_in)).exp() * intensity / (d * d);
        }
        let expected = 0.5 * 1e-7 * mu_t * sum * depth / f64::from(n) / 3.0;
        assert!((mean - expected).abs() < 4.5 * se + 2e-6 * expected, "g = {g}: {mean} +- {se}, {expected}");
        assert!(se < 2e-3 * expected, "g = {g}: {se} of {expected}");
    }
}

/// Camera reflectance pi L / E of half-spaces against the discrete-ordinates tables, as z scores over all values: from
/// 1 km away, where light and camera are parallel to 1e-6, and with the lit field 10 / mu_eff beyond the view.
#[test]
fn half_spaces_match_the_transport_table() {
    match_table(1.0, include_str!("reference/rte_halfspace_camera.csv"), 16_000);
}

/// The same where light is refracted.
#[test]
fn refracting_half_spaces_match_the_transport_table() {
    match_table(1.4, include_str!("reference/rte_halfspace_camera_n14.csv"), 10_000);
}

/// Camera and projector in one place see each other in a smooth wall: tables do not hold that.
fn without_lamp_reflection((camera, projector): (Camera, Projector)) -> (Camera, Projector) {
    (Camera { specular: Some(Specular::Exclude), ..camera }, projector)
}

fn match_table(n: f64, table: &str, samples: u32) {
    let mut z = Vec::new();
    let mut rows: Vec<[f64; 6]> = Vec::new();
    for line in table.lines().filter(|l| !l.starts_with(['#', 'g'])) {
        let row: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
        rows.push(row.try_into().unwrap());
    }
    for same_medium in rows.chunk_by(|a, b| a[..3] == b[..3]) {
        let [g, mu_a, mu_s_prime, ..] = same_medium[0];
        let mu_eff = (3.0 * mu_a * (mu_a + mu_s_prime)).sqrt();
        let lit = (20.0 / mu_eff).max(40.0);
        let slab = Shape::Slab { top: 0.0, bottom: -1000.0 };
        let medium = Medium { n, ..medium(mu_a, mu_s_prime / (1.0 - g), g) };
        let s =
            scene(&[("m", medium)], vec![object(slab, "m", 0)], without_lamp_reflection(rig(1e6, 0.0, 0.001, 1, lit)));
        let f_x: Vec<f64> = same_medium.iter().map(|r| r[3]).collect();
        let ports = run(&s, &json!({"f_x": f_x, "samples": samples}), 17);
        let factor = PI / irradiance(lit);
        for &[.., f, r, err] in same_medium {
            let (value, se) = if f == 0.0 {
                let layer = ports["frames"].find("radiance", Some(0.0)).unwrap();
                (2.0 * f64::from(layer.data[(0, 0)]), 2.0 * layer.info.mean_se.unwrap())
            } else {
                let (_, m, se) = amplitude(&ports, f);
                // The modulus is biased up by the variance across.
                ((m - 0.5 * se * se / m) * 2.0, 2.0 * se)
            };
            let (value, se) = (value * factor, se * factor);
            z.push((value - r) / (se * se + err * err).sqrt());
            assert!(
                z.last().unwrap().abs() < 4.5,
                "g {g}, mu_a {mu_a}, mu_s' {mu_s_prime}, f {f}: {value} +- {se}, {r}"
            );
        }
    }
    let n = z.len() as f64;
    let mean = z.iter().sum::<f64>() / n;
    let sd = (z.iter().map(|z| z * z).sum::<f64>() / n).sqrt();
    // Values of one medium share paths: allow for 3 values per independent one.
    let spread = (3.0 / n).sqrt();
    assert!(mean.abs() < 3.0 * spread && (sd - 1.0).abs() < 3.0 * spread / 2f64.sqrt(), "mean {mean}, rms {sd} of {n}");
}

/// Slabs that refract against the transport solver, at normal incidence: thin ones, in which light that the far side reflects
/// unscattered counts, and a dense one.
#[test]
fn refracting_slabs_match_the_transport_solver() {
    let mut z = Vec::new();
    for (n, g, mu_a, mu_s, thickness) in
        [(1.4, 0.8, 0.02, 2.0, 0.2), (1.4, 0.0, 0.1, 1.0, 3.0), (2.5, 0.5, 0.05, 4.0, 0.5), (1.33, -0.5, 0.0, 1.0, 0.1)]
    {
        let lit = 200.0;
        let m = Medium { n, ..medium(mu_a, mu_s, g) };
        let slab = Shape::Slab { top: 0.0, bottom: -thickness };
        let s = scene(&[("m", m)], vec![object(slab, "m", 0)], without_lamp_reflection(rig(1e6, 0.0, 0.001, 1, lit)));
        let (mean, se) = dc(&s, 24_000, 23);
        let medium = turbid_optics::Medium {
            mu_a,
            mu_s_prime: mu_s * (1.0 - g),
            phase: turbid_optics::PhaseFunction::henyey_greenstein(g),
            n,
        };
        let truth = turbid_optics::rte::respond(&medium, Some(thickness), 0.0).unwrap().reflectance.camera;
        let factor = 2.0 * PI / irradiance(lit);
        z.push((mean * factor - truth) / (se * factor));
        assert!(z.last().unwrap().abs() < 4.0, "n {n}, {thickness} mm: {} +- {}, {truth}", mean * factor, se * factor);
        assert!(se < 0.05 * mean, "n {n}: {se} of {mean}");
    }
    assert!((z.iter().sum::<f64>() / z.len() as f64).abs() < 4.0 / (z.len() as f64).sqrt(), "{z:?}");
}

/// What does not absorb gives back all it got: R + T = 1 for a slab of albedo 1, from 12 + 12 views at the Gauss nodes of
/// mu (radiance is smooth but for its edge at mu = 0, where the rule is good to 3e-4 of the whole). What is reflected and
/// transmitted without scattering is no radiance but a beam: (r + t^2 / (1 - r^2 e^-2tau) ...) in closed form.
#[test]
fn a_white_slab_gives_back_all_light() {
    let (tau, thickness) = (2.0_f64, 0.5);
    let slab = || Shape::Slab { top: 0.0, bottom: -thickness };
    let (nodes, weights) = gauss_12();
    for n in [1.0, 1.5] {
        let (mut sum, mut variance) = (0.0, 0.0);
        for side in [1.0, -1.0] {
            for (mu, w) in nodes.iter().zip(weights) {
                let distance = 1e5;
                let (mut camera, projector) = rig(distance, 0.0, 0.001, 1, 60.0);
                let z = if side > 0.0 { 0.0 } else { -thickness };
                camera.look_at = [0.0, 0.0, z];
                camera.position = [distance * (1.0 - mu * mu).sqrt(), 0.0, z + side * mu * distance];
                let m = Medium { n, ..medium(0.0, tau / thickness, 0.3) };
                let s = scene(&[("m", m)], vec![object(slab(), "m", 0)], (camera, projector));
                let (mean, se) = dc(&s, 20_000, 5);
                let weight = 2.0 * w * mu * 2.0 * PI / irradiance(60.0);
                sum += weight * mean;
                variance += (weight * se).powi(2);
            }
        }
        // A beam between two faces of reflectance r: the geometric series.
        let r = ((n - 1.0) / (n + 1.0)).powi(2);
        let through = (-tau).exp();
        let unscattered = r + (1.0 - r).powi(2) * through * (1.0 + r * through) / (1.0 - (r * through).powi(2));
        let (total, se) = (sum + unscattered, variance.sqrt());
        assert!((total - 1.0).abs() < 4.0 * se + 3e-4, "n {n}: R + T = {total} +- {se}");
        assert!(se < 3e-3, "{se}");
    }
}

/// Nodes and weights of the 12-point Gauss-Legendre rule on (0, 1), by Newton's method.
fn gauss_12() -> ([f64; 12], [f64; 12]) {
    let (mut nodes, mut weights) = ([0.0; 12], [0.0; 12]);
    for i in 0..12 {
        let mut x = (PI * (i as f64 + 0.75) / 12.5).cos();
        let mut slope = 0.0;
        for _ in 0..20 {
            let (mut p, mut q) = (1.0, 0.0);
            for k in 1..=12 {
                let k = f64::from(k);
                (p, q) = (((2.0 * k - 1.0) * x * p - (k - 1.0) * q) / k, p);
            }
            slope = 12.0 * (x * p - q) / (x * x - 1.0);
            x -= p / slope;
        }
        nodes[i] = 0.5 * (1.0 + x);
        weights[i] = 1.0 / ((1.0 - x * x) * slope * slope);
    }
    (nodes, weights)
}

/// Camera and projector may change places (with their fields): a path may be walked either way. With the flat profile both
/// weigh the plane z = 0 evenly, so the mean radiance of the image is the same.
#[test]
fn camera_and_projector_may_change_places() {
    let media = [("m", medium(0.02, 2.0, 0.8)), ("core", medium(0.3, 5.0, 0.5)), ("air", medium(0.0, 0.0, 0.0))];
    let objects = || {
        vec![
            object(Shape::Slab { top: 0.0, bottom: -6.0 }, "m", 0),
            object(Shape::Sphere { diameter: 3.0, center: [2.0, 1.0, -2.0] }, "core", 1),
            object(Shape::Spheroid { diameters: [3.0, 4.0, 2.0], center: [-1.0, 0.0, 0.0] }, "air", 2),
            lambertian(Shape::Box { size: [2.0, 2.0, 3.0], center: [0.0, -3.0, 1.5] }, 0.8),
        ]
    };
    let (mut camera, mut projector) = rig(40.0, 0.0, 8.0, 4, 5.0);
    camera.position = [10.0, 3.0, 40.0];
    projector.position = [-6.0, 14.0, 30.0];
    projector.look_at = [1.0, 0.5, 0.0];
    let (mut swapped_camera, mut swapped_projector) = (camera.clone(), projector.clone());
    (swapped_camera.position, swapped_camera.look_at) = (projector.position, projector.look_at);
    (swapped_projector.position, swapped_projector.look_at) = (camera.position, camera.look_at);
    (swapped_camera.field, swapped_projector.field) = (projector.field, camera.field);
    let (a, a_se) = dc(&scene(&media, objects(), (camera, projector)), 2000, 7);
    let (b, b_se) = dc(&scene(&media, objects(), (swapped_camera, swapped_projector)), 2000, 8);
    let z = (a - b) / f64::hypot(a_se, b_se);
    assert!(z.abs() < 4.0, "{a} +- {a_se}, swapped {b} +- {b_se}");
    assert!(a_se < 0.03 * a && b_se < 0.03 * b, "{a} +- {a_se}, {b} +- {b_se}");
}

/// The same across refracting planes: a tilted view of tissue under a glass plate, with an air gap between.
#[test]
fn places_may_change_across_refraction() {
    let media = [
        ("m", Medium { n: 1.4, ..medium(0.02, 2.0, 0.8) }),
        ("core", Medium { n: 1.4, ..medium(0.3, 5.0, 0.5) }),
        ("glass", Medium { n: 1.5, ..medium(0.01, 0.0, 0.0) }),
    ];
    let objects = || {
        vec![
            object(Shape::Slab { top: 0.0, bottom: -6.0 }, "m", 0),
            object(Shape::Sphere { diameter: 3.0, center: [2.0, 1.0, -2.0] }, "core", 1),
            object(Shape::Slab { top: 1.0, bottom: 0.5 }, "glass", 0),
            lambertian(Shape::Box { size: [2.0, 2.0, 3.0], center: [0.0, -3.0, 3.0] }, 0.8),
        ]
    };
    let (mut camera, mut projector) = rig(40.0, 0.0, 8.0, 4, 5.0);
    camera.position = [20.0, 3.0, 30.0];
    projector.position = [-6.0, 34.0, 30.0];
    projector.look_at = [1.0, 0.5, 0.0];
    let (mut swapped_camera, mut swapped_projector) = (camera.clone(), projector.clone());
    (swapped_camera.position, swapped_camera.look_at) = (projector.position, projector.look_at);
    (swapped_projector.position, swapped_projector.look_at) = (camera.position, camera.look_at);
    (swapped_camera.field, swapped_projector.field) = (projector.field, camera.field);
    let (a, a_se) = dc(&scene(&media, objects(), (camera, projector)), 4000, 7);
    let (b, b_se) = dc(&scene(&media, objects(), (swapped_camera, swapped_projector)), 4000, 8);
    let z = (a - b) / f64::hypot(a_se, b_se);
    assert!(z.abs() < 4.0, "{a} +- {a_se}, swapped {b} +- {b_se}");
    assert!(a_se < 0.03 * a && b_se < 0.03 * b, "{a} +- {a_se}, {b} +- {b_se}");
}

/// All lengths times 2^13 and all coefficients divided by it: the same paths, radiance by 2^-26 (the inverse square), bit
/// for bit, because scaling by powers of two is exact.
#[test]
fn scale_does_not_matter() {
    let render = |k: f64| {
        let (mut camera, mut projector) = rig(500.0 * k, 35.0 * k, 8.0 * k, 4, 60.0 * k);
        camera.look_at[0] = k;
        projector.profile = Profile::UniformIntensity;
        let objects = vec![
            object(Shape::Slab { top: 0.0, bottom: -2000.0 * k }, "m", 0),
            object(Shape::Sphere { diameter: 4.0 * k, center: [k, 0.0, 0.0] }, "core", 1),
        ];
        let media = [("m", medium(0.1 / k, 5.0 / k, 0.8)), ("core", medium(0.3 / k, 9.0 / k, 0.9))];
        run(&scene(&media, objects, (camera, projector)), &json!({"f_x": [0.1 / k], "samples": 32}), 3)
    };
    let k = 8192.0;
    let (small, large) = (&render(1.0)["frames"], &render(k)["frames"]);
    for (a, b) in small.layers.iter().zip(&large.layers) {
        assert!(a.data.iter().any(|&x| x > 0.0));
        let scale = match (a.info.kind, a.info.unit.as_str()) {
            (LayerKind::Condition, "mm") => 1.0 / k as f32,
            // Flags of unknown errors and angles have no scale.
            (LayerKind::Mask | LayerKind::Condition, _) => 1.0,
            _ => (k * k) as f32,
        };
        assert_eq!(a.data.mapv(|x| x / scale), b.data, "{:?}", a.info);
    }
}
