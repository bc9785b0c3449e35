//! Whether a mesh bounds a solid: closed, oriented outwards, of triangles that have an area and do not run through each other.

use glam::DVec3;
use turbid_contract::payload::Mesh;

use super::crossing::crossings;
use super::topology::{Fault, topology};

/// A triangle flatter than this part of its longest edge has no area.
const FLAT: f64 = 1e-9;

/// What is wrong with a mesh, each with a way out; empty for a solid.
pub fn check(mesh: &Mesh) -> Vec<(String, &'static str)> {
    if mesh.triangles.is_empty() {
        return vec![("the mesh has no triangle".to_owned(), "export a surface of triangles")];
    }
    let mut found = Vec::new();
    let corner = |i: u32| DVec3::from(mesh.vertices[i as usize]);
    let flat: Vec<_> = mesh.triangles.iter().filter(|t| is_flat(t.map(corner))).collect();
    if let Some(first) = flat.first() {
        let (n, at) = (flat.len(), said(corner(first[0])));
        found.push((
            format!("{} without area, the first at {at}", count(n, "triangle")),
            "merge close vertices and dissolve degenerate faces in a mesh editor",
        ));
    }
    let topology = topology(mesh);
    let faults = [
        (
            Fault::Open,
            "with one triangle only: the surface has holes",
            "fill the holes, or merge vertices that should be one",
        ),
        (
            Fault::Crowded,
            "with more than two triangles: the surface is not that of a solid",
            "take out inner faces and doubles",
        ),
        (
            Fault::Turned,
            "whose two triangles have normals to different sides",
            "recalculate normals so that all point outwards",
        ),
    ];
    for (fault, rule, way_out) in faults {
        let edges: Vec<[u32; 2]> = topology.faults.iter().filter(|f| f.0 == fault).map(|f| f.1).collect();
        if let Some(first) = edges.first() {
            let middle = 0.5 * (corner(first[0]) + corner(first[1]));
            found.push((format!("{} {rule}; the first is at {}", count(edges.len(), "edge"), said(middle)), way_out));
        }
    }
    if found.is_empty() {
        let pairs = crossings(mesh);
        if let Some((_, first)) = pairs.first() {
            found.push((
                format!("{} of triangles run through each other, the first at {}", count(pairs.len(), "pair"), said(*first)),
                "unite the parts (boolean union) in a mesh editor, or make them objects of their own with different priorities",
            ));
        }
    }
    if found.is_empty() {
        found.extend(orientation(mesh, &topology.parts, topology.part_count));
    }
    found
}

/// Parts that do not lie in another must bound a volume; those that do must bound a cavity, with normals into it.
fn orientation(mesh: &Mesh, parts: &[u32], part_count: usize) -> Option<(String, &'static str)> {
    let corner = |i: u32| DVec3::from(mesh.vertices[i as usize]);
    let (mut volumes, mut areas) = (vec![0.0; part_count], vec![0.0; part_count]);
    let (mut first, mut middles) = (vec![usize::MAX; part_count], vec![DVec3::ZERO; part_count]);
    for (i, (t, &part)) in mesh.triangles.iter().zip(parts).enumerate() {
        let part = part as usize;
        if first[part] == usize::MAX {
            (first[part], middles[part]) = (i, corner(t[0]));
        }
        // About a corner of its own, which keeps the digits of what is far from the origin.
        let [a, b, c] = t.map(|k| corner(k) - middles[part]);
        volumes[part] += a.dot(b.cross(c)) / 6.0;
        areas[part] += 0.5 * (b - a).cross(c - a).length();
    }
    let at = |part: usize| said(middles[part]);
    for part in 0..part_count {
        if volumes[part].abs() <= FLAT * areas[part] * areas[part].sqrt() {
            return Some((format!("the part at {} encloses no volume", at(part)), "give it a thickness"));
        }
        let around = if part_count > 1 { winding(mesh, parts, part as u32, middles[part]) } else { 0 };
        match (volumes[part] < 0.0, around) {
            (false, 0) | (true, 1) => {}
            (true, 0) => {
                let message = format!(
                    "the normals of the part at {} point inwards (its volume is {:.6} mm^3)",
                    at(part),
                    volumes[part]
                );
                return Some((message, "flip its normals"));
            }
            (false, _) => {
                let message = format!("the part at {} lies inside another part and bounds no cavity", at(part));
                return Some((message, "flip its normals if it is a cavity, or take it out"));
            }
            (true, _) => {
                let message = format!("the cavity at {} lies in {around} parts at once", at(part));
                return Some((message, "take out doubled parts"));
            }
        }
    }
    None
}

/// How many of the other parts hold a point (a cavity counts -1), by their solid angles.
fn winding(mesh: &Mesh, parts: &[u32], except: u32, p: DVec3) -> i64 {
    let mut angle = 0.0;
    for (t, _) in mesh.triangles.iter().zip(parts).filter(|(_, part)| **part != except) {
        let [a, b, c] = t.map(|i| DVec3::from(mesh.vertices[i as usize]) - p);
        let (la, lb, lc) = (a.length(), b.length(), c.length());
        // Van Oosterom and Strackee 1983.
        let below = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
        angle += 2.0 * libm::atan2(a.dot(b.cross(c)), below);
    }
    libm::round(angle / (4.0 * std::f64::consts::PI)) as i64
}

fn is_flat([a, b, c]: [DVec3; 3]) -> bool {
    let longest = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
    let twice = (b - a).cross(c - a).length();
    // Also where all corners are one.
    twice <= FLAT * longest
}

fn count(n: usize, what: &str) -> String {
    if n == 1 { format!("1 {what}") } else { format!("{n} {what}s") }
}

fn said(p: DVec3) -> String {
    format!("({:.4}, {:.4}, {:.4}) mm", p.x, p.y, p.z)
}
