//! What the reference phantom reflects according to a forward model.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use turbid_contract::payload::Convention;
use turbid_contract::{Error, PerLength, Problems, Usual};

/// The forward model of the reference.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Model {
    /// Radiative transfer by discrete ordinates: exact to 1e-5.
    #[default]
    Rte,
    /// Diffusion with exact Fresnel moments: fast, 1 to 40 % off in tissue.
    Diffusion,
}

/// The phantom, a half-space: coefficients in mm^-1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReferenceMedium {
    /// Absorption coefficient.
    pub mu_a: PerLength,
    /// Reduced scattering coefficient mu_s (1 - g).
    pub mu_s_prime: PerLength,
    /// Anisotropy of scattering, in (-1, 1).
    pub g: f64,
    /// Refractive index, >= 1.
    pub n: f64,
}

impl ReferenceMedium {
    /// Reports every value that no phantom can have.
    pub fn check(&self, problems: &mut Problems) {
        let Self { mu_a: PerLength(mu_a), mu_s_prime: PerLength(mu_s_prime), g, n } = *self;
        let finite = |x: f64, holds: bool| holds && x.is_finite();
        problems.require(finite(mu_a, mu_a >= 0.0), "reference.mu_a", mu_a, "mm^-1", "be >= 0");
        problems.require(finite(mu_s_prime, mu_s_prime > 0.0), "reference.mu_s_prime", mu_s_prime, "mm^-1", "be > 0");
        problems.require(g.abs() < 1.0, "reference.g", g, "", "lie in (-1, 1)");
        problems.require(finite(n, n >= 1.0), "reference.n", n, "", "be >= 1");
        problems.doubt(&Usual::MU_A, "reference.mu_a", mu_a);
        problems.doubt(&Usual::MU_S_PRIME, "reference.mu_s_prime", mu_s_prime);
    }

    /// Reflectance of the phantom at `f_x_per_mm` in the given convention.
    pub fn reflectance(&self, model: Model, convention: Convention, f_x_per_mm: f64) -> Result<f64, Error> {
        if convention == Convention::Relative {
            return Ok(1.0);
        }
        let medium = turbid_optics::Medium { mu_a: self.mu_a.0, mu_s_prime: self.mu_s_prime.0, g: self.g, n: self.n };
        let reflectance = match model {
            Model::Rte => turbid_optics::rte::reflectance(&medium, None, f_x_per_mm),
            Model::Diffusion => turbid_optics::diffusion::reflectance(&medium, None, f_x_per_mm),
        };
        let reflectance = reflectance.map_err(|e| Error::invalid("reference", e.to_string()))?;
        Ok(match convention {
            Convention::Camera => reflectance.camera,
            Convention::HemisphericalIncident => reflectance.hemispherical_incident,
            Convention::HemisphericalEntered => reflectance.hemispherical_entered,
            Convention::Relative => unreachable!("answered above"),
        })
    }
}
