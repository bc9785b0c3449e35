//! Refraction at facets: the tree leaves none out.

use glam::DVec3;

use super::super::Far;
use super::*;
use crate::philox::{philox4x32, unit};

#[path = "../../../tests/shapes/mod.rs"]
mod shapes;

/// Random numbers in (-1, 1).
fn cube(i: u32) -> DVec3 {
    let [a, b, c, _] = philox4x32([i, 0, 0, 0], [5, 6]);
    2.0 * DVec3::new(unit(a), unit(b), unit(c)) - 1.0
}

/// What the tree finds is what all facets, asked one by one, find: points inside and outside, near and far, light from points and from
/// infinity, either side the denser, by a little or by much. Snell's law holds there in vectors to 1e-12, the ends being on opposite sides.
#[test]
fn no_facet_that_turns_light_is_left_out() {
    let meshes = [
        ("sphere", shapes::icosphere(1.0, DVec3::new(0.1, -0.2, 0.3), 4)),
        ("block", shapes::block(DVec3::new(-1.0, -0.7, -0.5), DVec3::new(0.8, 0.9, 0.6))),
        ("ring", shapes::ring(0.4, 1.0, 0.3, 200)),
    ];
    let indices = [(1.0, 1.4), (1.4, 1.0), (1.0, 1.001), (2.5, 1.0), (1.0, 2.5), (1.33, 1.4)];
    for (name, (vertices, triangles)) in meshes {
        let mesh = Mesh::new(&vertices, &triangles);
        let (mut seen, mut several) = (0, 0);
        for i in 0..3000_u32 {
            let (near, place) = ([1.0, 1.0, 3.0][i as usize % 3] * cube(2 * i), cube(2 * i + 1));
            let far = match i % 4 {
                0 => Far::Direction(place.normalize()),
                1 => Far::Point(1.5 * place),
                _ => Far::Point(50.0 * place),
            };
            let (n_far, n_near) = indices[i as usize % indices.len()];
            let (ends, mirrored) = (Ends { far, n_far, near, n_near }, Ends::alike(far, near));
            let about = |ends: &Ends| ends.moved(|p| p - mesh.center, |w| w);
            let sort = |mut list: Vec<[f64; 3]>| {
                list.sort_by(|p, q| p.partial_cmp(q).expect("finite"));
                list
            };
            for (ends, side) in [(ends, -1.0), (mirrored, 1.0)] {
                let mut found = Vec::new();
                let mut keep = |p: DVec3| found.push(p.to_array());
                let local = about(&ends);
                let on = |corners: &[DVec3; 3], normal: DVec3| {
                    if side < 0.0 { local.through_facet(corners, normal) } else { local.by_facet(corners, normal) }
                };
                if side < 0.0 {
                    mesh.refractions(&ends, &mut keep);
                } else {
                    mesh.reflections(&ends, &mut keep);
                }
                let each = mesh.corners.iter().zip(&mesh.normals);
                let all = each.filter_map(|(corners, &normal)| Some((on(corners, normal)?, normal)));
                let mut expected = Vec::new();
                for (p, normal) in all {
                    let p = p + mesh.center;
                    let (a, b) = (far.from(p).0, (near - p).normalize());
                    let off = (ends.n_far * a + ends.n_near * b).cross(normal).length();
                    // A direction from p has as many digits as the distance.
                    assert!(off < 1e-12 + 1e-15 / (near - p).length(), "{name} {i}: {off}");
                    assert!(side * a.dot(normal) * b.dot(normal) > 0.0, "{name} {i}");
                    expected.push(p.to_array());
                }
                seen += expected.len();
                several += usize::from(expected.len() > 1);
                assert_eq!(sort(found), sort(expected), "{name} {i}: {ends:?}");
            }
        }
        assert!(seen > 300 && several > 20, "{name}: {seen} places, {several} pairs with several");
    }
}
