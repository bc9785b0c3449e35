//! Solids and how a line passes through them.

use std::sync::Arc;

use glam::{DVec2, DVec3};

pub mod bvh;
mod carved;
mod coordinates;
mod crossing;
mod curvature;
pub mod facets;
mod frame;
mod memo;
pub mod mesh;
mod normals;
mod patch;
mod rounded;
mod shapes;

pub use carved::Carved;
pub use crossing::{Ends, Far};
pub use frame::Frame;
pub use mesh::Mesh;
pub use patch::Patch;

/// A solid in world coordinates, mm.
#[derive(Clone, Debug, PartialEq)]
pub enum Solid {
    /// bottom <= z <= top, infinite sideways.
    Slab { bottom: f64, top: f64 },
    /// Axis-aligned, between two opposite corners, which may be infinite.
    Box { low: DVec3, high: DVec3 },
    /// Axis-aligned ellipsoid with semi-axes `radii`.
    Ellipsoid { center: DVec3, radii: DVec3 },
    /// Upright, round, about the line x, y = `axis`; its ends may be infinite.
    Cylinder { axis: DVec2, radius: f64, bottom: f64, top: f64 },
    /// A solid in a frame of its own.
    Turned(Arc<Turned>),
    /// A convex solid with holes.
    Carved(Arc<Carved>),
    /// What a closed surface of triangles encloses.
    Mesh(Arc<Mesh>),
}

/// A solid, and the frame that its coordinates are meant in.
#[derive(Clone, Debug, PartialEq)]
pub struct Turned {
    pub frame: Frame,
    pub solid: Solid,
}

/// Where a ray starts on a surface: then no rounding of the point can put it on the wrong side.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Start {
    pub face: u32,
    pub inside: bool,
}

/// Part of a line within a solid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stay {
    /// Infinite where the solid is, or where the line starts inside.
    pub enter: f64,
    pub leave: f64,
    /// The face at `enter` ...
    pub into: u32,
    /// ... and that at `leave`.
    pub out_of: u32,
}

impl Solid {
    /// The solid in a frame of its own.
    pub fn turned(self, frame: Frame) -> Self {
        Self::Turned(Arc::new(Turned { frame, solid: self }))
    }

    /// The convex solid less convex holes.
    pub fn carved(self, holes: Vec<Self>) -> Self {
        Self::Carved(Arc::new(Carved { whole: self, holes }))
    }

    /// Whether a line stays in it at most once.
    pub fn is_convex(&self) -> bool {
        match self {
            Self::Turned(turned) => turned.solid.is_convex(),
            Self::Carved(_) | Self::Mesh(_) => false,
            _ => true,
        }
    }

    /// Appends to `stays` where the line origin + t direction is in the solid, in ascending order; what ends at t <= 0 may be
    /// missing. With `start`, the ray t > 0 starts on that face, on that side. A line that only touches is outside.
    #[inline]
    pub fn cut(&self, origin: DVec3, direction: DVec3, start: Option<Start>, stays: &mut Vec<Stay>) {
        match self {
            Self::Turned(turned) => {
                let frame = &turned.frame;
                turned.solid.cut(frame.point_into(origin), frame.direction_into(direction), start, stays);
            }
            Self::Carved(carved) => carved.cut(origin, direction, start, stays),
            Self::Mesh(mesh) => mesh.cut(origin, direction, start, stays),
            _ => {
                if let Some((enter, leave)) = self.interval_from(start.map(|s| s.inside), origin, direction) {
                    stays.push(Stay { enter, leave, into: 0, out_of: 0 });
                }
            }
        }
    }

    /// Of a convex solid: where the line is inside. `start` says on which side the ray t > 0 starts, if it starts on the surface.
    #[inline]
    fn interval_from(&self, start: Option<bool>, origin: DVec3, direction: DVec3) -> Option<(f64, f64)> {
        match start {
            // From the outside of a convex surface nothing leads back into it.
            Some(false) => None,
            Some(true) => self.interval(origin, direction).map(|(_, leave)| (f64::NEG_INFINITY, leave)),
            None => self.interval(origin, direction),
        }
    }

