//! Camera and projector as they stand in a pipeline file.

use serde::{Deserialize, Serialize};
use turbid_contract::payload::{Profile, Projection, Specular};
use turbid_contract::schemars::JsonSchema;
use turbid_contract::{Length, Power};

use turbid_contract::PerChannel;

/// A camera; its field is measured in the plane z = look_at.z.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct CameraParams {
    /// World x, y and z of its pupil.
    pub position: [Length; 3],
    /// The point in the middle of its field.
    pub look_at: [Length; 3],
    /// The direction that is up in its image, as far as it is across the axis.
    #[serde(default = "y_up")]
    pub up: [f64; 3],
    /// Width and height seen in the plane z = look_at.z, centred on look_at.
    pub field: [Length; 2],
    /// Columns and rows.
    pub pixels: [u32; 2],
    /// Whether light that never entered a medium is seen; required where a smooth surface has n != 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub specular: Option<Specular>,
    /// A fisheye sees field / distance of look_at as an angle, in rad.
    #[serde(default)]
    pub projection: Projection,
    /// Of a pinhole.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distortion: Option<DistortionParams>,
    /// Diameter of the lens of a pinhole camera; without it everything is sharp.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub aperture: Option<Length>,
    /// Where the plane of focus (parallel to the plane z = look_at.z) cuts the axis, from the lens; look_at if left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub focus: Option<Length>,
}

/// A pinhole projector; its field is measured in the plane z = look_at.z, outside it there is no light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct ProjectorParams {
    /// World x, y and z of its pupil.
    pub position: [Length; 3],
    /// The point in the middle of its field.
    pub look_at: [Length; 3],
    /// The direction that is up in its image, as far as it is across the axis.
    #[serde(default = "y_up")]
    pub up: [f64; 3],
    /// Width and height lit in the plane z = look_at.z, centred on look_at.
    pub field: [Length; 2],
    /// W inside the field at pattern value 1, for all channels or one value each.
    pub power: PerChannel<Power>,
    /// `uniform_intensity`: the same W/sr in every direction; `flat`: the same irradiance on the plane z = look_at.z.
    #[serde(default)]
    pub profile: Profile,
    /// Columns and rows; bounds the spatial frequencies that it can show.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pixels: Option<[u32; 2]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distortion: Option<DistortionParams>,
}

/// Lens distortion after Brown and Conrady, in the unit "distance of look_at"; what is left out is 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct DistortionParams {
    /// Radial, of r^2.
    pub k1: f64,
    /// Radial, of r^4.
    pub k2: f64,
    /// Tangential: moves x by 2 p1 x y and y by p1 (r^2 + 2 y^2).
    pub p1: f64,
    /// Tangential: moves x by p2 (r^2 + 2 x^2) and y by 2 p2 x y.
    pub p2: f64,
    /// Radial, of r^6.
    pub k3: f64,
}

fn y_up() -> [f64; 3] {
    [0.0, 1.0, 0.0]
}
