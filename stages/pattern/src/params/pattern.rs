//! The params of `pattern`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use turbid_contract::{AngleDeg, MaxFile, PerLength};

use super::three;
use crate::dither::Dither;
use crate::image::Image;
use crate::speckle::Speckle;

/// The shape of a fringe.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Wave {
    /// (1 + cos) / 2, at the middle of each pixel.
    #[default]
    Sinusoid,
    /// 1 where the cosine is positive, else 0; the mean over each pixel.
    Square,
}

/// Params of `pattern`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Params {
    /// Spatial frequencies of fringes in the plane z = look_at.z of the projector, mm^-1; 0 is one layer of 1/2.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub f_x: Vec<PerLength>,
    /// Layers per f_x > 0, shifted by 2 pi / phases.
    #[serde(default = "three")]
    pub phases: u32,
    /// Directions in which the fringes vary, turned from world x towards world y.
    #[serde(default = "along_x")]
    pub orientation_deg: Vec<AngleDeg>,
    #[serde(default)]
    pub wave: Wave,
    /// Two levels in place of grey.
    #[serde(default)]
    pub dither: Dither,
    /// Speckle in place of fringes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speckle: Option<Speckle>,
    /// Pictures in place of fringes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub image: Option<Image>,
    /// Columns and rows, where the scene's projector does not say them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pixels: Option<[u32; 2]>,
    /// MB (10^6 bytes) that an input file may have; 1 GiB where left out. Not in the key.
    #[serde(default, skip_serializing)]
    pub max_file_mb: MaxFile,
}

fn along_x() -> Vec<AngleDeg> {
    vec![AngleDeg(0.0)]
}
