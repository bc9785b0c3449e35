//! Specular manifold sampling: a random ray, turned by interfaces at random, begins a manifold walk to the source; the number of trials until the
//! same is found again says how probable that was.

use glam::{DVec2, DVec3};
use turbid_optics::elementary::{ln, sin_cos_turns};
use turbid_optics::henyey_greenstein::turn;
use turbid_optics::ray_differential::NewtonStep;
use turbid_optics::refraction::refract;

use super::Next;
use super::shot::{Shot, SurfaceNormals};
use crate::connect::Draws;
use crate::connection::{ABOUT, Connection, SAME};
use crate::lamp::Source;
use crate::random::Dice;
use crate::walker::Walker;
use crate::world::SurfacePoint;

/// Where one begins to search.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Beginning {
    /// All around, more towards the source and where this normal of an interface that light comes out of points.
    Around(Option<DVec3>),
    /// All over the camera's image.
    Image,
}

/// A chain that has been found.
pub(crate) struct Found {
    shot: Shot,
    newton: NewtonStep,
    /// Interfaces that turn it.
    events: usize,
    /// With which probability the ray that led to it was followed so deep.
    followed: f64,
}

/// What only the first trial of a chain does: those that count how often it is found do all alike.
#[derive(Clone, Copy, Debug)]
struct First {
    /// One refraction is known, or not worth much: such trials go on with the probability [`ONCE`].
    rarely: bool,
    /// Rays through more optical depth than this are followed by roulette.
    depth: f64,
}

/// Of a known connection.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Best {
    /// What it brings over n^2, W mm^-2.
    pub strength: f64,
    /// Normal of the interface through which it comes.
    pub exit: Option<DVec3>,
    /// Interfaces that turn it.
    pub turns: usize,
    /// Its direction in single precision, where lanes have found it: then `self.known` does not hold it, and all known connections are by one refraction.
    pub about: Option<DVec3>,
}

/// Connections that bring less than this part of the light of the best are weighed by roulette.
pub(crate) const WEAK: f64 = 1e-2;
/// The same of lamp reflections of which interfaces and media leave less than this part.
const FAINT: f64 = 1e-4;
/// Of a trial's events: a ray from outside is reflected by an interface with this probability, one from inside with at least `RARE`.
const OUTSIDE: f64 = 0.5;
const RARE: f64 = 0.1;
/// A trial ends at each event with this probability.
const DIES: f64 = 0.1;
/// Among facets a trial begins with this probability near a chain by smooth surfaces, up to so many rad and down to e^-SCALES of that from it.
const SMOOTHLY: f64 = 0.75;
const FARTHEST: f64 = 0.3;
const SCALES: f64 = 8.0;
/// Where one refraction is known most trials by one lead to that: the others, behind foci, are tried with this probability.
const ONCE: f64 = 0.25;
/// Trials after which a chain that was found once is given up.
const MOST_TRIALS: u32 = 1 << 18;

impl Found {
    /// The direction in which it begins.
    fn chain(&self) -> DVec3 {
        self.shot.differential.start()
    }
}

