//! The light that flat mirrors throw, from the mirror images of its sources. What curved ones throw is found as what interfaces
//! refract (`caustic.rs`).

use glam::DVec3;

use crate::bsdf::Bsdf;
use crate::connect::Draws;
use crate::connection::Connection;
use crate::lamp::Source;
use crate::lengths::{Lengths, NO_LENGTHS, count, sum};
use crate::mirrors::{Mirrors, Plane};
use crate::setting::Setting;
use crate::strata::Bending;
use crate::walker::Walker;
use crate::world::{Interface, SurfacePoint};

/// A mirror at the end of a ray.
struct Seen {
    interface: Interface,
    /// Optical depth before it, and mm in each medium that tells channels apart.
    tau: f64,
    lengths: Lengths,
    /// Normal, along the ray, of the first boundary on it.
    exit: DVec3,
}

impl Walker<'_> {
    /// Adds the lit connections from r to a source by mirrors: each by one of them, and, where mirrors face each other, one by several, at random.
    #[inline]
    pub(crate) fn by_mirrors(
        &mut self,
        source: Source<'_>,
        r: DVec3,
        surface_point: Option<SurfacePoint>,
        draws: &Draws<'_>,
        connections: &mut Vec<Connection>,
    ) {
        if self.mirrors.planes.is_empty() {
            return;
        }
        self.by_one_mirror(source, r, surface_point, connections);
        if !self.mirrors.face || draws.whether(source)[0] < 0.5 {
            return;
        }
        let mut dice = draws.which(source);
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
        if let Some(connection) = self.by_planes(source, r, surface_point, &planes) {
            connections.push(Connection { irradiance: connection.irradiance / probability, ..connection });
        }
    }

    /// Adds the connections by one mirror.
    pub(crate) fn by_one_mirror(
        &mut self,
        source: Source<'_>,
        r: DVec3,
        surface_point: Option<SurfacePoint>,
        connections: &mut Vec<Connection>,
    ) {
        for k in 0..self.mirrors.planes.len() {
            let plane = &self.mirrors.planes[k];
            if plane.faces(r) && plane.faces_source(source) {
                connections.extend(self.by_planes(source, r, surface_point, &[k]));
            }
        }
    }

    /// The connection from r over these planes, one after the other, to the source, if there are mirrors, and it is open and lit.
    fn by_planes(
        &mut self,
        source: Source<'_>,
        r: DVec3,
        surface_point: Option<SurfacePoint>,
        planes: &[usize],
    ) -> Option<Connection> {
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
        let (mut p, mut surface_point, mut exit) = (r, surface_point, None);
        let (mut tau, mut lengths) = (0.0, NO_LENGTHS);
        for k in 0..planes.len() {
            let plane = plane(&self.mirrors, k);
            // It must come to the plane, on the side on which the light goes on.
            let distance = -plane.side(p) / w.dot(plane.normal);
            if !(distance > 0.0 && distance < f64::INFINITY) {
                return None;
            }
            let seen = self.mirror_at(p, w, surface_point, distance)?;
            tau += seen.tau;
            lengths = sum(&lengths, &seen.lengths);
            exit = exit.or(Some(seen.exit));
            p += distance * w;
            let inside = self.setting.world.normal(seen.interface, p).dot(w) > 0.0;
            surface_point = Some(SurfacePoint { interface: seen.interface, inside });
            w = plane.turn(w);
        }
        let arrival = source.arrival(p)?;
        let visibility = self.visibility(p, arrival.towards, arrival.distance, surface_point);
        if visibility.blocked || arrival.towards.dot(w) < 0.0 {
            return None;
        }
        let spread = if along.is_none() { arrival.distance / whole } else { 1.0 };
        Some(Connection {
            towards,
            irradiance: arrival.irradiance * spread * spread,
            tau: tau + visibility.tau,
            exit,
            on_plane: arrival.on_plane,
            lit: true,
            lengths: sum(&lengths, &visibility.lengths),
        })
    }

    /// The mirror at `distance` on a ray; `None` where there is none, or something is before it.
    fn mirror_at(&mut self, r: DVec3, w: DVec3, surface_point: Option<SurfacePoint>, distance: f64) -> Option<Seen> {
        let Setting { world, shared, .. } = self.setting;
        let (mut before, mut exit, mut n) = (None, None, None);
        let (mut tau, mut lengths) = (0.0, NO_LENGTHS);
        for segment in world.trace(r, w, surface_point, &mut self.chords) {
            let material = &world.materials[segment.material];
            if material.is_opaque() {
                let mirror = material.bsdf == Bsdf::Mirror;
                let p = r + segment.start * w;
                let plane = Plane { point: r + distance * w, normal: w, one_sided: false };
                let seen = |interface| Seen { interface, tau, lengths, exit: exit.unwrap_or(w) };
                return before.filter(|_| mirror && plane.holds(p)).map(seen);
            }
            if self.bending == Bending::AtRough && *n.get_or_insert(material.n) != material.n {
                return None;
            }
            let interface = segment.interface?;
            if exit.is_none() {
                let normal = world.normal(interface, r + segment.end * w);
                exit = Some(if normal.dot(w) < 0.0 { -normal } else { normal });
            }
            if segment.material != 0 {
                let length = segment.end - segment.start;
                tau += material.mu_t() * length;
                count(shared, &mut lengths, segment.material, length);
            }
            before = Some(interface);
        }
        None
    }
}
