//! Convex solids and how a line passes through them.

use glam::DVec3;

/// A convex solid in world coordinates, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Solid {
    /// bottom <= z <= top, infinite sideways.
    Slab { bottom: f64, top: f64 },
    /// Axis-aligned, between two opposite corners.
    Box { low: DVec3, high: DVec3 },
    /// Axis-aligned ellipsoid with semi-axes `radii`.
    Ellipsoid { center: DVec3, radii: DVec3 },
}

impl Solid {
    /// The part of the line origin + t direction inside the solid, as (t of entry, t of exit), entry < exit; the ends
    /// are infinite where the solid is. A line that only touches is outside.
    #[inline]
    pub fn interval(&self, origin: DVec3, direction: DVec3) -> Option<(f64, f64)> {
        let (enter, leave) = self.span(origin, direction);
        (enter < leave).then_some((enter, leave))
    }

    /// The same without a branch: entry >= exit where the line misses the solid.
    #[inline(always)]
    pub fn span(&self, origin: DVec3, direction: DVec3) -> (f64, f64) {
        match *self {
            Self::Slab { bottom, top } => between(origin.z, direction.z, bottom, top),
            Self::Box { low, high } => {
                let x = between(origin.x, direction.x, low.x, high.x);
                let y = between(origin.y, direction.y, low.y, high.y);
                let z = between(origin.z, direction.z, low.z, high.z);
                (x.0.max(y.0).max(z.0), x.1.min(y.1).min(z.1))
            }
            Self::Ellipsoid { center, radii } => {
                // In units of the semi-axes a unit sphere. Measured from the point of closest approach, because the
                // textbook discriminant loses half the digits when the origin is far away.
                let o = (origin - center) / radii;
                let d = direction / radii;
                let d2 = d.length_squared();
                let nearest = -o.dot(d) / d2;
                let inside = 1.0 - (o + nearest * d).length_squared();
                let half = (inside.max(0.0) / d2).sqrt();
                (nearest - half, nearest + half)
            }
        }
    }

    /// Whether the point lies in the solid or on its surface.
    pub fn contains(&self, p: DVec3) -> bool {
        match *self {
            Self::Slab { bottom, top } => bottom <= p.z && p.z <= top,
            Self::Box { low, high } => p.cmpge(low).all() && p.cmple(high).all(),
            Self::Ellipsoid { center, radii } => ((p - center) / radii).length_squared() <= 1.0,
        }
    }

    /// The distance (mm, >= 0) at which the ray from `p` along `w` meets the surface first, infinite where it does not.
    #[inline(always)]
    pub fn reach(&self, p: DVec3, w: DVec3) -> f64 {
        match *self {
            Self::Slab { bottom, top } => {
                // The plane that the ray comes to first, with one division: from outside the nearer one.
                let upward = if p.z < bottom { bottom } else { top };
                let downward = if p.z > top { top } else { bottom };
                let plane = if w.z > 0.0 { upward } else { downward };
                let t = (plane - p.z) / w.z;
                // Behind the ray, or along it (0 / 0), it is not in the way.
                if t >= 0.0 { t } else { f64::INFINITY }
            }
            _ => {
                let (enter, leave) = self.span(p, w);
                let t = if enter >= 0.0 { enter } else { leave };
                if (enter < leave) & (t >= 0.0) { t } else { f64::INFINITY }
            }
        }
    }

    /// A distance (mm, >= 0) within which of `p` there is no point of the surface; exact but for ellipsoids that are
    /// not spheres, where it is at least the shortest semi-axis over the longest times the true one.
    #[inline(always)]
    pub fn clearance(&self, p: DVec3) -> f64 {
        match *self {
            Self::Slab { bottom, top } => (p.z - bottom).abs().min((p.z - top).abs()),
            Self::Box { low, high } => {
                // > 0 outside, per axis.
                let out = (low - p).max(p - high);
                let deepest = out.max_element();
                if deepest <= 0.0 { -deepest } else { out.max(DVec3::ZERO).length() }
            }
            Self::Ellipsoid { center, radii } => {
                (((p - center) / radii).length() - 1.0).abs() * radii.min_element() * (1.0 - 4.0 * f64::EPSILON)
            }
        }
    }

    /// Outward unit normal at a point of the surface.
    pub fn normal(&self, p: DVec3) -> DVec3 {
        match *self {
            Self::Slab { bottom, top } => {
                if (p.z - top).abs() <= (p.z - bottom).abs() {
                    DVec3::Z
                } else {
                    DVec3::NEG_Z
                }
            }
            Self::Box { low, high } => {
                let faces = [
                    (p.x - low.x, DVec3::NEG_X),
                    (p.x - high.x, DVec3::X),
                    (p.y - low.y, DVec3::NEG_Y),
                    (p.y - high.y, DVec3::Y),
                    (p.z - low.z, DVec3::NEG_Z),
                    (p.z - high.z, DVec3::Z),
                ];
                let nearest = faces.iter().min_by(|a, b| a.0.abs().total_cmp(&b.0.abs()));
                nearest.expect("a box has six faces").1
            }
            Self::Ellipsoid { center, radii } => ((p - center) / (radii * radii)).normalize(),
        }
    }

