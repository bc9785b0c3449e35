//! Next-event estimation one scattering ahead: where on the line of the next flight a point is taken, and how often any is.

use std::f64::consts::FRAC_1_PI;

use turbid_optics::elementary::{exp, ln};
use turbid_optics::{Medium, diffusion};

use crate::world::Material;

/// A vertex is connected with probability min(1, (TAU_SURE / tau)^4) at optical distance tau from the light; estimating ahead, from the plane of
/// the interface through which it comes.
pub const TAU_SURE: f64 = 3.0;
/// The same where light comes through curved interfaces or facets: there connections cost far more than flights ...
pub const TAU_SURE_WHERE_DEAR: f64 = 2.0;
/// ... and those expected to bring less than this part of what a whole path does are made with the probability of their part of that ...
const WORTH: f64 = 0.3;
/// ... and no less than this: what is expected takes interfaces for flat, and knows of one refraction only.
pub const LEAST_CHANCE: f64 = 1.0 / 16.0;
/// Connections other than the likeliest are tried with this probability: they carry a few per cent of the light.
pub(crate) const OTHER_CONNECTIONS: f64 = 0.125;
/// A density that falls by less than this along a line is taken as even, before its `mass` loses digits.
pub const FLAT: f64 = 0.02;
/// Optical depth at which nothing is left; [`exp`] needs a bound.
const DARK: f64 = 700.0;

/// What light of irradiance 1 does along a line below a plane, the optical depth `tau` away, through which it comes: the integral of mu_t exp(-mu_t s) times
/// what is left of it at s; `steepness` as of [`ahead`].
#[inline]
pub fn expected(steepness: f64, tau: f64) -> f64 {
    let fall = 1.0 - steepness;
    let at_once = exp(-tau.min(DARK));
    if fall.abs() < FLAT {
        return tau * at_once;
    }
    let left = if steepness > 0.0 { exp(-(tau / steepness).min(DARK)) } else { 0.0 };
    (at_once - left) / fall
}

/// What an estimate of a vertex in this material has to bring to be made for sure, over what irradiates it, sr^-1.
pub fn worth(material: &Material) -> f64 {
    let medium =
        Medium { mu_a: material.mu_a, mu_s_prime: material.mu_s_prime(), phase: material.phase, n: material.n };
    let reflectance = diffusion::reflectance(&medium, None, 0.0).map_or(0.0, |r| r.hemispherical_incident);
    WORTH * reflectance * FRAC_1_PI * material.n * material.n
}

/// One over the probability with which an estimate is made that is expected to bring so much.
#[inline]
pub fn inverse_chance(expected: f64, worth: f64) -> f64 {
    // Where nothing is expected that is not a number, or infinite.
    let inverse = worth / expected;
    if inverse < 1.0 / LEAST_CHANCE { inverse.max(1.0) } else { 1.0 / LEAST_CHANCE }
}

/// With which probability connections other than the likeliest are tried at a point that is connected at all with a probability of one over `inverse_chance`. That
/// probability follows the likeliest connection; the others are tried more often there, so that they become less rare, and less bright when they are found.
#[inline]
pub fn others(inverse_chance: f64) -> f64 {
    (OTHER_CONNECTIONS * inverse_chance.sqrt()).min(1.0)
}

/// s in (0, length) from a density proportional to exp(-rate s), and one over that density.
///
/// Below a plane the optical depth to the light falls by mu_t `steepness` per mm: then the rate mu_t (1 - steepness) makes every s
/// score the same. Elsewhere it is a guess, kept where the weight cannot explode: [-1, 2] mu_t. Any rate is unbiased.
#[inline]
pub fn ahead(steepness: f64, length: f64, mu_t: f64, u: f64) -> (f64, f64) {
    let rate = if steepness.is_nan() { 1.0 } else { 1.0 - steepness }.clamp(-1.0, 2.0) * mu_t;
    // On an infinite length only positive rates have a density.
    let rate = if (length == f64::INFINITY) & (rate <= 1e-4 * mu_t) { mu_t } else { rate };
    let steep = (rate * length).abs();
    let mass = 1.0 - exp(-steep.min(DARK));
    let left = 1.0 - u * mass;
    let fallen = (-ln(left) / rate.abs()).min(length);
    // A growing density is a falling one seen from the other end.
    let s = if rate > 0.0 { fallen } else { length - fallen };
    let flat = steep < FLAT;
    (if flat { u * length } else { s }, if flat { length } else { mass / (rate.abs() * left) })
}

/// Optical depth below the plane through which the light comes, which is `tau` away at the cosine `cos`; at least what is known.
///
/// An estimate ahead is from further on along the path, which may come up to the interface the short way: where light grazes the exit, it is far
/// away from places near which it is bright. A roulette by `tau` itself would leave those to one estimate in very many (measured in a tube
/// lit along its axis: kurtosis above 2000, intervals of two standard errors that hold the truth in 86 % of cases after 256 paths).
#[inline]
pub fn depth(tau: f64, cos: f64, least: f64) -> f64 {
    let depth = tau * cos.abs();
    if depth > least { depth } else { least }
}

/// One over the probability of connecting at optical distance `tau`, for sure up to `sure`; that falls slower than the light does.
#[inline]
pub fn inverse_survival(tau: f64, sure: f64) -> f64 {
    let x = (tau * (1.0 / sure)).max(1.0);
    x * x * x * x
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against Simpson's rule along the line: up to the plane where it comes to that, else to the end of all light.
    #[test]
    fn what_is_expected_is_the_integral_along_the_line() {
        for tau in [0.0, 1e-3, 0.3, 2.0, 9.0, 300.0] {
            for steepness in [-3.0, -1.0, 0.0, 0.2, 0.97, 1.0, 1.03, 4.0] {
                let end = if steepness > 0.0 { f64::min(tau / steepness, 60.0) } else { 60.0 };
                let light = |s: f64| f64::exp(-s - (tau - s * steepness));
                let n = 20_000;
                let weight = |i: usize| if i == 0 || i == n { 1.0 } else { 2.0 + 2.0 * (i % 2) as f64 };
                let step = end / n as f64;
                let sum: f64 = (0..=n).map(|i| weight(i) * light(i as f64 * step)).sum::<f64>() * step / 3.0;
                let found = expected(steepness, tau);
                // Near 1 a line along which nothing falls stands for those along which little does.
                let slack = if (steepness - 1.0_f64).abs() > FLAT { 1e-6 } else { 1e-6 + FLAT * tau };
                assert!((found - sum).abs() <= slack * sum + 1e-12, "{steepness}, {tau}: {found}, {sum}");
            }
        }
    }

    /// For sure from what is worth it on; rare below that, whatever is expected.
    #[test]
    fn chances_are_probabilities() {
        for (expected, inverse) in
            [(2.0, 1.0), (1.0, 1.0), (0.5, 2.0), (1e-9, 16.0), (0.0, 16.0), (f64::INFINITY, 1.0), (f64::NAN, 16.0)]
        {
            assert_eq!(inverse_chance(expected, 1.0), inverse, "{expected}");
        }
        assert_eq!(inverse_chance(0.0, 0.0), 1.0 / LEAST_CHANCE);
        for inverse in [1.0, 2.0, 16.0, 1e6] {
            let others = others(inverse);
            assert!((OTHER_CONNECTIONS..=1.0).contains(&others), "{inverse}: {others}");
        }
    }
}
