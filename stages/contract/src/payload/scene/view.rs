//! Camera and projector.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Aperture, Distortion, Projection};

/// Whether light that never entered a medium is seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Specular {
    Include,
    Exclude,
}

/// A camera. Its image plane is parallel to the plane z = look_at.z (as behind a shift lens), so that `field`
/// is exactly the rectangle seen there, centred on `look_at`, and every pixel an equal part of it.
///
/// With right = forward x up: image x runs along the horizontal part of right, rows run downwards. Only a fisheye's image plane is
/// square to its axis: it sees `field` / distance of look_at, in rad.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    pub position: [f64; 3],
    pub look_at: [f64; 3],
    pub up: [f64; 3],
    /// mm seen in the plane z = look_at.z.
    pub field: [f64; 2],
    /// Columns, rows.
    pub pixels: [u32; 2],
    pub specular: Option<Specular>,
    #[serde(default, skip_serializing_if = "is_pinhole")]
    pub projection: Projection,
    /// Of a pinhole only, as is the aperture.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distortion: Option<Distortion>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub aperture: Option<Aperture>,
}

/// How a projector spreads a pattern value of 1 over its field.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Profile {
    /// The same radiant intensity (W/sr) in every direction of the field.
    #[default]
    UniformIntensity,
    /// The same irradiance everywhere on the plane z = look_at.z.
    Flat,
}

/// A pinhole projector, framed like [`Camera`]; dark outside its field.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Projector {
    pub position: [f64; 3],
    pub look_at: [f64; 3],
    pub up: [f64; 3],
    /// mm lit in the plane z = look_at.z.
    pub field: [f64; 2],
    /// W inside the field at pattern value 1, one value per channel.
    pub power: Vec<f64>,
    pub profile: Profile,
    /// Columns, rows; bounds the f_x that it can show.
    pub pixels: Option<[u32; 2]>,
    /// Moves the light of each place of the pattern; its flux stays the same.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distortion: Option<Distortion>,
}

fn is_pinhole(projection: &Projection) -> bool {
    *projection == Projection::Pinhole
}
