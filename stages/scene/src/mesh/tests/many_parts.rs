//! Meshes of many parts: what lies in what, what runs through what, and how long it takes to say so.

use std::time::Instant;

use super::super::nearby::Nearby;
use super::super::nesting::nesting;
use super::super::topology::topology;
use super::super::*;
use super::{FACES, VERTICES, cube, join};
use glam::DVec3;
use turbid_contract::payload::Mesh;

/// Tetrahedra with their corners moved, scaled, and perhaps turned inside out.
fn tetrahedra(places: impl Iterator<Item = (DVec3, f64, bool)>) -> Mesh {
    let mut mesh = Mesh { vertices: Vec::new(), triangles: Vec::new() };
    for (at, scale, inward) in places {
        let first = mesh.vertices.len() as u32;
        mesh.vertices.extend(VERTICES.map(|v| (at + scale * DVec3::from(v)).to_array()));
        mesh.triangles.extend(FACES.map(|[a, b, c]| if inward { [a, c, b] } else { [a, b, c] }.map(|i| first + i)));
    }
    mesh
}

/// How many of the other parts hold a point (an inward one counts -1), by their solid angles (Van Oosterom and Strackee 1983).
fn winding(mesh: &Mesh, parts: &[u32], except: u32, p: DVec3) -> i64 {
    let mut angle = 0.0;
    for (t, _) in mesh.triangles.iter().zip(parts).filter(|(_, part)| **part != except) {
        let [a, b, c] = t.map(|i| DVec3::from(mesh.vertices[i as usize]) - p);
        let (la, lb, lc) = (a.length(), b.length(), c.length());
        let below = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
        angle += 2.0 * libm::atan2(a.dot(b.cross(c)), below);
    }
    libm::round(angle / (4.0 * std::f64::consts::PI)) as i64
}

fn nested(mesh: &Mesh) -> (Vec<i64>, Vec<i64>) {
    let topology = topology(mesh);
    let mut volumes = vec![0.0; topology.part_count];
    let mut firsts = vec![DVec3::ZERO; topology.part_count];
    for (t, &part) in mesh.triangles.iter().zip(&topology.parts) {
        let [a, b, c] = t.map(|i| DVec3::from(mesh.vertices[i as usize]));
        volumes[part as usize] += a.dot(b.cross(c)) / 6.0;
        firsts[part as usize] = a;
    }
    let expected = firsts.iter().enumerate().map(|(i, p)| winding(mesh, &topology.parts, i as u32, *p)).collect();
    (nesting(&Nearby::of(mesh), &topology.parts, &volumes), expected)
}

/// Nested as they may be, inward or not, the rays say what the solid angles say.
#[test]
fn rays_and_solid_angles_agree_on_what_lies_in_what() {
    let mut state = 1_u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / 2f64.powi(31)
    };
    for round in 0..60 {
        // A random tree of boxes: each is cut into 2 x 2 x 2 cells, in some of which one lies, with the same done to it.
        let mut mesh = Mesh { vertices: Vec::new(), triangles: Vec::new() };
        let mut open = vec![(DVec3::ZERO, 100.0)];
        while let Some((low, side)) = open.pop() {
            if mesh.triangles.len() > 12 * 40 {
                break;
            }
            for cell in 0..8 {
                if random() < 0.5 {
                    let corner =
                        low + 0.5 * side * DVec3::new((cell & 1).into(), (cell >> 1 & 1).into(), (cell >> 2).into());
                    let (at, size) = (corner + 0.02 * side, side * (0.2 + 0.2 * random()));
                    let mut part = cube(0.0, size);
                    part.vertices.iter_mut().for_each(|v| *v = (at + DVec3::from(*v)).to_array());
                    mesh = join(&mesh, &part, random() < 0.5);
                    open.push((at, size));
                }
            }
            open.sort_by(|a, b| a.1.total_cmp(&b.1));
        }
        if mesh.triangles.is_empty() {
            continue;
        }
        // Aslant, too, and where all coordinates are exact.
        if round % 2 == 1 {
            let frame = turbid_optics::solid::Frame::turned(DVec3::new(3.0, -1e3, 0.1), [20.0, 50.0, 70.0]);
            mesh.vertices.iter_mut().for_each(|v| *v = frame.point_out((*v).into()).to_array());
        }
        let (said, expected) = nested(&mesh);
        assert_eq!(said, expected, "round {round}: {} parts", expected.len());
    }
}

