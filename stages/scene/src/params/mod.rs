//! The parameters of a scene as they stand in a pipeline file.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use turbid_contract::schemars::JsonSchema;
use turbid_contract::{MaxFile, Wavelength};

mod detector;
mod drawn;
mod lamp;
mod medium;
mod object;
mod path;
mod phase_function;
mod relief;
mod scatter;
mod shape;
mod surface;
mod view;

pub use detector::{DetectorParams, DiscParams, RectangleParams};
pub use drawn::{Drawn, Quantity};
pub use lamp::{AmbientParams, CollimatedParams, LampParams, PointParams, SpotParams};
pub use medium::{MediumParams, ScatteringParams};
pub use object::ObjectParams;
pub use path::PathParams;
pub use phase_function::PhaseParams;
pub use relief::ReliefParams;
pub use scatter::{RegionParams, ScatterParams};
pub use shape::{
    BoxParams, CylinderParams, MeshParams, PortParams, RoundPortParams, SlabParams, SphereParams, SphereShellParams,
    SpheroidParams, SquarePortParams, TubeParams,
};
pub use surface::{AlbedoParams, CheckerParams, ImageParams, SurfaceParams, TextureParams, WaveParams};
pub use view::{CameraParams, DistortionParams, ProjectorParams};

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct Params {
    /// One wavelength per channel; every list in `media` then has one entry for each. Left out where the input `rig` names them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub wavelength_nm: Vec<Wavelength>,
    /// What objects are filled with, by name; none in a scene that is only the rig of others.
    #[serde(default)]
    pub media: BTreeMap<String, MediumParams>,
    /// Solids by name; at least one, but for a scene that is only the rig of others.
    #[serde(default)]
    pub objects: BTreeMap<String, ObjectParams>,
    /// Left out where it comes from the input `rig`, and in a scene that nobody renders.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraParams>,
    /// Left out where it comes from the input `rig`, and where there are steady lights only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub projector: Option<ProjectorParams>,
    /// Steady lights beside the projector: every frame gets them in full. Left out where they come from the input `rig`.
    #[serde(default)]
    pub lights: BTreeMap<String, LampParams>,
    /// Areas that count the power of the light that comes through them: rows of render's port `power`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub detectors: BTreeMap<String, DetectorParams>,
    /// MB (10^6 bytes) that an input file may have; 1 GiB where left out. Not in the key.
    #[serde(default, skip_serializing)]
    pub max_file_mb: MaxFile,
}
