//! Tubes along a spline as they stand in a pipeline file.

use serde::{Deserialize, Serialize};
use turbid_contract::Length;
use turbid_contract::schemars::JsonSchema;

/// A round solid tube along a smooth curve through points (a centripetal Catmull-Rom spline), with flat ends across it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct PathParams {
    /// World x, y and z of 2 to 1000 points that the middle of the tube goes through, in their order.
    pub points: Vec<[Length; 3]>,
    /// Across the curve.
    pub diameter: Length,
}
