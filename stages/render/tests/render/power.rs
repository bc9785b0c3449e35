//! Where power goes: slabs against the transport tables, conservation photon by photon, and every kind of source.

use turbid_contract::payload::{Lamp, Profile, Shape};

use crate::setup::*;

/// R and T of slabs under a normal beam against the discrete-ordinates table (albedo, g, tau, n; R without specular, T total), as
/// z scores. At n = 1.4 the beam's own reflex, ((n - 1) / (n + 1))^2, comes on top of R.
#[test]
fn slabs_match_the_transport_table() {
    let rows = [
        (0.5, 0.0, 2.0, 1.0, Some(0.1128332), None),
        (0.5, 0.5, 1.0, 1.0, Some(0.03824196), Some(0.520069)),
        (0.5, 0.75, 4.0, 1.0, Some(0.01946323), Some(0.08328523)),
        (0.5, 0.9, 2.0, 1.0, Some(0.006057235), Some(0.3425067)),
        (0.9, 0.0, 1.0, 1.0, Some(0.2674103), Some(0.5916251)),
        (0.9, 0.5, 4.0, 1.0, None, Some(0.2505325)),
        (0.9, 0.75, 2.0, 1.0, Some(0.09739464), None),
        (0.5, 0.0, 4.0, 1.4, Some(0.05230833), None),
        (0.5, 0.0, 2.0, 1.4, None, Some(0.1585196)),
        (0.5, 0.5, 1.0, 1.4, Some(0.02410616), None),
        (0.5, 0.75, 2.0, 1.4, None, Some(0.2611056)),
    ];
    let mut scores = Vec::new();
    for (i, (albedo, g, tau, n, r, t)) in rows.into_iter().enumerate() {
        let mut m = medium(tau * (1.0 - albedo), tau * albedo, g);
        m.n = n;
        let slab = object(Shape::Slab { top: 0.0, bottom: -1.0 }, "m", 0);
        let mut s = beam_on(scene(&[("m", m)], vec![slab], rig(60.0, 0.0, 4.0, 1, 9.0)));
        s.camera.as_mut().unwrap().specular = Some(turbid_contract::payload::Specular::Exclude);
        let found = power(&s, 60_000, i as u64 + 1);
        let reflex: f64 = (n - 1.0) / (n + 1.0);
        for (k, expected) in [(0, r.map(|r| r + reflex * reflex)), (1, t)] {
            if let Some(expected) = expected {
                let (_, _, share, se) = found[k];
                scores.push((share - expected) / se);
                assert!((share - expected).abs() < 4.5 * se, "{:?}: {share} +- {se}, {expected}", rows[i]);
            }
        }
    }
    let n = scores.len() as f64;
    let mean = scores.iter().sum::<f64>() / n;
    let rms = (scores.iter().map(|z| z * z).sum::<f64>() / n).sqrt();
    // R and T of one slab share photons; 15 scores: three sigma of mean and rms.
    assert!(
        mean.abs() < 3.0 / n.sqrt() && (rms - 1.0).abs() < 3.0 / (2.0 * n).sqrt(),
        "mean {mean}, rms {rms}: {scores:?}"
    );
}

/// Every photon ends in one place: shares sum to 1 to rounding. Without absorption none is absorbed; a black block takes what falls
/// on it and a clear absorber 1 - exp(-mu_a d) of a beam.
#[test]
fn no_photon_is_lost() {
    let media = [("milk", medium(0.0, 3.0, 0.6)), ("ink", medium(0.2, 1.0, 0.0)), ("dye", medium(0.7, 0.0, 0.0))];
    let slab = |m, top, bottom| object(Shape::Slab { top, bottom }, m, 0);
    let ball = || object(Shape::Sphere { diameter: 3.0, center: [0.5, 0.0, -1.0] }, "ink", 1);
    let white = lambertian(Shape::Slab { top: -2.0, bottom: -9.0 }, 1.0);
    let view = || rig(60.0, 10.0, 4.0, 1, 9.0);
    let objects =
        [vec![slab("milk", 0.0, -2.0), white], vec![slab("milk", 0.0, -2.0), ball()], vec![slab("dye", 0.0, -2.0)]];
    for (i, objects) in objects.into_iter().enumerate() {
        for s in [beam_on(scene(&media, objects.clone(), view())), scene(&media, objects.clone(), view())] {
            let found = power(&s, 20_000, 3);
            let sum: f64 = found.iter().map(|row| row.2).sum();
            assert!((sum - 1.0).abs() < 1e-12, "{sum}: {found:?}");
            let total: f64 = found.iter().map(|row| row.1).sum();
            let expected = if s.projector.is_some() { 5.0 } else { 2.0 };
            assert!((total / expected - 1.0).abs() < 1e-12, "{total} W");
            match i {
                // Nothing goes through, nothing is absorbed.
                0 => assert_eq!(found[0].2, 1.0, "{found:?}"),
                1 => assert!(found[2].0.ends_with('b') && found[2].2 > 0.01 && found[3].2 == 0.0, "{found:?}"),
                _ if s.projector.is_none() => {
                    let (_, _, share, se) = found[2];
                    assert!((share - (1.0 - (-1.4f64).exp())).abs() < 4.5 * se, "{found:?}");
                }
                _ => {}
            }
        }
    }
}

