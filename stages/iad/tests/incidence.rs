//! Oblique, conical and diffuse light: closed forms, averages of one over another, and the way back.

mod truth;

use std::f64::consts::FRAC_PI_2;

use truth::slab;
use turbid_iad::{Error, Incidence, Inverse, Plan, Reading, Response, Slab, Slide, Surface};

fn lit<const N: usize>(slab: &Slab, light: Incidence) -> Plan<N> {
    Plan::lit(slab, light).expect("a slab that can be")
}

/// Chandrasekhar's half-space at every angle of the table, 1 - H(mu_0) sqrt(1 - albedo): the order of N = 8, 16, 32 for the
/// beam along the normal holds for all; 1e-9 is the weight of the beam's own direction.
#[test]
fn isotropic_half_space_at_every_angle() {
    fn worst<const N: usize>() -> f64 {
        let mut worst = 0f64;
        for line in truth::CHANDRASEKHAR.lines().skip(1) {
            let cells: Vec<&str> = line.split(',').collect();
            let Ok(cos) = cells[1].parse::<f64>() else { continue };
            let [albedo, truth] = [0, 3].map(|i| cells[i].parse::<f64>().expect("a number"));
            if cos <= 0.0 {
                continue;
            }
            let plan = lit::<N>(&Slab::bare(1.0, 0.0, 1.0), Incidence::Oblique(libm::acos(cos)));
            let response = plan.forward_optical(albedo, f64::INFINITY).expect("within range");
            worst = worst.max((response.ur1 - truth).abs());
        }
        worst
    }
    let [coarse, middle, fine] = [worst::<8>(), worst::<16>(), worst::<32>()];
    println!("worst error at N = 8, 16, 32: {coarse:.1e} {middle:.1e} {fine:.1e}");
    // A direction costs one of the N: as good as N - 1 along the normal, whose error falls as N^-6, and for grazing light less.
    assert!(fine < middle / 16.0 + 4e-9 && middle < coarse / 16.0, "{coarse:.1e} {middle:.1e} {fine:.1e}");
    assert!(fine < 1e-7, "{fine:.1e}");
}

/// van de Hulst (1980), light at cosine 0.5: five printed digits, and what N = 32 leaves.
#[test]
fn slabs_of_van_de_hulst() {
    for (albedo, tau, g, r, t) in [(0.99, 1.0, 0.0, 0.48652, 0.49163), (0.99, 4.0, 0.5, 0.61996, 0.30605)] {
        let plan = lit::<32>(&Slab::bare(1.0, g, 1.0), Incidence::Oblique(libm::acos(0.5)));
        let found = plan.forward_optical(albedo, tau).expect("within range");
        assert!((found.ur1 - r).abs() < 6e-6 && (found.ut1 - t).abs() < 6e-6, "{found:?}");
    }
}

/// Without scattering: Beer-Lambert along the slanted way between Fresnel's surfaces.
#[test]
fn absorbers_on_a_slanted_way() {
    for n in [1.0f64, 1.4] {
        for angle in [1e-9, 0.1, 0.8, 1.4, 1.57] {
            let plan = lit::<16>(&Slab::bare(n, 0.3, 1.0), Incidence::Oblique(angle));
            let cos = (1.0 - libm::sin(angle).powi(2) / (n * n)).sqrt();
            let face = Surface::new(n, Slide::NONE, cos);
            for tau in [1e-6, 0.5, 5.0] {
                let found = plan.forward_optical(0.0, tau).expect("within range");
                let pass = libm::exp(-tau / cos);
                let rounds = face.through * face.through / (1.0 - face.inside * face.inside * pass * pass);
                let (r, t) = (face.outside + rounds * face.inside * pass * pass, rounds * pass);
                assert!(
                    (found.ur1 - r).abs() < 1e-11 && (found.ut1 - t).abs() < 1e-11,
                    "n {n} {angle} {tau}: {found:?} {r} {t}"
                );
                assert!(
                    (found.ut1_unscattered - found.ut1).abs() < 1e-11
                        && (found.ur1_unscattered - found.ur1).abs() < 1e-11
                );
            }
        }
    }
}

/// Whatever the light, what comes back, goes through and stays is all of it.
#[test]
fn all_light_is_accounted_for() {
    for n in [1.0, 1.33, 1.5] {
        for g in [-0.9, 0.0, 0.9, 0.999] {
            for light in [
                Incidence::Oblique(0.3),
                Incidence::Oblique(1.5),
                Incidence::Cone(1e-3),
                Incidence::Cone(0.4),
                Incidence::Cone(1.5),
                Incidence::Diffuse,
            ] {
                let plan = lit::<16>(&Slab { top: Slide::clear(1.5), ..Slab::bare(n, g, 1.0) }, light);
                for albedo in [0.0, 0.5, 0.999, 1.0] {
                    for tau in [1e-7, 0.3, 10.0, 1e4] {
                        let r = plan.forward_optical(albedo, tau).expect("within range");
                        let sum = r.ur1 + r.ut1 + r.absorbed;
                        assert!((sum - 1.0).abs() < 1e-10, "n {n} g {g} {light:?} {albedo} {tau}: {sum}");
                        assert!((r.uru + r.utu + r.absorbed_diffuse - 1.0).abs() < 1e-10, "n {n} g {g} {light:?}");
                    }
                }
            }
        }
    }
}

