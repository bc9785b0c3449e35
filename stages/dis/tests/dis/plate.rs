//! A photon in the sample: adding-doubling, conservation, mean path, and what the side faces take.

use glam::DVec3;
use turbid_dis::{Plate, Ray, Stream};
use turbid_optics::PhaseFunction;

use crate::statistics::{judge, mean};

const WIDE: [f64; 2] = [f64::INFINITY; 2];

fn normal() -> Ray {
    Ray { r: DVec3::ZERO, u: DVec3::Z }
}

/// Onto z = 0 by the cosine law.
fn diffuse(random: &mut Stream, width: f64) -> Ray {
    let (cos2, turn) = (random.uniform(), std::f64::consts::TAU * random.uniform());
    let sin = (1.0 - cos2).sqrt();
    let r = DVec3::new(width * (random.uniform() - 0.5), width * (random.uniform() - 0.5), 0.0);
    Ray { r, u: DVec3::new(sin * turn.cos(), sin * turn.sin(), cos2.sqrt()) }
}

/// UR1, UT1, URU, UTU of wide plates with and without slides; the table's own error is added.
#[test]
fn wide_plates_meet_adding_doubling() {
    let mut z = Vec::new();
    let rows = include_str!("reference/plates.csv").lines().filter(|l| !l.starts_with(['#', 'a']));
    for (k, line) in rows.enumerate() {
        let row: Vec<f64> = line.split(',').map(|cell| cell.parse().expect("a number")).collect();
        let &[albedo, tau, g, n, slides, ur1, ut1, uru, utu, bound] = row.as_slice() else { panic!("{line}") };
        let plate = Plate {
            mu_a: tau * (1.0 - albedo),
            mu_s: tau * albedo,
            phase: PhaseFunction::henyey_greenstein(g),
            n,
            thickness: 1.0,
            size: WIDE,
            slides,
        };
        for (beam, expected) in [(true, [ur1, ut1]), (false, [uru, utu])] {
            for (face, expected) in expected.into_iter().enumerate() {
                let (found, se) = mean(8_000, |i| {
                    let mut random = Stream::new(3, 4 * k as u32 + 2 * u32::from(beam) + face as u32, i);
                    let ray = if beam { normal() } else { diffuse(&mut random, 0.0) };
                    let passage = plate.pass(ray, &mut random);
                    if passage.ray.is_some_and(|ray| (ray.u.z > 0.0) == (face == 1)) { passage.out } else { 0.0 }
                });
                // Too few photons for a mean to be normal: no score.
                if expected * 8_000.0 > 50.0 && (1.0 - expected) * 8_000.0 > 50.0 {
                    z.push((found - expected) / (se * se + bound * bound).sqrt());
                }
            }
        }
    }
    judge("plates", &z);
}

/// Every photon's shares sum to 1 to rounding; the wide plate's too but for what it absorbs.
#[test]
fn shares_sum_to_one() {
    for (mu_a, mu_s, g, n, slides) in [
        (0.0, 0.0, 0.0, 1.0, 1.0),
        (0.1, 20.0, 0.8, 1.0, 1.0),
        (3.0, 0.0, 0.0, 1.4, 1.5),
        (0.01, 5.0, 0.9, 1.4, 1.5),
        (0.0, 3.0, -0.9, 1.33, 1.0),
        (200.0, 1.0, 0.5, 1.5, 1.0),
    ] {
        let plate = Plate {
            mu_a,
            mu_s,
            phase: PhaseFunction::henyey_greenstein(g),
            n,
            thickness: 1.0,
            size: [2.0, 3.0],
            slides,
        };
        for i in 0..3000 {
            let mut random = Stream::new(9, 1, i);
            let ray = diffuse(&mut random, 2.0);
            let p = plate.pass(ray, &mut random);
            let sum = p.out + p.absorbed + p.sides + p.roulette;
            assert!((sum - 1.0).abs() < 1e-12, "{plate:?}: {p:?}");
            if let Some(out) = p.ray {
                assert!((out.u.length() - 1.0).abs() < 1e-9, "{out:?}");
                assert!(out.r.x.abs() <= 1.0 && out.r.y.abs() <= 1.5 && (out.r.z == 0.0 || out.r.z == 1.0), "{out:?}");
            }
        }
    }
}

/// Diffuse light spends a mean path of 2 n^2 d in a wide plate however it scatters, counted per light that enters (n = 1), and 4 V / S in a box
/// that is lit from all sides (Blanco and Fournier, Europhys. Lett. 61, 168 (2003)). Absorption at mu_a -> 0 counts it; 4.5 sigma.
#[test]
fn mean_path_knows_no_scattering() {
    for (mu_s, g) in [(0.0, 0.0), (1.0, 0.0), (30.0, 0.8), (4.0, -0.5)] {
        let plate = Plate {
            mu_a: 1e-7,
            mu_s,
            phase: PhaseFunction::henyey_greenstein(g),
            n: 1.0,
            thickness: 1.0,
            size: WIDE,
            slides: 1.0,
        };
        let (path, se) = mean(40_000, |i| {
            let mut random = Stream::new(8, 2, i);
            let ray = diffuse(&mut random, 0.0);
            plate.pass(ray, &mut random).absorbed / plate.mu_a
        });
        assert!((path - 2.0).abs() < 4.5 * se + 1e-5, "mu_s = {mu_s}: {path} +- {se}");
    }
}

/// Up to the first side face the plate and its wide twin are one: what the twin sends out has the mean of a wide plate.
#[test]
fn the_wide_twin_is_a_wide_plate() {
    let mut z = Vec::new();
    for (k, (n, slides, size)) in
        [(1.0, 1.0, 1.0), (1.4, 1.0, 1.0), (1.4, 1.5, 3.0), (1.0, 1.0, 10.0)].into_iter().enumerate()
    {
        let plate = Plate {
            mu_a: 0.05,
            mu_s: 8.0,
            phase: PhaseFunction::henyey_greenstein(0.8),
            n,
            thickness: 1.0,
            size: [size, 1.5 * size],
            slides,
        };
        let wide = Plate { size: WIDE, ..plate };
        for face in 0..2 {
            let share = |plate: &Plate, stream, i| {
                let mut random = Stream::new(6, stream, i);
                let ray = diffuse(&mut random, size);
                plate.pass(ray, &mut random).wide[face]
            };
            let a = mean(20_000, |i| share(&plate, 4 * k as u32 + 1, i));
            let b = mean(20_000, |i| share(&wide, 4 * k as u32 + 2 + face as u32, i));
            z.push((a.0 - b.0) / (a.1 * a.1 + b.1 * b.1).sqrt());
        }
    }
    judge("wide twins", &z);
}
