//! Whether two solids share volume.

use glam::DVec3;
use turbid_optics::solid::{Chord, Solid};

/// Solids that share less than this fraction of their extent only touch: coordinates are rounded.
const TOUCH: f64 = 1e-9;

/// Lines along each axis with which shared volume is looked for.
const LINES: usize = 64;
/// Part of the shared box that a line must spend in both solids to tell: roots near a tangent lose half their digits.
const LEAST_CHORD: f64 = 1e-6;

/// Whether two solids share volume; touching faces, edges and points do not count.
///
/// Exact between slabs, boxes and ellipsoids that stand straight. Others are searched by lines: what they share is found where
/// its shadow along x, y or z covers 1/4000 of that of the box which both solids' boxes share.
pub fn overlap(a: &Solid, b: &Solid) -> bool {
    let straight = |s: &Solid| matches!(s, Solid::Slab { .. } | Solid::Box { .. } | Solid::Ellipsoid { .. });
    if !straight(a) || !straight(b) {
        return boxes_overlap(a, b) && lines_overlap(a, b);
    }
    match (a, b) {
        (Solid::Ellipsoid { center, radii }, other) | (other, Solid::Ellipsoid { center, radii }) => {
            // In units of the semi-axes the ellipsoid is a unit sphere, and the other solid keeps its kind.
            nearest_to_origin(other, *center, *radii) < 1.0 - TOUCH
        }
        _ => boxes_overlap(a, b),
    }
}

fn boxes_overlap(a: &Solid, b: &Solid) -> bool {
    let ((a_low, a_high), (b_low, b_high)) = (a.bounds(), b.bounds());
    let shared = a_high.min(b_high) - a_low.max(b_low);
    let extent = (a_high - a_low).min(b_high - b_low);
    // Both infinite: they share that direction wholly.
    (0..3).all(|i| extent[i].is_infinite() || shared[i] > TOUCH * extent[i])
}

/// Whether a line of a lattice across the box that both share is in both solids at once.
fn lines_overlap(a: &Solid, b: &Solid) -> bool {
    let ((a_low, a_high), (b_low, b_high)) = (a.bounds(), b.bounds());
    let (low, size) = (a_low.max(b_low), a_high.min(b_high) - a_low.max(b_low));
    let (mut in_a, mut in_b): (Vec<Chord>, Vec<Chord>) = (Vec::new(), Vec::new());
    (0..3 * LINES * LINES).any(|i| {
        let (axis, i) = (i % 3, i / 3);
        // Off the middles, where the edges of round numbers are.
        let at = |i: usize| (i as f64 + 0.382) / LINES as f64;
        let (mut origin, mut direction) = (low, DVec3::ZERO);
        origin[(axis + 1) % 3] += at(i % LINES) * size[(axis + 1) % 3];
        origin[(axis + 2) % 3] += at(i / LINES) * size[(axis + 2) % 3];
        origin[axis] -= size[axis];
        direction[axis] = 1.0;
        in_a.clear();
        in_b.clear();
        a.cut(origin, direction, None, &mut in_a);
        b.cut(origin, direction, None, &mut in_b);
        in_a.iter().any(|a| in_b.iter().any(|b| a.leave.min(b.leave) - a.enter.max(b.enter) > LEAST_CHORD * size[axis]))
    })
}

/// Distance from the origin to the solid after (p - center) / scale; 0 inside.
fn nearest_to_origin(solid: &Solid, center: DVec3, scale: DVec3) -> f64 {
    match *solid {
        Solid::Ellipsoid { center: other, radii } => {
            distance_to_ellipsoid(((center - other) / scale).abs(), radii / scale)
        }
        _ => {
            let (low, high) = solid.bounds();
            let (low, high) = ((low - center) / scale, (high - center) / scale);
            low.max(-high).max(DVec3::ZERO).length()
        }
    }
}

/// Distance of `p` (first octant) from a solid ellipsoid at the origin.
///
/// The nearest point is x_i = r_i^2 p_i / (t + r_i^2) with the only root t >= 0 of sum (r_i p_i / (t + r_i^2))^2 = 1
/// (Eberly, "Distance from a point to an ellipse, an ellipsoid, or a hyperellipsoid", 2013); found by bisection.
fn distance_to_ellipsoid(p: DVec3, radii: DVec3) -> f64 {
    let r2 = radii * radii;
    let excess = |t: f64| (radii * p / (r2 + t)).length_squared() - 1.0;
    if excess(0.0) <= 0.0 {
        return 0.0;
    }
    let (mut low, mut high) = (0.0, (radii * p).length());
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if excess(middle) > 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    (p - r2 * p / (r2 + high)).length()
}

#[cfg(test)]
mod tests {
    use turbid_optics::solid::Frame;

    use super::*;

