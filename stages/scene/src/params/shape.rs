//! Shapes as they stand in a pipeline file.

use serde::{Deserialize, Serialize};
use turbid_contract::Length;
use turbid_contract::schemars::JsonSchema;

/// Everything between two horizontal planes; infinite sideways unless `size` is given.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct SlabParams {
    pub thickness: Length,
    /// World z of its upper face.
    pub top: Length,
    /// Extent along x and y.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size: Option<[Length; 2]>,
    /// World x and y of its middle; [0, 0] where left out. Only with `size`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub center: Option<[Length; 2]>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct BoxParams {
    pub size: [Length; 3],
    pub center: [Length; 3],
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct SphereParams {
    pub diameter: Length,
    pub center: [Length; 3],
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct SpheroidParams {
    /// Along x, y and z.
    pub diameters: [Length; 3],
    pub center: [Length; 3],
}
