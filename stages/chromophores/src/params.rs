//! Params of `chromophores`.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use turbid_contract::{MaxFile, Ratio, Wavelength};
use turbid_optics::chromophore::MOLAR_TO_MM;

use crate::amount::Amount;

/// Params of `chromophores`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    /// What is looked for: names among HbO2, Hb, water, lipid, melanin and the columns of `spectra`; at most 8, and no more than wavelengths.
    #[serde(alias = "species")]
    pub chromophores: Vec<String>,
    /// Spectra of one's own, which come before those of the same name that are known here.
    pub spectra: Vec<SpectraParams>,
    /// What absorbs besides in a known amount, by name: it is taken off, and its error is taken for none.
    pub fixed: BTreeMap<String, Amount>,
    /// Whether concentrations may be below 0.
    pub fit: Fit,
    /// Whether a power law of the wavelength is fitted to mu_s'.
    pub scattering: bool,
    /// Which wavelengths of the maps are read; all where left out.
    pub wavelength_nm: Vec<Wavelength>,
    /// The condition number above which the wavelengths do not tell the chromophores apart.
    pub largest_condition: f64,
    /// What the port `design` is made for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub design: Option<DesignParams>,
    /// MB (10^6 bytes) that an input file may have; 1 GiB where left out. Not in the key.
    #[serde(skip_serializing)]
    pub max_file_mb: MaxFile,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            chromophores: vec!["HbO2".to_owned(), "Hb".to_owned()],
            spectra: Vec::new(),
            fixed: BTreeMap::new(),
            fit: Fit::default(),
            scattering: false,
            wavelength_nm: Vec::new(),
            largest_condition: 100.0,
            design: None,
            max_file_mb: MaxFile::default(),
        }
    }
}

/// How concentrations are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Fit {
    /// None is below 0. Pixels with one that is held at 0 are counted in the layer `at_bound`, and their standard errors are flagged as unknown.
    #[default]
    NonNegative,
    /// Noise may take them below 0: means over a region are then unbiased.
    Linear,
}

/// A table of spectra.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SpectraParams {
    /// Text with the columns wavelength_nm and one for each chromophore, by name; relative to the pipeline file.
    pub file: String,
    /// Unit of the columns, with the base of its logarithm.
    pub unit: SpectrumUnit,
}

/// What a spectrum is given in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SpectrumUnit {
    /// Molar extinction as chemists tabulate it, cm^-1 / (mol/l), log base 10. Concentrations in uM.
    MolarLog10,
    /// Molar absorption, cm^-1 / (mol/l), log base e. Concentrations in uM.
    MolarLn,
    /// mm^-1 per uM, log base e. Concentrations in uM.
    PerMmPerUm,
    /// Absorption coefficient of the pure substance, mm^-1, log base e. Concentrations are shares of the volume.
    PerMm,
    /// The same in cm^-1.
    PerCm,
    /// The same in m^-1.
    PerM,
}

impl SpectrumUnit {
    /// mm^-1 of log base e for one unit of concentration.
    pub fn to_mm(self) -> f64 {
        match self {
            Self::MolarLog10 => MOLAR_TO_MM,
            Self::MolarLn => 1e-7,
            Self::PerMmPerUm | Self::PerMm => 1.0,
            Self::PerCm => 0.1,
            Self::PerM => 1e-3,
        }
    }

    /// Of the concentration.
    pub fn of_amount(self) -> &'static str {
        match self {
            Self::MolarLog10 | Self::MolarLn | Self::PerMmPerUm => "uM",
            Self::PerMm | Self::PerCm | Self::PerM => "1",
        }
    }
}

/// Which wavelengths give StO2 with the least error.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DesignParams {
    /// Wavelengths to choose from; those of the maps where left out.
    #[serde(default)]
    pub candidates: Vec<Wavelength>,
    /// How many are chosen.
    pub choose: u32,
    /// What the tissue holds, by name: each of `chromophores`, and what else absorbs.
    pub typical: BTreeMap<String, Amount>,
    /// Standard error of mu_a over mu_a, the same and independent at each wavelength.
    #[serde(default = "two_percent")]
    pub relative_error: Ratio,
    /// Rows of the table: the best choices.
    #[serde(default = "twenty")]
    pub list: u32,
}

fn two_percent() -> Ratio {
    Ratio(0.02)
}

fn twenty() -> u32 {
    20
}
