//! The params of `calibrate`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use turbid_contract::MaxFile;
use turbid_contract::payload::Convention;

use crate::model::Model;
use crate::reference::Reference;
use crate::rigs::Rigs;

/// What becomes of the part of the mean that dividing by a noisy reference adds, var M / M^2 of the smoothed reference.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum NoiseBias {
    /// Taken off pixel by pixel; without standard errors nothing changes.
    #[default]
    Correct,
    /// Left in: R_d is the plain ratio.
    Keep,
}

/// Params of `calibrate`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Params {
    /// What the reference arm shows.
    pub reference: Reference,
    #[serde(default)]
    pub model: Model,
    /// What the reflectance means; the table that inverts it must say the same.
    #[serde(default)]
    pub convention: Convention,
    /// Standard deviation in px of the Gaussian that smooths the reference; 0 leaves it alone.
    #[serde(default)]
    pub smooth: f64,
    /// The same for the sample: quieter maps that show nothing finer.
    #[serde(default)]
    pub smooth_sample: f64,
    #[serde(default)]
    pub noise_bias: NoiseBias,
    /// Whether sample and reference must share camera, projector, lights and wavelength.
    #[serde(default)]
    pub rigs: Rigs,
    /// MB (10^6 bytes) that an input file may have; 1 GiB where left out. Not in the key.
    #[serde(default, skip_serializing)]
    pub max_file_mb: MaxFile,
}
