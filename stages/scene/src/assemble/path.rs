//! Tubes along a spline: checked, and made into meshes.

use glam::DVec3;
use turbid_contract::Problems;
use turbid_contract::payload::Mesh;

use crate::assemble::plain;
use crate::assemble::relief::MOST_TRIANGLES;
use crate::mesh::first_crossing;
use crate::params::PathParams;
use crate::path::Path;

const MOST_POINTS: usize = 1000;

/// `None` where it bounds no solid.
pub fn path(name: &str, p: &PathParams, problems: &mut Problems) -> Option<Mesh> {
    let at = |field: &str| format!("objects.{name}.path.{field}");
    let (n, diameter) = (p.points.len(), p.diameter.0);
    problems.require(diameter > 0.0, at("diameter"), diameter, "mm", "be > 0");
    if !(2..=MOST_POINTS).contains(&n) {
        let message = format!("points has {n}: a path needs 2 to {MOST_POINTS}");
        problems.push_with_hint(at("points"), message, "name its two ends at least, [x, y, z] each");
    }
    let points: Vec<DVec3> = p.points.iter().map(|point| plain(*point).into()).collect();
    let doubled = points.windows(2).position(|ends| ends[0] == ends[1]);
    if let Some(i) = doubled {
        let message = format!("the points {i} and {} (from 0) are the same, {}", i + 1, said(points[i]));
        problems.push_with_hint(at(&format!("points.{}", i + 1)), message, "take one of them out");
    }
    if !(diameter > 0.0 && (2..=MOST_POINTS).contains(&n) && doubled.is_none()) {
        return None;
    }
    let path = Path::new(&points, diameter);
    let bend = path.sharpest();
    if bend.radius <= path.reach() {
        problems.push_with_hint(
            at(&format!("points.{}", bend.point)),
            format!(
                "near the point {} (from 0), at {}, the path bends with a radius of {:.4} mm, but the tube's is {} mm: its wall would run through itself",
                bend.point,
                said(bend.place),
                bend.radius,
                0.5 * diameter
            ),
            "add points that round the bend, move them apart, or make `diameter` smaller",
        );
        return None;
    }
    let mesh = path.mesh();
    if mesh.triangles.len() as f64 > MOST_TRIANGLES {
        let message = format!("the path takes {} triangles, more than {MOST_TRIANGLES:e}", mesh.triangles.len());
        problems.push_with_hint(at("points"), message, "use fewer points, or split it into several objects");
        return None;
    }
    if let Some(place) = first_crossing(&mesh) {
        problems.push_with_hint(
            at("points"),
            format!("the tube runs through itself at {}", said(place)),
            "move the points apart, make `diameter` smaller, or let two objects with different priorities cross",
        );
        return None;
    }
    Some(mesh)
}

fn said(p: DVec3) -> String {
    format!("({:.4}, {:.4}, {:.4}) mm", p.x, p.y, p.z)
}
