//! A round tube along a smooth curve, as a closed mesh.

mod spline;

use glam::DVec3;
use turbid_contract::payload::Mesh;
use turbid_optics::elementary::sin_cos_turns;

use spline::Spline;

/// Corners of the cross-section.
pub const SIDES: usize = 32;
/// Largest turn of the curve between two rings, rad.
pub const TURN: f64 = 0.1;
/// Rings of each piece before it is asked whether it turns.
const PARTS: usize = 4;
/// A piece is halved so often at most; a curve that bends no sharper than its tube never is.
const DEEPEST: u32 = 16;
/// Places of each piece at which its curvature is looked at.
const LOOKS: usize = 64;

/// A tube: mm.
pub struct Path {
    spline: Spline,
    radius: f64,
}

/// Where a curve bends: the point next to it, the place, the radius of curvature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bend {
    pub point: usize,
    pub place: DVec3,
    pub radius: f64,
}

impl Path {
    /// Through two points or more, of which no neighbours are the same.
    pub fn new(points: &[DVec3], diameter: f64) -> Self {
        Self { spline: Spline::through(points), radius: 0.5 * diameter }
    }

    /// Where the curve bends sharpest, on a close look.
    pub fn sharpest(&self) -> Bend {
        let mut found = Bend { point: 0, place: self.spline.at(0, 0.0)[0], radius: f64::INFINITY };
        for piece in 0..self.spline.pieces() {
            for i in 0..=LOOKS {
                let s = i as f64 / LOOKS as f64;
                let radius = self.spline.radius(piece, s);
                if radius < found.radius {
                    found = Bend { point: piece + usize::from(s > 0.5), place: self.spline.at(piece, s)[0], radius };
                }
            }
        }
        found
    }

    /// Distance of the corners of the cross-section from the curve: the polygon has the area of the circle.
    pub fn reach(&self) -> f64 {
        let (sin, _) = sin_cos_turns(1.0 / SIDES as f64);
        self.radius * libm::sqrt(2.0 * std::f64::consts::PI / (SIDES as f64 * sin))
    }

    /// The closed surface, outwards; its rings turn with the curve as little as they can (parallel transport). Only where the curve bends
    /// less than the tube is wide.
    pub fn mesh(&self) -> Mesh {
        let rings = self.rings();
        let mut mesh = Mesh { vertices: Vec::new(), triangles: Vec::new() };
        let mut tangent = rings[0].1;
        let mut side = tangent.any_orthonormal_vector();
        for &(middle, next) in &rings {
            // The turn from one tangent to the next about the axis square to both.
            side -= side.dot(next) / (1.0 + tangent.dot(next)) * (tangent + next);
            side = (side - side.dot(next) * next).normalize();
            tangent = next;
            let up = tangent.cross(side);
            let corner = |k: usize| {
                let (sin, cos) = sin_cos_turns(k as f64 / SIDES as f64);
                middle + self.reach() * (cos * side + sin * up)
            };
            mesh.vertices.extend((0..SIDES).map(|k| corner(k).to_array().map(|x| x + 0.0)));
        }
        let ends = [rings[0].0, rings[rings.len() - 1].0];
        let caps = mesh.vertices.len() as u32;
        mesh.vertices.extend(ends.map(|p| p.to_array().map(|x| x + 0.0)));
        let last = (rings.len() - 1) * SIDES;
        for k in 0..SIDES {
            let corner = |first: usize, k: usize| (first + k % SIDES) as u32;
            mesh.triangles.push([caps, corner(0, k + 1), corner(0, k)]);
            for first in (0..last).step_by(SIDES) {
                let (a, b) = (corner(first, k), corner(first, k + 1));
                let (c, d) = (corner(first + SIDES, k), corner(first + SIDES, k + 1));
                mesh.triangles.extend([[a, b, d], [a, d, c]]);
            }
            mesh.triangles.push([caps + 1, corner(last, k), corner(last, k + 1)]);
        }
        mesh
    }

    /// Middles of the rings with the directions of the curve there.
    fn rings(&self) -> Vec<(DVec3, DVec3)> {
        let mut rings = vec![(self.spline.at(0, 0.0)[0], self.spline.tangent(0, 0.0))];
        for piece in 0..self.spline.pieces() {
            for part in 0..PARTS {
                let ends = [part, part + 1].map(|i| i as f64 / PARTS as f64);
                self.follow(piece, ends, 0, &mut rings);
            }
        }
        rings
    }

