//! Integrating detectors.

use serde::{Deserialize, Serialize};

/// A flat area that counts the power of the light which comes through it from the front. It stands in nobody's way.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Detector {
    pub outline: Outline,
    /// Its middle.
    pub position: [f64; 3],
    /// Unit vector towards its front.
    pub facing: [f64; 3],
    /// The most that light may be inclined to that, in (0, 90].
    pub half_angle_deg: f64,
    /// Whether the light that it counts ends there.
    pub absorbs: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outline {
    Disc {
        diameter: f64,
    },
    /// `size`: across `up`, and along it.
    Rectangle {
        up: [f64; 3],
        size: [f64; 2],
    },
}
