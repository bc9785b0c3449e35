use super::*;
use crate::philox::{philox4x32, unit};
use crate::quadrature::gauss_legendre_on;
use crate::refraction::Refraction;

/// alpha, n_from, n_to, cosine of the ray that comes.
const CASES: [(f64, f64, f64, f64); 6] = [
    (0.3, 1.0, 1.4, 0.9),
    (0.3, 1.4, 1.0, 0.9),
    (0.6, 1.0, 1.5, 0.4),
    (0.6, 1.5, 1.0, 0.3),
    (1.0, 1.0, 2.5, 0.7),
    (0.15, 1.4, 1.33, 0.6),
];

fn interface(alpha: f64, n_from: f64, n_to: f64) -> Rough {
    Rough { alpha, normal: DVec3::Z, n_from, n_to }
}

/// A direction down at this cosine.
fn down(cos: f64) -> DVec3 {
    let sin = f64::sqrt(1.0 - cos * cos);
    DVec3::new(0.6 * sin, -0.8 * sin, -cos)
}

/// The numbers of one walk of one of several series.
fn dice(series: u32, walk: u32) -> impl FnMut() -> [f64; 4] {
    let mut throw = 0;
    move || {
        throw += 1;
        philox4x32([walk, throw, series, 3], [5, 6]).map(unit)
    }
}

/// The walks of a series, with the directions in which they leave.
fn walks(rough: Rough, w: DVec3, series: u32, count: u32) -> impl Iterator<Item = (DVec3, Vec<FacetFlight>)> + Clone {
    (0..count).map(move |walk| {
        let mut flights = Vec::new();
        (rough.walk(w, dice(series, walk), &mut flights), flights)
    })
}

/// Mean and its standard error.
fn mean(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (mut n, mut sum, mut squares) = (0.0, 0.0, 0.0);
    for value in values {
        (n, sum, squares) = (n + 1.0, sum + value, squares + value * value);
    }
    let mean = sum / n;
    (mean, ((squares / n - mean * mean).max(0.0) / (n - 1.0)).sqrt())
}

fn agree(what: &str, (a, a_se): (f64, f64), (b, b_se): (f64, f64)) {
    let error = f64::hypot(a_se, b_se);
    assert!((a - b).abs() < 5.0 * error + 1e-12, "{what}: {a} +- {a_se}, {b} +- {b_se}");
}

/// Every walk leaves by itself, with a direction and finite depths, from straight down to along the surface; between equal indices it goes straight on.
#[test]
fn every_walk_ends_outside() {
    for alpha in [1e-4, 0.01, 0.1, 0.3, 0.6, 1.0] {
        for n in [1.0, 1.1, 1.33, 1.4, 1.5, 2.0, 2.5] {
            for rough in [interface(alpha, 1.0, n), interface(alpha, n, 1.0)] {
                for cos in [1.0, 0.9, 0.5, 0.1, 1e-3, 1e-9, 1e-17, 0.0] {
                    for (on, flights) in walks(rough, down(cos), 1, 100) {
                        let last = flights.last().expect("one at least");
                        // Rays along the surface go through very many facets where the indices are nearly equal.
                        assert!(last.facet.is_none() || alpha / cos > 1e4, "{rough:?} {cos}: {} facets", flights.len());
                        assert!((on.length() - 1.0).abs() < 1e-14 && on.z != 0.0, "{rough:?} {cos}: {on}");
                        assert!(
                            last.facet.is_some() || (on == last.w && (on.z < 0.0) == last.behind),
                            "{rough:?} {cos}"
                        );
                        for flight in &flights {
                            let depths = [Some(flight.depth), flight.facet];
                            assert!(depths.iter().flatten().all(|d| (0.0..1e3).contains(d)), "{flight:?}");
                        }
                        for l in [down(0.3), -down(0.3), on, -on, DVec3::X] {
                            let response = rough.response(&flights, l);
                            assert!(response >= 0.0 && response.is_finite(), "{rough:?} {cos} {l}: {response}");
                        }
                        assert!(n != 1.0 || cos < 1e-3 || (on - down(cos)).length() < 1e-12, "{rough:?}: {on}");
                    }
                }
            }
        }
    }
}

