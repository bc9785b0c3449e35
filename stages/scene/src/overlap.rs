//! Whether two solids share volume.

use glam::DVec3;
use turbid_optics::solid::Solid;

/// Solids that share less than this fraction of their extent only touch: coordinates are rounded.
const TOUCH: f64 = 1e-9;

/// Whether two solids share volume; touching faces, edges and points do not count.
pub fn overlap(a: &Solid, b: &Solid) -> bool {
    match (a, b) {
        (Solid::Ellipsoid { center, radii }, other) | (other, Solid::Ellipsoid { center, radii }) => {
            // In units of the semi-axes the ellipsoid is a unit sphere, and the other solid keeps its kind.
            nearest_to_origin(other, *center, *radii) < 1.0 - TOUCH
        }
        _ => {
            let ((a_low, a_high), (b_low, b_high)) = (a.bounds(), b.bounds());
            let shared = a_high.min(b_high) - a_low.max(b_low);
            let extent = (a_high - a_low).min(b_high - b_low);
            // Both infinite: they share that direction wholly.
            (0..3).all(|i| extent[i].is_infinite() || shared[i] > TOUCH * extent[i])
        }
    }
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

    #[test]
    fn one_inside_the_other_overlaps() {
        assert!(overlap(&SLAB, &ellipsoid([0.0, 0.0, -100.0], [1.0, 2.0, 3.0])));
        assert!(overlap(&ellipsoid([0.0; 3], [9.0; 3]), &ellipsoid([1.0; 3], [0.5, 1.0, 0.1])));
        assert!(overlap(&cuboid([-9.0; 3], [9.0; 3]), &cuboid([-1.0; 3], [1.0; 3])));
    }
}
