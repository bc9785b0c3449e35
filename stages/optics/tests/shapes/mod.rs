//! Meshes of known solids.

use std::collections::HashMap;

use glam::DVec3;

pub type Triangles = (Vec<[f64; 3]>, Vec<[u32; 3]>);

/// A sphere of 20 4^levels triangles: an icosahedron with its edges halved again and again.
pub fn icosphere(radius: f64, center: DVec3, levels: u32) -> Triangles {
    let phi = (1.0 + 5f64.sqrt()) / 2.0;
    let mut points = Vec::new();
    for (a, b) in [(-1.0, phi), (1.0, phi), (-1.0, -phi), (1.0, -phi)] {
        points.extend([DVec3::new(a, b, 0.0), DVec3::new(0.0, a, b), DVec3::new(b, 0.0, a)]);
    }
    // The faces are the triples of corners 2 apart from each other, seen counterclockwise from outside.
    let mut triangles = Vec::new();
    for i in 0..12_usize {
        for (j, k) in (i + 1..12).flat_map(|j| (j + 1..12).map(move |k| (j, k))) {
            let near = |a: usize, b: usize| (points[a].distance(points[b]) - 2.0).abs() < 1e-9;
            if near(i, j) && near(j, k) && near(k, i) {
                let outward = (points[j] - points[i]).cross(points[k] - points[i]).dot(points[i]) > 0.0;
                triangles.push(if outward { [i, j, k] } else { [i, k, j] }.map(|v| v as u32));
            }
        }
    }
    for _ in 0..levels {
        let mut middles: HashMap<(u32, u32), u32> = HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                points.push(points[a as usize].normalize() + points[b as usize].normalize());
                points.len() as u32 - 1
            })
        };
        triangles = triangles
            .iter()
            .flat_map(|&[a, b, c]| {
                let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    (points.iter().map(|p| (center + radius * p.normalize()).to_array()).collect(), triangles)
}

/// An axis-aligned box of twelve triangles.
pub fn block(low: DVec3, high: DVec3) -> Triangles {
    let corner = |i: usize| {
        let pick = |bit: usize, axis: usize| if i >> bit & 1 == 1 { high[axis] } else { low[axis] };
        [pick(0, 0), pick(1, 1), pick(2, 2)]
    };
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    ((0..8).map(corner).collect(), triangles)
}

/// A ring of square section about z: a surface with a hole through it, met up to four times by a line.
pub fn ring(inner: f64, outer: f64, half: f64, n: u32) -> Triangles {
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for i in 0..n {
        let (sin, cos) = (2.0 * std::f64::consts::PI * f64::from(i) / f64::from(n)).sin_cos();
        for (r, z) in [(outer, -half), (outer, half), (inner, half), (inner, -half)] {
            vertices.push([r * cos, r * sin, z]);
        }
        let next = (i + 1) % n;
        for k in 0..4 {
            let (a, b) = (4 * i + k, 4 * i + (k + 1) % 4);
            let (c, d) = (4 * next + k, 4 * next + (k + 1) % 4);
            triangles.extend([[a, c, d], [a, d, b]]);
        }
    }
    (vertices, triangles)
}