/// Shells in shells, each the cavity of the one around it: the ray of each asks the next, and all are right.
#[test]
fn shells_are_nested() {
    let shell = |i: u32| (-0.25 * f64::from(i) * DVec3::new(1.0, 0.7, 0.13), f64::from(i), i.is_multiple_of(2));
    let mesh = tetrahedra((1..120).map(shell));
    let (said, expected) = nested(&mesh);
    assert_eq!(said, expected);
    assert_eq!(check(&mesh), []);
    let outward = tetrahedra((1..120).map(shell).map(|(at, scale, _)| (at, scale, false)));
    let found = check(&outward);
    assert!(found[0].0.contains("lies inside another part and bounds no cavity"), "{found:?}");
}

/// Parts that touch at a corner hold nothing of each other.
#[test]
fn touching_parts_are_beside_each_other() {
    let beside = |step: f64| (0..6).map(move |i| (f64::from(i) * step * DVec3::from(VERTICES[1]), 1.0, false));
    for step in [1.0, -1.0] {
        // Vertices at one place are one.
        let mesh = tetrahedra(beside(step));
        let soup = Soup { vertices: mesh.vertices, triangles: mesh.triangles };
        assert_eq!(check(&place(&soup, &super::STRAIGHT)), []);
    }
}

/// 27,000 separate particles, as many in one line, fine rods aslant, and one part around them all: good meshes, said in seconds. When each part was
/// compared with all triangles the first took minutes.
#[test]
fn many_parts_take_seconds() {
    let lattice = |n: i32, step: DVec3| {
        (0..n * n * n).map(move |i| (step * DVec3::from([i % n, i / n % n, i / n / n].map(f64::from)), 1.0, false))
    };
    let line = |along: DVec3| (0..27_000).map(move |i| (f64::from(i) * along, 1.0, false));
    let around = |mesh: Mesh| join(&mesh, &cube(-1e6, 2e6), false);
    let rods = {
        let frame = turbid_optics::solid::Frame::turned(DVec3::ZERO, [40.0, 30.0, 20.0]);
        let mut mesh = tetrahedra(lattice(13, DVec3::new(3.0, 2.0, 2.0)));
        mesh.vertices.iter_mut().for_each(|v| {
            *v = frame.point_out(DVec3::from(*v) * DVec3::new(100.0, 1.0, 1.0)).to_array();
        });
        mesh
    };
    // Eight faces aslant, whose boxes all have the middle in common.
    let octahedra = {
        let shell = |i: u32| {
            let axes = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| 0.01 * f64::from(i) * axis);
            let octants = (0..8_u32).map(move |o| [0, 1, 2].map(|k| if o >> k & 1 == 0 { axes[k] } else { -axes[k] }));
            octants.enumerate().map(
                move |(o, [x, y, z])| {
                    if (o.count_ones() + i).is_multiple_of(2) { [x, y, z] } else { [x, z, y] }
                },
            )
        };
        let corners = (2..1001).rev().flat_map(shell).flatten().map(|v| v.to_array());
        let vertices: Vec<[f64; 3]> = corners.collect();
        let triangles = (0..vertices.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        place(&Soup { vertices, triangles }, &super::STRAIGHT)
    };
    let cases = [
        ("octahedra", octahedra, 0),
        ("lattice", tetrahedra(lattice(30, DVec3::splat(4.0))), 0),
        ("in a line", tetrahedra(line(DVec3::new(4.0, 0.0, 0.0))), 0),
        ("in a line aslant", tetrahedra(line(DVec3::new(0.9, 1.7, 3.5))), 0),
        ("within one", around(tetrahedra(lattice(30, DVec3::splat(4.0)))), 1),
        ("rods", rods, 0),
    ];
    for (name, mesh, faults) in cases {
        let begun = Instant::now();
        let found = check(&mesh);
        assert_eq!(found.len(), faults, "{name}: {found:?}");
        assert!(begun.elapsed().as_secs() < 60, "{name}: {:?}", begun.elapsed());
        println!("{name}: {:?}", begun.elapsed());
    }
}

/// 5000 tetrahedra through each other are 44 million pairs: the first hundred are enough.
#[test]
fn crossings_stop_at_the_first() {
    let at = |i: u32| 0.01 * DVec3::from([i % 17, i / 17 % 17, i / 289].map(|k| f64::from(k) / 3.0));
    let found = check(&tetrahedra((0..5000).map(|i| (at(i), 1.0, false))));
    assert!(found[0].0.contains("at least 100 pairs of triangles run through each other"), "{found:?}");
}
