//! The pipelines in `pipelines/checks`: scenes whose closed form stands in the head comment of the file.

use std::f64::consts::PI;

use serde_json::Value;

use crate::space::Space;

/// Statistics of the value layers `name` of a port, by f_x, after a run of a check.
fn layers(check: &str, port: &str, name: &str) -> Vec<Value> {
    let file = format!("{}/pipelines/checks/{check}.yaml", env!("CARGO_MANIFEST_DIR"));
    let space = Space::new();
    space.turbid(&["run", &file, "--json"]).ok();
    let shown = space.turbid(&["show", &file, port, "--json"]).json();
    let ports = shown["instances"][0]["ports"].as_object().expect("ports");
    let layers = ports.values().next().expect("one port")["layers"].as_array().expect("layers").clone();
    layers.into_iter().filter(|l| l["name"] == name).collect()
}

/// W mm^-2 sr^-1: the mean that photons give which walk from the lamp of `near_lamp.yaml` (`tests/render/grazing.rs` of the renderer), to 5 %.
const NEAR: f64 = 1.30e-5;

fn number(layer: &Value, name: &str) -> f64 {
    layer[name].as_f64().unwrap_or_else(|| panic!("{name}: {layer}"))
}

/// f32 images: 1e-6 relative where nothing is random, 4 standard errors where paths are.
#[test]
fn closed_forms_come_out() {
    let dc = 0.4 * 5.0 / (200.0 * 200.0) / (2.0 * PI);
    for (name, expected) in [("m_dc", dc), ("m_ac", dc * (0.1 * PI).sin() / (0.1 * PI))] {
        let found = layers("lambertian_plane", "fringes.modulation", name);
        let layer = found.iter().find(|l| l["f_x_per_mm"] == 0.05).expect("the fringe");
        let off = number(layer, "mean") - expected;
        assert!(off.abs() <= 4.0 * number(layer, "mean_se") + 1e-6 * expected, "{name}: {layer}");
    }
    let frame = &layers("single_scattering", "frames.frames", "radiance")[0];
    let backward = (1.0 - 0.8) / (4.0 * PI * 1.8f64.powi(2));
    let expected = 0.5 * 5.0 / (200.0 * 200.0) * 0.5e-6 * backward;
    // The inverse square from 100 m over the mean depth: 2e-5.
    assert!((number(frame, "mean") / expected - 1.0).abs() < 3e-5, "{frame}, {expected:e}");
    let frame = &layers("two_term", "frames.frames", "radiance")[0];
    let term = |g: f64| (1.0 - g) / (4.0 * PI * (1.0 + g).powi(2));
    let expected = 0.5 * 5.0 / (200.0 * 200.0) * 0.5e-6 * (0.95 * term(0.9) + 0.05 * term(-0.3));
    assert!((number(frame, "mean") / expected - 1.0).abs() < 3e-5, "{frame}, {expected:e}");
    let frame = &layers("beer_lambert", "frames.frames", "radiance")[0];
    let bare = 0.8 * 5.0 / (200.0 * 200.0) / (2.0 * PI);
    let expected = bare * 0.5 * ((-1.2f64).exp() + (-0.4f64).exp());
    assert!((number(frame, "mean") - expected).abs() <= 4.0 * number(frame, "mean_se"), "{frame}, {expected:e}");
    let frame = &layers("curved_wall", "frames.frames", "radiance")[0];
    // int exp(-2 mu_t z) / (1 - k z)^2 dz by Simpson's rule; the finite distance: 3e-5.
    let (n, depth) = (20_000, 20.0);
    let focused = |i: u32| {
        let z = depth * f64::from(i) / f64::from(n);
        let weight = if i == 0 || i == n { 1.0 } else { f64::from(2 + 2 * (i % 2)) };
        weight * (-z).exp() / (1.0 - z * 0.4 / 14.0).powi(2) * depth / f64::from(3 * n)
    };
    let passes = 1.0 - (0.4f64 / 2.4).powi(2);
    let expected =
        0.5 * (passes / 1.4).powi(2) * 5.0 / (200.0 * 200.0) * 5e-7 / (4.0 * PI) * (0..=n).map(focused).sum::<f64>();
    let off = number(frame, "mean") - expected;
    assert!(off.abs() <= 4.0 * number(frame, "mean_se") + 1e-4 * expected, "{frame}, {expected:e}");
    assert!(number(frame, "mean_se") < 1e-3 * expected, "{frame}");
    let frame = &layers("mesh_beer_lambert", "frames.frames", "radiance")[0];
    let expected = (-0.8f64).exp() * 0.6 * 5.0 / (100.0 * 100.0) / (2.0 * PI);
    assert!((number(frame, "mean") - expected).abs() <= 4.0 * number(frame, "mean_se"), "{frame}, {expected:e}");
    let glint = &layers("glint", "frames.frames", "radiance")[0];
    let (cos, n) = (100.0 / (100.0f64 * 100.0 + 15.0 * 15.0).sqrt(), 1.5);
    let cos_in = (1.0 - (1.0 - cos * cos) / (n * n)).sqrt();
    let (s, p) = ((cos - n * cos_in) / (cos + n * cos_in), (n * cos - cos_in) / (n * cos + cos_in));
    let expected = 2.0 / (4.0 * PI) * 0.5 * (s * s + p * p) / (4.0 * 16.0 * cos);
    assert!((number(glint, "mean") * 256.0 / expected - 1.0).abs() < 1e-6, "{glint}, {expected:e}");
    assert!((number(glint, "max") / expected - 1.0).abs() < 1e-6, "{glint}, {expected:e}");
    assert_eq!(number(&layers("glint", "black.frames", "radiance")[0], "max"), 0.0);
    let glint = &layers("ball_glint", "frames.frames", "radiance")[0];
    let (d, radius) = ((100.0f64 * 100.0 + 30.0 * 30.0).sqrt(), 20.0);
    let cos = 100.0 / d;
    let cos_in = (1.0 - (1.0 - cos * cos) / (n * n)).sqrt();
    let (s, p) = ((cos - n * cos_in) / (cos + n * cos_in), (n * cos - cos_in) / (n * cos + cos_in));
    let spread = (1.0 + d / (radius * cos)) * (1.0 + d * cos / radius);
    let expected = 2.0 / (4.0 * PI) * 0.5 * (s * s + p * p) / (4.0 * 16.0 * cos * spread);
    assert!((number(glint, "mean") * 256.0 / expected - 1.0).abs() < 1e-6, "{glint}, {expected:e}");
    assert!((number(glint, "max") / expected - 1.0).abs() < 1e-6, "{glint}, {expected:e}");
    assert_eq!(number(&layers("ball_glint", "black.frames", "radiance")[0], "max"), 0.0);
}

