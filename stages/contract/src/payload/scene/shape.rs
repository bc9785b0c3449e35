//! Shapes of objects.

use serde::{Deserialize, Serialize};

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// All points with bottom <= z <= top.
    Slab {
        top: f64,
        bottom: f64,
    },
    /// Axis-aligned.
    Box {
        size: [f64; 3],
        center: [f64; 3],
    },
    Sphere {
        diameter: f64,
        center: [f64; 3],
    },
    /// Axes along x, y, z.
    Spheroid {
        diameters: [f64; 3],
        center: [f64; 3],
    },
}
