//! Light in spheres with real ports and a real sample: the three ways of following it against each other, energy, necks, baffles.

use glam::DVec3;
use turbid_dis::{
    Baffle, Beam, FATES, Fate, Method, Opening, Outline, Plate, Port, Setup, Sphere, Stream, Tally, Target,
};
use turbid_optics::PhaseFunction;

use crate::statistics::judge;

const MEDIUM: Plate = Plate {
    mu_a: 0.05,
    mu_s: 5.0,
    phase: PhaseFunction::henyey_greenstein(0.8),
    n: 1.0,
    thickness: 1.0,
    size: [10.0, 10.0],
    slides: 1.0,
};

fn spheres(reflectance: f64, sample: Outline, neck: f64, baffle: Option<f64>) -> [Sphere; 2] {
    let radius = 25.0;
    let outline = Outline::Square { half: 5.0 };
    let detector = (Port::Detector, Opening::new(Outline::Round { radius: 5.0 }, 0.25, radius));
    let one = |far| {
        let (a, b) = (DVec3::new(0.0, 0.0, -radius), DVec3::new(radius, 0.0, 0.0));
        Sphere {
            radius,
            reflectance,
            plane: Sphere::rim(radius, sample) + neck,
            sample: Opening::new(sample, 0.0, radius),
            ports: vec![(far, Opening::new(outline, 0.5, radius)), detector],
            baffle: baffle.map(|radius| Baffle { center: 0.5 * (a + b), normal: (b - a).normalize(), radius }),
            sees_sample: true,
        }
    };
    [one(Port::Entrance), one(Port::Exit)]
}

fn tally(setup: &Setup, photons: u64, stream: u32) -> Tally {
    let mut tally = Tally::default();
    for i in 0..photons {
        tally.add(&setup.photon(Stream::new(21, stream, i)));
    }
    tally
}

/// Setups that differ in all that the ways of following light treat differently.
fn cases() -> Vec<Setup> {
    let (round, square) = (Outline::Round { radius: 5.0 }, Outline::Square { half: 5.0 });
    let (parallel, cone) = (Beam { radius: 0.5, cos_half_angle: 1.0 }, Beam { radius: 0.5, cos_half_angle: 0.98 });
    let n14 = Plate { n: 1.4, slides: 1.5, size: [8.0, 14.0], ..MEDIUM };
    let mut cases = Vec::new();
    for (reflectance, sample, neck, target, beam) in [
        (0.9, square, 0.0, Target::Medium(MEDIUM), parallel),
        (0.98, round, 0.0, Target::Medium(MEDIUM), cone),
        (1.0, square, 6.0, Target::Medium(MEDIUM), cone),
        (0.95, round, 8.0, Target::Medium(n14), cone),
        (0.95, square, 3.0, Target::White(0.9), cone),
        (0.95, square, 3.0, Target::Joined, parallel),
        (0.9, round, 1.0, Target::Joined, cone),
        (0.95, square, 0.0, Target::Open, cone),
        (0.0, square, 0.0, Target::Medium(MEDIUM), parallel),
    ] {
        let mut setup = Setup {
            spheres: spheres(reflectance, sample, neck, None),
            target,
            beam,
            method: Method::Summed,
            bounces: None,
        };
        cases.push(setup.clone());
        setup.spheres.iter_mut().for_each(|sphere| sphere.sees_sample = false);
        cases.push(setup.clone());
        cases.push(Setup { bounces: Some(cases.len() as u32 % 4 + 1), ..setup });
    }
    cases
}

fn z(a: &Tally, b: &Tally, i: usize) -> Option<f64> {
    let variance = a.covariance(i, i)? + b.covariance(i, i)?;
    (variance > 0.0).then(|| (a.mean(i) - b.mean(i)) / variance.sqrt())
}

/// Closed form, expected values and plain counting give the same readings and the same losses.
#[test]
fn three_ways_agree() {
    let mut scores = Vec::new();
    for (k, setup) in cases().into_iter().enumerate() {
        let counted = tally(&Setup { method: Method::Counted, ..setup.clone() }, 20_000, 3 * k as u32);
        let traced = tally(&Setup { method: Method::Traced, ..setup.clone() }, 10_000, 3 * k as u32 + 1);
        let summed = tally(&setup, 10_000, 3 * k as u32 + 2);
        for i in [0, 1, 3, 4, 6, 7] {
            scores.extend(z(&summed, &counted, i));
            scores.extend(z(&traced, &counted, i));
        }
    }
    judge("three ways", &scores);
}

