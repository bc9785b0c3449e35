//! Two terms of Henyey and Greenstein against the transport solver, which knows the phase function by its moments.

use std::f64::consts::PI;

use turbid_contract::payload::{Medium, PhaseFunction, Shape, Specular};
use turbid_optics::{PhaseFunction as Phase, rte};

use crate::setup::*;

const TERMS: [(f64, f64, f64); 2] = [(0.9, -0.3, 0.95), (0.8, -0.7, 0.8)];

fn two_term(mu_a: f64, mu_s: f64, (g_forward, g_backward, forward): (f64, f64, f64), n: f64) -> Medium {
    let phase = PhaseFunction::TwoTermHenyeyGreenstein { g_forward, g_backward, forward };
    Medium { phase, n, ..medium(mu_a, mu_s, 0.0) }
}

/// As the solver takes it, and Henyey and Greenstein's function of the same mean cosine.
fn solved(m: &Medium) -> [turbid_optics::Medium; 2] {
    let phase = turbid_geometry::phase_function(&m.phase);
    let of = |phase: Phase| turbid_optics::Medium {
        mu_a: m.mu_a[0],
        mu_s_prime: m.mu_s[0] * (1.0 - phase.g()),
        phase,
        n: m.n,
    };
    [of(phase), of(Phase::henyey_greenstein(phase.g()))]
}

/// The camera's reflectance of a thin slab and a half-space under a plane wave, in f32 lanes (the scalar walker is the same to rounding, `lanes.rs`), to 4 standard
/// errors; some of the values are 10 and more from those of one term with the same mean cosine.
#[test]
fn plane_waves_match_the_transport_solver() {
    let (mut scores, mut unlike) = (Vec::new(), 0.0_f64);
    for (terms, n, thickness, mu_a) in [
        (TERMS[0], 1.0, 0.5, 0.1),
        (TERMS[1], 1.4, 0.5, 0.1),
        (TERMS[0], 1.0, 1000.0, 0.5),
        (TERMS[1], 1.0, 1000.0, 0.5),
    ] {
        let (m, lit) = (two_term(mu_a, 4.0, terms, n), 200.0);
        let (mut camera, projector) = rig(1e6, 0.0, 0.001, 1, lit);
        camera.specular = Some(Specular::Exclude);
        let slab = Shape::Slab { top: 0.0, bottom: -thickness };
        let s = scene(&[("m", m.clone())], vec![object(slab, "m", 0)], (camera, projector));
        let factor = 2.0 * PI * lit * lit / 5.0;
        let (mean, se) = dc(&s, 16_000, 29);
        let of = |medium| rte::reflectance(&medium, Some(thickness), 0.0).unwrap().camera;
        let [truth, one_term] = solved(&m).map(of);
        let (value, se) = (mean * factor, se * factor);
        println!("{terms:?}, n {n}, {thickness} mm: {value} +- {se}, {truth}, of one term {one_term}");
        scores.push((value - truth) / se);
        unlike = unlike.max((value - one_term).abs() / se);
        assert!(scores.last().unwrap().abs() < 4.0, "{terms:?}, n {n}, {thickness} mm: {value} +- {se}, {truth}");
    }
    assert!(scores.iter().sum::<f64>().abs() < 4.0 * (scores.len() as f64).sqrt(), "{scores:?}");
    assert!(unlike > 10.0, "the tests do not tell the shape: {unlike}");
}

/// R and T of photons from a beam, to 4.5 standard errors; every photon ends in one place, and without absorption none in the slab.
#[test]
fn photons_match_the_transport_solver() {
    let mut unlike = 0.0_f64;
    for (terms, n, mu_a) in [(TERMS[0], 1.0, 0.2), (TERMS[1], 1.4, 0.0)] {
        let m = two_term(mu_a, 3.0, terms, n);
        let slab = object(Shape::Slab { top: 0.0, bottom: -1.0 }, "m", 0);
        let s = beam_on(scene(&[("m", m.clone())], vec![slab], rig(60.0, 0.0, 4.0, 1, 9.0)));
        let found = power(&s, 60_000, 31);
        let [truth, one_term] = solved(&m).map(|medium| rte::respond(&medium, Some(1.0), 0.0).unwrap());
        let reflex = ((n - 1.0) / (n + 1.0)).powi(2);
        let (sum, [r, t]) = (found.iter().map(|row| row.2).sum::<f64>(), [0, 1].map(|k| (found[k].2, found[k].3)));
        let expected = [reflex + truth.reflectance.hemispherical_incident, truth.transmittance];
        for ((share, se), expected) in [r, t].into_iter().zip(expected) {
            assert!((share - expected).abs() < 4.5 * se, "{terms:?}: {share} +- {se}, {expected}");
        }
        unlike = unlike.max((r.0 - reflex - one_term.reflectance.hemispherical_incident).abs() / r.1);
        assert!((sum - 1.0).abs() < 1e-12, "{found:?}");
        assert!(mu_a > 0.0 || found[2].2 == 0.0, "{found:?}");
    }
    assert!(unlike > 10.0, "R does not tell the shape: {unlike}");
}

/// The truth map shows mu_s (1 - g) with the mean cosine.
#[test]
fn truth_has_the_mean_cosine() {
    let m = two_term(0.1, 10.0, TERMS[0], 1.0);
    let s = scene(&[("m", m)], vec![object(FLOOR, "m", 0)], rig(100.0, 10.0, 4.0, 2, 9.0));
    let ports = run(&s, &serde_json::json!({"f_x": [0], "samples": 2}), 1);
    let layer = ports["truth"].layers.iter().find(|layer| layer.info.name == "mu_s_prime").unwrap();
    let expected = 10.0 * (1.0 - (0.95 * 0.9 - 0.05 * 0.3));
    assert!(layer.data.iter().all(|&x| (f64::from(x) - expected).abs() < 1e-6 * expected), "{:?}", layer.data);
}