    /// The part of the line origin + t direction inside the convex solid, as (t of entry, t of exit), entry < exit; the ends
    /// are infinite where the solid is. A line that only touches is outside.
    #[inline]
    pub fn interval(&self, origin: DVec3, direction: DVec3) -> Option<(f64, f64)> {
        let (enter, leave) = self.span(origin, direction);
        (enter < leave).then_some((enter, leave))
    }

    /// The same without a branch: entry >= exit where the line misses the solid.
    ///
    /// # Panics
    /// For solids that are not convex.
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
            Self::Cylinder { axis, radius, bottom, top } => {
                let (o, d) = ((origin.truncate() - axis) / radius, direction.truncate() / radius);
                let d2 = d.length_squared();
                // Along the axis 0 / 0: then the caps alone are met, or nothing is.
                let nearest = -o.dot(d) / d2;
                let inside = 1.0 - (o + nearest * d).length_squared();
                let half = (inside.max(0.0) / d2).sqrt();
                let (enter, leave) = between(origin.z, direction.z, bottom, top);
                let within = if o.length_squared() < 1.0 { f64::INFINITY } else { f64::NEG_INFINITY };
                let side = if d2 > 0.0 { (nearest - half, nearest + half) } else { (-within, within) };
                (side.0.max(enter), side.1.min(leave))
            }
            Self::Turned(ref turned) => {
                let frame = &turned.frame;
                turned.solid.span(frame.point_into(origin), frame.direction_into(direction))
            }
            Self::Carved(_) | Self::Mesh(_) => panic!("a line may stay several times in a solid that is not convex"),
        }
    }

    /// Whether the point lies in the solid or on its surface.
    pub fn contains(&self, p: DVec3) -> bool {
        match *self {
            Self::Slab { bottom, top } => bottom <= p.z && p.z <= top,
            Self::Box { low, high } => p.cmpge(low).all() && p.cmple(high).all(),
            Self::Ellipsoid { center, radii } => ((p - center) / radii).length_squared() <= 1.0,
            Self::Cylinder { axis, radius, bottom, top } => {
                bottom <= p.z && p.z <= top && (p.truncate() - axis).length_squared() <= radius * radius
            }
            Self::Turned(ref turned) => turned.solid.contains(turned.frame.point_into(p)),
            Self::Carved(ref carved) => carved.contains(p),
            Self::Mesh(ref mesh) => mesh.contains(p),
        }
    }

    /// The distance (mm, >= 0) at which the ray from `p` along `w` meets the surface first, infinite where it does not; for solids
    /// that are not convex less than that.
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
            Self::Turned(ref turned) => turned.solid.reach(turned.frame.point_into(p), turned.frame.direction_into(w)),
            Self::Carved(_) | Self::Mesh(_) => self.clearance(p),
            _ => {
                let (enter, leave) = self.span(p, w);
                let t = if enter >= 0.0 { enter } else { leave };
                if (enter < leave) & (t >= 0.0) { t } else { f64::INFINITY }
            }
        }
    }

    /// A distance (mm, >= 0) within which of `p` there is no point of the surface. Exact for slabs, boxes, spheres and cylinders;
    /// for other ellipsoids at least the shortest semi-axis over the longest times the true one.
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
            Self::Cylinder { axis, radius, bottom, top } => {
                // > 0 outside, of the side and of the caps.
                let side = (p.truncate() - axis).length() - radius;
                let caps = (bottom - p.z).max(p.z - top);
                if side.max(caps) <= 0.0 { -side.max(caps) } else { DVec2::new(side, caps).max(DVec2::ZERO).length() }
            }
            // Less what the turn rounds.
            Self::Turned(ref turned) => {
                let clear = turned.solid.clearance(turned.frame.point_into(p));
                (clear - 1e-14 * p.abs().max_element()).max(0.0)
            }
            Self::Carved(ref carved) => carved.clearance(p),
            Self::Mesh(ref mesh) => mesh.clearance(p),
        }
    }

    /// Outward unit normal at a point of a face.
    pub fn normal(&self, face: u32, p: DVec3) -> DVec3 {
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
            Self::Cylinder { axis, radius, bottom, top } => {
                let out = p.truncate() - axis;
                let side = (out.length() - radius).abs();
                let (below, above) = ((p.z - bottom).abs(), (p.z - top).abs());
                if side <= below.min(above) {
                    out.normalize().extend(0.0)
                } else if above <= below {
                    DVec3::Z
                } else {
                    DVec3::NEG_Z
                }
            }
            Self::Turned(ref turned) => {
                let frame = &turned.frame;
                frame.direction_out(turned.solid.normal(face, frame.point_into(p)))
            }
            Self::Carved(ref carved) => carved.normal(face, p),
            Self::Mesh(ref mesh) => mesh.normal(face),
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
            Self::Cylinder { axis, radius, bottom, top } => {
                ((axis - radius).extend(bottom), (axis + radius).extend(top))
            }
            Self::Turned(ref turned) => {
                let (low, high) = turned.solid.bounds();
                turned.frame.bounds_out(low, high)
            }
            Self::Carved(ref carved) => carved.whole.bounds(),
            Self::Mesh(ref mesh) => mesh.bounds(),
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

    /// Convex ones.
    fn solids() -> Vec<Solid> {
        let axis = DVec2::new(0.3, -0.4);
        let frame = Frame::turned(DVec3::new(0.5, -0.3, 0.2), [25.0, -40.0, 70.0]);
        vec![
            Solid::Slab { bottom: -3.0, top: 0.5 },
            Solid::Box { low: DVec3::new(-1.0, -2.0, -3.0), high: DVec3::new(2.0, 0.5, 1.0) },
            Solid::Ellipsoid { center: DVec3::new(0.3, -0.2, 0.1), radii: DVec3::splat(1.7) },
            Solid::Ellipsoid { center: DVec3::new(0.3, -0.2, 0.1), radii: DVec3::new(0.4, 1.7, 3.0) },
            Solid::Cylinder { axis, radius: 1.5, bottom: -2.0, top: 1.0 },
            Solid::Cylinder { axis, radius: 1.5, bottom: -f64::INFINITY, top: 1.0 },
            Solid::Box { low: DVec3::new(-1.0, -0.5, -2.0), high: DVec3::new(1.0, 1.5, 1.0) }.turned(frame),
            Solid::Ellipsoid { center: DVec3::ZERO, radii: DVec3::new(0.5, 1.7, 2.5) }.turned(frame),
            Solid::Cylinder { axis, radius: 0.8, bottom: -2.0, top: 1.0 }
                .turned(Frame::along(DVec3::ZERO, DVec3::new(0.6, 0.0, -0.8))),
        ]
    }

    /// A tube, a hollow sphere with a round and a square port, a block with a groove.
    fn hollows() -> Vec<Solid> {
        let cylinder = |radius: f64, half: f64| Solid::Cylinder { axis: DVec2::ZERO, radius, bottom: -half, top: half };
        let ball = |radius| Solid::Ellipsoid { center: DVec3::ZERO, radii: DVec3::splat(radius) };
        let far = f64::INFINITY;
        let round = Solid::Cylinder { axis: DVec2::ZERO, radius: 0.6, bottom: 0.0, top: far };
        let square = Solid::Box { low: DVec3::new(-0.5, -0.5, 0.0), high: DVec3::new(0.5, 0.5, far) };
        let towards = |w: DVec3| Frame::along(DVec3::ZERO, w.normalize());
        let block = Solid::Box { low: DVec3::splat(-2.0), high: DVec3::splat(2.0) };
        let groove = Solid::Box { low: DVec3::new(-0.75, -9.0, 0.0), high: DVec3::new(0.75, 9.0, 9.0) };
        vec![
            cylinder(2.0, 1.5).carved(vec![cylinder(1.2, far)]),
            ball(2.5).carved(vec![
                ball(2.0),
                round.turned(towards(DVec3::new(1.0, 2.0, -2.0))),
                square.turned(towards(DVec3::X)),
            ]),
            block.carved(vec![groove]),
        ]
    }

    fn cut(solid: &Solid, origin: DVec3, direction: DVec3, start: Option<Start>) -> Vec<Stay> {
        let mut stays = Vec::new();
        solid.cut(origin, direction, start, &mut stays);
        stays
    }

    /// The i-th number of the Halton sequence in [0, 1).
    fn halton(i: usize, base: usize) -> f64 {
        let (mut n, mut f, mut r) = (i + 1, 1.0, 0.0);
        while n > 0 {
            f /= base as f64;
            r += f * (n % base) as f64;
            n /= base;
        }
        r
    }

    /// A Halton point in (-4, 4)^3: evenly spread, no generator needed.
    fn spread(i: usize) -> DVec3 {
        DVec3::new(halton(i, 2), halton(i, 3), halton(i, 5)) * 8.0 - 4.0
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
                    let outward = solid.normal(0, at(end)).dot(direction) * (if end == leave { 1.0 } else { -1.0 });
                    assert!(outward > 0.0, "{solid:?}: normal {}", solid.normal(0, at(end)));
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

    /// Along a line, a solid with holes is where `contains` says, its ends lie on the face that they name, and a ray that starts
    /// there, off by rounding either way, sees the rest of the same line. |p| < 30, so 1e-12 is some 100 roundings.
    #[test]
    fn hollow_solids_are_cut_where_they_are() {
        for solid in hollows() {
            let mut several = 0;
            for i in 0..1000 {
                let direction = DVec3::new(halton(i, 7) - 0.5, halton(i, 11) - 0.5, halton(i, 13) - 0.5).normalize();
                let origin = 0.7 * spread(i) - 8.0 * direction;
                let stays = cut(&solid, origin, direction, None);
                let at = |t: f64| origin + t * direction;
                several += usize::from(stays.len() > 1);
                for k in 0..400 {
                    let t = 0.07 * f64::from(k) - 14.0;
                    let inside = stays.iter().any(|s| s.enter <= t && t <= s.leave);
                    assert_eq!(solid.contains(at(t)), inside, "{solid:?} {origin} {direction} {t}");
                }
                for (n, stay) in stays.iter().enumerate() {
                    assert!(stay.enter < stay.leave && (n == 0 || stays[n - 1].leave < stay.enter));
                    for (t, face, into) in [(stay.enter, stay.into, true), (stay.leave, stay.out_of, false)] {
                        assert!(solid.clearance(at(t)) <= 1e-12, "{solid:?}: {} off", solid.clearance(at(t)));
                        let along = solid.normal(face, at(t)).dot(direction);
                        assert!(if into { along < 0.0 } else { along > 0.0 }, "{solid:?}: {along}");
                        for off in [-1e-13, 0.0, 1e-13] {
                            let rest = cut(&solid, at(t + off), direction, Some(Start { face, inside: into }));
                            let ahead: Vec<_> = rest.iter().filter(|s| s.leave > 0.0).collect();
                            let expected = &stays[if into { n } else { n + 1 }..];
                            assert_eq!(ahead.len(), expected.len(), "{solid:?} {origin} {direction}");
                            for (a, b) in ahead.iter().zip(expected) {
                                assert!((a.leave - (b.leave - t)).abs() < 1e-11);
                            }
                        }
                    }
                }
            }
            assert!(several > 50, "{several} lines enter twice");
        }
    }

    /// The part of a box that lines spend in a solid is its part of the volume: 3 x 96^2 lines through the middles of a lattice,
    /// against pi (R^2 - r^2) L, and the block less its groove, whose
    /// edges lie on the lattice. On the round outline the midpoint rule errs by less than a cell over the diameter: 1 %.
    #[test]
    fn stays_add_up_to_the_volume() {
        use std::f64::consts::PI;
        let n = 96;
        for (solid, volume) in hollows().iter().zip([PI * (4.0 - 1.44) * 3.0, f64::NAN, 64.0 - 12.0]) {
            for axis in 0..3 {
                let mut sum = 0.0;
                for i in 0..n * n {
                    let at = |i: usize| 6.0 * (i as f64 + 0.5) / n as f64 - 3.0;
                    let (mut origin, mut direction) = (DVec3::splat(-9.0), DVec3::ZERO);
                    (origin[(axis + 1) % 3], origin[(axis + 2) % 3]) = (at(i % n), at(i / n));
                    direction[axis] = 1.0;
                    sum += cut(solid, origin, direction, None).iter().map(|s| s.leave - s.enter).sum::<f64>();
                }
                let found = sum * (6.0 / n as f64).powi(2);
                assert!(volume.is_nan() || (found / volume - 1.0).abs() < 0.01, "{solid:?}: {found}, {volume}");
            }
        }
    }

    /// From everywhere, the surface is nowhere nearer than the clearance, and from most places it is not much farther.
    #[test]
    fn clearance_of_hollow_solids_is_a_lower_bound() {
        for solid in hollows() {
            let (mut tight, n) = (0, 60);
            for i in 0..n {
                let p = 0.9 * spread(i);
                let mut nearest = f64::INFINITY;
                for k in 0..4000 {
                    for s in cut(&solid, p, spread(k).normalize(), None) {
                        nearest = nearest.min(s.enter.abs()).min(s.leave.abs());
                    }
                }
                let clearance = solid.clearance(p);
                assert!((0.0..=nearest * (1.0 + 1e-12)).contains(&clearance), "{solid:?} {p}: {clearance} > {nearest}");
                tight += usize::from(clearance > 0.9 * nearest - 0.02);
            }
            assert!(3 * tight > 2 * n, "{solid:?}: {tight} of {n}");
        }
    }

    /// The mean chord of a convex body is 4 V / S for lines of an isotropic, uniform field (Cauchy): 80,000 lines of a Halton
    /// sequence, of which 0.5 % is what independent ones would leave (1.5 sigma; a sequence leaves less).
    #[test]
    fn the_mean_chord_of_a_cylinder_is_four_v_over_s() {
        use std::f64::consts::PI;
        let solid = Solid::Cylinder { axis: DVec2::ZERO, radius: 1.0, bottom: -1.5, top: 1.5 };
        let (mut sum, mut hits) = (0.0, 0);
        for i in 0..80_000 {
            let (cos, phi) = (2.0 * halton(i, 2) - 1.0, 2.0 * PI * halton(i, 3));
            let sin = (1.0 - cos * cos).sqrt();
            let w = DVec3::new(sin * phi.cos(), sin * phi.sin(), cos);
            // A point in the square of 4 mm across it.
            let (u, v) = w.any_orthonormal_pair();
            let origin = (4.0 * halton(i, 5) - 2.0) * u + (4.0 * halton(i, 7) - 2.0) * v;
            if let Some((enter, leave)) = solid.interval(origin, w) {
                sum += leave - enter;
                hits += 1;
            }
        }
        let (volume, area) = (PI * 3.0, 2.0 * PI * 3.0 + 2.0 * PI);
        let mean = sum / f64::from(hits);
        assert!((mean / (4.0 * volume / area) - 1.0).abs() < 0.01, "{mean}, {}", 4.0 * volume / area);
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