/// With a baffle in either sphere.
#[test]
fn baffles_are_traced() {
    let mut scores = Vec::new();
    for (k, setup) in cases().into_iter().enumerate() {
        let baffled = spheres(setup.spheres[0].reflectance, setup.spheres[0].sample.outline, 0.0, Some(6.0));
        let setup = Setup { spheres: baffled, ..setup };
        let counted = tally(&Setup { method: Method::Counted, ..setup.clone() }, 20_000, 100 + 2 * k as u32);
        let traced = tally(&Setup { method: Method::Traced, ..setup }, 10_000, 101 + 2 * k as u32);
        for i in [0, 1, 4, 7] {
            scores.extend(z(&traced, &counted, i));
        }
    }
    judge("baffles", &scores);
}

/// A baffle hides the sample: in black spheres the detector then sees nothing, without one it does.
#[test]
fn a_baffle_hides_the_sample() {
    for (baffle, seen) in [(Some(8.0), false), (None, true)] {
        let spheres = spheres(0.0, Outline::Round { radius: 5.0 }, 0.0, baffle);
        let beam = Beam { radius: 0.5, cos_half_angle: 1.0 };
        let setup = Setup { spheres, target: Target::Medium(MEDIUM), beam, method: Method::Traced, bounces: None };
        let tally = tally(&setup, 20_000, 200);
        assert_eq!([tally.mean(0) > 0.0, tally.mean(1) > 0.0], [seen; 2]);
    }
}

/// Every photon's light is detected, absorbed or lost, to rounding.
#[test]
fn energy_is_conserved() {
    for setup in cases() {
        for i in 0..2000 {
            let score = setup.photon(Stream::new(5, 7, i));
            let sum = score.fates.iter().fold(score.detected[0] + score.detected[1], |sum, fate| sum + fate);
            assert!((sum - 1.0).abs() < 1e-11, "{setup:?}: {score:?}");
            assert_eq!(score.fates.len(), FATES);
        }
    }
}

/// White walls and a white plate flush with its round port: entrance and detector share the light by their areas.
#[test]
fn white_spheres_share_by_area() {
    let spheres = spheres(1.0, Outline::Round { radius: 5.0 }, 0.0, None);
    let [detector, entrance] = [Port::Detector, Port::Entrance].map(|port| spheres[0].port_fraction(port));
    let beam = Beam { radius: 0.5, cos_half_angle: 0.98 };
    let setup = Setup { spheres, target: Target::White(1.0), beam, method: Method::Summed, bounces: None };
    let tally = tally(&setup, 40_000, 300);
    let (expected, se) = (detector / (detector + entrance), tally.covariance(0, 0).expect("many photons").sqrt());
    assert!((tally.mean(0) - expected).abs() < 4.5 * se, "{} +- {se}, {expected}", tally.mean(0));
    assert_eq!(tally.fate(Fate::Wall), 0.0);
}

/// An empty plate between two round ports: what crosses it of diffuse light is the view factor of two parallel discs of radius a at the distance
/// d, (X - sqrt(X^2 - 4)) / 2 with X = 2 + (d / a)^2. The holes of the wall opposite and the first bounce break the evenness by their share; 4.5 sigma.
#[test]
fn an_empty_plate_is_two_discs() {
    let mut spheres = spheres(1.0, Outline::Round { radius: 5.0 }, 0.0, None);
    let radius = 25.0;
    for (k, port) in [Port::Entrance, Port::Exit].into_iter().enumerate() {
        let hole = |turns| Opening::new(Outline::Round { radius: 0.5 }, turns, radius);
        spheres[k].ports = vec![(port, hole(0.5)), (Port::Detector, hole(0.25))];
    }
    // Uneven is what falls through holes, and the first bounce, at the far pole.
    let holes = 2.0 * spheres[0].port_fraction(Port::Detector);
    let uneven = holes + 1.0 - spheres[1].wall_fraction();
    let empty = Plate { mu_a: 0.0, mu_s: 0.0, size: [f64::INFINITY; 2], ..MEDIUM };
    let beam = Beam { radius: 0.5, cos_half_angle: 1.0 };
    for thickness in [1.0, 4.0] {
        let target = Target::Medium(Plate { thickness, ..empty });
        // An exit in the way of the beam would leave no diffuse light.
        let mut spheres = spheres.clone();
        spheres[1].ports.remove(0);
        let setup = Setup { spheres, target, beam, method: Method::Summed, bounces: None };
        let (lost, se) = tally(&setup, 60_000, 400).ratio(7, 5).expect("diffuse light");
        let se = se.expect("light was lost");
        let x = 2.0 + (thickness / 5.0) * (thickness / 5.0);
        let expected = 1.0 - 0.5 * (x - (x * x - 4.0f64).sqrt());
        assert!((lost - expected).abs() < 4.5 * se + uneven * expected, "{thickness}: {lost} +- {se}, {expected}");
        assert!(se < 0.05 * expected, "{se} says nothing about {expected}");
    }
}
