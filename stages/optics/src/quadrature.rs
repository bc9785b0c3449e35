//! Gauss-Legendre quadrature.

use std::f64::consts::PI;
use std::sync::OnceLock;

/// Rules of fewer points are kept: they are asked for again and again.
const KEPT: usize = 129;
static RULES: [OnceLock<Vec<(f64, f64)>>; KEPT] = [const { OnceLock::new() }; KEPT];

/// Nodes (increasing) and weights of the n-point rule on [-1, 1]; exact for polynomials of degree 2n - 1.
///
/// Newton's iteration on P_n from the asymptotic guess; a few ulp up to n of some thousand.
pub fn gauss_legendre(n: usize) -> Vec<(f64, f64)> {
    assert!(n > 0, "a quadrature without nodes");
    RULES.get(n).map_or_else(|| worked_out(n), |rule| rule.get_or_init(|| worked_out(n)).clone())
}

fn worked_out(n: usize) -> Vec<(f64, f64)> {
    let mut rule = vec![(0.0, 0.0); n];
    for i in 0..n.div_ceil(2) {
        let mut x = libm::cos(PI * (i as f64 + 0.75) / (n as f64 + 0.5));
        let mut slope = 1.0;
        for _ in 0..100 {
            let (p, dp) = legendre_with_slope(n, x);
            slope = dp;
            let step = p / dp;
            x -= step;
            if step.abs() <= 1e-16 {
                break;
            }
        }
        if 2 * i + 1 == n {
            x = 0.0;
            slope = legendre_with_slope(n, 0.0).1;
        }
        let weight = 2.0 / ((1.0 - x * x) * slope * slope);
        rule[n - 1 - i] = (x, weight);
        rule[i] = (-x, weight);
    }
    rule
}

/// The n-point rule on [a, b].
pub fn gauss_legendre_on(a: f64, b: f64, n: usize) -> Vec<(f64, f64)> {
    let half = 0.5 * (b - a);
    gauss_legendre(n).into_iter().map(|(x, w)| (a + half * (1.0 + x), half * w)).collect()
}

fn legendre_with_slope(n: usize, x: f64) -> (f64, f64) {
    let (mut before, mut p) = (1.0, x);
    for l in 2..=n {
        let l = l as f64;
        (before, p) = (p, ((2.0 * l - 1.0) * x * p - (l - 1.0) * before) / l);
    }
    (p, n as f64 * (x * p - before) / (x * x - 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// int x^d over [-1, 1] = 2 / (d + 1) for even d <= 2n - 1; 1e-14 is n rounding errors of the largest term.
    #[test]
    fn exact_for_polynomials() {
        for n in [1, 2, 3, 16, 63] {
            for d in [0, (n - 1) / 2 * 2, 2 * n - 2] {
                let sum: f64 = gauss_legendre(n).iter().map(|&(x, w)| w * libm::pow(x, d as f64)).sum();
                assert!((sum - 2.0 / (d as f64 + 1.0)).abs() < 1e-14 * n as f64, "n = {n}, degree {d}: {sum}");
            }
        }
    }
}