    /// Adds rings behind s = `from` to `to`, so that no two neighbours are turned by more than [`TURN`].
    fn follow(&self, piece: usize, [from, to]: [f64; 2], depth: u32, rings: &mut Vec<(DVec3, DVec3)>) {
        let middle = 0.5 * (from + to);
        let tangents = [from, middle, to].map(|s| self.spline.tangent(piece, s));
        let turn = |a: DVec3, b: DVec3| libm::atan2(a.cross(b).length(), a.dot(b));
        // Both halves count: a wave may end as it began.
        if depth < DEEPEST && turn(tangents[0], tangents[1]) + turn(tangents[1], tangents[2]) > TURN {
            self.follow(piece, [from, middle], depth + 1, rings);
            self.follow(piece, [middle, to], depth + 1, rings);
        } else {
            rings.push((self.spline.at(piece, to)[0], tangents[2]));
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::mesh::check;

    /// A vessel, a straight one, a coil, a wave with a knot in a straight part, one of two points along z.
    fn curves() -> Vec<(Vec<DVec3>, f64)> {
        let coil = (0..30).map(f64::from).map(|t| DVec3::new(6.0 * (0.5 * t).cos(), 6.0 * (0.5 * t).sin(), 0.4 * t));
        vec![
            (vec![DVec3::new(-20.0, 0.0, -2.0), DVec3::new(0.0, 4.0, -3.0), DVec3::new(20.0, 0.0, -2.0)], 1.5),
            (vec![DVec3::ZERO, DVec3::X, 9.0 * DVec3::X], 3.0),
            (coil.collect(), 2.0),
            (
                vec![DVec3::ZERO, DVec3::new(9.0, 3.0, 0.0), DVec3::new(18.0, -3.0, 0.0), DVec3::new(27.0, 0.0, 4.0)],
                4.0,
            ),
            (vec![DVec3::ZERO, -5.0 * DVec3::Z], 0.7),
        ]
    }

    fn volume(mesh: &Mesh) -> f64 {
        let corner = |i: u32| DVec3::from(mesh.vertices[i as usize]);
        mesh.triangles.iter().map(|t| t.map(corner)).map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
    }

    /// Length by the midpoint rule: 2000 parts of each piece.
    fn length(path: &Path) -> f64 {
        let parts = 2000;
        let speed = |i: usize| path.spline.at(i / parts, ((i % parts) as f64 + 0.5) / parts as f64)[1].length();
        (0..path.spline.pieces() * parts).map(speed).sum::<f64>() / parts as f64
    }

    /// Watertight, outwards, without crossings; the volume is pi r^2 L (Pappus: the middle of each section lies on the curve). The section
    /// has the area of the circle; between two rings turned by t against each other the mesh has sin(t) / t of what is swept, at least
    /// 1 - t^2 / 6 with t = 0.1: 0.17 %. Straight tubes are exact, as
    /// far as the midpoint rule is.
    #[test]
    fn the_volume_is_that_of_the_tube() {
        for (points, diameter) in curves() {
            let path = Path::new(&points, diameter);
            assert!(path.sharpest().radius > path.reach());
            let mesh = path.mesh();
            assert_eq!(check(&mesh), [], "{points:?}");
            let (found, exact) = (volume(&mesh), 0.25 * PI * diameter * diameter * length(&path));
            let off = found / exact - 1.0;
            let least = if path.sharpest().radius > 1e9 { -1e-6 } else { -TURN * TURN / 6.0 };
            assert!((least..1e-6).contains(&off), "{found} mm^3, not {exact}: {off:e}");
        }
    }

    /// Every vertex of the wall lies within the reach of the corners around a point of the curve, and none nearer.
    #[test]
    fn vertices_lie_around_the_curve() {
        let (points, diameter) = curves().remove(0);
        let path = Path::new(&points, diameter);
        let mesh = path.mesh();
        let places: Vec<DVec3> = (0..4000).map(|i| path.spline.at(i / 2000, (i % 2000) as f64 / 2000.0)[0]).collect();
        for v in &mesh.vertices[..mesh.vertices.len() - 2] {
            let nearest = places.iter().map(|p| (*p - DVec3::from(*v)).length()).fold(f64::INFINITY, f64::min);
            assert!((nearest / path.reach() - 1.0).abs() < 1e-3, "{v:?}: {nearest} mm");
        }
        assert!((path.reach() / (0.5 * diameter) - 1.0 - 0.003_23).abs() < 1e-4, "{}", path.reach());
    }
}
