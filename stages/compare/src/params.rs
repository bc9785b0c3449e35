//! The params of `compare`.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use turbid_contract::PerLength;

use crate::region::Region;
use crate::written::Amounts;

/// Params of `compare`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Params {
    /// Regions of maps by name; without any, `all` and each object that the camera sees.
    #[serde(default)]
    pub regions: BTreeMap<String, Region>,
    /// The truth of a fit, medium by medium, where no port `truth` brings it.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub media: BTreeMap<String, MediumParams>,
    /// The truth of concentrations by object of the scene that the port `truth` shows, or of `all` pixels without it: names of their layers with amounts, in uM
    /// of haemoglobin and as shares of others. THb and StO2 follow from HbO2 and Hb.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub concentrations: BTreeMap<String, Amounts>,
}

/// What a medium is, or is printed to be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MediumParams {
    /// Absorption coefficient, mm^-1.
    pub mu_a: PerLength,
    /// Reduced scattering coefficient, mm^-1.
    pub mu_s_prime: PerLength,
}
