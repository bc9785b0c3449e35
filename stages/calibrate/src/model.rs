//! What the reference phantom reflects according to a forward model.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use turbid_contract::payload::Convention;
use turbid_contract::{Error, PerChannel, PerLength, Problems, Usual};

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

/// The phantom, a half-space: coefficients in mm^-1. Each quantity is one number for all wavelengths, or a list with one for each, in the order of
/// the sample's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReferenceMedium {
    /// Absorption coefficient.
    pub mu_a: PerChannel<PerLength>,
    /// Reduced scattering coefficient mu_s (1 - g).
    pub mu_s_prime: PerChannel<PerLength>,
    /// Anisotropy of scattering, in (-1, 1).
    pub g: PerChannel<f64>,
    /// Refractive index, >= 1.
    pub n: PerChannel<f64>,
}

impl ReferenceMedium {
    /// Reports every value that no phantom can have.
    pub fn check(&self, problems: &mut Problems) {
        for (at, &PerLength(mu_a)) in self.mu_a.entries("reference.mu_a") {
            problems.require(mu_a >= 0.0 && mu_a.is_finite(), at.clone(), mu_a, "mm^-1", "be >= 0");
            problems.doubt(&Usual::MU_A, at, mu_a);
        }
        for (at, &PerLength(mu_s_prime)) in self.mu_s_prime.entries("reference.mu_s_prime") {
            problems.require(mu_s_prime > 0.0 && mu_s_prime.is_finite(), at.clone(), mu_s_prime, "mm^-1", "be > 0");
            problems.doubt(&Usual::MU_S_PRIME, at, mu_s_prime);
        }
        for (at, &g) in self.g.entries("reference.g") {
            problems.require(g.abs() < 1.0, at, g, "", "lie in (-1, 1)");
        }
        for (at, &n) in self.n.entries("reference.n") {
            problems.require(n >= 1.0 && n.is_finite(), at, n, "", "be >= 1");
        }
    }

    /// Lists whose length is not the number of the sample's wavelengths: where each stands, and how many values it has.
    pub fn unfit(&self, channels: usize) -> impl Iterator<Item = (&'static str, usize)> {
        let lengths = [
            ("mu_a", self.mu_a.channels()),
            ("mu_s_prime", self.mu_s_prime.channels()),
            ("g", self.g.channels()),
            ("n", self.n.channels()),
        ];
        lengths.into_iter().filter_map(move |(name, length)| Some((name, length.filter(|&length| length != channels)?)))
    }

    /// The phantom at the wavelength of this number; `None` where a list ends before.
    pub fn at(&self, channel: usize) -> Option<Phantom> {
        Some(Phantom {
            mu_a: self.mu_a.of(channel)?.0,
            mu_s_prime: self.mu_s_prime.of(channel)?.0,
            g: *self.g.of(channel)?,
            n: *self.n.of(channel)?,
        })
    }
}

/// The phantom at one wavelength: coefficients in mm^-1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Phantom {
    pub mu_a: f64,
    pub mu_s_prime: f64,
    pub g: f64,
    pub n: f64,
}

impl Phantom {
    /// Reflectance at `f_x_per_mm` in the given convention.
    pub fn reflectance(&self, model: Model, convention: Convention, f_x_per_mm: f64) -> Result<f64, Error> {
        if convention == Convention::Relative {
            return Ok(1.0);
        }
        let Self { mu_a, mu_s_prime, g, n } = *self;
        let medium = turbid_optics::Medium { mu_a, mu_s_prime, g, n };
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