    /// Lowest and highest corner of the bounding box; infinite where the solid is.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        match *self {
            Self::Slab { bottom, top } => {
                let wide = f64::INFINITY;
                (DVec3::new(-wide, -wide, bottom), DVec3::new(wide, wide, top))
            }
            Self::Box { low, high } => (low, high),
            Self::Ellipsoid { center, radii } => (center - radii, center + radii),
        }
    }
}

/// Where o + t d lies between two parallel planes: (t of entry, t of exit), entry >= exit where nowhere.
#[inline(always)]
fn between(o: f64, d: f64, low: f64, high: f64) -> (f64, f64) {
    // Along the planes (d = 0): -inf and inf between them, the same infinity twice outside; in one of them 0 / 0, which min and
    // max pass over, leaving the other's infinity twice.
    let (a, b) = ((low - o) / d, (high - o) / d);
    (a.min(b), a.max(b))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn solids() -> [Solid; 4] {
        [
            Solid::Slab { bottom: -3.0, top: 0.5 },
            Solid::Box { low: DVec3::new(-1.0, -2.0, -3.0), high: DVec3::new(2.0, 0.5, 1.0) },
            Solid::Ellipsoid { center: DVec3::new(0.3, -0.2, 0.1), radii: DVec3::splat(1.7) },
            Solid::Ellipsoid { center: DVec3::new(0.3, -0.2, 0.1), radii: DVec3::new(0.4, 1.7, 3.0) },
        ]
    }

    /// A Halton point in (-4, 4)^3: evenly spread, no generator needed.
    fn spread(i: usize) -> DVec3 {
        let halton = |base: usize| {
            let (mut n, mut f, mut r) = (i + 1, 1.0, 0.0);
            while n > 0 {
                f /= base as f64;
                r += f * (n % base) as f64;
                n /= base;
            }
            8.0 * r - 4.0
        };
        DVec3::new(halton(2), halton(3), halton(5))
    }

    /// Ends of an interval lie on the surface, its middle inside, points beyond it outside; |p| < 30, so 1e-12 is
    /// some 100 roundings.
    #[test]
    fn intervals_are_where_the_line_is_inside() {
        for solid in solids() {
            let mut hits = 0;
            for i in 0..1000 {
                let (origin, direction) = (1.5 * spread(i), (spread(i + 1000) - spread(i)).normalize());
                let Some((enter, leave)) = solid.interval(origin, direction) else {
                    assert!((0..200).all(|k| !solid.contains(origin + (0.5 * f64::from(k) - 50.0) * direction)));
                    continue;
                };
                hits += 1;
                let at = |t: f64| origin + t * direction;
                assert!(solid.contains(at(0.5 * (enter + leave))), "{solid:?} {origin} {direction}");
                for (end, beyond) in [(enter, enter - 1e-9), (leave, leave + 1e-9)] {
                    assert!(solid.clearance(at(end)) <= 1e-12, "{solid:?}: {} off", solid.clearance(at(end)));
                    assert!(!solid.contains(at(beyond)), "{solid:?} {origin} {direction}");
                    let outward = solid.normal(at(end)).dot(direction) * (if end == leave { 1.0 } else { -1.0 });
                    assert!(outward > 0.0, "{solid:?}: normal {}", solid.normal(at(end)));
                }
            }
            assert!(hits > 20, "{solid:?}: {hits} hits");
        }
    }

    /// The ray meets the surface where `interval` says, from within, from outside, and not behind.
    #[test]
    fn reach_is_the_first_end_ahead() {
        for solid in solids() {
            let mut met = 0;
            for i in 0..1000 {
                let (p, w) = (1.5 * spread(i), (spread(i + 1000) - spread(i)).normalize());
                let ends = solid.interval(p, w).map_or([f64::INFINITY; 2], |(enter, leave)| [enter, leave]);
                let expected = ends.into_iter().find(|&t| t >= 0.0).unwrap_or(f64::INFINITY);
                assert_eq!(solid.reach(p, w), expected, "{solid:?} {p} {w}");
                met += usize::from(expected < f64::INFINITY);
            }
            assert!((20..1000).contains(&met), "{solid:?}: {met} rays meet it");
        }
    }

    /// No line through p meets the surface nearer than the clearance, and on a dense fan of lines it is not far from it.
    #[test]
    fn clearance_is_a_lower_bound_of_the_distance() {
        for solid in solids() {
            for i in 0..40 {
                let p = spread(i);
                let mut nearest = f64::INFINITY;
                for k in 0..2000 {
                    let direction = spread(k).normalize();
                    if let Some((enter, leave)) = solid.interval(p, direction) {
                        nearest = nearest.min(enter.abs()).min(leave.abs());
                    }
                }
                let clearance = solid.clearance(p);
                assert!(clearance <= nearest * (1.0 + 1e-12), "{solid:?} {p}: {clearance} > {nearest}");
                assert!(clearance >= 0.0);
            }
        }
    }

    #[test]
    fn touching_and_parallel_lines_are_outside() {
        let slab = Solid::Slab { bottom: -1.0, top: 0.0 };
        assert_eq!(slab.interval(DVec3::ZERO, DVec3::X), None);
        assert_eq!(slab.interval(DVec3::new(0.0, 0.0, -0.5), DVec3::X), Some((f64::NEG_INFINITY, f64::INFINITY)));
        let sphere = Solid::Ellipsoid { center: DVec3::ZERO, radii: DVec3::ONE };
        assert_eq!(sphere.interval(DVec3::new(-5.0, 1.0, 0.0), DVec3::X), None);
    }
}
