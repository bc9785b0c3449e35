//! The params of `section_tube`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Where sections end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// By equal steps of the mean intensity: `count` of them, each of at least `threshold` grey levels, or as many as `threshold` gives.
    #[default]
    IntensitySteps,
    EqualLength,
    /// By equal steps of the logarithm of the mean intensity.
    EqualLogIntensity,
    /// So that ln M_DC and ln M_AC vary as little as possible within the sections.
    Optimal,
}

impl Method {
    /// As pipeline files spell it.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::IntensitySteps => "intensity_steps",
            Self::EqualLength => "equal_length",
            Self::EqualLogIntensity => "equal_log_intensity",
            Self::Optimal => "optimal",
        }
    }
}

/// Params of `section_tube`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    pub method: Method,
    /// Sections; if left out 5, or as many as the pixels suffice for (with a warning), but for `intensity_steps` with a threshold, which then says how many.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub count: Option<u32>,
    /// intensity_steps: how many grey levels sections differ by at least; 255 is the 99.9th percentile of M_DC. 10 if left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub threshold: Option<f64>,
    /// Part of the sections over which neighbours pass into each other, from 0 (a seam) to 1 (linear from middle to middle).
    pub blend: f64,
    /// Names of the objects whose walls are sectioned; all if left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub objects: Option<Vec<String>>,
    /// A section with fewer pixels than this is an error.
    pub least_pixels: u32,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            method: Method::IntensitySteps,
            count: None,
            threshold: None,
            blend: 0.2,
            objects: None,
            least_pixels: 20,
        }
    }
}
