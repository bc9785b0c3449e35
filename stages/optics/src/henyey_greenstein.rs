//! The Henyey-Greenstein phase function: value and sampling, for every |g| < 1.
//!
//! Source: Henyey, Greenstein, Astrophys. J. 93, 70 (1941).

use std::f64::consts::PI;

use glam::DVec3;

use crate::elementary::sin_cos_turns;

/// 1 + g^2 - 2 g cos(theta), the denominator of the phase function to the power 2/3; written so that it loses no digits
/// at g -> 1, theta -> 0.
#[inline(always)]
pub fn denominator(g: f64, cos: f64) -> f64 {
    (1.0 - g) * (1.0 - g) + 2.0 * g * (1.0 - cos)
}

/// Probability of scattering by theta, per steradian; integrates to 1 over the sphere.
#[inline(always)]
pub fn density(g: f64, cos: f64) -> f64 {
    let q = denominator(g, cos);
    (1.0 - g) * (1.0 + g) / (4.0 * PI * q * q.sqrt())
}

/// 1 - cos(theta) for a uniform u in (0, 1), by inversion of the distribution function.
///
/// 2 (1-g)^2 (1-u) (1+g u) / (1 - g + 2 g u)^2: the textbook (1 + g^2 - s^2) / 2g without its division by g and without its
/// cancellation at small angles; g = 0 needs no case of its own.
#[inline(always)]
pub fn sample_one_minus_cos(g: f64, u: f64) -> f64 {
    let ratio = (1.0 - g) / (1.0 - g + 2.0 * g * u);
    2.0 * ratio * ratio * (1.0 - u) * (1.0 + g * u)
}

/// A direction scattered from the unit vector `w`, for uniforms u in (0, 1) and `turns` in [0, 1) or [-1/2, 1/2).
#[inline(always)]
pub fn sample(g: f64, w: DVec3, u: f64, turns: f64) -> DVec3 {
    let h = sample_one_minus_cos(g, u);
    let (sin_phi, cos_phi) = sin_cos_turns(turns);
    turn(w, 1.0 - h, (h * (2.0 - h)).max(0.0).sqrt(), sin_phi, cos_phi)
}

/// The unit vector at angle theta from the unit vector `w`, azimuth phi about it; stays of unit length over any number of turns.
#[inline(always)]
pub fn turn(w: DVec3, cos_theta: f64, sin_theta: f64, sin_phi: f64, cos_phi: f64) -> DVec3 {
    // Orthonormal basis without a branch: Duff et al., J. Comput. Graph. Tech. 6 (1), 1 (2017).
    let sign = 1f64.copysign(w.z);
    let a = -1.0 / (sign + w.z);
    let b = w.x * w.y * a;
    let (x, y) = (sin_theta * cos_phi, sin_theta * sin_phi);
    let turned = DVec3::new(
        x * (1.0 + sign * w.x * w.x * a) + y * b + cos_theta * w.x,
        x * sign * b + y * (sign + w.y * w.y * a) + cos_theta * w.y,
        -x * sign * w.x - y * w.y + cos_theta * w.z,
    );
    // One Newton step towards length 1: rounding would drift over millions of turns.
    turned * (1.5 - 0.5 * turned.length_squared())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::philox::{philox4x32, unit, unit_fine};

    const N: u32 = 200_000;

    fn uniforms(i: u32) -> (f64, f64) {
        let [a, b, c, _] = philox4x32([i, 7, 0, 0], [3, 4]);
        (unit_fine(a, b), unit(c))
    }

    /// E[cos theta] = g, and Var = (1 - g^2) / 3; 5 sigma of the exact variance (the sampled one misses the tail).
    #[test]
    fn mean_cosine_is_g() {
        for g in [-0.999_999, -0.5, 0.0, 1e-12, 1e-9, 0.3, 0.8, 0.999_999] {
            let mean = (0..N).map(|i| 1.0 - sample_one_minus_cos(g, uniforms(i).0)).sum::<f64>() / f64::from(N);
            let sigma = ((1.0 - g * g) / 3.0 / f64::from(N)).sqrt();
            assert!((mean - g).abs() <= 5.0 * sigma, "g = {g}: mean cosine {mean} +- {sigma}");
        }
    }

    /// Sampling inverts the distribution function F(cos) = (1-g^2)/2g (1/sqrt(q) - 1/(1+g)): u(cos(u)) = u. From 1 - cos,
    /// q has all its digits for g > 0; for g < 0 it cancels down to (1+g)^2 at the backward peak.
    #[test]
    fn sampling_inverts_the_distribution() {
        for g in [-0.99, -0.3, 1e-3, 0.5, 0.8, 0.99, 0.999_999] {
            for k in 1..200 {
                let u = f64::from(k) / 200.0;
                let q = (1.0 - g) * (1.0 - g) + 2.0 * g * sample_one_minus_cos(g, u);
                let back = (1.0 - g) * (1.0 + g) / (2.0 * g) * (1.0 / q.sqrt() - 1.0 / (1.0 + g));
                let cancelled = if g < 0.0 { 4.0 / (1.0 + g) / (1.0 + g) } else { 4.0 };
                let tolerance = f64::EPSILON * (cancelled + 4.0 / g.abs());
                assert!((back - u).abs() <= tolerance, "g = {g}, u = {u}: {back}");
            }
        }
    }

    /// The density integrates to 1, with mean cosine g; with q as the variable the integrand is smooth, 2000 Simpson
    /// steps leave 1e-9.
    #[test]
    fn density_integrates_to_one() {
        for g in [-0.9, -0.2, 0.0, 0.5, 0.9] {
            let n = 20_000;
            let (mut total, mut mean) = (0.0, 0.0);
            for i in 0..=n {
                let cos = -1.0 + 2.0 * f64::from(i) / f64::from(n);
                let weight = if i == 0 || i == n {
                    1.0
                } else if i % 2 == 1 {
                    4.0
                } else {
                    2.0
                };
                let p = weight * 2.0 * PI * density(g, cos) * 2.0 / f64::from(n) / 3.0;
                total += p;
                mean += p * cos;
            }
            assert!((total - 1.0).abs() < 1e-7 && (mean - g).abs() < 1e-7, "g = {g}: {total}, {mean}");
        }
    }

    /// Turned vectors keep angle and length, from every start; the azimuth is uniform: E[x] = E[y] = 0 about w.
    #[test]
    fn turning_keeps_angles_and_length() {
        for w in [DVec3::Z, DVec3::NEG_Z, DVec3::X, DVec3::new(0.6, -0.64, -0.48), DVec3::new(1e-9, 0.0, -1.0)] {
            let w = w.normalize();
            let mut sum = DVec3::ZERO;
            for i in 0..4000 {
                let (u, v) = uniforms(i);
                let e = sample(0.5, w, u, v);
                assert!((e.length() - 1.0).abs() < 1e-15 * 4.0);
                assert!((e.dot(w) - (1.0 - sample_one_minus_cos(0.5, u))).abs() < 1e-14);
                sum += e - e.dot(w) * w;
            }
            // Each component across has variance < 1/2.
            assert!(sum.length() < 5.0 * (0.5f64 * 4000.0 * 2.0).sqrt(), "{w}: {sum}");
        }
        let mut w = DVec3::Z;
        for i in 0..1_000_000 {
            w = turn(w, 0.8, 0.6, 0.28, 0.96 - f64::from(i % 2) * 1.92);
        }
        assert!((w.length() - 1.0).abs() < 1e-15, "{:e} after a million turns", w.length() - 1.0);
    }
}