    fn cuboid(low: [f64; 3], high: [f64; 3]) -> Solid {
        Solid::Box { low: low.into(), high: high.into() }
    }
    fn ellipsoid(center: [f64; 3], radii: [f64; 3]) -> Solid {
        Solid::Ellipsoid { center: center.into(), radii: radii.into() }
    }
    const SLAB: Solid = Solid::Slab { bottom: -2000.0, top: 0.0 };

    /// Truth table: each pair touches exactly, then one of them is moved by 1e-6 into or out of the other.
    #[test]
    fn touching_is_not_overlapping() {
        type Make = fn(f64) -> (Solid, Solid);
        let pairs: [(&str, Make); 7] = [
            ("slab over slab", |d| (SLAB, Solid::Slab { bottom: -d, top: 5.0 })),
            ("box on slab", |d| (SLAB, cuboid([0.1, 0.2, -d], [0.3, 0.7, 1.0]))),
            ("box beside box", |d| (cuboid([0.0; 3], [0.1, 1.0, 1.0]), cuboid([0.1 - d, 0.0, 0.0], [0.3, 1.0, 1.0]))),
            ("sphere on slab", |d| (SLAB, ellipsoid([5.0, 1.0, 20.0 - d], [20.0; 3]))),
            ("sphere at a box's edge", |d| {
                // (3, 4, 0) from the edge: at distance 5.
                (cuboid([0.0; 3], [1.0, 2.0, 3.0]), ellipsoid([4.0 - 0.6 * d, 6.0 - 0.8 * d, 1.5], [5.0; 3]))
            }),
            ("spheroid beside spheroid", |d| {
                (ellipsoid([0.0; 3], [20.0, 20.0, 40.0]), ellipsoid([25.0 - d, 0.0, 0.0], [5.0, 9.0, 2.0]))
            }),
            ("sphere at a tilt", |d| {
                let s = (5.0 - d) * 0.5f64.sqrt();
                (ellipsoid([0.0; 3], [2.0; 3]), ellipsoid([s, s, 0.0], [3.0; 3]))
            }),
        ];
        for (name, make) in pairs {
            for (d, expected) in [(0.0, false), (1e-5, true), (-1e-5, false)] {
                let (a, b) = make(d);
                assert_eq!(overlap(&a, &b), expected, "{name}, shifted by {d}");
                assert_eq!(overlap(&b, &a), expected, "{name}, shifted by {d}, other order");
            }
        }
    }

    /// The same for solids that are searched by lines, with what these must find: 0.02 in 10 of a cap (its shadow along x is 1/700 of the
    /// shared box), 1e-3 of a ring around a rod.
    #[test]
    fn lines_find_what_is_shared() {
        let rod = |radius: f64| Solid::Cylinder { axis: [1.0, 2.0].into(), radius, bottom: -5.0, top: 7.0 };
        let bore = Solid::tube(6.0, 9.0, [1.0, 2.0].into(), -3.0, 4.0);
        let turned = |solid: Solid, pivot: [f64; 3]| solid.turned(Frame::turned_about(pivot.into(), [0.0, 30.0, 0.0]));
        let along = |x: f64| Solid::cylinder(4.0, 10.0, [x, 0.0, 2.0].into(), DVec3::X);
        let pairs = [
            (rod(3.0), bore.clone(), false),
            (rod(3.001), bore.clone(), true),
            (rod(2.0), bore, false),
            (along(0.0), SLAB, false),
            (along(0.0), turned(SLAB, [0.0; 3]), true),
            (along(0.0), ellipsoid([15.0, 0.0, 2.0], [10.0; 3]), false),
            (along(0.0), ellipsoid([14.98, 0.0, 2.0], [10.0; 3]), true),
            (turned(cuboid([0.0; 3], [1.0; 3]), [1.0; 3]), turned(cuboid([1.0; 3], [2.0; 3]), [1.0; 3]), false),
            (turned(cuboid([0.0; 3], [1.0; 3]), [1.0; 3]), turned(cuboid([0.9; 3], [2.0; 3]), [1.0; 3]), true),
        ];
        for (a, b, expected) in pairs {
            assert_eq!((overlap(&a, &b), overlap(&b, &a)), (expected, expected), "{a:?} {b:?}");
        }
    }

    #[test]
    fn one_inside_the_other_overlaps() {
        assert!(overlap(&SLAB, &ellipsoid([0.0, 0.0, -100.0], [1.0, 2.0, 3.0])));
        assert!(overlap(&ellipsoid([0.0; 3], [9.0; 3]), &ellipsoid([1.0; 3], [0.5, 1.0, 0.1])));
        assert!(overlap(&cuboid([-9.0; 3], [9.0; 3]), &cuboid([-1.0; 3], [1.0; 3])));
    }
}