fn four(r: &Response) -> [f64; 4] {
    [r.ur1, r.ut1, r.ur1_unscattered, r.ut1_unscattered]
}

/// A cone is the average of oblique beams over it, weighted by their cosines, and the whole hemisphere is diffuse light:
/// averages by 24 beams, each with its own rule. 1e-9 is a beam's weight; a cone's rule is not that of the beams, which leaves
/// a few times as much at N = 32 (measured 7e-9: a ceiling for regressions).
#[test]
fn cones_are_averages_of_beams() {
    let worst = |n: f64, angle: f64| {
        let slab = slab(n, 0.7, 1.0);
        let edge = if angle == FRAC_PI_2 { 0.0 } else { libm::cos(angle) };
        let beams = turbid_optics::quadrature::gauss_legendre_on(edge, 1.0, 24);
        let mut mean = [0.0; 4];
        for (cos, weight) in beams {
            let plan = lit::<32>(&slab, Incidence::Oblique(libm::acos(cos)));
            let one = four(&plan.forward(0.1, 1.0).expect("within range"));
            for (mean, one) in mean.iter_mut().zip(one) {
                *mean += one * 2.0 * cos * weight / (1.0 - edge * edge);
            }
        }
        let light = if angle == FRAC_PI_2 { Incidence::Diffuse } else { Incidence::Cone(angle) };
        let response = lit::<32>(&slab, light).forward(0.1, 1.0).expect("within range");
        if light == Incidence::Diffuse {
            assert!((response.ur1 - response.uru).abs() < 1e-14 && (response.ut1 - response.utu).abs() < 1e-14);
        }
        four(&response).iter().zip(mean).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    };
    for angle in [2e-4, 0.05, 0.3, 1.0, 1.5, FRAC_PI_2] {
        let (matched, refracting) = (worst(1.0, angle), worst(1.4, angle));
        println!("half angle {angle}: {matched:.1e} {refracting:.1e}");
        assert!(matched < 2e-8 && refracting < 2e-8, "half angle {angle}: {matched:.1e} {refracting:.1e}");
    }
}

/// Light that turns towards the normal becomes the beam along it, as the square of the angle.
#[test]
fn beams_meet_the_normal() {
    for n in [1.0, 1.4] {
        let slab = slab(n, 0.8, 1.0);
        let normal = lit::<32>(&slab, Incidence::Normal).forward(0.1, 1.0).expect("within range");
        assert_eq!(lit::<32>(&slab, Incidence::Oblique(0.0)).forward(0.1, 1.0).expect("within range"), normal);
        for light in [Incidence::Oblique(1e-4), Incidence::Cone(1e-4), Incidence::Cone(1.1e-5)] {
            let found = lit::<32>(&slab, light).forward(0.1, 1.0).expect("within range");
            // 1e-8 is the square; the rest the difference of two rules.
            let within = if n == 1.0 { 1e-6 } else { 1e-5 };
            assert!(
                (found.ur1 - normal.ur1).abs() < within && (found.ut1 - normal.ut1).abs() < within,
                "n {n} {light:?}: {found:?} {normal:?}"
            );
        }
    }
}

/// What the model says under any light comes back; oblique beams have 1e-9 of their digits' room.
#[test]
fn round_trips_under_any_light() {
    let mut failures = Vec::new();
    for light in [
        Incidence::Oblique(0.14),
        Incidence::Oblique(1.2),
        Incidence::Cone(0.05),
        Incidence::Cone(0.6),
        Incidence::Diffuse,
    ] {
        for (n, n_slide, g) in [(1.0, 1.0, 0.0), (1.4, 1.0, 0.8), (1.33, 1.5, 0.95)] {
            let inverse = Inverse::<8>::lit(&slab(n, g, n_slide), light).expect("a slab");
            for mu_a in [1e-4, 0.01, 0.3, 3.0] {
                for mu_s_prime in [0.05, 0.5, 3.0, 20.0] {
                    let r = inverse.plan().forward(mu_a, mu_s_prime).expect("within range");
                    let case = format!("{light:?} n {n} g {g} {mu_a} {mu_s_prime}");
                    match inverse.invert(&Reading { m_r: r.ur1, m_t: r.ut1, sigma: 0.0 }) {
                        Ok(fit) => {
                            let off = (fit.mu_a_per_mm / mu_a - 1.0)
                                .abs()
                                .max((fit.mu_s_prime_per_mm / mu_s_prime - 1.0).abs());
                            assert!(off < 1e-7, "{case}: {fit:?}");
                        }
                        Err(error) => failures.push(format!("{case}: {error}")),
                    }
                }
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

#[test]
fn angles_that_cannot_be_are_refused() {
    let slab = Slab::bare(1.4, 0.8, 1.0);
    for light in [
        Incidence::Oblique(FRAC_PI_2),
        Incidence::Oblique(-0.1),
        Incidence::Oblique(f64::NAN),
        Incidence::Cone(0.0),
        Incidence::Cone(1.6),
        Incidence::Cone(f64::NAN),
    ] {
        assert!(
            matches!(Plan::<8>::lit(&slab, light).err(), Some(Error::Range { name: "angle of incidence", .. })),
            "{light:?}"
        );
    }
}
