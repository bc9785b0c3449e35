//! The directions of the calculation and how scattering couples them.

#![allow(clippy::needless_range_loop, reason = "rows and columns of one matrix")]

use turbid_optics::fresnel::critical_cos;
use turbid_optics::quadrature::gauss_legendre_on;

use crate::matrix::{Matrix, zeros};

/// N cosines in (0, 1], increasing, the last one 1 (the beam along the normal), with weights for integrals over [0, 1].
///
/// Matched slab: Gauss-Radau. Otherwise Gauss below the critical cosine, where all light is reflected, and above it
/// Radau in the cosine in air: there Fresnel's reflectance has no square-root corner.
pub fn nodes<const N: usize>(n: f64) -> [(f64, f64); N] {
    let critical = critical_cos(n);
    let trapped = if n == 1.0 { 0 } else { 3 * N / 8 };
    let mut rule = [(0.0, 0.0); N];
    if trapped > 0 {
        rule[..trapped].copy_from_slice(&gauss_legendre_on(0.0, critical, trapped));
    }
    for (node, (x, w)) in rule[trapped..].iter_mut().zip(radau(N - trapped)) {
        // n^2 cos d cos = cos_air d cos_air; for n = 1 the map is the identity.
        let cos = (1.0 - (1.0 - x * x) / (n * n)).sqrt();
        *node = if n == 1.0 { (x, w) } else { (cos, w * x / (n * n * cos)) };
    }
    rule
}

/// The n-point Gauss-Radau rule on [0, 1] with a node at 1, increasing; exact to degree 2n - 2.
fn radau(n: usize) -> Vec<(f64, f64)> {
    if n == 1 {
        return vec![(1.0, 1.0)];
    }
    // Nodes on [-1, 1] with one at -1 are the zeros of (P_{n-1} + P_n) / (1 + x); mirrored here.
    let value = |x: f64| {
        let (mut before, mut p) = (1.0, x);
        let (mut slope_before, mut slope) = (0.0, 1.0);
        for l in 2..=n {
            let l = l as f64;
            let next = ((2.0 * l - 1.0) * x * p - (l - 1.0) * before) / l;
            let next_slope = slope_before + (2.0 * l - 1.0) * p;
            (before, p) = (p, next);
            (slope_before, slope) = (slope, next_slope);
        }
        (before, (before + p) / (1.0 + x), (slope_before + slope) / (1.0 + x) - (before + p) / ((1.0 + x) * (1.0 + x)))
    };
    let count = n as f64;
    let mut rule = vec![(1.0, 1.0 / (count * count))];
    let mut found: Vec<f64> = Vec::new();
    for i in 0..n - 1 {
        let mut x = libm::cos(std::f64::consts::PI * 2.0 * (i as f64 + 0.5 + 0.25) / (2.0 * count - 1.0 + 0.5));
        for _ in 0..100 {
            let (_, f, slope) = value(x);
            // Newton with the zeros already found divided out: it cannot return to one of them.
            let pushed: f64 = found.iter().map(|z| 1.0 / (x - z)).sum();
            let step = f / (slope - f * pushed);
            x -= step;
            if step.abs() <= 1e-16 {
                break;
            }
        }
        found.push(x);
        let p = value(x).0;
        rule.push((0.5 * (1.0 - x), 0.5 * (1.0 - x) / (count * count * p * p)));
    }
    rule.sort_by(|a, b| a.0.total_cmp(&b.0));
    rule
}

/// Scattering between the nodes, azimuth averaged, for one Henyey-Greenstein phase function.
pub struct Coupling<const N: usize> {
    /// Even part, times both weights, off the diagonal; the diagonal follows from conservation.
    pub even: Matrix<N>,
    /// Odd part, times the roots of both weights.
    pub odd: Matrix<N>,
    /// Fraction of the scattering in the peak, which is taken as exactly forward (g > 0) or backward (g < 0).
    pub peak: f64,
    /// 1 - peak, with all its digits.
    pub rest: f64,
}

