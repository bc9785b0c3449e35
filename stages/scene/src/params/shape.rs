//! Shapes as they stand in a pipeline file.

use serde::{Deserialize, Serialize};
use turbid_contract::schemars::JsonSchema;
use turbid_contract::{AngleDeg, Length, Ratio};

use crate::axis::Axis;

/// Everything between two horizontal planes; infinite sideways unless `size` is given.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct SlabParams {
    /// From its upper to its lower face.
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

/// A box, along x, y and z unless it is turned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct BoxParams {
    /// Along x, y and z, before it is turned.
    pub size: [Length; 3],
    /// World x, y and z of its middle.
    pub center: [Length; 3],
    /// About its center, by these angles about the world's x, then y, then z axis.
    #[serde(default, skip_serializing_if = "is_straight")]
    pub rotation_deg: [AngleDeg; 3],
}

/// A ball.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct SphereParams {
    /// Its diameter.
    pub diameter: Length,
    /// World x, y and z of its middle.
    pub center: [Length; 3],
}

/// An ellipsoid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct SpheroidParams {
    /// Along x, y and z.
    pub diameters: [Length; 3],
    /// World x, y and z of its middle.
    pub center: [Length; 3],
    /// About its center, by these angles about the world's x, then y, then z axis.
    #[serde(default, skip_serializing_if = "is_straight")]
    pub rotation_deg: [AngleDeg; 3],
}

/// A round cylinder with flat ends.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct CylinderParams {
    /// Its diameter.
    pub diameter: Length,
    /// From end to end.
    pub length: Length,
    /// World x, y and z of its middle.
    pub center: [Length; 3],
    /// `x`, `y`, `z`, or a vector along it; z where left out.
    #[serde(default)]
    pub axis: Axis,
}

/// A hollow cylinder with open ends, along z.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct TubeParams {
    /// Of its bore.
    pub inner_diameter: Length,
    /// Of its outside.
    pub outer_diameter: Length,
    /// From end to end.
    pub length: Length,
    /// World z of its upper end.
    pub top: Length,
    /// World x and y of its axis; [0, 0] where left out.
    #[serde(default)]
    pub center: [Length; 2],
}

/// A hollow sphere with holes through its wall.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct SphereShellParams {
    /// Of the hollow inside.
    pub inner_diameter: Length,
    /// Its thickness.
    pub wall: Length,
    /// Holes through the wall.
    #[serde(default)]
    pub ports: Vec<PortParams>,
    /// [0, 0, 0] where left out.
    #[serde(default)]
    pub center: [Length; 3],
}

/// A straight hole about a line from the center of a sphere shell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(crate = "turbid_contract::schemars")]
pub enum PortParams {
    /// A round hole.
    Round(RoundPortParams),
    /// Two of its sides are horizontal, or along x where it looks up or down.
    Square(SquarePortParams),
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct RoundPortParams {
    /// From the center of the sphere; its length does not matter.
    pub direction: Axis,
    /// Its diameter.
    pub diameter: Length,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct SquarePortParams {
    /// From the center of the sphere; its length does not matter.
    pub direction: Axis,
    /// Length of its sides.
    pub side: Length,
}

/// A closed surface of triangles from an STL, PLY, OBJ or glTF file; lengths of the file times `scale` are mm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct MeshParams {
    /// Its file, relative to the pipeline file.
    pub file: String,
    /// mm per unit of the file; 1 where left out.
    #[serde(default = "one")]
    pub scale: Ratio,
    /// Where the file's origin comes to lie; [0, 0, 0] where left out.
    #[serde(default)]
    pub position: [Length; 3],
    /// About the file's origin, by these angles about the world's x, then y, then z axis.
    #[serde(default, skip_serializing_if = "is_straight")]
    pub rotation_deg: [AngleDeg; 3],
}

fn one() -> Ratio {
    Ratio(1.0)
}

fn is_straight(rotation_deg: &[AngleDeg; 3]) -> bool {
    rotation_deg.iter().all(|angle| angle.0 == 0.0)
}
