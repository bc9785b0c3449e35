//! The params of `predistort`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use turbid_contract::{AngleDeg, PerLength, Ratio};

use super::three;

/// How the pattern is found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Rays of the projector's pixels are followed to the surface: any scene.
    #[default]
    Trace,
    /// The formula for a straight tube along z and a projector on its axis.
    Analytic,
    /// A picture that the scene's camera takes of a white tube with the fringes painted on its wall, lit by lamps along its axis.
    Capture,
}

impl Method {
    /// As pipeline files spell it.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Trace => "trace",
            Self::Analytic => "analytic",
            Self::Capture => "capture",
        }
    }
}

/// Params of `predistort`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Params {
    /// Name of the object on which the fringes shall be uniform: along the bore of a tube, the side of a cylinder, the meridians of a
    /// sphere or spheroid, the upper and lower face of a slab or box.
    pub surface: String,
    /// Spatial frequencies along the surface, mm^-1; 0 is one layer of 1/2.
    pub f_x: Vec<PerLength>,
    /// Layers per f_x > 0, shifted by 2 pi / phases.
    #[serde(default = "three")]
    pub phases: u32,
    /// On flat faces, the direction in which the fringes vary, turned from world x towards world y.
    #[serde(default)]
    pub orientation_deg: AngleDeg,
    #[serde(default)]
    pub method: Method,
    /// Rays per side of a pixel, over which its value is averaged.
    #[serde(default = "four")]
    pub rays: u32,
    /// Where a period has fewer of the projector's pixels, the light is left flat and the map masked; 2 is what pixels can show at all.
    #[serde(default = "four_pixels")]
    pub pixels_per_period: f64,
    /// Evens out the irradiance of the surface: what is lit more than the rest is dimmed, by at most this factor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub flatten: Option<Ratio>,
    /// capture: lamps along the axis.
    #[serde(default = "forty")]
    pub lamps: u32,
    /// Columns and rows, where the scene's projector does not say them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pixels: Option<[u32; 2]>,
}

fn four() -> u32 {
    4
}

fn four_pixels() -> f64 {
    4.0
}

fn forty() -> u32 {
    40
}