impl Walker<'_> {
    /// One of the connections that are not in `self.known`, found by trying. The mean number of trials until it is found again is one over the
    /// probability with which it is found: so it is scored by that number.
    pub(crate) fn sample_manifold(
        &mut self,
        source: Source<'_>,
        r: DVec3,
        surface_point: Option<SurfacePoint>,
        draws: &Draws<'_>,
    ) -> Option<Connection> {
        let best = self.known.first().map(|known| Best {
            strength: known.connection.irradiance * libm::exp(-known.connection.tau),
            exit: known.connection.exit,
            turns: known.events,
            about: None,
        });
        self.sample_manifold_once(source, (r, surface_point), draws, best)
    }

    /// The same where a known connection is said.
    pub(crate) fn sample_manifold_once(
        &mut self,
        source: Source<'_>,
        begin: (DVec3, Option<SurfacePoint>),
        draws: &Draws<'_>,
        best: Option<Best>,
    ) -> Option<Connection> {
        if self.mirrors.once {
            return None;
        }
        let (r, surface_point) = begin;
        let tried = if best.is_some() { draws.others } else { 1.0 };
        let [whether, roulette, ..] = draws.whether(source);
        if whether >= tried {
            return None;
        }
        let mut dice = draws.which(source);
        let beginning = Beginning::Around(best.and_then(|best| best.exit));
        let n_far = self.index_around(source.origin().0);
        let rarely = !self.facetted && best.is_some_and(|best| best.turns == 1);
        let unattenuated = source.arrival(r).map_or(0.0, |arrival| arrival.irradiance / (n_far * n_far));
        // What medium leaves less of than WEAK of the best brings next to nothing beside it.
        let attenuation = best.map_or(1.0, |best| (best.strength / unattenuated).min(1.0));
        let depth = if attenuation > 0.0 { -ln(WEAK * attenuation) } else { f64::INFINITY };
        let first = Some(First { rarely, depth });
        let found = self.try_chain(source, begin, beginning, n_far, &mut dice, first)?;
        let refracted = self.events[..] == [false];
        if let Some(about) = best.and_then(|best| best.about) {
            if refracted && (found.chain() - about).length() < ABOUT {
                return None;
            }
            self.known.clear();
            if refracted {
                self.find_known(source, r, surface_point, false);
            }
        }
        if self.known.iter().any(|known| known.is(found.chain(), found.events)) {
            return None;
        }
        let mut connection = self.arrive(source, &found.shot, &found.newton).filter(|connection| connection.lit)?;
        let strength = connection.irradiance * libm::exp(-connection.tau);
        let best = best.map_or(unattenuated, |best| best.strength);
        // One that was followed by roulette is heavier by that.
        let kept = if best > 0.0 { (strength / (found.followed * WEAK * best)).min(1.0) } else { 1.0 };
        if roulette >= kept {
            return None;
        }
        let trials = self.trials_until_again(source, begin, beginning, &found, &mut dice)?;
        let tried = if rarely && refracted { ONCE * tried } else { tried };
        connection.irradiance *= f64::from(trials) / (tried * kept * found.followed);
        Some(connection)
    }

    /// One of the lamp reflections by several interfaces, found by trying from a place where the camera sees light (from a light, of parallel rays); scored
    /// in the same way.
    pub(crate) fn sample_manifold_of_lamp_reflection(
        &mut self,
        source: Source<'_>,
        eye: DVec3,
        beginning: Beginning,
        dice: &mut Dice,
        shows: impl Fn(&Connection) -> bool,
    ) -> Option<Connection> {
        let n_far = self.index_around(source.origin().0);
        let [roulette, ..] = dice.throw();
        let found = self.try_chain(source, (eye, None), beginning, n_far, dice, None)?;
        // Between ends of one index that is a reflection, and all of those are known.
        if found.events == 1 {
            return None;
        }
        let mut connection =
            self.arrive(source, &found.shot, &found.newton).filter(|connection| connection.lit && shows(connection))?;
        let kept = (found.shot.passed * libm::exp(-connection.tau) / FAINT).min(1.0);
        if roulette >= kept {
            return None;
        }
        let trials = self.trials_until_again(source, (eye, None), beginning, &found, dice)?;
        connection.irradiance *= f64::from(trials) / kept;
        Some(connection)
    }

    /// How many trials it takes to find a chain again; `None` where that are too many.
    fn trials_until_again(
        &mut self,
        source: Source<'_>,
        begin: (DVec3, Option<SurfacePoint>),
        beginning: Beginning,
        found: &Found,
        dice: &mut Dice,
    ) -> Option<u32> {
        let n_far = self.index_around(source.origin().0);
        for trial in 1..MOST_TRIALS {
            dice.begin(trial);
            let again = self.try_chain(source, begin, beginning, n_far, dice, None);
            if again.is_some_and(|a| a.events == found.events && (a.chain() - found.chain()).length() < SAME) {
                return Some(trial);
            }
        }
        self.given_up += 1;
        None
    }

    /// A manifold walk to the source from a random ray with random events.
    fn try_chain(
        &mut self,
        source: Source<'_>,
        (r, surface_point): (DVec3, Option<SurfacePoint>),
        beginning: Beginning,
        n_far: f64,
        dice: &mut Dice,
        trial: Option<First>,
    ) -> Option<Found> {
        let [choice, u, turns, spare] = dice.throw();
        let around = |axis: DVec3, least: f64| {
            let cos = 1.0 - u * (1.0 - least);
            let (sin_phi, cos_phi) = sin_cos_turns(turns);
            turn(axis, cos, (1.0 - cos * cos).max(0.0).sqrt(), sin_phi, cos_phi)
        };
        // Towards the source, or where interfaces let light out, or into all directions.
        let first = match beginning {
            Beginning::Image => self.setting.camera.view.ray(u, turns).1,
            Beginning::Around(_) if choice < 0.25 => around(source.towards(r).0, 0.95),
            Beginning::Around(Some(exit)) if choice < 0.6 => around(exit, 0.7),
            Beginning::Around(_) => around(DVec3::Z, -1.0),
        };
        let mut events = std::mem::take(&mut self.events);
        events.clear();
        let depth = trial.map_or(f64::INFINITY, |trial| trial.depth);
        let followed = self.events_of((r, surface_point), first, n_far, dice, depth, &mut events);
        // One refraction by a flat interface is known.
        let known = self.facetted && self.flat;
        let rarely = trial.is_some_and(|trial| trial.rarely);
        let followed = followed.filter(|_| events[..] != [false] || !(known || (rarely && spare >= ONCE)));
        let first = followed.and_then(|_| self.among_facets(source, (r, surface_point), first, &events, dice));
        let found =
            first.and_then(|w| self.walk_from(source, (r, surface_point), w, &events, SurfaceNormals::AsTheyAre));
        let count = events.len();
        self.events = events;
        found.zip(followed).map(|((shot, newton), followed)| Found { shot, newton, events: count, followed })
    }

    /// Where there are facets, mostly a direction at random about the one that would be the chain if the surfaces that they stand for were smooth: chains
    /// by facets, of which each holds one or none, lie around it, and few walks find a chain from far off. All scales are as likely.
    fn among_facets(
        &mut self,
        source: Source<'_>,
        begin: (DVec3, Option<SurfacePoint>),
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
        let (shot, _) = self.walk_from(source, begin, w, events, SurfaceNormals::Rounded)?;
        let off = FARTHEST * libm::exp(-SCALES * scale) * u.sqrt();
        let (sin, cos) = sin_cos_turns(turns);
        Some(shot.differential.turned(off * DVec2::new(cos, sin)))
    }

    /// Random events along a ray, until it may see the source: the probability with which roulette let it go deeper than `depth`.
    fn events_of(
        &mut self,
        (mut r, mut surface_point): (DVec3, Option<SurfacePoint>),
        mut w: DVec3,
        n_far: f64,
        dice: &mut Dice,
        depth: f64,
        events: &mut Vec<bool>,
    ) -> Option<f64> {
        let (mut tau, mut followed) = (0.0, 1.0);
        loop {
            let [ends, dies, reflects, deep] = dice.throw();
            let edge = match self.next_edge(r, w, surface_point) {
                Next::Edge(edge) => edge,
                Next::Free(n) => return (n == n_far && !events.is_empty()).then_some(followed),
                // The ray may be turned past it.
                Next::Opaque => return (!events.is_empty()).then_some(followed),
            };
            if edge.n == n_far && !events.is_empty() && ends < 0.5 {
                return Some(followed);
            }
            tau += edge.tau;
            let goes_on = libm::exp(depth - tau).min(1.0) / followed;
            if dies < DIES || deep >= goes_on {
                return None;
            }
            followed *= goes_on;
            r += edge.distance * w;
            let normal = self.setting.world.normal(edge.interface, r);
            let met = refract(w, normal, edge.n, edge.beyond);
            let likely = if edge.is_mirror() {
                1.0
            } else if edge.n == n_far {
                OUTSIDE
            } else {
                met.reflectance.clamp(RARE, 1.0 - RARE)
            };
            let on = met.refracted.filter(|_| reflects >= likely);
            events.push(on.is_none());
            let inside = normal.dot(w) > 0.0;
            surface_point = Some(SurfacePoint { interface: edge.interface, inside: inside == on.is_none() });
            w = on.unwrap_or(met.reflected);
        }
    }
}
