//! Mirrors: where they are, and the light that flat ones throw, from the mirror images of its sources. What curved ones throw is looked for as what walls
//! refract (`caustic.rs`).

use glam::DVec3;
use turbid_optics::solid::Solid;

use crate::channels::{Lengths, NO_LENGTHS, count, sum};
use crate::finish::Finish;
use crate::lamp::Source;
use crate::link::{Chance, Link};
use crate::path::{Setting, Walker};
use crate::strata::Bending;
use crate::world::{Body, Skin, Wall, World};

/// A plane in which there are mirrors, and a unit vector across it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    point: DVec3,
    normal: DVec3,
    /// Whether they reflect on the side of the normal only.
    one_sided: bool,
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
    /// Whether no way of light has more turns than one, by a mirror: it is convex, and alone in turning light.
    pub once: bool,
    /// Their planes, where all of them are flat.
    planes: Vec<Plane>,
    /// For each two of them, row by row, whether light may go from mirror to mirror.
    seen: Vec<bool>,
}

/// A plane, and corners of all mirrors in it; `None` where they have no bounds.
struct Face {
    plane: Plane,
    corners: Option<Vec<DVec3>>,
}

impl Face {
    /// Whether some of another lies where this reflects.
    fn is_before(&self, other: &Self) -> bool {
        let above = |p: &DVec3| self.plane.side(*p) > ON_PLANE * (1.0 + p.abs().max_element());
        !self.plane.one_sided || other.corners.as_ref().is_none_or(|corners| corners.iter().any(above))
    }
}

/// A mirror at the end of a ray.
struct Seen {
    wall: Wall,
    /// Optical depth before it, and mm in each medium that tells channels apart.
    tau: f64,
    lengths: Lengths,
    /// Normal, along the ray, of the first boundary on it.
    exit: DVec3,
}

/// What a place may lie off its plane, relative to the coordinates: rounding.
const ON_PLANE: f64 = 1e-9;

impl Plane {
    fn image(&self, p: DVec3) -> DVec3 {
        p - 2.0 * (p - self.point).dot(self.normal) * self.normal
    }

    fn turn(&self, w: DVec3) -> DVec3 {
        w - 2.0 * w.dot(self.normal) * self.normal
    }

    fn side(&self, p: DVec3) -> f64 {
        (p - self.point).dot(self.normal)
    }

    /// Whether light may come from a mirror in it to a point.
    fn faces(&self, p: DVec3) -> bool {
        !self.one_sided || self.side(p) > 0.0
    }

    /// Whether light of a source may fall on a mirror in it.
    fn faces_source(&self, source: Source<'_>) -> bool {
        match source.origin() {
            (origin, None) => self.faces(origin),
            (_, Some(along)) => !self.one_sided || along.dot(self.normal) < 0.0,
        }
    }

    fn holds(&self, p: DVec3) -> bool {
        self.side(p).abs() <= ON_PLANE * (1.0 + p.abs().max_element())
    }
}

