//! The smooth surface that facets stand for: normals that turn evenly from corner to corner (Phong 1975).
//!
//! It is no surface on which light is refracted, which are the facets; it tells about where on them to look.

use glam::DVec3;

use super::Solid;

/// Facets at a corner are of one smooth surface if their normals differ by less: the cosine of 40 degrees.
const CREASE: f64 = 0.766;

/// The surface's unit normals at the corners of each facet.
#[derive(Clone, Debug, PartialEq)]
pub struct Rounded(Vec<[DVec3; 3]>);

impl Rounded {
    /// At a corner the mean of the facets around it, by their angles there, as far as they are of one surface.
    pub fn over(corners: &[[DVec3; 3]], normals: &[DVec3]) -> Self {
        // What has the same place stands side by side.
        let mut places: Vec<([u64; 3], usize, usize)> = Vec::with_capacity(3 * corners.len());
        for (face, triangle) in corners.iter().enumerate() {
            places.extend((0..3).map(|k| (triangle[k].to_array().map(f64::to_bits), face, k)));
        }
        places.sort_unstable();
        let angle = |face: usize, k: usize| {
            let [at, next, last] = [0, 1, 2].map(|i| corners[face][(k + i) % 3]);
            let (x, y) = ((next - at).normalize_or_zero(), (last - at).normalize_or_zero());
            libm::acos(x.dot(y).clamp(-1.0, 1.0))
        };
        let mut rounded = vec![[DVec3::ZERO; 3]; corners.len()];
        for around in places.chunk_by(|one, other| one.0 == other.0) {
            for &(_, face, k) in around {
                let own = normals[face];
                let of_one = around.iter().filter(|other| normals[other.1].dot(own) > CREASE);
                let sum: DVec3 = of_one.map(|&(_, other, i)| angle(other, i) * normals[other]).sum();
                rounded[face][k] = sum.try_normalize().unwrap_or(own);
            }
        }
        Self(rounded)
    }

    /// Its normal, not of unit length, at a point of a facet, and how that changes over a displacement.
    pub fn at(&self, face: u32, [a, b, c]: &[DVec3; 3], normal: DVec3, p: DVec3) -> (DVec3, impl Fn(DVec3) -> DVec3) {
        let [of_a, of_b, of_c] = self.0[face as usize];
        let area = (b - a).cross(c - a).dot(normal);
        // How the shares of the corners grow along the facet.
        let (to_a, to_b) = (normal.cross(c - b) / area, normal.cross(a - c) / area);
        let change = move |d: DVec3| to_a.dot(d) * (of_a - of_c) + to_b.dot(d) * (of_b - of_c);
        (of_c + change(p - *c), change)
    }
}

impl Solid {
    /// As [`Solid::normal`]; of a mesh that of the smooth surface that its facets stand for.
    pub fn rounded_normal(&self, face: u32, p: DVec3) -> DVec3 {
        match self {
            Self::Turned(turned) => {
                let frame = &turned.frame;
                frame.direction_out(turned.solid.rounded_normal(face, frame.point_into(p)))
            }
            Self::Mesh(mesh) => mesh.rounded(face, p).0.normalize(),
            _ => self.normal(face, p),
        }
    }

    /// As [`Solid::bends`], of the same surface.
    pub fn rounded_bends(&self, face: u32, p: DVec3, displacement: DVec3) -> DVec3 {
        match self {
            Self::Turned(turned) => {
                let frame = &turned.frame;
                let (p, d) = (frame.point_into(p), frame.direction_into(displacement));
                frame.direction_out(turned.solid.rounded_bends(face, p, d))
            }
            Self::Mesh(mesh) => {
                let (sum, change) = mesh.rounded(face, p);
                let (size, change) = (sum.length(), change(displacement));
                let n = sum / size;
                (change - n.dot(change) * n) / size
            }
            _ => self.bends(face, p, displacement),
        }
    }
}
