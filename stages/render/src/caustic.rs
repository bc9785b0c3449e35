//! Ways of light through smooth walls of any shape: some known for sure, all others by chance.
//!
//! A way is found by aiming: a ray from the point is refracted and reflected as its events say, its neighbours tell how to turn it so that it
//! meets the light. `docs/theory/render.md` says why nothing is counted twice and nothing is left out.

use glam::DVec3;
use turbid_optics::elementary::sin_cos_turns;
use turbid_optics::henyey_greenstein::turn;
use turbid_optics::pencil::{Aim, Pencil};
use turbid_optics::philox::{philox4x32, unit};
use turbid_optics::refraction::refract;
use turbid_optics::solid::{Ends, Far};

use crate::channels::{Lengths, NO_LENGTHS, sum};
use crate::lamp::Source;
use crate::link::{Chance, DETOURS, Link};
use crate::path::{Setting, Walker, count};
use crate::world::{Skin, Wall};

/// A way that need not be looked for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Known {
    pub link: Link,
    /// Walls that turn it.
    events: usize,
}

/// A ray behind the last wall of its way.
struct Shot {
    pencil: Pencil,
    skin: Option<Skin>,
    /// Refractive index there.
    n: f64,
    /// What the walls let through or reflect.
    passed: f64,
    /// Optical depth, and mm in each medium that tells channels apart.
    tau: f64,
    lengths: Lengths,
    /// As of a [`Link`].
    exit: Option<DVec3>,
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

/// Newton's method doubles the digits, from some way off.
const MOST_STEPS: usize = 12;
/// A step is halved as often before the trial is given up.
const MOST_HALVINGS: usize = 4;
/// The largest step, rad.
const LARGEST_STEP: f64 = 0.5;
/// Rad; what is left after a step of so much is its square.
const SETTLED: f64 = 1e-8;
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
                let w = (p - r).normalize();
                let shot = self.shoot((r, skin), w, &[false]);
                let aim = shot.and_then(|shot| shot.aim(source));
                if aim.is_some_and(|aim| aim.turn.length() < NEAR) {
                    self.keep(source, r, skin, w, &[false], known);
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
            self.keep(source, r, skin, towards, &vec![false; edges], known);
        }
    }

    /// Adds the way that a ray along `w` leads to, if it is not known yet.
    fn keep(
        &mut self,
        source: Source<'_>,
        r: DVec3,
        skin: Option<Skin>,
        w: DVec3,
        events: &[bool],
        known: &mut Vec<Known>,
    ) {
        let Some((shot, aim)) = self.connect(source, (r, skin), w, events) else { return };
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
        let found = begun.and_then(|()| self.connect(source, (r, skin), first, &events));
        let count = events.len();
        self.events = events;
        found.map(|(shot, aim)| (shot, aim, count))
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

    /// Turns a ray with these events until it meets the source; `None` where it does not come to that.
    fn connect(
        &mut self,
        source: Source<'_>,
        begin: (DVec3, Option<Skin>),
        w: DVec3,
        events: &[bool],
    ) -> Option<(Shot, Aim)> {
        let mut shot = self.shoot(begin, w, events)?;
        let mut aim = shot.aim(source)?;
        for _ in 0..MOST_STEPS {
            let size = aim.turn.length();
            if size < SETTLED {
                return Some((shot, aim));
            }
            let mut step = aim.turn * (LARGEST_STEP / size).min(1.0);
            let mut next = None;
            for _ in 0..MOST_HALVINGS {
                let tried = self.shoot(begin, shot.pencil.turned(step), events);
                let better = tried.and_then(|shot| shot.aim(source).map(|aim| (shot, aim)));
                next = better.filter(|(_, a)| a.miss < aim.miss);
                if next.is_some() {
                    break;
                }
                step *= 0.5;
            }
            let Some((better, better_aim)) = next else {
                // As near as rounding lets it come.
                return (size < SAME).then_some((shot, aim));
            };
            (shot, aim) = (better, better_aim);
        }
        None
    }

    /// A ray through its events; `None` where one of them cannot be.
    fn shoot(&mut self, (r, skin): (DVec3, Option<Skin>), w: DVec3, events: &[bool]) -> Option<Shot> {
        let world = self.setting.world;
        let pencil = Pencil::new(r, w);
        let mut shot = Shot { pencil, skin, n: f64::NAN, passed: 1.0, tau: 0.0, lengths: NO_LENGTHS, exit: None };
        for &reflected in events {
            let Next::Edge(edge) = self.next_edge(shot.pencil.r, shot.pencil.w, shot.skin) else { return None };
            let pencil = &mut shot.pencil;
            pencil.fly(edge.distance);
            let (wall, p) = (edge.wall, pencil.r);
            let solid = &world.bodies[wall.body].solid;
            let normal = solid.normal(wall.face, p);
            let inside = normal.dot(pencil.w) > 0.0;
            let reflectance =
                pencil.meet(normal, |d| solid.bends(wall.face, p, d), (edge.n, edge.beyond), reflected)?;
            shot.passed *= if reflected { reflectance } else { 1.0 - reflectance };
            shot.n = if reflected { edge.n } else { edge.beyond };
            shot.skin = Some(Skin { wall, inside: inside == reflected });
            shot.tau += edge.tau;
            shot.lengths = sum(&shot.lengths, &edge.lengths);
            shot.exit.get_or_insert(edge.exit);
        }
        Some(shot)
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

impl Shot {
    fn aim(&self, source: Source<'_>) -> Option<Aim> {
        match source.origin() {
            (_, Some(along)) => self.pencil.aim_along(-along),
            (origin, None) => self.pencil.aim_at(origin),
        }
    }
}

#[cfg(test)]
mod tests;
