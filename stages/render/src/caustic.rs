//! Ways of light through smooth walls of any shape, and by mirrors: some known for sure, all others by chance.
//!
//! A way is found by aiming: a ray from the point is refracted and reflected as its events say, its neighbours tell how to turn it so that it
//! meets the light. `docs/theory/render.md` says why nothing is counted twice and nothing is left out.

use glam::DVec3;
use turbid_optics::pencil::Aim;
use turbid_optics::solid::{Ends, Far};

use crate::finish::Finish;
use crate::lamp::Source;
use crate::lengths::{Lengths, NO_LENGTHS, count, sum};
use crate::setting::Setting;
use crate::walker::Walker;
use crate::way::{Known, Link};
use crate::world::{Skin, Wall};

mod chance;
mod reflection;
mod shot;

pub(crate) use chance::{Beginning, Best};
use shot::{Shot, Walls};

/// Where the refractive index changes next on a ray, or there is a mirror.
struct Edge {
    distance: f64,
    wall: Wall,
    n: f64,
    /// Behind it; at a mirror the same as before it.
    beyond: f64,
    /// As of a [`Shot`].
    tau: f64,
    lengths: Lengths,
    /// Normal, along the ray, of the first boundary on it, be the index the same or not.
    exit: DVec3,
}

/// What a ray comes to.
enum Next {
    Edge(Edge),
    Opaque,
    /// Nothing any more; the index around it.
    Free(f64),
}