/// What is sampled is what is evaluated: moments of the directions in which walks leave, on either side, are those of the responses towards even directions.
#[test]
fn walks_leave_as_the_response_says() {
    let moments: [fn(DVec3) -> f64; 6] =
        [|_| 1.0, |l| l.x, |l| l.z * l.z, |l| 1f64.copysign(l.z), |l| l.y * l.z, |l| (1.0 - l.z * l.z) * l.z];
    for (case, (alpha, n_from, n_to, cos)) in CASES.into_iter().enumerate() {
        let (rough, w) = (interface(alpha, n_from, n_to), down(cos));
        let evaluated: Vec<(DVec3, f64)> = walks(rough, w, 1, 400_000)
            .enumerate()
            .map(|(i, (_, flights))| {
                let [u, turns, ..] = dice(2, i as u32)();
                let (sin_phi, cos_phi) = sin_cos_turns(turns);
                let l = turn(DVec3::Z, 2.0 * u - 1.0, 2.0 * (u * (1.0 - u)).sqrt(), sin_phi, cos_phi);
                (l, 4.0 * PI * rough.response(&flights, l))
            })
            .collect();
        let sampled: Vec<DVec3> = walks(rough, w, 3, 400_000).map(|(on, _)| on).collect();
        for (k, moment) in moments.into_iter().enumerate() {
            let (one, other) =
                (mean(sampled.iter().map(|&l| moment(l))), mean(evaluated.iter().map(|&(l, f)| f * moment(l))));
            agree(&format!("case {case}, moment {k}"), one, other);
            assert!(other.1 < 0.1, "case {case}, moment {k}: too noisy, {}", other.1);
        }
    }
}

/// Helmholtz: with L / n^2 the response over the cosine of the light's direction is the same with both directions exchanged, but
/// for the n^2 of the light's side.
#[test]
fn directions_may_be_exchanged() {
    let seen = |rough: Rough, from: DVec3, to: DVec3, series| {
        let (rough, n) = if from.z > 0.0 { (rough, rough.n_from) } else { (rough.reversed(), rough.n_to) };
        let (value, error) =
            mean(walks(rough, -from, series, 100_000).map(|(_, flights)| rough.response(&flights, to)));
        let weight = n * n * from.z.abs();
        (value * weight, error * weight)
    };
    let mut compared = 0;
    for (alpha, n_from, n_to, _) in CASES {
        let rough = interface(alpha, n_from, n_to);
        for z in [0.05_f64, 0.3, 0.7, 0.95] {
            let (a, b) = (DVec3::new((1.0 - z * z).sqrt(), 0.0, z), DVec3::new(0.3, -0.4, -0.75f64.sqrt()));
            for b in [b, -b] {
                let (one, other) = (seen(rough, a, b, 1), seen(rough, b, a, 2));
                // Where walks from one side see the other direction by rare facets only, so few know nothing of their error.
                if one.1 < 0.05 * one.0 && other.1 < 0.05 * other.0 {
                    agree(&format!("{rough:?} {a} {b}"), one, other);
                    compared += 1;
                }
            }
        }
    }
    assert!(compared >= 30, "{compared} of 48 pairs");
}

/// The same of the walks themselves: of even light that a side sends in, a moment of where it comes from with one of where it goes to is n^2 times the same
/// both ways; with 1 for both, n^2 times what is let through is the same from both sides.
#[test]
fn even_light_is_exchanged() {
    let moments: [fn(DVec3) -> f64; 3] = [|_| 1.0, |l| l.z.abs(), |l| l.x];
    let walked = |rough: Rough, series| -> Vec<(DVec3, DVec3)> {
        (0..200_000)
            .map(|walk| {
                let mut draw = dice(series, walk);
                let [u, turns, ..] = draw();
                let (sin_phi, cos_phi) = sin_cos_turns(turns);
                let from = turn(rough.normal, u.sqrt(), (1.0 - u).sqrt(), sin_phi, cos_phi);
                (from, rough.walk(-from, draw, &mut Vec::new()))
            })
            .collect()
    };
    for (alpha, n_from, n_to, _) in CASES {
        let rough = interface(alpha, n_from, n_to);
        let (there, back) = (walked(rough, 4), walked(rough.reversed(), 5));
        for f in moments {
            for g in moments {
                let through = |walks: &[(DVec3, DVec3)], f: fn(DVec3) -> f64, g: fn(DVec3) -> f64, n: f64| {
                    let crossed = |(from, to): &(DVec3, DVec3)| from.z * to.z < 0.0;
                    let (value, error) = mean(walks.iter().map(|x| if crossed(x) { f(x.0) * g(x.1) } else { 0.0 }));
                    (value * n * n, error * n * n)
                };
                agree(&format!("{rough:?}"), through(&there, f, g, n_from), through(&back, g, f, n_to));
            }
        }
    }
}

