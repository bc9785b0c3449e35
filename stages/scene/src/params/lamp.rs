//! A steady light as it stands in a pipeline file.

use serde::{Deserialize, Serialize};
use turbid_contract::schemars::JsonSchema;
use turbid_contract::{AngleDeg, Length, Power};

use turbid_contract::PerChannel;

/// One of `point`, `spot`, `collimated`, `ambient`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(crate = "turbid_contract::schemars")]
pub enum LampParams {
    Point(PointParams),
    Spot(SpotParams),
    Collimated(CollimatedParams),
    Ambient(AmbientParams),
}

/// Shines alike in all directions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct PointParams {
    /// Where it stands.
    pub position: [Length; 3],
    /// W, for all channels or one value each.
    pub power: PerChannel<Power>,
}

/// Shines alike in all directions of a cone.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct SpotParams {
    /// Where it stands: the tip of the cone.
    pub position: [Length; 3],
    /// A point on the axis of the cone.
    pub look_at: [Length; 3],
    /// Full angle of the cone.
    pub angle_deg: AngleDeg,
    /// W inside the cone, for all channels or one value each.
    pub power: PerChannel<Power>,
}

/// A parallel beam with a round, even cross section.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct CollimatedParams {
    /// Centre of the disc on which the beam starts.
    pub position: [Length; 3],
    /// A point on its axis.
    pub look_at: [Length; 3],
    /// Of the beam.
    pub diameter: Length,
    /// W, for all channels or one value each.
    pub power: PerChannel<Power>,
}

/// The same radiance from all sides.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct AmbientParams {
    /// W mm^-2 sr^-1, for all channels or one value each.
    pub radiance: PerChannel<f64>,
}
