//! The light that flat mirrors throw, from the mirror images of its sources. What curved ones throw is looked for as what walls
//! refract (`caustic.rs`).

use glam::DVec3;

use crate::finish::Finish;
use crate::lamp::Source;
use crate::lengths::{Lengths, NO_LENGTHS, count, sum};
use crate::link::Chance;
use crate::mirrors::{Mirrors, Plane};
use crate::setting::Setting;
use crate::strata::Bending;
use crate::walker::Walker;
use crate::way::Link;
use crate::world::{Skin, Wall};

/// A mirror at the end of a ray.
struct Seen {
    wall: Wall,
    /// Optical depth before it, and mm in each medium that tells channels apart.
    tau: f64,
    lengths: Lengths,
    /// Normal, along the ray, of the first boundary on it.
    exit: DVec3,
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