/// Rough walls lose no light: a slab under an even sky is as bright as that, with known errors, nobody warns of anything, and `power` has no row for what is lost.
#[test]
fn rough_walls_lose_no_light() {
    let file = format!("{}/pipelines/checks/rough_furnace.yaml", env!("CARGO_MANIFEST_DIR"));
    let space = Space::new();
    let check = space.turbid(&["check", &file]);
    // It warns of the few paths of `balance` alone.
    let [warnings, lobes] = ["warning:", "so narrow a lobe"].map(|text| check.out.matches(text).count());
    assert!(check.out.contains("no mistakes") && [warnings, lobes] == [1, 1], "{}", check.out);
    for stage in ["smooth", "rough"] {
        let frames = &layers("rough_furnace", &format!("{stage}.frames"), "radiance")[0];
        let ends = ["min", "max"].map(|end| number(frames, end));
        assert!(ends.iter().all(|x| (x - 1.0).abs() < 1e-6) && frames["mean_se"].is_number(), "{stage}: {frames}");
        assert!(layers("rough_furnace", &format!("{stage}.frames"), "radiance_se_unknown").is_empty());
    }
    space.turbid(&["run", &file, "balance.power"]).ok();
    let shown = space.turbid(&["show", &file, "balance.power"]).out;
    assert!(shown.contains("left upwards") && shown.contains("share_high") && !shown.contains("lost"), "{shown}");
}

/// Paths with weight windows know their errors, however narrow the lobe; those without say where it is too narrow for them.
#[test]
fn unknown_errors_are_marked() {
    let flags = layers("peaked", "ball_frames.frames", "radiance_se_unknown");
    assert_eq!(number(&flags[0], "max"), 1.0);
    for g in ["0.8", "0.98", "0.995"] {
        assert!(layers("peaked", &format!("frames[g={g}].frames"), "radiance_se_unknown").is_empty(), "g = {g}");
    }
}

/// Light and view exchanged give the same but for the cosines, to 4 standard errors of both.
#[test]
fn grazing_light_is_reciprocal() {
    let [down, along] = ["down_frames.frames", "along_frames.frames"].map(|port| {
        let frame = layers("grazing_slab", port, "radiance").swap_remove(0);
        (number(&frame, "mean"), number(&frame, "mean_se"))
    });
    let cos = (89f64).to_radians().cos();
    let (off, error) = (down.0 / cos - along.0, (down.1 / cos).hypot(along.1));
    assert!(off.abs() < 4.0 * error && error < 0.05 * along.0, "{down:?} / {cos}, {along:?}");
}

/// A lamp 1 mm above a slab, and one 2 mm high and 200 mm aside: they end (not so where reflections to and fro have no end), with the radiance in the head of the
/// file, that of photons, to 4 standard errors and its own.
#[test]
fn lamps_close_to_a_slab_end() {
    let near = layers("near_lamp", "near_frames.frames", "radiance").swap_remove(0);
    let (mean, se) = (number(&near, "mean"), number(&near, "mean_se"));
    assert!((mean - NEAR).abs() < 4.0 * se.hypot(0.05 * NEAR) && se < 0.2 * NEAR, "{near}");
    let aside = layers("near_lamp", "aside_frames.frames", "radiance").swap_remove(0);
    assert!(number(&aside, "mean") > 0.0 && number(&aside, "mean_se") < 0.1 * number(&aside, "mean"), "{aside}");
}