/// Smith's Lambda, as published.
fn lambda(alpha: f64, cos: f64) -> f64 {
    0.5 * ((1.0 + alpha * alpha * (1.0 / (cos * cos) - 1.0)).sqrt() - 1.0)
}

/// Height-correlated masking of both directions, on one side and on both.
fn masking(alpha: f64, cos_v: f64, cos_l: f64) -> f64 {
    let (v, l) = (lambda(alpha, cos_v), lambda(alpha, cos_l.abs()));
    if cos_l > 0.0 {
        1.0 / (1.0 + v + l)
    } else {
        libm::exp(libm::lgamma(1.0 + v) + libm::lgamma(1.0 + l) - libm::lgamma(2.0 + v + l))
    }
}

/// The first facet of a walk is the one facet of Walter et al. (2007), equations 20 and 21, with height-correlated masking: exactly by reflection, and
/// over the heights of facets by refraction.
#[test]
fn one_facet_is_that_of_walter() {
    for (alpha, n_from, n_to, cos) in CASES {
        let (rough, w) = (interface(alpha, n_from, n_to), down(cos));
        for l in [
            DVec3::new(0.5, 0.1, 0.74f64.sqrt()),
            DVec3::new(0.3, -0.4, -0.75f64.sqrt()),
            DVec3::new(-0.1, 0.0, -0.99f64.sqrt()),
        ] {
            let first = walks(rough, w, 6, 20_000).map(|(_, flights)| rough.response(&flights[..1], l));
            let masked = masking(alpha, cos, l.z);
            let (v, d) = (-w, |cos: f64| rough.density(cos));
            let expected = if l.z > 0.0 {
                let h = (v + l).normalize();
                refract(w, h, n_from, n_to).reflectance * d(h.z) * masked / (4.0 * cos)
            } else {
                let h = -(n_from * v + n_to * l).normalize();
                let h = if h.z < 0.0 { -h } else { h };
                let q = n_from * v.dot(h) + n_to * l.dot(h);
                let seen = v.dot(h).max(0.0) * (-l.dot(h)).max(0.0);
                (1.0 - refract(w, h, n_from, n_to).reflectance) * seen * n_to * n_to * d(h.z) * masked / (cos * q * q)
            };
            let exact = |response: f64| (response - expected).abs() <= 1e-12 * expected;
            assert!(l.z < 0.0 || first.clone().all(exact), "{rough:?} {l}: {expected}");
            agree(&format!("{rough:?} {l}"), mean(first), (expected, 0.0));
        }
    }
}

/// The light that leaves after one facet, upwards and downwards, is a quadrature over visible facets of F and 1 - F times the part that no other facet masks;
/// its error is what a quarter of the nodes say otherwise.
#[test]
fn light_leaves_after_one_facet_as_by_quadrature() {
    for (alpha, n_from, n_to, cos) in CASES {
        let (rough, w) = (interface(alpha, n_from, n_to), down(cos));
        let by_nodes = |n: usize| {
            let mut shares = [0.0; 2];
            for (u, of_u) in gauss_legendre_on(0.0, 1.0, n) {
                for (turns, of_turns) in gauss_legendre_on(0.0, 1.0, n) {
                    let Refraction { reflected, refracted, reflectance } =
                        refract(w, rough.facet(-w, u, turns), n_from, n_to);
                    // Along the surface nothing leaves.
                    let passes = |l: DVec3| {
                        if l.z.abs() < 1e-12 { 0.0 } else { masking(alpha, cos, l.z) * (1.0 + lambda(alpha, cos)) }
                    };
                    let weight = of_u * of_turns;
                    shares[0] += if reflected.z > 0.0 { weight * reflectance * passes(reflected) } else { 0.0 };
                    let down = refracted.filter(|l| l.z < 0.0).map_or(0.0, passes);
                    shares[1] += weight * (1.0 - reflectance) * down;
                }
            }
            shares
        };
        let (coarse, fine) = (by_nodes(100), by_nodes(200));
        for (side, up) in [true, false].into_iter().enumerate() {
            let left = walks(rough, w, 7, 200_000)
                .map(|(on, flights)| f64::from(u8::from(flights.len() == 2 && (on.z > 0.0) == up)));
            let (value, error) = mean(left);
            let cells = (fine[side] - coarse[side]).abs();
            assert!(
                cells < 1e-3 && (value - fine[side]).abs() < 5.0 * error + cells,
                "{rough:?} {up}: {value} +- {error}, {fine:?}"
            );
        }
    }
}

