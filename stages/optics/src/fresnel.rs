//! Fresnel's formulas for unpolarised light at a smooth surface, and their diffuse moments.

use crate::quadrature::gauss_legendre_on;

/// Cosine of the refracted ray, for `cos` inside a medium of relative index `n` (towards the outside).
///
/// `None` beyond the critical angle.
pub fn refracted_cos(n: f64, cos: f64) -> Option<f64> {
    let sin2 = n * n * (1.0 - cos * cos);
    (sin2 < 1.0).then(|| (1.0 - sin2).sqrt())
}

/// Reflectance of the surface seen from inside: `cos` >= 0 in the medium of relative index `n`; also for n < 1.
///
/// 1 under total reflection, 0 where n = 1.
pub fn reflectance(n: f64, cos: f64) -> f64 {
    if n == 1.0 {
        return 0.0;
    }
    let Some(cos_out) = refracted_cos(n, cos) else { return 1.0 };
    let s = (n * cos - cos_out) / (n * cos + cos_out);
    let p = (cos - n * cos_out) / (cos + n * cos_out);
    0.5 * (s * s + p * p)
}

/// Reflectance at normal incidence, ((n - 1) / (n + 1))^2, from either side.
pub fn normal_reflectance(n: f64) -> f64 {
    let r = (n - 1.0) / (n + 1.0);
    r * r
}

/// Cosine of the critical angle inside a medium of relative index `n` >= 1; 0 where n = 1.
pub fn critical_cos(n: f64) -> f64 {
    ((n - 1.0) * (n + 1.0)).sqrt() / n
}

/// The moments `2 int R cos dcos` and `3 int R cos^2 dcos` over [0, 1] of the reflectance R seen from inside (n >= 1).
///
/// They are the reflected fractions of a diffuse radiance's flux and of its gradient part (Haskell et al., J. Opt.
/// Soc. Am. A 11, 2727 (1994)). Relative error below 1e-12: in the cosine outside, R is analytic.
pub fn diffuse_moments(n: f64) -> (f64, f64) {
    if n == 1.0 {
        return (0.0, 0.0);
    }
    let critical = critical_cos(n);
    let (mut flux, mut gradient) = (critical * critical, critical * critical * critical);
    for (cos_out, weight) in gauss_legendre_on(0.0, 1.0, 48) {
        let cos = (1.0 - (1.0 - cos_out * cos_out) / (n * n)).sqrt();
        // d cos = cos_out / (n^2 cos) d cos_out
        let r = reflectance(n, cos) * weight * cos_out / (n * n);
        flux += 2.0 * r;
        gradient += 3.0 * r * cos;
    }
    (flux, gradient)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Both sides of the surface reflect the same fraction (reciprocity).
    #[test]
    fn both_sides_reflect_alike() {
        for n in [1.0, 1.000001, 1.33, 1.4, 2.5] {
            for cos_out in [1e-3, 0.3, 0.8, 1.0] {
                let cos: f64 = (1.0f64 - (1.0 - cos_out * cos_out) / (n * n)).sqrt();
                let (inside, outside) = (reflectance(n, cos), reflectance(1.0 / n, cos_out));
                // The cosine outside comes back from 1 - sin^2: its rounding grows as 1 / cos_out^2.
                let tolerance = 1e-15 * n * n / (cos_out * cos_out);
                assert!((inside - outside).abs() < tolerance, "n = {n}, cos_out = {cos_out}: {inside} {outside}");
            }
            assert!((reflectance(n, 1.0) - normal_reflectance(n)).abs() < 1e-15);
        }
    }

    /// The flux moments inside and outside obey n^2 (1 - r_inside) = 1 - r_outside (equal brightness); the outside
    /// moment has a closed form for n = 1.5 only as a number: r_outside = 0.0918 (Walsh 1926).
    #[test]
    fn diffuse_flux_moment_is_walshs() {
        for n in [1.0, 1.33, 1.4, 1.5, 2.5] {
            let n2: f64 = n * n;
            let walsh = if n == 1.0 {
                0.0
            } else {
                0.5 + (n - 1.0) * (3.0 * n + 1.0) / (6.0 * (n + 1.0) * (n + 1.0))
                    + n2 * (n2 - 1.0) * (n2 - 1.0) / libm::pow(n2 + 1.0, 3.0) * libm::log((n - 1.0) / (n + 1.0))
                    - 2.0 * n * n2 * (n2 + 2.0 * n - 1.0) / ((n2 + 1.0) * (n2 * n2 - 1.0))
                    + 8.0 * n2 * n2 * (n2 * n2 + 1.0) / ((n2 + 1.0) * (n2 * n2 - 1.0) * (n2 * n2 - 1.0)) * libm::log(n)
            };
            let inside = diffuse_moments(n).0;
            assert!((n2 * (1.0 - inside) - (1.0 - walsh)).abs() < 1e-11, "n = {n}: {inside} {walsh}");
        }
    }

    #[test]
    fn critical_angle_divides_total_from_partial_reflection() {
        let c = critical_cos(1.4);
        assert_eq!(reflectance(1.4, c - 1e-12), 1.0);
        assert!(reflectance(1.4, c + 1e-12) < 1.0);
        assert_eq!(critical_cos(1.0), 0.0);
    }
}
