//! Directions: cosines with Fresnel's surface built in, azimuths of a quarter turn, associated Legendre functions.

use std::f64::consts::{FRAC_PI_2, SQRT_2};

use crate::fresnel;
use crate::quadrature::gauss_legendre_on;

/// The downward hemisphere by its cosines mu in (0, 1); the upward one is its mirror image.
pub struct Cosines {
    pub mu: Vec<f64>,
    /// Weights of int_0^1 d mu.
    pub weight: Vec<f64>,
    /// Fresnel reflectance of the surface, seen from inside.
    pub rho: Vec<f64>,
}

impl Cosines {
    /// `count` Gauss nodes; for n > 1 half of them on either side of the critical angle, those inside the escape cone
    /// crowded towards it, where Fresnel's transmittance has a square root. `fine`: crowded towards grazing too, for
    /// patterns finer than a mean free path.
    pub fn new(n: f64, count: usize, fine: bool) -> Self {
        let below = |end: f64, count: usize| {
            let rule = gauss_legendre_on(0.0, 1.0, count).into_iter();
            rule.map(move |(t, w)| if fine { (end * t * t, 2.0 * end * t * w) } else { (end * t, end * w) })
        };
        let mut nodes: Vec<(f64, f64)> = Vec::with_capacity(count);
        if n == 1.0 {
            nodes.extend(below(1.0, count));
        } else {
            let critical = fresnel::critical_cos(n);
            nodes.extend(below(critical, count / 2));
            // mu - critical = t^2 (1 - critical): the cosine outside, and so Fresnel's formulas, are analytic in t.
            nodes.extend(
                gauss_legendre_on(0.0, 1.0, count.div_ceil(2))
                    .into_iter()
                    .map(|(t, weight)| (critical + (1.0 - critical) * t * t, 2.0 * weight * t * (1.0 - critical))),
            );
        }
        let (mu, weight): (Vec<f64>, Vec<f64>) = nodes.into_iter().unzip();
        let rho = mu.iter().map(|&mu| fresnel::reflectance(n, mu)).collect();
        Self { mu, weight, rho }
    }
}

/// Azimuths in (0, pi/2); the fields' symmetries, psi(-phi) = psi(phi) and psi(pi - phi) = conj psi(phi), give the rest.
pub struct Azimuths {
    pub cos: Vec<f64>,
    /// Weights of the mean over the turn.
    pub weight: Vec<f64>,
    /// `mode[m][p]` = sqrt(2 - delta_m0) cos(m phi_p), with the sign of (-i)^m: even modes are real parts, odd ones
    /// imaginary parts.
    pub mode: Vec<Vec<f64>>,
}

impl Azimuths {
    /// How many azimuths the modes and the factor 1 / (1 + i kappa cos phi) need: midpoints converge as
    /// (kappa / (1 + sqrt(1 + kappa^2)))^(4 count); for large kappa nodes crowd where cos phi = 0.
    pub fn needed(modes: usize, kappa: f64) -> usize {
        let r = kappa / (1.0 + (1.0 + kappa * kappa).sqrt());
        let evenly = (libm::log(1e-8) / (4.0 * libm::log(r))).ceil();
        (modes / 2 + 1).max(if evenly <= EVENLY { evenly as usize } else { crowded(kappa) + modes / 2 })
    }

    pub fn new(modes: usize, count: usize, kappa: f64) -> Self {
        let nodes: Vec<(f64, f64)> = if count <= EVENLY as usize && count < crowded(kappa) {
            (0..count).map(|p| ((p as f64 + 0.5) * FRAC_PI_2 / count as f64, 1.0 / count as f64)).collect()
        } else {
            // pi/2 - phi = sinh(t) / kappa: the pole at cos phi = i / kappa keeps its distance in t.
            gauss_legendre_on(0.0, libm::asinh(FRAC_PI_2 * kappa), count)
                .into_iter()
                .map(|(t, weight)| (FRAC_PI_2 - libm::sinh(t) / kappa, weight * libm::cosh(t) / (kappa * FRAC_PI_2)))
                .collect()
        };
        let mode = (0..modes).map(|m| nodes.iter().map(|&(phi, _)| phased_mode(m, phi)).collect()).collect();
        Self {
            cos: nodes.iter().map(|&(phi, _)| libm::cos(phi)).collect(),
            weight: nodes.iter().map(|&(_, weight)| weight).collect(),
            mode,
        }
    }
}