/// A place where light may cross one wall is a way if what is left to turn is less than this, rad: else another wall comes first.
const NEAR: f64 = 1e-4;
impl Walker<'_> {
    /// Fills `self.known` with ways found from fixed beginnings: the straight line, or refraction at one wall, or the straight line's walls one
    /// after the other; and reflection at one mirror. With the first of them if `one` will do.
    pub(crate) fn know_ways(&mut self, source: Source<'_>, r: DVec3, skin: Option<Skin>, one: bool) {
        let mut known = std::mem::take(&mut self.known);
        known.clear();
        self.find_ways(source, r, skin, one, &mut known);
        if (known.is_empty() || !one) && !self.mirrors.is_empty() {
            self.by_one_reflection(source, (r, skin), false, &mut known);
            // In a focus there is no telling how bright it is; hardly any place is in one.
            known.retain(|known| known.link.irradiance.is_finite());
        }
        self.known = known;
    }

    fn find_ways(&mut self, source: Source<'_>, r: DVec3, skin: Option<Skin>, one: bool, known: &mut Vec<Known>) {
        let (towards, distance) = source.towards(r);
        let (n, edges) = self.edges(r, towards, skin, distance);
        if edges == Some(0) {
            known.extend(self.unbent(source, r, skin, n).map(|link| Known { link, events: 0 }));
            return;
        }
        let far = match source.origin() {
            (_, Some(along)) => Far::Direction(-along),
            (origin, None) => Far::Point(origin),
        };
        let n_far = self.index_around(source.origin().0);
        if n != n_far {
            let ends = Ends { far, n_far, near: r, n_near: n };
            let mut places = std::mem::take(&mut self.places);
            places.clear();
            for body in &self.setting.world.bodies {
                if !self.setting.world.materials[body.material].is_opaque() {
                    body.solid.crossings(&ends, &mut |p| places.push(p));
                }
            }
            for p in &places {
                let shot = self.shoot((r, skin), (p - r).normalize(), &[false], Walls::AsTheyAre);
                let shot = shot.and_then(|shot| shot.aim(source).map(|aim| (shot, aim)));
                if let Some((shot, aim)) = shot.filter(|(_, aim)| aim.turn.length() < NEAR) {
                    self.keep(source, (r, skin), (shot, aim), &[false], known);
                }
                if one && !known.is_empty() {
                    break;
                }
            }
            self.places = places;
        }
        if known.is_empty()
            && let Some(edges @ 1..) = edges
        {
            let events = vec![false; edges];
            let shot = self.shoot((r, skin), towards, &events, Walls::AsTheyAre);
            if let Some(shot) = shot.and_then(|shot| shot.aim(source).map(|aim| (shot, aim))) {
                self.keep(source, (r, skin), shot, &events, known);
            }
        }
    }

    /// Adds the way that a ray leads to, if it is not known yet.
    fn keep(
        &mut self,
        source: Source<'_>,
        begin: (DVec3, Option<Skin>),
        shot: (Shot, Aim),
        events: &[bool],
        known: &mut Vec<Known>,
    ) {
        let Some((shot, aim)) = self.steer(source, begin, shot, events, Walls::AsTheyAre) else { return };
        let way = shot.pencil.start();
        if known.iter().any(|known| known.is(way, events.len())) {
            return;
        }
        let link = self.arrive(source, &shot, &aim);
        known.extend(link.map(|link| Known { link, events: events.len() }));
    }

    /// The light that comes by a way that has been found, if nothing stands in its last part.
    fn arrive(&mut self, source: Source<'_>, shot: &Shot, aim: &Aim) -> Option<Link> {
        let Shot { pencil, skin, n, passed, tau, lengths, exit } = shot;
        let sight = self.sight(pencil.r, pencil.w, source.towards(pencil.r).1, *skin);
        if sight.blocked {
            return None;
        }
        let mut link = Link {
            towards: pencil.start(),
            irradiance: 0.0,
            tau: tau + sight.tau,
            exit: *exit,
            on_plane: DVec3::ZERO,
            lit: false,
            lengths: sum(lengths, &sight.lengths),
        };
        // From the last wall on it is the light's own cone: there are its intensity and the place on its pattern.
        if let Some(arrival) = source.arrival(pencil.r) {
            let strength = match source.origin().1 {
                None => arrival.irradiance * arrival.distance * arrival.distance,
                Some(_) => arrival.irradiance,
            };
            link.irradiance = strength * passed * aim.spread / (n * n);
            (link.on_plane, link.lit) = (arrival.on_plane, true);
        }
        Some(link)
    }

    /// The straight way through one index.
    fn unbent(&mut self, source: Source<'_>, r: DVec3, skin: Option<Skin>, n: f64) -> Option<Link> {
        let (towards, distance) = source.towards(r);
        let sight = self.sight(r, towards, distance, skin);
        if sight.blocked {
            return None;
        }
        let arrival = source.arrival(r);
        Some(Link {
            towards,
            irradiance: arrival.map_or(0.0, |arrival| arrival.irradiance / (n * n)),
            tau: sight.tau,
            exit: sight.exit,
            on_plane: arrival.map_or(DVec3::ZERO, |arrival| arrival.on_plane),
            lit: arrival.is_some(),
            lengths: sight.lengths,
        })
    }

    /// Where the index changes first along a ray, or a mirror is.
    fn next_edge(&mut self, r: DVec3, w: DVec3, skin: Option<Skin>) -> Next {
        let Setting { world, shared, .. } = self.setting;
        let (mut n, mut tau, mut lengths) = (None, 0.0, NO_LENGTHS);
        let (mut before, mut exit): (Option<Wall>, Option<DVec3>) = (None, None);
        for piece in world.trace(r, w, skin, &mut self.spans) {
            let material = &world.materials[piece.material];
            let mirror = material.finish == Finish::Mirror;
            if material.is_opaque() && !mirror {
                return Next::Opaque;
            }
            let n = *n.get_or_insert(material.n);
            let beyond = if mirror { n } else { material.n };
            if let Some(wall) = before {
                let along = || {
                    let normal = world.normal(wall, r + piece.start * w);
                    if normal.dot(w) < 0.0 { -normal } else { normal }
                };
                let exit = *exit.get_or_insert_with(along);
                if mirror || beyond != n {
                    return Next::Edge(Edge { distance: piece.start, wall, n, beyond, tau, lengths, exit });
                }
            } else if mirror {
                // Rounding put the start of the ray into it.
                return Next::Opaque;
            }
            if piece.wall.is_none() {
                return Next::Free(n);
            }
            if piece.material != 0 {
                let length = piece.end - piece.start;
                tau += material.mu_t() * length;
                count(shared, &mut lengths, piece.material, length);
            }
            before = piece.wall;
        }
        Next::Free(n.unwrap_or(1.0))
    }

    /// The index at r on the side of `w`, and how often it changes on the way along `w`; `None` where something opaque is in the way.
    fn edges(&mut self, r: DVec3, w: DVec3, skin: Option<Skin>, distance: f64) -> (f64, Option<usize>) {
        let world = self.setting.world;
        let (mut first, mut n, mut edges) = (None, 1.0, 0);
        for piece in world.trace(r, w, skin, &mut self.spans) {
            if piece.start >= distance {
                break;
            }
            let material = &world.materials[piece.material];
            if first.is_none() {
                (first, n) = (Some(material.n), material.n);
            }
            if material.is_opaque() {
                return (first.unwrap_or(n), None);
            }
            edges += usize::from(material.n != n);
            n = material.n;
        }
        (first.unwrap_or(n), Some(edges))
    }

    /// The refractive index around a point.
    fn index_around(&self, p: DVec3) -> f64 {
        let world = self.setting.world;
        world.bodies.iter().find(|body| body.solid.contains(p)).map_or(1.0, |body| world.materials[body.material].n)
    }
}

impl Edge {
    fn is_mirror(&self) -> bool {
        self.n == self.beyond
    }
}

#[cfg(test)]
mod tests;
