//! Mirrors: where they are in a world.

use glam::DVec3;
use turbid_optics::solid::Solid;

use crate::bsdf::Bsdf;
use crate::lamp::Source;
use crate::world::{Body, World};

/// A plane in which there are mirrors, and a unit vector across it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    pub(crate) point: DVec3,
    pub(crate) normal: DVec3,
    /// Whether they reflect on the side of the normal only.
    pub(crate) one_sided: bool,
}

/// The mirrors of a world.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mirrors {
    /// Bodies with mirrors for walls: of them, or carved into them.
    pub bodies: Vec<usize>,
    /// Whether light may go from mirror to mirror.
    pub face: bool,
    /// Whether one of them is not flat, or a mesh.
    pub curved: bool,
    /// Whether no specular chain has more turns than one, by a mirror: it is convex, and alone in turning light.
    pub once: bool,
    /// Their planes, where all of them are flat.
    pub(crate) planes: Vec<Plane>,
    /// For each two of them, row by row, whether light may go from mirror to mirror.
    pub(crate) seen: Vec<bool>,
}

/// A plane, and corners of all mirrors in it; `None` where they have no bounds.
struct Face {
    pub(crate) plane: Plane,
    pub(crate) corners: Option<Vec<DVec3>>,
}

impl Face {
    /// Whether some of another lies where this reflects.
    fn is_before(&self, other: &Self) -> bool {
        let above = |p: &DVec3| self.plane.side(*p) > ON_PLANE * (1.0 + p.abs().max_element());
        !self.plane.one_sided || other.corners.as_ref().is_none_or(|corners| corners.iter().any(above))
    }
}

/// What a place may lie off its plane, relative to the coordinates: rounding.
const ON_PLANE: f64 = 1e-9;

impl Plane {
    pub(crate) fn image(&self, p: DVec3) -> DVec3 {
        p - 2.0 * (p - self.point).dot(self.normal) * self.normal
    }

    pub(crate) fn turn(&self, w: DVec3) -> DVec3 {
        w - 2.0 * w.dot(self.normal) * self.normal
    }

    pub(crate) fn side(&self, p: DVec3) -> f64 {
        (p - self.point).dot(self.normal)
    }

    /// Whether light may come from a mirror in it to a point.
    pub(crate) fn faces(&self, p: DVec3) -> bool {
        !self.one_sided || self.side(p) > 0.0
    }

    /// Whether light of a source may fall on a mirror in it.
    pub(crate) fn faces_source(&self, source: Source<'_>) -> bool {
        match source.origin() {
            (origin, None) => self.faces(origin),
            (_, Some(along)) => !self.one_sided || along.dot(self.normal) < 0.0,
        }
    }

    pub(crate) fn holds(&self, p: DVec3) -> bool {
        self.side(p).abs() <= ON_PLANE * (1.0 + p.abs().max_element())
    }
}

impl Mirrors {
    pub fn of(world: &World) -> Self {
        let is_mirror = |body: &Body| world.materials[body.material].bsdf == Bsdf::Mirror;
        let (mut mirrors, mut found) = (Self::default(), Vec::new());
        for (i, body) in world.bodies.iter().enumerate() {
            // What is carved into a mirror has mirrors for walls.
            let carves = || world.bodies[i + 1..].iter().any(|below| is_mirror(below) && meet(body, below));
            if !is_mirror(body) && !carves() {
                continue;
            }
            mirrors.face |= !mirrors.bodies.is_empty() || !is_mirror(body) || !body.solid.is_convex();
            mirrors.bodies.push(i);
            mirrors.curved |= faces(&body.solid, is_mirror(body), &mut found).is_none();
        }
        if mirrors.curved {
            found.clear();
        }
        let pairs = found.iter().flat_map(|a| found.iter().map(move |b| (a, b)));
        mirrors.seen = pairs.map(|(a, b)| a.is_before(b) && b.is_before(a)).collect();
        mirrors.planes = found.iter().map(|face| face.plane).collect();
        let one_index = world.bodies.iter().all(|body| world.materials[body.material].n == 1.0);
        mirrors.once = !mirrors.is_empty() && !mirrors.face && one_index;
        mirrors
    }

    pub fn is_empty(&self) -> bool {
        self.bodies.is_empty()
    }
}

pub fn has_mirrors(world: &World) -> bool {
    world.bodies.iter().any(|body| world.materials[body.material].bsdf == Bsdf::Mirror)
}

/// Whether the bodies' bounding boxes touch.
fn meet(a: &Body, b: &Body) -> bool {
    let ((a_low, a_high), (b_low, b_high)) = (a.solid.bounds(), b.solid.bounds());
    a_low.cmple(b_high).all() && b_low.cmple(a_high).all()
}

/// Adds the planes of a solid's faces, normals outwards; `None` where one is curved.
fn faces(solid: &Solid, one_sided: bool, faces_so_far: &mut Vec<Face>) -> Option<()> {
    let mut add = |point: DVec3, normal: DVec3, corners: Option<Vec<DVec3>>| {
        if !point.is_finite() {
            return;
        }
        let plane = Plane { point, normal, one_sided };
        let known =
            |f: &&mut Face| f.plane.normal == normal && f.plane.one_sided == one_sided && f.plane.side(point) == 0.0;
        match faces_so_far.iter_mut().find(known) {
            None => faces_so_far.push(Face { plane, corners }),
            Some(face) => {
                face.corners = face.corners.take().zip(corners).map(|(mut all, more)| {
                    all.extend(more);
                    all
                });
            }
        }
    };
    match solid {
        Solid::Slab { bottom, top } => {
            add(*top * DVec3::Z, DVec3::Z, None);
            add(*bottom * DVec3::Z, DVec3::NEG_Z, None);
        }
        Solid::Box { low, high } => {
            for axis in DVec3::AXES {
                for (end, normal) in [(low, -axis), (high, axis)] {
                    let at = |i: usize| {
                        let [x, y, z] = [0, 1, 2].map(|k| if i >> k & 1 == 0 { low[k] } else { high[k] });
                        let corner = DVec3::new(x, y, z);
                        corner + (end.dot(axis) - corner.dot(axis)) * axis
                    };
                    add(end.dot(axis) * axis, normal, Some((0..8).map(at).collect()));
                }
            }
        }
        Solid::Turned(turned) => {
            let mut own = Vec::new();
            faces(&turned.solid, one_sided, &mut own)?;
            let frame = &turned.frame;
            for Face { plane, corners } in own {
                let corners = corners.map(|c| c.into_iter().map(|p| frame.point_out(p)).collect());
                add(frame.point_out(plane.point), frame.direction_out(plane.normal), corners);
            }
        }
        Solid::Ellipsoid { .. } | Solid::Cylinder { .. } | Solid::Carved(_) | Solid::Mesh(_) => return None,
    }
    Some(())
}
