//! A detector as it stands in a pipeline file.

use serde::{Deserialize, Serialize};
use turbid_contract::schemars::JsonSchema;
use turbid_contract::{AngleDeg, Length};

/// One of `disc`, `rectangle`: an area that counts the power of the light that comes through it from the front.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(crate = "turbid_contract::schemars")]
pub enum DetectorParams {
    Disc(DiscParams),
    Rectangle(RectangleParams),
}

/// A disc.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct DiscParams {
    /// Its middle.
    pub position: [Length; 3],
    /// A point straight in front of it.
    pub look_at: [Length; 3],
    /// Its diameter.
    pub diameter: Length,
    /// Light more inclined to its axis than this is not counted.
    #[serde(default = "all")]
    pub half_angle_deg: AngleDeg,
    /// Whether the light that it counts ends there.
    #[serde(default)]
    pub absorbs: bool,
}

/// A rectangle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct RectangleParams {
    /// Its middle.
    pub position: [Length; 3],
    /// A point straight in front of it.
    pub look_at: [Length; 3],
    /// Across `up`, and along it.
    pub size: [Length; 2],
    /// Along one pair of its sides, as far as it lies in its plane.
    #[serde(default = "y_up")]
    pub up: [f64; 3],
    /// Light more inclined to its axis than this is not counted.
    #[serde(default = "all")]
    pub half_angle_deg: AngleDeg,
    /// Whether the light that it counts ends there.
    #[serde(default)]
    pub absorbs: bool,
}

fn all() -> AngleDeg {
    AngleDeg(90.0)
}

fn y_up() -> [f64; 3] {
    [0.0, 1.0, 0.0]
}
