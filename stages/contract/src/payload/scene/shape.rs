//! Shapes of objects.

use serde::{Deserialize, Serialize};

use super::mesh::Mesh;
use crate::fixed::Fixed;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
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
    Cylinder {
        diameter: f64,
        length: f64,
        center: [f64; 3],
        /// Unit vector.
        axis: [f64; 3],
    },
    /// A hollow cylinder with open ends along z; x and y of its axis.
    Tube {
        inner_diameter: f64,
        outer_diameter: f64,
        top: f64,
        bottom: f64,
        center: [f64; 2],
    },
    /// A hollow sphere; ports are holes through its wall.
    SphereShell {
        inner_diameter: f64,
        outer_diameter: f64,
        center: [f64; 3],
        ports: Vec<Port>,
    },
    /// What a closed surface of triangles encloses.
    Mesh(Fixed<Mesh>),
    /// A shape turned about a point by degrees about the world's x, then y, then z axis.
    Turned {
        shape: Box<Shape>,
        about: [f64; 3],
        rotation_deg: [f64; 3],
    },
}

/// A hole through the wall of a hollow sphere, straight, about a line from its center.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Port {
    Round {
        /// Unit vector from the center.
        direction: [f64; 3],
        diameter: f64,
    },
    /// Two of its sides are horizontal (along x where the port looks up or down).
    Square { direction: [f64; 3], side: f64 },
}