/// A walk by another method: heights with a normal distribution, flights in small steps with the chance to meet the surface in each, facets by rejection.
/// The height, of which `p` and `below` are the density and its integral, has the unit of its standard deviation.
fn walk_in_steps(rough: Rough, mut w: DVec3, draw: &mut impl FnMut() -> [f64; 4]) -> DVec3 {
    const STEP: f64 = 0.02;
    let p = |h: f64| libm::exp(-0.5 * h * h) / (2.0 * PI).sqrt();
    let below = |h: f64| 0.5 * libm::erfc(-h / 2f64.sqrt());
    let (mut side, mut h) = (rough, 5.0);
    loop {
        let cos = w.dot(side.normal);
        let lambda = lambda(side.alpha, cos.abs()) + if cos > 0.0 { 0.0 } else { 1.0 };
        let mut left = -ln(draw()[0]);
        while left > 0.0 {
            let middle = h + 0.5 * STEP * cos.signum();
            let facets = lambda * STEP * p(middle) / below(middle);
            h += STEP * cos.signum() * (left / facets).min(1.0);
            left -= facets;
            if h > 6.0 {
                return w;
            }
        }
        let facet = loop {
            let [u, turns, keep, _] = draw();
            let (sin_phi, cos_phi) = sin_cos_turns(turns);
            let facet = turn(side.normal, u, (1.0 - u * u).sqrt(), sin_phi, cos_phi);
            if keep * side.density(1.0) < -w.dot(facet) * side.density(u) {
                break facet;
            }
        };
        let met = refract(w, facet, side.n_from, side.n_to);
        w = met.reflected;
        if let Some(refracted) = met.refracted.filter(|_| draw()[0] >= met.reflectance) {
            (w, side, h) = (refracted, side.reversed(), -h);
        }
    }
}

/// Total albedos, and where the light goes, by both methods. Steps of 0.02, midpoint rule: their square is far below sigma.
#[test]
fn walks_in_small_steps_leave_the_same_way() {
    let moments: [fn(DVec3) -> f64; 3] = [|l| f64::from(u8::from(l.z > 0.0)), |l| l.z, |l| 0.6 * l.x - 0.8 * l.y];
    for (alpha, n_from, n_to, cos) in [(0.3, 1.4, 1.0, 0.6), (1.0, 1.0, 2.5, 0.7), (1.0, 1.5, 1.0, 0.4)] {
        let (rough, w) = (interface(alpha, n_from, n_to), down(cos));
        let steps: Vec<DVec3> = (0..40_000).map(|walk| walk_in_steps(rough, w, &mut dice(8, walk))).collect();
        for moment in moments {
            let one = mean(walks(rough, w, 9, 400_000).map(|(on, _)| moment(on)));
            let other = mean(steps.iter().map(|&on| moment(on)));
            agree(&format!("{rough:?}"), one, other);
        }
    }
}

/// Without roughness it is a smooth wall: Fresnel's share, and directions off the mirror's and Snell's by a few alpha (as far as 1e5 facets reach: slopes
/// of 300 alpha).
#[test]
fn a_little_roughness_is_a_smooth_wall() {
    let alpha = 1e-5;
    for (n_from, n_to, cos) in [(1.0, 1.4, 0.9), (1.4, 1.0, 0.9), (1.4, 1.0, 0.3), (1.0, 2.5, 0.2)] {
        let (rough, w) = (interface(alpha, n_from, n_to), down(cos));
        let smooth = refract(w, DVec3::Z, n_from, n_to);
        let off = |on: DVec3| {
            (on - if on.z > 0.0 { smooth.reflected } else { smooth.refracted.expect("it passes") }).length()
        };
        assert!(walks(rough, w, 10, 100_000).all(|(on, _)| off(on) < 1e4 * alpha));
        let share = mean(walks(rough, w, 10, 100_000).map(|(on, _)| f64::from(u8::from(on.z > 0.0))));
        agree(&format!("{rough:?}"), share, (smooth.reflectance, 0.0));
    }
}