impl<const N: usize> Coupling<N> {
    /// For the rule of [`nodes`] at index `n` and anisotropy `g` in (-1, 1).
    pub fn new(nodes: &[(f64, f64); N], n: f64, g: f64) -> Self {
        // Radau integrates products of these exactly. The rule of n > 1 does not, and more terms alias: at N = 16, n = 1.4,
        // g <= 0.9 the worst error is 8.8e-4 with N terms, 4.5e-4 with 5 N / 4, 7.4e-4 with 3 N / 2.
        let terms = if n == 1.0 { 2 * N } else { 5 * N / 4 };
        let sharp = g.abs();
        let log = if sharp > 0.0 { libm::log(sharp) } else { -800.0 };
        let order = terms as f64;
        let (peak, rest) = (libm::exp(order * log), -libm::expm1(order * log));
        let legendre = nodes.map(|(x, _)| {
            let mut values = vec![1.0, x];
            for l in 2..terms {
                let k = l as f64;
                values.push(((2.0 * k - 1.0) * x * values[l - 1] - (k - 1.0) * values[l - 2]) / k);
            }
            values
        });
        let (mut even, mut odd) = (zeros(), zeros());
        for l in 0..terms {
            // (|g|^l - f) / (1 - f) = |g|^l (1 - |g|^(L-l)) / (1 - |g|^L).
            let moment = libm::exp(l as f64 * log) * -libm::expm1((order - l as f64) * log) / rest;
            let moment = if l % 2 == 1 && g < 0.0 { -moment } else { moment };
            let factor = (2 * l + 1) as f64 * moment;
            let part: &mut Matrix<N> = if l % 2 == 0 { &mut even } else { &mut odd };
            for i in 0..N {
                for j in 0..N {
                    part[i][j] += factor * legendre[i][l] * legendre[j][l];
                }
            }
        }
        for i in 0..N {
            for j in 0..N {
                let both = nodes[i].1 * nodes[j].1;
                even[i][j] *= both;
                odd[i][j] *= both.sqrt();
            }
        }
        Self { even, odd, peak, rest }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// int x^d over [0, 1] = 1 / (d + 1) up to degree 2n - 2; 1e-14: n roundings.
    #[test]
    fn radau_is_exact_for_polynomials() {
        for n in [1, 2, 3, 8, 33, 64] {
            let rule = radau(n);
            assert!(rule.is_sorted_by(|a, b| a.0 < b.0) && rule[n - 1].0 == 1.0);
            for d in [0, 1, n - 1, 2 * n - 2] {
                let sum = rule.iter().fold(0.0, |sum, &(x, w)| sum + w * libm::pow(x, d as f64));
                assert!(
                    (sum * (d as f64 + 1.0) - 1.0).abs() < 3e-14 * n as f64 || d > 2 * n - 2,
                    "n = {n}, d = {d}: {sum}"
                );
            }
        }
    }

    /// Over all directions cos integrates to 1 / 2 and a diffuse flux from air to 1 (exactly: Radau in the cosine in air).
    #[test]
    fn nodes_hold_the_diffuse_flux() {
        for n in [1.0f64, 1.0001, 1.4, 3.0] {
            let rule = nodes::<16>(n);
            let total = rule.iter().fold(0.0, |sum, &(x, w)| sum + x * w);
            let free =
                rule.iter().filter(|node| node.0 > critical_cos(n)).fold(0.0, |sum, &(x, w)| sum + 2.0 * n * n * x * w);
            assert!((total - 0.5).abs() < 1e-14 && (free - 1.0).abs() < 1e-14, "n = {n}: {total} {free}");
        }
    }

    /// Matched, each node scatters all that it scatters: Radau is exact for every even moment kept.
    #[test]
    fn coupling_conserves() {
        let rule = nodes::<8>(1.0);
        for g in [-0.9, 0.0, 0.5, 0.99] {
            for (row, (_, weight)) in Coupling::new(&rule, 1.0, g).even.iter().zip(rule) {
                let sum = row.iter().fold(0.0, |sum, x| sum + x);
                assert!((sum / weight - 1.0).abs() < 1e-12, "g = {g}: {sum} of {weight}");
            }
        }
    }
}
