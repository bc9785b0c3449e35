//! A medium as it stands in a pipeline file.

use serde::{Deserialize, Serialize};
use turbid_contract::schemars::JsonSchema;
use turbid_contract::{Density, PerLength, Ratio};

use crate::per_channel::PerChannel;

/// mu_a with mu_s or mu_s_prime (mm^-1), or the densities A_rho and S_rho (m^-1); g and n always.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct MediumParams {
    /// Absorption coefficient, mm^-1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mu_a: Option<PerChannel<PerLength>>,
    /// Scattering coefficient, mm^-1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mu_s: Option<PerChannel<PerLength>>,
    /// Reduced scattering coefficient mu_s (1 - g), mm^-1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mu_s_prime: Option<PerChannel<PerLength>>,
    /// Absorption density, m^-1: mu_a = A_rho / 1000.
    #[serde(default, rename = "A_rho", skip_serializing_if = "Option::is_none")]
    pub a_rho: Option<PerChannel<Density>>,
    /// Scattering density, m^-1: mu_s = S_rho / 1000.
    #[serde(default, rename = "S_rho", skip_serializing_if = "Option::is_none")]
    pub s_rho: Option<PerChannel<Density>>,
    /// Mean cosine of the Henyey-Greenstein phase function, in (-1, 1).
    pub g: Ratio,
    /// Refractive index, >= 1.
    pub n: Ratio,
}