impl Mirrors {
    pub fn of(world: &World) -> Self {
        let is_mirror = |body: &Body| world.materials[body.material].finish == Finish::Mirror;
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
    world.bodies.iter().any(|body| world.materials[body.material].finish == Finish::Mirror)
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

impl Walker<'_> {
    /// Adds the lit ways from a source to r by mirrors: each by one of them, and, where mirrors face each other, one by several, by chance.
    #[inline]
    pub(crate) fn by_mirrors(
        &mut self,
        source: Source<'_>,
        r: DVec3,
        skin: Option<Skin>,
        chance: &Chance<'_>,
        links: &mut Vec<Link>,
    ) {
        if self.mirrors.planes.is_empty() {
            return;
        }
        self.by_one_mirror(source, r, skin, links);
        if !self.mirrors.face || chance.whether(source)[0] < 0.5 {
            return;
        }
        let mut dice = chance.which(source);
        // Two of them with probability 1/2, three with 1/4, ...
        let mut length = 2;
        while dice.throw()[0] < 0.5 {
            length += 1;
        }
        let mut probability = 0.5 * libm::ldexp(1.0, 1 - length as i32);
        let mut planes: Vec<usize> = Vec::with_capacity(length);
        for i in 0..length {
            let fits = |&k: &usize| {
                let plane = &self.mirrors.planes[k];
                planes.last().is_none_or(|&last| last != k && self.mirrors.seen[last * self.mirrors.planes.len() + k])
                    && (i > 0 || plane.faces(r))
                    && (i + 1 < length || plane.faces_source(source))
            };
            let all = 0..self.mirrors.planes.len();
            let count = all.clone().filter(fits).count();
            let chosen = (dice.throw()[0] * count as f64) as usize;
            let Some(next) = all.filter(fits).nth(chosen.min(count.saturating_sub(1))) else { return };
            planes.push(next);
            probability /= count as f64;
        }
        if let Some(link) = self.by_planes(source, r, skin, &planes) {
            links.push(Link { irradiance: link.irradiance / probability, ..link });
        }
    }

    /// Adds the ways by one mirror.
    pub(crate) fn by_one_mirror(&mut self, source: Source<'_>, r: DVec3, skin: Option<Skin>, links: &mut Vec<Link>) {
        for k in 0..self.mirrors.planes.len() {
            let plane = &self.mirrors.planes[k];
            if plane.faces(r) && plane.faces_source(source) {
                links.extend(self.by_planes(source, r, skin, &[k]));
            }
        }
    }

    /// The way from r over these planes, one after the other, to the source, if there are mirrors, and it is open and lit.
    fn by_planes(&mut self, source: Source<'_>, r: DVec3, skin: Option<Skin>, planes: &[usize]) -> Option<Link> {
        let plane = |mirrors: &Mirrors, k: usize| mirrors.planes[planes[k]];
        let (origin, along) = source.origin();
        // Unfolded: the image of the source in the last plane, then in those before it.
        let back = (0..planes.len()).rev();
        let (mut w, whole) = match along {
            None => {
                let image = back.fold(origin, |p, k| plane(&self.mirrors, k).image(p));
                ((image - r).normalize(), (image - r).length())
            }
            Some(along) => (back.fold(-along, |w, k| plane(&self.mirrors, k).turn(w)), f64::NAN),
        };
        let towards = w;
        let (mut p, mut skin, mut exit) = (r, skin, None);
        let (mut tau, mut lengths) = (0.0, NO_LENGTHS);
        for k in 0..planes.len() {
            let plane = plane(&self.mirrors, k);
            // It must come to the plane, on the side on which the light goes on.
            let distance = -plane.side(p) / w.dot(plane.normal);
            if !(distance > 0.0 && distance < f64::INFINITY) {
                return None;
            }
            let seen = self.mirror_at(p, w, skin, distance)?;
            tau += seen.tau;
            lengths = sum(&lengths, &seen.lengths);
            exit = exit.or(Some(seen.exit));
            p += distance * w;
            let inside = self.setting.world.normal(seen.wall, p).dot(w) > 0.0;
            skin = Some(Skin { wall: seen.wall, inside });
            w = plane.turn(w);
        }
        let arrival = source.arrival(p)?;
        let sight = self.sight(p, arrival.towards, arrival.distance, skin);
        if sight.blocked || arrival.towards.dot(w) < 0.0 {
            return None;
        }
        let spread = if along.is_none() { arrival.distance / whole } else { 1.0 };
        Some(Link {
            towards,
            irradiance: arrival.irradiance * spread * spread,
            tau: tau + sight.tau,
            exit,
            on_plane: arrival.on_plane,
            lit: true,
            lengths: sum(&lengths, &sight.lengths),
        })
    }

    /// The mirror at `distance` on a ray; `None` where there is none, or something is before it.
    fn mirror_at(&mut self, r: DVec3, w: DVec3, skin: Option<Skin>, distance: f64) -> Option<Seen> {
        let Setting { world, shared, .. } = self.setting;
        let (mut before, mut exit, mut n) = (None, None, None);
        let (mut tau, mut lengths) = (0.0, NO_LENGTHS);
        for piece in world.trace(r, w, skin, &mut self.spans) {
            let material = &world.materials[piece.material];
            if material.is_opaque() {
                let mirror = material.finish == Finish::Mirror;
                let p = r + piece.start * w;
                let plane = Plane { point: r + distance * w, normal: w, one_sided: false };
                let seen = |wall| Seen { wall, tau, lengths, exit: exit.unwrap_or(w) };
                return before.filter(|_| mirror && plane.holds(p)).map(seen);
            }
            if self.bending == Bending::AtRough && *n.get_or_insert(material.n) != material.n {
                return None;
            }
            let wall = piece.wall?;
            if exit.is_none() {
                let normal = world.normal(wall, r + piece.end * w);
                exit = Some(if normal.dot(w) < 0.0 { -normal } else { normal });
            }
            if piece.material != 0 {
                let length = piece.end - piece.start;
                tau += material.mu_t() * length;
                count(shared, &mut lengths, piece.material, length);
            }
            before = Some(wall);
        }
        None
    }
}
