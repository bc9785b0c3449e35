//! A homogeneous turbid medium, and what it reflects.

use crate::{Error, PhaseFunction};

/// Optical properties of a medium, seen from vacuum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Medium {
    /// Absorption coefficient, mm^-1, >= 0.
    pub mu_a: f64,
    /// Reduced scattering coefficient mu_s (1 - g), mm^-1, >= 0; g the mean cosine of the phase function.
    pub mu_s_prime: f64,
    pub phase: PhaseFunction,
    /// Refractive index relative to the outside, >= 1.
    pub n: f64,
}

impl Medium {
    /// Scattering coefficient, mm^-1.
    pub fn mu_s(&self) -> f64 {
        self.mu_s_prime / (1.0 - self.phase.g())
    }

    /// Extinction coefficient mu_a + mu_s, mm^-1.
    pub fn mu_t(&self) -> f64 {
        self.mu_a + self.mu_s()
    }

    /// Single-scattering albedo mu_s / mu_t; the medium must not be empty.
    pub fn albedo(&self) -> f64 {
        self.mu_s() / self.mu_t()
    }

    /// Error: a property outside its range (a NaN is outside every range).
    pub fn check(&self) -> Result<(), Error> {
        const PER_MM: &str = "mm^-1";
        const NOT_NEGATIVE: &str = "be a finite number >= 0";
        let Self { mu_a, mu_s_prime, phase, n } = *self;
        Error::unless(mu_a >= 0.0 && mu_a.is_finite(), "mu_a", mu_a, PER_MM, NOT_NEGATIVE)?;
        Error::unless(mu_s_prime >= 0.0 && mu_s_prime.is_finite(), "mu_s_prime", mu_s_prime, PER_MM, NOT_NEGATIVE)?;
        phase.check()?;
        Error::unless(n >= 1.0 && n.is_finite(), "n", n, "", "be a finite number >= 1")
    }
}

/// Diffuse reflectance under a normally incident plane wave of spatial frequency f_x, in the three conventions.
///
/// Light that is reflected at the front surface without having entered (the specular part) is left out of all three.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reflectance {
    /// pi x radiance of scattered light along the outward normal / irradiance.
    pub camera: f64,
    /// Power that leaves into the hemisphere / power incident.
    pub hemispherical_incident: f64,
    /// Power that leaves into the hemisphere / power that entered.
    pub hemispherical_entered: f64,
}
