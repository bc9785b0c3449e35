//! The parameters of a scene as they stand in a pipeline file.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use turbid_contract::payload::{Profile, Specular};
use turbid_contract::schemars::JsonSchema;
use turbid_contract::{Density, Length, PerLength, Power, Ratio, Wavelength};

use crate::per_channel::PerChannel;

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct Params {
    /// One wavelength per channel; every list in `media` then has one entry for each.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub wavelength_nm: Vec<Wavelength>,
    pub media: BTreeMap<String, MediumParams>,
    pub objects: BTreeMap<String, ObjectParams>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraParams>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub projector: Option<ProjectorParams>,
    /// No kind of light beside the projector is known yet: must be empty.
    #[serde(default)]
    pub lights: BTreeMap<String, Value>,
}

/// mu_a with mu_s or mu_s_prime (mm^-1), or the densities A_rho and S_rho (m^-1); g and n always.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct MediumParams {
    /// Absorption coefficient, mm^-1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mu_a: Option<PerChannel<PerLength>>,
    /// Scattering coefficient, mm^-1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mu_s: Option<PerChannel<PerLength>>,
    /// Reduced scattering coefficient mu_s (1 - g), mm^-1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mu_s_prime: Option<PerChannel<PerLength>>,
    /// Absorption density, m^-1: mu_a = A_rho / 1000.
    #[serde(default, rename = "A_rho", skip_serializing_if = "Option::is_none")]
    pub a_rho: Option<PerChannel<Density>>,
    /// Scattering density, m^-1: mu_s = S_rho / 1000.
    #[serde(default, rename = "S_rho", skip_serializing_if = "Option::is_none")]
    pub s_rho: Option<PerChannel<Density>>,
    /// Mean cosine of the Henyey-Greenstein phase function, in (-1, 1).
    pub g: Ratio,
    /// Refractive index, >= 1.
    pub n: Ratio,
}

/// A solid: exactly one of `slab`, `box`, `sphere`, `spheroid`, with its medium.
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
    /// Name of an entry of `media`; may be left out below an opaque surface.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub medium: Option<String>,
    /// Where objects overlap, the higher priority wins.
    #[serde(default)]
    pub priority: i32,
    #[serde(default)]
    pub surface: SurfaceParams,
}

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

/// `smooth`, or `{lambertian: rho}`: opaque and diffusely reflecting the fraction rho.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(crate = "turbid_contract::schemars")]
pub enum SurfaceParams {
    #[default]
    Smooth,
    Lambertian(Ratio),
}

/// A pinhole camera; its field is measured in the plane z = look_at.z.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct CameraParams {
    pub position: [Length; 3],
    pub look_at: [Length; 3],
    #[serde(default = "y_up")]
    pub up: [f64; 3],
    /// Width and height seen in the plane z = look_at.z, centred on look_at.
    pub field: [Length; 2],
    /// Columns and rows.
    pub pixels: [u32; 2],
    /// Whether light that never entered a medium is seen; required where a smooth surface has n != 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub specular: Option<Specular>,
}

/// A pinhole projector; its field is measured in the plane z = look_at.z, outside it there is no light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct ProjectorParams {
    pub position: [Length; 3],
    pub look_at: [Length; 3],
    #[serde(default = "y_up")]
    pub up: [f64; 3],
    /// Width and height lit in the plane z = look_at.z, centred on look_at.
    pub field: [Length; 2],
    /// W inside the field at pattern value 1.
    pub power: Power,
    /// `uniform_intensity`: the same W/sr in every direction; `flat`: the same irradiance on the plane z = look_at.z.
    #[serde(default)]
    pub profile: Profile,
    /// Columns and rows; bounds the spatial frequencies that it can show.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pixels: Option<[u32; 2]>,
}

fn y_up() -> [f64; 3] {
    [0.0, 1.0, 0.0]
}
