//! Lights beside the projector.

use serde::{Deserialize, Serialize};

/// A light that no pattern modulates: every frame gets it in full. Powers in W and radiances in W mm^-2 sr^-1, one value per channel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Lamp {
    /// The same intensity in every direction.
    Point { position: [f64; 3], power: Vec<f64> },
    /// The same intensity all over a cone around the axis; `angle_deg` is its full angle.
    Spot { position: [f64; 3], look_at: [f64; 3], angle_deg: f64, power: Vec<f64> },
    /// A parallel beam that starts on a disc around `position`, the same irradiance all over it.
    Collimated { position: [f64; 3], look_at: [f64; 3], diameter: f64, power: Vec<f64> },
    /// From infinity, the same radiance from all sides.
    Ambient { radiance: Vec<f64> },
}
