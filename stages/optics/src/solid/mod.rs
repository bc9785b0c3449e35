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
mod patch;
mod reflection;
mod rounded;
mod shapes;
mod specular_tree;

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
pub struct Chord {
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

    /// Whether a line is in it at most once.
    pub fn is_convex(&self) -> bool {
        match self {
            Self::Turned(turned) => turned.solid.is_convex(),
            Self::Carved(_) | Self::Mesh(_) => false,
            _ => true,
        }
    }

    /// Appends to `chords` where the line origin + t direction is in the solid, in ascending order; what ends at t <= 0 may be
    /// missing. With `start`, the ray t > 0 starts on that face, on that side. A line that only touches is outside.
    #[inline]
    pub fn cut(&self, origin: DVec3, direction: DVec3, start: Option<Start>, chords: &mut Vec<Chord>) {
        match self {
            Self::Turned(turned) => {
                let frame = &turned.frame;
                turned.solid.cut(frame.point_into(origin), frame.direction_into(direction), start, chords);
            }
            Self::Carved(carved) => carved.cut(origin, direction, start, chords),
            Self::Mesh(mesh) => mesh.cut(origin, direction, start, chords),
            _ => {
                if let Some((enter, leave)) = self.interval_from(start.map(|s| s.inside), origin, direction) {
                    chords.push(Chord { enter, leave, into: 0, out_of: 0 });
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
        let (enter, leave) = self.chord(origin, direction);
        (enter < leave).then_some((enter, leave))
    }

    /// The same without a branch: entry >= exit where the line misses the solid.
    ///
    /// # Panics
    /// For solids that are not convex.
    #[inline(always)]
    pub fn chord(&self, origin: DVec3, direction: DVec3) -> (f64, f64) {
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
                turned.solid.chord(frame.point_into(origin), frame.direction_into(direction))
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
                let (enter, leave) = self.chord(p, w);
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

    /// How far (mm, >= 0) a line from `r` along `w` goes in the solid, and the unit normal outwards where it leaves it; `None` where `inside`, a point near r, is not in
    /// the solid. Where that is not convex, of a line from there.
    pub fn way_out(&self, (r, inside): (DVec3, DVec3), w: DVec3, chords: &mut Vec<Chord>) -> Option<(f64, DVec3)> {
        if self.is_convex() {
            let distance = self.contains(inside).then(|| self.chord(r, w).1.max(0.0))?;
            let normal = self.normal(0, r + distance * w);
            // Where r is on an edge that may be the other face's.
            return Some((distance, if normal.dot(w) < 0.0 { -normal } else { normal }));
        }
        chords.clear();
        self.cut(inside, w, None, chords);
        let own = chords.iter().find(|chord| chord.enter <= 0.0 && chord.leave > 0.0)?;
        Some((own.leave, self.normal(own.out_of, inside + own.leave * w)))
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
mod tests;
