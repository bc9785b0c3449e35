//! Lenses of cameras and projectors.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How a camera maps directions to its image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Projection {
    /// All rays run through one point (or a lens around it).
    #[default]
    Pinhole,
    /// All rays are parallel to the axis.
    Orthographic,
    /// The angle to the axis is proportional to the distance from the image's middle (equidistant).
    Fisheye,
}

/// Brown-Conrady coefficients. With x to the right, y down the image, both from the image's middle in units of the distance of
/// look_at, and r^2 = x^2 + y^2, the light of the ideal place (x, y) goes to
/// x s + 2 p1 x y + p2 (r^2 + 2 x^2), y s + p1 (r^2 + 2 y^2) + 2 p2 x y with s = 1 + k1 r^2 + k2 r^4 + k3 r^6.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Distortion {
    pub k1: f64,
    pub k2: f64,
    pub p1: f64,
    pub p2: f64,
    pub k3: f64,
}

impl Distortion {
    /// k1, k2, p1, p2, k3.
    pub fn coefficients(&self) -> [f64; 5] {
        [self.k1, self.k2, self.p1, self.p2, self.k3]
    }
}

/// A round opening: what is not in the plane of focus is blurred.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Aperture {
    /// mm.
    pub diameter: f64,
    /// Where the plane of focus, parallel to the plane z = look_at.z, cuts the axis: mm from the lens.
    pub focus: f64,
}
