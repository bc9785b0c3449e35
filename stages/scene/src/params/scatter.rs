//! Many bodies of one kind as they stand in a pipeline file.

use serde::{Deserialize, Serialize};
use turbid_contract::schemars::JsonSchema;
use turbid_contract::{AngleDeg, Length};

use super::drawn::Drawn;
use crate::axis::Axis;

/// Bodies of one kind, exactly one of `sphere`, `spheroid`, `cylinder`, at random places where they do not meet; the object `spots`
/// becomes `spots_0`, `spots_1`, and so on. Sizes are numbers or distributions, drawn anew for each body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct ScatterParams {
    /// How many, 0 to 1000; where not all of them find a place it is an error.
    pub count: u32,
    /// Where they lie, each as a whole.
    pub within: RegionParams,
    /// Least distance between the surfaces of two of them; 0 where left out.
    #[serde(default)]
    pub apart: Length,
    /// Sizes and places are a function of it and of the object's name; 0 where left out. `"${NAME}"` of a drawn `NAME: {integer: [0,
    /// 4294967295]}` gives each sample its own.
    #[serde(default)]
    pub seed: u64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sphere: Option<ScatteredSphereParams>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spheroid: Option<ScatteredSpheroidParams>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cylinder: Option<ScatteredCylinderParams>,
}

/// `{rect: {x, y, top, depth}}`, or `{box: {size, center}}`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(crate = "turbid_contract::schemars")]
pub enum RegionParams {
    /// Below a rectangle, at a depth.
    Rect(RectParams),
    /// Anywhere in a box.
    Box(RegionBoxParams),
}

/// Seen from above each body lies wholly in a rectangle; its highest point lies `depth` below the plane z = `top`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct RectParams {
    /// World x of its sides: [first, last].
    pub x: [Length; 2],
    /// World y of its sides: [first, last].
    pub y: [Length; 2],
    /// World z from which `depth` counts; 0 where left out.
    #[serde(default)]
    pub top: Length,
    /// From `top` down to the highest point of the body; 0 where left out, so that it touches the plane from below; below 0 it sticks out.
    #[serde(default)]
    pub depth: Drawn<Length>,
}

/// Bodies lie wholly in it, anywhere.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct RegionBoxParams {
    /// Along x, y and z.
    pub size: [Length; 3],
    /// World x, y and z of its middle.
    pub center: [Length; 3],
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct ScatteredSphereParams {
    /// Of each.
    pub diameter: Drawn<Length>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct ScatteredSpheroidParams {
    /// Along x, y and z, before it is turned.
    pub diameters: [Drawn<Length>; 3],
    /// About its center, by these angles about the world's x, then y, then z axis; not turned where left out.
    #[serde(default)]
    pub rotation_deg: [Drawn<AngleDeg>; 3],
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct ScatteredCylinderParams {
    /// Of each.
    pub diameter: Drawn<Length>,
    /// From end to end.
    pub length: Drawn<Length>,
    /// `x`, `y`, `z`, or a vector along them; z where left out.
    #[serde(default)]
    pub axis: Axis,
}