/// The most azimuths spaced evenly.
const EVENLY: f64 = 24.0;

fn crowded(kappa: f64) -> usize {
    (14.0 + 3.0 * libm::log(1.0 + kappa)) as usize
}

fn phased_mode(m: usize, phi: f64) -> f64 {
    // (-i)^m = 1, -i, -1, i, ...
    let sign = [1.0, -1.0, -1.0, 1.0][m % 4];
    sign * if m == 0 { 1.0 } else { SQRT_2 * libm::cos(m as f64 * phi) }
}

/// Associated Legendre functions of order m, normalised to int_-1^1 P^2 = 1: `[l - m][i]` for m <= l <= `degree` at `mu[i]`.
pub fn legendre(degree: usize, m: usize, mu: &[f64]) -> Vec<Vec<f64>> {
    let mut rows: Vec<Vec<f64>> = Vec::with_capacity(degree + 1 - m);
    let start = (1..=m).fold(0.5f64.sqrt(), |p, k| p * ((2 * k + 1) as f64 / (2 * k) as f64).sqrt());
    rows.push(
        mu.iter()
            .map(|&mu| {
                let sin = ((1.0 - mu) * (1.0 + mu)).sqrt();
                (0..m).fold(start, |p, _| p * sin)
            })
            .collect(),
    );
    let square = |k: usize| (k * k) as f64;
    for l in m + 1..=degree {
        let a = ((4.0 * square(l) - 1.0) / (square(l) - square(m))).sqrt();
        let b = if l > m + 1 { ((square(l - 1) - square(m)) / (4.0 * square(l - 1) - 1.0)).sqrt() } else { 0.0 };
        let row = (0..mu.len())
            .map(|i| {
                let before = if l > m + 1 { rows[l - m - 2][i] } else { 0.0 };
                a * (mu[i] * rows[l - m - 1][i] - b * before)
            })
            .collect();
        rows.push(row);
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Orthonormal under the quadrature, both parities, up to its degree; 1e-13 is rounding of some 30 terms.
    #[test]
    fn legendre_functions_are_orthonormal() {
        let cosines = Cosines::new(1.0, 24, false);
        for m in [0, 1, 5] {
            let p = legendre(20, m, &cosines.mu);
            for a in 0..p.len() {
                for b in (a % 2..p.len()).step_by(2) {
                    let sum: f64 = (0..24).map(|i| 2.0 * cosines.weight[i] * p[a][i] * p[b][i]).sum();
                    assert!((sum - f64::from(u8::from(a == b))).abs() < 1e-13, "m = {m}, {a} {b}: {sum}");
                }
            }
        }
    }

    /// The weights integrate 1 over the hemisphere whatever the index; azimuth modes are orthonormal over the turn.
    #[test]
    fn weights_fill_the_sphere() {
        for n in [1.0, 1.0 + 1e-12, 1.4, 3.0] {
            let total: f64 = Cosines::new(n, 20, n > 1.2).weight.iter().sum();
            assert!((total - 1.0).abs() < 1e-12, "n = {n}: {total}");
        }
        let azimuths = Azimuths::new(9, 9, 0.5);
        for a in 0..9 {
            for b in (a % 2..9).step_by(2) {
                let mean: f64 = (0..9).map(|p| azimuths.weight[p] * azimuths.mode[a][p] * azimuths.mode[b][p]).sum();
                assert!((mean - f64::from(u8::from(a == b))).abs() < 1e-13, "{a} {b}: {mean}");
            }
        }
    }
}
