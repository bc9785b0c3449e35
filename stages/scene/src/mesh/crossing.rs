//! Triangles that run through each other.

use std::ops::ControlFlow;

use glam::DVec3;
use turbid_contract::payload::Mesh;

use super::nearby::Nearby;

/// After so many pairs the mesh is wrong enough.
const MOST_FOUND: usize = 100;
/// Pairs of triangles with boxes that share a point which are looked at: some twenty seconds. A mesh that is fit to be rendered has about
/// ten for each triangle; each of n long ones aslant in different directions has n.
const MOST_NEAR: u64 = 1_000_000_000;

/// What was found of triangles of which an edge of one passes through the other.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Crossings {
    /// Pairs, and where the first is.
    pub count: usize,
    pub first: DVec3,
    pub left: Left,
}

/// What was not looked at.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Left {
    #[default]
    Nothing,
    /// Behind the first [`MOST_FOUND`].
    Others,
    /// Behind so many pairs that are near each other.
    TooNear(u64),
}

/// Where a closed mesh first runs through itself.
pub fn first_crossing(mesh: &Mesh) -> Option<DVec3> {
    let found = crossings(&Nearby::of(mesh));
    (found.count > 0).then_some(found.first)
}

/// Touching is not crossing: an edge must pass a triangle's plane and inside by more than rounding.
pub fn crossings(nearby: &Nearby<'_>) -> Crossings {
    looked_at(nearby, MOST_NEAR)
}

fn looked_at(nearby: &Nearby<'_>, most_near: u64) -> Crossings {
    let mut found = Crossings::default();
    let mut first = (usize::MAX, usize::MAX);
    let all = nearby.pairs(most_near, |i, j| {
        if let Some(point) = crossing(nearby, i, j) {
            // By the order in the file, not by that of the tree.
            if (i, j) < first {
                (first, found.first) = ((i, j), point);
            }
            found.count += 1;
            if found.count == MOST_FOUND {
                found.left = Left::Others;
                return ControlFlow::Break(());
            }
        }
        ControlFlow::Continue(())
    });
    if !all {
        found.left = Left::TooNear(most_near);
    }
    found
}

/// Where two triangles run through each other.
fn crossing(nearby: &Nearby<'_>, i: usize, j: usize) -> Option<DVec3> {
    let [a, b] = [i, j].map(|k| &nearby.mesh.triangles[k]);
    // Of neighbours at an edge each edge ends at a corner of the other.
    if a.iter().filter(|corner| b.contains(corner)).count() > 1 {
        return None;
    }
    let [p, q] = [i, j].map(|k| nearby.corners(k));
    // Most pairs are told apart by a plane of one of them.
    let over_b = heights(&q, &p).filter(|h| !on_one_side(h))?;
    let over_a = heights(&p, &q).filter(|h| !on_one_side(h))?;
    edge_through((a, &p), (b, &q), over_b).or_else(|| edge_through((b, &q), (a, &p), over_a))
}

type Heights = [Option<f64>; 3];

/// Six times the volumes that points span with a triangle; each `None` where it may be rounding, nothing where all are.
fn heights([a, b, c]: &[DVec3; 3], points: &[DVec3; 3]) -> Option<Heights> {
    let (u, v) = (b - a, c - a);
    let (normal, scale) = (u.cross(v), rounding(u) * v.length());
    let heights = points.map(|p| {
        let w = p - a;
        let six = normal.dot(w);
        (six.abs() > scale * w.length()).then_some(six)
    });
    heights.iter().any(Option::is_some).then_some(heights)
}

fn on_one_side(heights: &Heights) -> bool {
    heights.iter().all(|h| h.is_some_and(|h| h > 0.0)) || heights.iter().all(|h| h.is_some_and(|h| h < 0.0))
}

/// Where an edge of the first triangle, whose corners have heights over the second, passes through that; edges that end at its corners cannot.
fn edge_through(edges: (&[u32; 3], &[DVec3; 3]), through: (&[u32; 3], &[DVec3; 3]), heights: Heights) -> Option<DVec3> {
    let [a, b, c] = *through.1;
    (0..3).find_map(|k| {
        let ends = [k, (k + 1) % 3];
        if ends.iter().any(|&e| through.0.contains(&edges.0[e])) {
            return None;
        }
        let (over, under) = (heights[ends[0]]?, heights[ends[1]]?);
        if (over < 0.0) == (under < 0.0) {
            return None;
        }
        let [p, q] = ends.map(|e| edges.1[e]);
        let sides = [volume(p, q, a, b)?, volume(p, q, b, c)?, volume(p, q, c, a)?];
        let same = sides.iter().all(|&s| s > 0.0) || sides.iter().all(|&s| s < 0.0);
        same.then(|| p + over / (over - under) * (q - p))
    })
}

/// Six times the volume of a tetrahedron; `None` where it may be rounding.
fn volume(a: DVec3, b: DVec3, c: DVec3, d: DVec3) -> Option<f64> {
    let (u, v, w) = (b - a, c - a, d - a);
    let six = u.cross(v).dot(w);
    (six.abs() > rounding(u) * v.length() * w.length()).then_some(six)
}

/// Lengths rounded to 1e-16 of the coordinates; files keep no more than f32, so what is this flat was meant to be.
fn rounding(u: DVec3) -> f64 {
    1e-6 * u.length()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Faces of octahedra about one middle, where all their boxes meet, are no fault where all pairs are looked at, and said to be too many
    /// where not.
    #[test]
    fn too_many_near_pairs_are_said() {
        let face = |i: u32| {
            let side = |k: u32| if i >> k & 1 == 0 { f64::from(1 + i / 8) } else { -f64::from(1 + i / 8) };
            [[side(0), 0.0, 0.0], [0.0, side(1), 0.0], [0.0, 0.0, side(2)]]
        };
        let vertices: Vec<[f64; 3]> = (0..40).flat_map(face).collect();
        let triangles = (0..40).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let mesh = Mesh { vertices, triangles };
        assert_eq!(looked_at(&Nearby::of(&mesh), 10_000), Crossings::default());
        assert_eq!(looked_at(&Nearby::of(&mesh), 50).left, Left::TooNear(50));
    }

    /// Two tetrahedra: of three crossings of the first triangle that with the sixth.
    #[test]
    fn the_first_is_that_of_the_file() {
        let one = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]];
        let other = [[0.2, 0.2, -1.0], [0.4, 0.2, -1.0], [0.2, 0.4, -1.0], [0.2, 0.2, 1.0]];
        let sides = |k: u32| [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]].map(|t: [u32; 3]| t.map(|i| i + k));
        let mesh = Mesh { vertices: [one, other].concat(), triangles: [sides(0), sides(4)].concat() };
        let first = first_crossing(&mesh).expect("they share a volume");
        assert!(first.abs_diff_eq(DVec3::new(0.3, 0.2, 0.0), 1e-15), "{first}");
    }
}
