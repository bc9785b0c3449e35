//! An object as it stands in a pipeline file.

use serde::{Deserialize, Serialize};
use turbid_contract::schemars::JsonSchema;

use super::{
    BoxParams, CylinderParams, MeshParams, PathParams, ReliefParams, ScatterParams, SlabParams, SphereParams,
    SphereShellParams, SpheroidParams, SurfaceParams, TubeParams,
};

/// A solid: exactly one of `slab`, `box`, `sphere`, `spheroid`, `cylinder`, `tube`, `sphere_shell`, `mesh`, `relief`, `path`, with its
/// medium; or many of one kind, `scatter`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct ObjectParams {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slab: Option<SlabParams>,
    #[serde(default, rename = "box", skip_serializing_if = "Option::is_none")]
    pub cuboid: Option<BoxParams>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sphere: Option<SphereParams>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spheroid: Option<SpheroidParams>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cylinder: Option<CylinderParams>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tube: Option<TubeParams>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sphere_shell: Option<SphereShellParams>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mesh: Option<MeshParams>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub relief: Option<ReliefParams>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub path: Option<PathParams>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scatter: Option<ScatterParams>,
    /// Name of an entry of `media`; may be left out below an opaque surface.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub medium: Option<String>,
    /// Where objects overlap, the higher priority wins.
    #[serde(default)]
    pub priority: i32,
    #[serde(default)]
    pub surface: SurfaceParams,
}
