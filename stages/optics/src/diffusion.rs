//! Diffusion approximation of the reflectance, Robin boundary with the exact Fresnel moments.

use crate::fresnel::{diffuse_moments, normal_reflectance};
use crate::{Error, Medium, Reflectance};

/// The boundary constant A = (1 + r_gradient) / (1 - r_flux) of the Robin condition phi = 2 A D dphi/dz; 1 for n = 1.
///
/// n = 1.4: 2.9485. The common polynomial in n for the effective reflection (Egan and Hilgeman) is 10 % off.
pub fn a_robin(n: f64) -> f64 {
    let (flux, gradient) = diffuse_moments(n);
    (1.0 + gradient) / (1.0 - flux)
}

/// Reflectance of a half-space (`thickness` `None`) in the diffusion approximation.
///
/// The radiance that leaves is taken as Lambertian, so `camera` is `hemispherical_incident`. Per light that entered,
/// R = a' / ((1 + x) (1 + 2 A x / 3)) with a' = mu_s' / mu_tr, x = sqrt(3 mu_a mu_tr + (2 pi f_x)^2) / mu_tr
/// (Svaasand et al. 1999; Cuccia et al., J. Biomed. Opt. 14, 024012 (2009)). Against transport it is off by up to
/// 3 % for mu_a << mu_s' and f_x << mu_s', and by 40 % for strong absorption or fine patterns.
///
/// Errors: a property out of range; an empty medium; a slab (diffusion between two boundaries is not offered:
/// it is worst just where a slab matters).
pub fn reflectance(medium: &Medium, thickness: Option<f64>, f_x_per_mm: f64) -> Result<Reflectance, Error> {
    medium.check()?;
    check_f_x(f_x_per_mm)?;
    if let Some(value) = thickness {
        return Err(Error::Range {
            name: "thickness",
            value,
            unit: "mm",
            must: "be left out with the diffusion model, which knows the half-space only",
        });
    }
    let mu_tr = medium.mu_a + medium.mu_s_prime;
    Error::unless(mu_tr > 0.0, "mu_a + mu_s_prime", mu_tr, "mm^-1", "be > 0")?;
    let q = std::f64::consts::TAU * f_x_per_mm;
    let x = (3.0 * medium.mu_a * mu_tr + q * q).sqrt() / mu_tr;
    let entered = medium.mu_s_prime / mu_tr / ((1.0 + x) * (1.0 + 2.0 / 3.0 * a_robin(medium.n) * x));
    let incident = (1.0 - normal_reflectance(medium.n)) * entered;
    Ok(Reflectance { camera: incident, hemispherical_incident: incident, hemispherical_entered: entered })
}

pub(crate) fn check_f_x(f_x: f64) -> Result<(), Error> {
    Error::unless(f_x >= 0.0 && f_x.is_finite(), "f_x", f_x, "mm^-1", "be a finite number >= 0")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::PhaseFunction;

    /// Published values of the exact moments, to the digits given.
    #[test]
    fn boundary_constant() {
        assert_eq!(a_robin(1.0), 1.0);
        assert!((a_robin(1.4) - 2.9485).abs() < 5e-5);
        assert!((a_robin(1.33) - 2.5154).abs() < 5e-5);
    }

    /// Nothing is lost without absorption; the scaling law holds to rounding; the limits are finite.
    #[test]
    fn limits() {
        let medium = Medium { mu_a: 0.0, mu_s_prime: 1.0, phase: PhaseFunction::henyey_greenstein(0.8), n: 1.4 };
        assert_eq!(reflectance(&medium, None, 0.0).unwrap().hemispherical_entered, 1.0);
        let fine = reflectance(&medium, None, 1e6).unwrap().camera;
        assert!(fine > 0.0 && fine < 1e-12);
        let a = reflectance(&Medium { mu_a: 0.02, mu_s_prime: 0.7, ..medium }, None, 0.1).unwrap();
        let b = reflectance(&Medium { mu_a: 0.06, mu_s_prime: 2.1, ..medium }, None, 0.3).unwrap();
        assert!((a.camera / b.camera - 1.0).abs() < 1e-14);
        assert!(reflectance(&medium, Some(1.0), 0.0).is_err());
        assert!(reflectance(&Medium { mu_a: f64::NAN, ..medium }, None, 0.0).is_err());
        assert!(reflectance(&Medium { mu_s_prime: 0.0, ..medium }, None, 0.0).is_err());
    }
}