/// The share of each source that falls on a black disc-like block: that of a point is its solid angle, of a cone and a projector what
/// they throw on it; two lights in the ratio of their powers.
#[test]
fn sources_throw_what_they_should() {
    let block = |side: f64| lambertian(Shape::Box { size: [side, side, 1.0], center: [0.0, 0.0, -0.5] }, 0.0);
    let position = [0.0, 0.0, 10.0];
    // Solid angle of a square seen from above its middle.
    let omega = |side: f64, h: f64| 4.0 * (side * side / (4.0 * h * (0.5 * side * side + h * h).sqrt())).atan();
    let full = 4.0 * std::f64::consts::PI;
    let cone = full * (20f64.to_radians() / 2.0).sin().powi(2);
    let lamp = |lamp| {
        let mut s = scene(&[], vec![block(4.0)], rig(60.0, 0.0, 4.0, 1, 9.0));
        s.projector = None;
        s.lights = [("l".to_owned(), lamp)].into();
        s
    };
    let point = Lamp::Point { position, power: vec![3.0] };
    // Wide enough for the corners of the block.
    let spot = Lamp::Spot { position, look_at: [0.0; 3], angle_deg: 40.0, power: vec![3.0] };
    let mut projected = scene(&[], vec![block(4.0)], rig(10.0, 0.0, 4.0, 1, 12.0));
    projected.camera.as_mut().unwrap().position = [0.0, 0.0, 60.0];
    let flat = 16.0 / 144.0;
    let mut even = projected.clone();
    even.projector.as_mut().unwrap().profile = Profile::UniformIntensity;
    let mut both = projected.clone();
    both.lights = [("l".to_owned(), point.clone())].into();
    let of_point = omega(4.0, 10.0) / full;
    let cases = [
        (lamp(point), of_point),
        (lamp(spot), omega(4.0, 10.0) / cone),
        (projected, flat),
        (even, omega(4.0, 10.0) / omega(12.0, 10.0)),
        (both, (5.0 * flat + 3.0 * of_point) / 8.0),
    ];
    for (i, (scene, expected)) in cases.into_iter().enumerate() {
        let (_, _, share, se) = power(&scene, 100_000, 7)[2];
        assert!((share - expected).abs() < 4.5 * se, "case {i}: {share} +- {se}, {expected}");
    }
}

/// Shares of 0 and 1 have no error, but an interval that holds the truth; of others it is some two standard errors wide on each side, and powers are
/// shares of the lights' power.
#[test]
fn shares_of_nothing_and_all_have_intervals() {
    let white = lambertian(Shape::Slab { top: -2.0, bottom: -9.0 }, 1.0);
    let milk = object(Shape::Slab { top: 0.0, bottom: -2.0 }, "milk", 0);
    let scene = beam_on(scene(&[("milk", medium(0.0, 3.0, 0.6))], vec![milk, white], rig(60.0, 10.0, 4.0, 1, 9.0)));
    let photons = 10_000;
    let table = power_table(&scene, photons, 3);
    let column = |name: &str| table.maybe_f64s(name).unwrap();
    let (share, se, low, high) = (column("share"), column("share_se"), column("share_low"), column("share_high"));
    let end = 1.0 - 0.025_f64.powf(1.0 / f64::from(photons));
    // Left upwards: all. Left downwards and absorbed: nothing.
    assert_eq!((share[0], se[0], high[0]), (Some(1.0), None, Some(1.0)));
    assert!((1.0 - low[0].unwrap() - end).abs() < 1e-6 * end);
    for row in 1..table.rows() {
        assert_eq!((share[row], se[row], low[row]), (Some(0.0), None, Some(0.0)));
        assert!((high[row].unwrap() - end).abs() < 1e-6 * end);
        assert!((column("power_high")[row].unwrap() - 2.0 * end).abs() < 1e-6 * end);
    }
    assert_eq!(table.attributes["confidence"], 0.95);
}
