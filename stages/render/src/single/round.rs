//! Curved surfaces in f32 lanes: points on them, normals and curvature.

use fearless_simd::prelude::*;

use super::ground::Shape;
use super::lane::{F, V, splat};

impl Shape {
    /// Points near the curved surface, on it.
    #[inline(always)]
    pub fn onto<S: Simd>(self, p: V<S>) -> V<S> {
        match self {
            Self::Ellipsoid { center, inverse_radii, .. } => {
                let d = p.from(center);
                let q = d.scaled(inverse_radii);
                let f = 1.0 / q.dot(q).sqrt();
                V { x: d.x * f + center[0], y: d.y * f + center[1], z: d.z * f + center[2] }
            }
            Self::Cylinder { axis, radius, .. } => {
                let (x, y) = (p.x - axis[0], p.y - axis[1]);
                let f = radius / (x * x + y * y).sqrt();
                V { x: x * f + axis[0], y: y * f + axis[1], z: p.z }
            }
            Self::Slab { .. } | Self::Box { .. } | Self::Mesh | Self::Other => unreachable!("not curved"),
        }
    }

    /// Unit vectors out of the body at points of the curved surface.
    #[inline(always)]
    pub fn unit_normal<S: Simd>(self, p: V<S>) -> V<S> {
        let gradient = self.gradient(p);
        gradient.times(1.0 / gradient.dot(gradient).sqrt())
    }

    /// By how much the normal turns (rad / mm) along u towards u, along u towards v, and along v towards v: tangent unit vectors across each other.
    #[inline(always)]
    pub fn bends<S: Simd>(self, p: V<S>, u: V<S>, v: V<S>) -> [F<S>; 3] {
        let gradient = self.gradient(p);
        let f = 1.0 / gradient.dot(gradient).sqrt();
        let (gu, gv) = (self.change(u), self.change(v));
        [u.dot(gu) * f, u.dot(gv) * f, v.dot(gv) * f]
    }

    /// Of the function that is 1 on the surface, halved.
    #[inline(always)]
    fn gradient<S: Simd>(self, p: V<S>) -> V<S> {
        match self {
            Self::Ellipsoid { center, .. } => self.change(p.from(center)),
            Self::Cylinder { axis, .. } => self.change(p.from([axis[0], axis[1], 0.0])),
            Self::Slab { .. } | Self::Box { .. } | Self::Mesh | Self::Other => unreachable!("not curved"),
        }
    }

    /// How it changes along d.
    #[inline(always)]
    fn change<S: Simd>(self, d: V<S>) -> V<S> {
        match self {
            Self::Ellipsoid { inverse_radii: [a, b, c], .. } => d.scaled([a * a, b * b, c * c]),
            Self::Cylinder { radius, .. } => {
                let f = 1.0 / (radius * radius);
                V { x: d.x * f, y: d.y * f, z: splat(d.z.token(), 0.0) }
            }
            Self::Slab { .. } | Self::Box { .. } | Self::Mesh | Self::Other => unreachable!("not curved"),
        }
    }
}
