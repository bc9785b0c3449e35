//! Refraction at facets, and lines: the trees leave none out.

use glam::DVec3;

use super::super::Far;
use super::super::crossing::holds;
use super::*;
use crate::philox::{philox4x32, unit};

#[path = "../../../tests/shapes/mod.rs"]
mod shapes;

/// Random numbers in (-1, 1).
fn cube(i: u32) -> DVec3 {
    let [a, b, c, _] = philox4x32([i, 0, 0, 0], [5, 6]);
    2.0 * DVec3::new(unit(a), unit(b), unit(c)) - 1.0
}

/// What the tree finds is what the planes of all facets, asked one by one, say: points inside and outside, near and far, light from points, from
/// far away and from infinity, either side the denser, by a little or by much, meshes of 1e-9 to 1e9 mm.
/// Snell's law holds there in vectors to 1e-12, the ends being on opposite sides.
#[test]
fn no_facet_that_turns_light_is_left_out() {
    let meshes = [
        ("sphere", shapes::icosphere(1.0, DVec3::new(0.1, -0.2, 0.3), 4)),
        ("block", shapes::block(DVec3::new(-1.0, -0.7, -0.5), DVec3::new(0.8, 0.9, 0.6))),
        ("ring", shapes::ring(0.4, 1.0, 0.3, 200)),
    ];
    let indices = [(1.0, 1.4), (1.4, 1.0), (1.0, 1.001), (2.5, 1.0), (1.0, 2.5), (1.33, 1.4)];
    for ((name, (vertices, triangles)), scale) in
        meshes.iter().flat_map(|mesh| [(mesh, 1.0), (mesh, 1e-9), (mesh, 1e9)])
    {
        let vertices: Vec<_> = vertices.iter().map(|v| v.map(|x| scale * x)).collect();
        let mesh = Mesh::new(&vertices, triangles);
        let (mut seen, mut several) = (0, 0);
        for i in 0..3000_u32 {
            let near = scale * [1.0, 1.0, 3.0, 1.0, 30.0][i as usize % 5] * cube(2 * i);
            let place = cube(2 * i + 1);
            let far = match i % 4 {
                0 => Far::Direction(place.normalize()),
                1 => Far::Point(1.5 * scale * place),
                2 => Far::Point(50.0 * scale * place),
                _ => Far::Point(1e8 * scale * place),
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
                    if side > 0.0 {
                        return local.by_facet(corners, normal);
                    }
                    local.through_plane(normal, normal.dot(corners[0])).filter(|p| holds(corners, normal, *p))
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
                    // A direction from p has as many digits as the distance, of what the coordinates have.
                    let nearest = 1.0 / far.from(p).1.max(1.0 / (near - p).length());
                    let size = near.abs().max_element().max(scale);
                    assert!(off < 1e-12 + 1e-15 * size / nearest, "{name} {i}: {off}, {ends:?}");
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

/// What lines meet in the tree for them is what they meet among all triangles: lines through vertices, along edges and axes, from within, from
/// near and from 1e4 and 1e10 times as far as the mesh is large, of meshes of 1e-9 to 1e9 mm, about the origin and not.
#[test]
fn no_triangle_on_a_line_is_left_out() {
    let shapes = [
        ("sphere", shapes::icosphere(1.0, DVec3::ZERO, 4)),
        ("sphere not about the origin", shapes::icosphere(1.0, DVec3::new(300.0, -70.0, 3.0), 4)),
        ("block", shapes::block(DVec3::new(-1.0, -0.7, -0.5), DVec3::new(0.8, 0.9, 0.6))),
        ("needle", shapes::block(DVec3::ZERO, DVec3::new(1e-6, 1e-6, 1.0))),
        ("ring", shapes::ring(0.4, 1.0, 0.3, 400)),
    ];
    for ((name, (vertices, triangles)), scale) in
        shapes.iter().flat_map(|shape| [(shape, 1.0), (shape, 1e-9), (shape, 1e9)])
    {
        let vertices: Vec<_> = vertices.iter().map(|v| v.map(|x| scale * x)).collect();
        let mesh = Mesh::new(&vertices, triangles);
        assert!(mesh.wide.is_some(), "{name}");
        let (mut seen, half) = (0, mesh.half.max_element());
        for i in 0..1500_u32 {
            let [u, v, w, _] = philox4x32([i, 2, 0, 0], [5, 6]).map(unit);
            let [a, b, c] = mesh.corners[(u * mesh.corners.len() as f64) as usize];
            let target = mesh.center + [a, 0.5 * (a + b), a + v * (b - a), (a + b + c) / 3.0][i as usize % 4];
            let away = [1.5, 0.1, 1e4, 1e10][(i / 4) as usize % 4] * half;
            let towards = [
                cube(i).normalize(),
                DVec3::AXES[i as usize % 3],
                -(b - a).normalize(),
                DVec3::new(1e-9 * w, -1.0, -0.0),
            ];
            let direction = towards[(i / 16) as usize % 4].normalize();
            let origin = target - away * direction;
            let from = [0.0, -1e-12 * half, away - 1e-3 * half][i as usize % 3];
            let mut found = Vec::new();
            mesh.crossings(origin, direction, from, |c| found.push((c.face, c.t)));
            found.retain(|&(_, t)| t >= from);
            found.sort_by_key(|&(face, _)| face);
            let line = Line::new(origin - mesh.center, direction, half);
            let all = mesh.corners.iter().zip(0..).filter_map(|(corners, face)| Some((face, line.meets(corners)?.0)));
            let expected: Vec<_> = all.filter(|&(_, t)| t >= from).collect();
            assert_eq!(found, expected, "{name} {scale}: {origin} {direction} {from}");
            seen += expected.len();
        }
        assert!(seen > 500, "{name}: {seen}");
    }
}

/// Just below the middle of every facet, and just above it, the plane near is that facet's; in the middle of the mesh there is none.
#[test]
fn the_plane_near_a_facet_is_its_own() {
    let (vertices, triangles) = shapes::icosphere(1.0, DVec3::new(0.1, -0.2, 0.3), 3);
    let mesh = Mesh::new(&vertices, &triangles);
    for face in 0..triangles.len() {
        let ([a, b, c], normal) = (mesh.corners[face], mesh.normals[face]);
        let middle = mesh.center + (a + b + c) / 3.0;
        for height in [1e-4, -1e-4] {
            let (found, above) = mesh.plane_near(middle - height * normal).expect("a facet is about");
            assert!((found - normal).length() < 1e-12 && (above - height).abs() < 1e-12, "{face}: {found}, {above}");
        }
    }
    assert_eq!(mesh.plane_near(mesh.center), None);
    assert_eq!(mesh.plane_near(mesh.center + DVec3::splat(1e3)), None);
}
