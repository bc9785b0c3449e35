//! Triangles that run through each other.

use glam::DVec3;
use turbid_contract::payload::Mesh;
use turbid_optics::solid::bvh::Tree;

/// Pairs of triangles of which an edge of one passes through the other, each once, with a point where they cross.
///
/// Touching is not crossing: an edge must pass a triangle's plane and inside by more than rounding.
pub fn crossings(mesh: &Mesh) -> Vec<([usize; 2], DVec3)> {
    let corner = |i: u32| DVec3::from(mesh.vertices[i as usize]);
    let corners: Vec<[DVec3; 3]> = mesh.triangles.iter().map(|t| t.map(corner)).collect();
    let boxes: Vec<_> = corners.iter().map(|[a, b, c]| (a.min(*b).min(*c), a.max(*b).max(*c))).collect();
    let tree = Tree::over(&boxes);
    let mut found = Vec::new();
    for (i, (low, high)) in boxes.iter().enumerate() {
        let shares = |l: DVec3, h: DVec3| l.cmple(*high).all() && low.cmple(h).all();
        tree.visit(shares, |places| {
            for place in places {
                let j = tree.order()[place] as usize;
                if j > i && shares(boxes[j].0, boxes[j].1) {
                    let [a, b] = [i, j].map(|k| (&mesh.triangles[k], &corners[k]));
                    let point = edge_through(a, b).or_else(|| edge_through(b, a));
                    found.extend(point.map(|p| ([i, j], p)));
                }
            }
        });
    }
    found
}

/// Where an edge of the first triangle passes through the second; edges that end at its corners cannot.
fn edge_through(edges: (&[u32; 3], &[DVec3; 3]), through: (&[u32; 3], &[DVec3; 3])) -> Option<DVec3> {
    let [a, b, c] = *through.1;
    (0..3).find_map(|k| {
        let ends = [k, (k + 1) % 3];
        if ends.iter().any(|&e| through.0.contains(&edges.0[e])) {
            return None;
        }
        let [p, q] = ends.map(|e| edges.1[e]);
        // Six times the volumes that p and q span with the triangle, and the edge with its sides.
        let (over, under) = (volume(a, b, c, p)?, volume(a, b, c, q)?);
        let sides = [volume(p, q, a, b)?, volume(p, q, b, c)?, volume(p, q, c, a)?];
        let same = sides.iter().all(|&s| s > 0.0) || sides.iter().all(|&s| s < 0.0);
        (over * under < 0.0 && same).then(|| p + over / (over - under) * (q - p))
    })
}

/// Six times the volume of a tetrahedron; `None` where it may be rounding.
fn volume(a: DVec3, b: DVec3, c: DVec3, d: DVec3) -> Option<f64> {
    let (u, v, w) = (b - a, c - a, d - a);
    let six = u.cross(v).dot(w);
    // Lengths rounded to 1e-16 of the coordinates; files keep no more than f32, so what is this flat was meant to be.
    let rounding = 1e-6 * u.length() * v.length() * w.length();
    (six.abs() > rounding).then_some(six)
}
