//! Whether a mesh bounds a solid: closed, oriented outwards, of triangles that have an area and do not run through each other.

use glam::DVec3;
use turbid_contract::payload::Mesh;

use super::crossing::{Crossings, Left, crossings};
use super::nearby::Nearby;
use super::nesting::nesting;
use super::topology::topology;

/// A triangle flatter than this part of its longest edge has no area.
const FLAT: f64 = 1e-9;

/// Largest coordinate, and least extent along the longest side, mm: beyond lie mistakes of scale, and products that are no numbers.
const FARTHEST: f64 = 1e9;
const SMALLEST: f64 = 1e-6;

type Fault = (String, &'static str);

/// What is wrong with a mesh, each with a way out; empty for a solid.
pub fn check(mesh: &Mesh) -> Vec<Fault> {
    if mesh.triangles.is_empty() {
        return vec![("the mesh has no triangle".to_owned(), "export a surface of triangles")];
    }
    if let Some(fault) = extent(mesh) {
        return vec![fault];
    }
    let corner = |i: u32| DVec3::from(mesh.vertices[i as usize]);
    let mut found: Vec<Fault> = Vec::new();
    let mut flat = mesh.triangles.iter().filter(|t| is_flat(t.map(corner)));
    if let Some(first) = flat.next() {
        let (n, at) = (1 + flat.count(), said(corner(first[0])));
        found.push((
            format!("{} without area, the first at {at}", count(n, "triangle")),
            "merge close vertices and dissolve degenerate faces in a mesh editor",
        ));
    }
    let topology = topology(mesh);
    let faults = [
        (
            topology.open,
            "with one triangle only: the surface has holes",
            "fill the holes, or merge vertices that should be one",
        ),
        (
            topology.crowded,
            "with more than two triangles: the surface is not that of a solid",
            "take out inner faces and doubles",
        ),
        (
            topology.turned,
            "whose two triangles have normals to different sides",
            "recalculate normals so that all point outwards",
        ),
    ];
    for (edges, rule, way_out) in faults.into_iter().filter(|(edges, ..)| edges.count > 0) {
        let middle = 0.5 * (corner(edges.first[0]) + corner(edges.first[1]));
        found.push((format!("{} {rule}; the first is at {}", count(edges.count, "edge"), said(middle)), way_out));
    }
    if found.is_empty() {
        let nearby = Nearby::of(mesh);
        found.extend(crossing_fault(&crossings(&nearby)));
        if found.is_empty() {
            found.extend(orientation(&nearby, &topology.parts, topology.part_count));
        }
    }
    found
}

/// Coordinates with which no product of three is infinite or nothing.
fn extent(mesh: &Mesh) -> Option<Fault> {
    const HINT: &str = "check `scale`: lengths of the file times it are mm";
    let corners = || mesh.triangles.iter().flatten().map(|&i| DVec3::from(mesh.vertices[i as usize]));
    // NaN, which overflow may bring, is not within either.
    if let Some(p) = corners().find(|p| !p.to_array().iter().all(|x| x.abs() <= FARTHEST)) {
        let [x, y, z] = p.to_array();
        let rule = format!("coordinates must be within {FARTHEST:e} mm of 0");
        return Some((format!("a vertex lies at ({x:e}, {y:e}, {z:e}) mm: {rule}"), HINT));
    }
    let nowhere = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (low, high) = corners().fold(nowhere, |(low, high), p| (low.min(p), high.max(p)));
    let size = (high - low).max_element();
    (size < SMALLEST).then(|| (format!("it is {size:e} mm across: it must be at least {SMALLEST:e} mm"), HINT))
}

fn crossing_fault(crossings: &Crossings) -> Option<Fault> {
    match crossings.left {
        Left::TooNear(pairs) if crossings.count == 0 => Some((
            format!(
                "more than {pairs} pairs of its triangles are so near each other that they may cross, too many to look at"
            ),
            "split long thin triangles (remesh), or give its parts as objects of their own",
        )),
        _ if crossings.count == 0 => None,
        left => {
            let least = if left == Left::Nothing { "" } else { "at least " };
            let pairs = count(crossings.count, "pair");
            Some((
                format!("{least}{pairs} of triangles run through each other, the first at {}", said(crossings.first)),
                "unite the parts (boolean union) in a mesh editor, or make them objects of their own with different priorities",
            ))
        }
    }
}

/// Parts that do not lie in another must bound a volume; those that do must bound a cavity, with normals into it.
fn orientation(nearby: &Nearby<'_>, parts: &[u32], part_count: usize) -> Option<Fault> {
    let (mut volumes, mut areas) = (vec![0.0; part_count], vec![0.0; part_count]);
    let mut firsts = vec![None; part_count];
    for (i, &part) in parts.iter().enumerate() {
        let (part, corners) = (part as usize, nearby.corners(i));
        let first = *firsts[part].get_or_insert(corners[0]);
        // About a corner of its own, which keeps the digits of what is far from the origin.
        let [a, b, c] = corners.map(|corner| corner - first);
        volumes[part] += a.dot(b.cross(c)) / 6.0;
        areas[part] += 0.5 * (b - a).cross(c - a).length();
    }
    let at = |part: usize| said(firsts[part].unwrap_or_default());
    let thin = |part: &usize| volumes[*part].abs() <= FLAT * areas[*part] * areas[*part].sqrt();
    if let Some(part) = (0..part_count).find(thin) {
        return Some((format!("the part at {} encloses no volume", at(part)), "give it a thickness"));
    }
    for (part, around) in nesting(nearby, parts, &volumes).into_iter().enumerate() {
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
