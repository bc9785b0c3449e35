//! Solids by the dimensions that people give them, mm.

use glam::{DVec2, DVec3};

use super::{Frame, Solid};

impl Solid {
    /// About `center`, with its axis along a unit vector.
    pub fn cylinder(diameter: f64, length: f64, center: DVec3, axis: DVec3) -> Self {
        let upright = |axis, bottom, top| Self::Cylinder { axis, radius: 0.5 * diameter, bottom, top };
        if axis.x == 0.0 && axis.y == 0.0 {
            upright(center.truncate(), center.z - 0.5 * length, center.z + 0.5 * length)
        } else {
            upright(DVec2::ZERO, -0.5 * length, 0.5 * length).turned(Frame::along(center, axis))
        }
    }

    /// A hollow cylinder with open ends. Face 0 is its outside with the ends, face 1 its bore.
    pub fn tube(inner_diameter: f64, outer_diameter: f64, axis: DVec2, bottom: f64, top: f64) -> Self {
        let far = f64::INFINITY;
        let bore = Self::Cylinder { axis, radius: 0.5 * inner_diameter, bottom: -far, top: far };
        Self::Cylinder { axis, radius: 0.5 * outer_diameter, bottom, top }.carved(vec![bore])
    }

    /// A hollow sphere less the ports. Face 0 is its outside, face 1 its inside, the ports follow.
    pub fn sphere_shell(inner_diameter: f64, outer_diameter: f64, center: DVec3, ports: Vec<Self>) -> Self {
        let ball = |diameter: f64| Self::Ellipsoid { center, radii: DVec3::splat(0.5 * diameter) };
        ball(outer_diameter).carved(std::iter::once(ball(inner_diameter)).chain(ports).collect())
    }

    /// A straight hole without end from `center` along a unit vector.
    pub fn round_port(diameter: f64, center: DVec3, direction: DVec3) -> Self {
        Self::Cylinder { axis: DVec2::ZERO, radius: 0.5 * diameter, bottom: 0.0, top: f64::INFINITY }
            .turned(Frame::along(center, direction))
    }

    /// The same of square section; two of its sides are horizontal, or along x where it looks up or down.
    pub fn square_port(side: f64, center: DVec3, direction: DVec3) -> Self {
        let half = 0.5 * side;
        Self::Box { low: DVec3::new(-half, -half, 0.0), high: DVec3::new(half, half, f64::INFINITY) }
            .turned(Frame::along(center, direction))
    }
}
