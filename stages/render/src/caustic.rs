//! Ways of light through smooth walls of any shape: some known for sure, all others by chance.
//!
//! A way is found by aiming: a ray from the point is refracted and reflected as its events say, its neighbours tell how to turn it so that it
//! meets the light. `docs/theory/render.md` says why nothing is counted twice and nothing is left out.

use glam::{DVec2, DVec3};
use turbid_optics::elementary::sin_cos_turns;
use turbid_optics::henyey_greenstein::turn;
use turbid_optics::pencil::Aim;
use turbid_optics::philox::{philox4x32, unit};
use turbid_optics::refraction::refract;
use turbid_optics::solid::{Ends, Far};

use crate::channels::{Lengths, NO_LENGTHS, count, sum};
use crate::lamp::Source;
use crate::link::{Chance, DETOURS, Link};
use crate::path::{Setting, Walker};
use crate::world::{Skin, Wall};

mod shot;

use shot::{Shot, Walls};

/// A way that need not be looked for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Known {
    pub link: Link,
    /// Walls that turn it.
    events: usize,
}

/// Where the refractive index changes next on a ray.
struct Edge {
    distance: f64,
    wall: Wall,
    n: f64,
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

/// Random numbers of the trials at one place.
struct Dice {
    key: [u32; 2],
    head: [u32; 2],
    trial: u32,
    throw: u32,
}

/// A place where light may cross one wall is a way if what is left to turn is less than this, rad: else another wall comes first.
const NEAR: f64 = 1e-4;
/// Ways are one if their directions differ by less, rad.
const SAME: f64 = 1e-6;
/// Ways that bring less than this part of the light of the best are weighed by roulette.
const WEAK: f64 = 1e-2;
/// Of a trial's events: a ray from outside is reflected by a wall with this probability, one from inside with at least `RARE`.
const OUTSIDE: f64 = 0.5;
const RARE: f64 = 0.1;
/// A trial ends at each event with this probability.
const DIES: f64 = 0.1;
/// Among facets a trial begins with this probability near a way by smooth surfaces, up to so many rad and down to e^-SCALES of that from it.
const SMOOTHLY: f64 = 0.75;
const FARTHEST: f64 = 0.3;
const SCALES: f64 = 8.0;
/// Trials after which a way that was found once is given up.
const MOST_TRIALS: u32 = 1 << 18;

impl Dice {
    fn throw(&mut self) -> [f64; 4] {
        self.throw += 1;
        philox4x32([self.trial, self.throw, self.head[0], self.head[1]], self.key).map(unit)
    }
}

impl Walker<'_> {
    /// Fills `self.known` with ways found from fixed beginnings: the straight line, or refraction at one wall, or the straight line's walls one
    /// after the other; with the first of them if `one` will do.
    pub(crate) fn know_ways(&mut self, source: Source<'_>, r: DVec3, skin: Option<Skin>, one: bool) {
        let mut known = std::mem::take(&mut self.known);
        known.clear();
        self.find_ways(source, r, skin, one, &mut known);
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

    /// One of the ways that are not in `self.known`, found by trying. The mean number of trials until it is found again is one over the
    /// probability with which it is found: so it is scored by that number.
    pub(crate) fn by_chance(
        &mut self,
        source: Source<'_>,
        r: DVec3,
        skin: Option<Skin>,
        chance: &Chance<'_>,
    ) -> Option<Link> {
        let best = self.known.first().map(|known| known.link);
        let tried = if best.is_some() { DETOURS } else { 1.0 };
        let random = |decision| chance.stream.aside(chance.number, source.place(), chance.place, decision);
        let [whether, roulette, ..] = random(1).map(unit);
        if whether >= tried {
            return None;
        }
        let [a, b, c, d] = random(2);
        let mut dice = Dice { key: [a, b], head: [c, d], trial: 0, throw: 0 };
        let exit = best.and_then(|link| link.exit);
        let n_far = self.index_around(source.origin().0);
        let begin = (r, skin);
        let (shot, aim, events) = self.try_way(source, begin, exit, n_far, &mut dice)?;
        let way = shot.pencil.start();
        if self.known.iter().any(|known| known.is(way, events)) {
            return None;
        }
        let mut link = self.arrive(source, &shot, &aim).filter(|link| link.lit)?;
        let strength = link.irradiance * libm::exp(-link.tau);
        let best = match best {
            Some(link) => link.irradiance * libm::exp(-link.tau),
            None => source.arrival(r).map_or(0.0, |arrival| arrival.irradiance / (n_far * n_far)),
        };
        let kept = if best > 0.0 { (strength / (WEAK * best)).min(1.0) } else { 1.0 };
        if roulette >= kept {
            return None;
        }
        for trial in 1..MOST_TRIALS {
            dice = Dice { trial, throw: 0, ..dice };
            let again = self.try_way(source, begin, exit, n_far, &mut dice);
            if again.is_some_and(|(shot, _, n)| n == events && (shot.pencil.start() - way).length() < SAME) {
                link.irradiance *= f64::from(trial) / (tried * kept);
                return Some(link);
            }
        }
        self.given_up += 1;
        None
    }

    /// A random ray with random events, aimed at the source; how many events it has.
    fn try_way(
        &mut self,
        source: Source<'_>,
        (r, skin): (DVec3, Option<Skin>),
        exit: Option<DVec3>,
        n_far: f64,
        dice: &mut Dice,
    ) -> Option<(Shot, Aim, usize)> {
        let [choice, u, turns, _] = dice.throw();
        let around = |axis: DVec3, least: f64| {
            let cos = 1.0 - u * (1.0 - least);
            let (sin_phi, cos_phi) = sin_cos_turns(turns);
            turn(axis, cos, (1.0 - cos * cos).max(0.0).sqrt(), sin_phi, cos_phi)
        };
        // Towards the source, or where walls let light out, or into all directions.
        let first = match exit {
            _ if choice < 0.25 => around(source.towards(r).0, 0.95),
            Some(exit) if choice < 0.6 => around(exit, 0.7),
            _ => around(DVec3::Z, -1.0),
        };
        let mut events = std::mem::take(&mut self.events);
        events.clear();
        let begun = self.events_of((r, skin), first, n_far, dice, &mut events);
        // One refraction by a flat wall is known.
        let begun = begun.filter(|()| !(self.facetted && self.flat && events[..] == [false]));
        let first = begun.and_then(|()| self.among_facets(source, (r, skin), first, &events, dice));
        let found = first.and_then(|w| self.connect(source, (r, skin), w, &events, Walls::AsTheyAre));
        let count = events.len();
        self.events = events;
        found.map(|(shot, aim)| (shot, aim, count))
    }

    /// Where there are facets, mostly a direction at random about the one that would be the way if the surfaces that they stand for were smooth: ways
    /// by facets, of which each holds one or none, lie around it, and few rays find a way from far off. All scales are as likely.
    fn among_facets(
        &mut self,
        source: Source<'_>,
        begin: (DVec3, Option<Skin>),
        w: DVec3,
        events: &[bool],
        dice: &mut Dice,
    ) -> Option<DVec3> {
        if !self.facetted {
            return Some(w);
        }
        let [whether, scale, u, turns] = dice.throw();
        if whether >= SMOOTHLY {
            return Some(w);
        }
        let (shot, _) = self.connect(source, begin, w, events, Walls::Rounded)?;
        let off = FARTHEST * libm::exp(-SCALES * scale) * u.sqrt();
        let (sin, cos) = sin_cos_turns(turns);
        Some(shot.pencil.turned(off * DVec2::new(cos, sin)))
    }

    /// Random events along a ray, until it may see the source.
    fn events_of(
        &mut self,
        (mut r, mut skin): (DVec3, Option<Skin>),
        mut w: DVec3,
        n_far: f64,
        dice: &mut Dice,
        events: &mut Vec<bool>,
    ) -> Option<()> {
        loop {
            let [ends, dies, reflects, _] = dice.throw();
            let edge = match self.next_edge(r, w, skin) {
                Next::Edge(edge) => edge,
                Next::Free(n) => return (n == n_far && !events.is_empty()).then_some(()),
                // The ray may be turned past it.
                Next::Opaque => return (!events.is_empty()).then_some(()),
            };
            if edge.n == n_far && !events.is_empty() && ends < 0.5 {
                return Some(());
            }
            if dies < DIES {
                return None;
            }
            r += edge.distance * w;
            let normal = self.setting.world.normal(edge.wall, r);
            let met = refract(w, normal, edge.n, edge.beyond);
            let likely = if edge.n == n_far { OUTSIDE } else { met.reflectance.clamp(RARE, 1.0 - RARE) };
            let on = met.refracted.filter(|_| reflects >= likely);
            events.push(on.is_none());
            let inside = normal.dot(w) > 0.0;
            skin = Some(Skin { wall: edge.wall, inside: inside == on.is_none() });
            w = on.unwrap_or(met.reflected);
        }
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

    /// Where the index changes first along a ray.
    fn next_edge(&mut self, r: DVec3, w: DVec3, skin: Option<Skin>) -> Next {
        let Setting { world, shared, .. } = self.setting;
        let (mut n, mut tau, mut lengths) = (None, 0.0, NO_LENGTHS);
        let (mut before, mut exit): (Option<Wall>, Option<DVec3>) = (None, None);
        for piece in world.trace(r, w, skin, &mut self.spans) {
            let material = &world.materials[piece.material];
            if material.is_opaque() {
                return Next::Opaque;
            }
            let n = *n.get_or_insert(material.n);
            if let Some(wall) = before {
                let along = || {
                    let normal = world.normal(wall, r + piece.start * w);
                    if normal.dot(w) < 0.0 { -normal } else { normal }
                };
                let exit = *exit.get_or_insert_with(along);
                if material.n != n {
                    return Next::Edge(Edge { distance: piece.start, wall, n, beyond: material.n, tau, lengths, exit });
                }
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

impl Known {
    /// Whether it is the way that begins along `w`.
    fn is(&self, w: DVec3, events: usize) -> bool {
        self.events == events && (self.link.towards - w).length() < SAME
    }
}

#[cfg(test)]
mod tests;
