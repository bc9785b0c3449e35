//! A medium as it stands in a pipeline file.

use serde::{Deserialize, Serialize};
use turbid_contract::schemars::JsonSchema;
use turbid_contract::{Concentration, Density, PerLength, Ratio};
use turbid_optics::Chromophore;

use turbid_contract::PerChannel;

use crate::params::PhaseParams;

/// Absorption by mu_a (mm^-1) or by what absorbs (HbO2, Hb, water, lipid, melanin at the scene's wavelengths), with scattering by mu_s, mu_s_prime
/// (mm^-1) or a power law; or the densities A_rho and S_rho (m^-1); g, or another phase function, and n always.
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
    /// Reduced scattering coefficient mu_s (1 - g), mm^-1, g the mean cosine of the phase function.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mu_s_prime: Option<PerChannel<PerLength>>,
    /// Absorption density, m^-1: mu_a = A_rho / 1000.
    #[serde(default, rename = "A_rho", skip_serializing_if = "Option::is_none")]
    pub a_rho: Option<PerChannel<Density>>,
    /// Scattering density, m^-1: mu_s = S_rho / 1000.
    #[serde(default, rename = "S_rho", skip_serializing_if = "Option::is_none")]
    pub s_rho: Option<PerChannel<Density>>,
    /// Oxygenated haemoglobin, uM.
    #[serde(default, rename = "HbO2", skip_serializing_if = "Option::is_none")]
    pub hbo2: Option<Concentration>,
    /// Deoxygenated haemoglobin, uM.
    #[serde(default, rename = "Hb", skip_serializing_if = "Option::is_none")]
    pub hb: Option<Concentration>,
    /// Share of the volume.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub water: Option<Ratio>,
    /// Share of the volume.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lipid: Option<Ratio>,
    /// Melanosomes, share of the volume.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub melanin: Option<Ratio>,
    /// mu_s' = a (lambda / 500 nm)^-b.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scattering: Option<ScatteringParams>,
    /// Mean cosine of the Henyey-Greenstein phase function, in (-1, 1).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub g: Option<Ratio>,
    /// Another phase function, in the place of g.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub phase: Option<PhaseParams>,
    /// Refractive index, >= 1.
    pub n: Ratio,
}

/// Reduced scattering as a power law of the wavelength.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct ScatteringParams {
    /// mu_s' at 500 nm, mm^-1.
    pub a: PerLength,
    /// Power by which it falls with the wavelength, in [-4, 4]: 4 is that of particles much smaller than the wavelength, 0.5 to 2 that of tissue.
    pub b: f64,
}

impl MediumParams {
    /// What absorbs, with its concentration in the unit of [`Chromophore::unit`].
    pub fn chromophores(&self) -> Vec<(Chromophore, f64)> {
        let molar = |c: Option<Concentration>| c.map(|c| c.0);
        let share = |c: Option<Ratio>| c.map(|c| c.0);
        Chromophore::ALL
            .into_iter()
            .filter_map(|chromophore| {
                let given = match chromophore {
                    Chromophore::HbO2 => molar(self.hbo2),
                    Chromophore::Hb => molar(self.hb),
                    Chromophore::Water => share(self.water),
                    Chromophore::Lipid => share(self.lipid),
                    Chromophore::Melanin => share(self.melanin),
                };
                Some((chromophore, given?))
            })
            .collect()
    }
}
