//! Next-event estimation one scattering ahead, in f32 lanes: `Walker::next_event_ahead` for worlds of few transparent bodies.

use fearless_simd::prelude::*;

use super::bend::{FoundInLanes, KnownConnection, ScalarConnection};
use super::deposit::{Deposit, Seen};
use super::facets::bits;
use super::frame::Frame;
use super::ground::Chord;
use super::interfaces::{Heading, Refraction};
use super::lane::{F, LANES, M, U, V, choose, exp, ln, philox, splat, unit};
use super::limits::{DARK, ENTRY, FIRST, MOST_CHANNELS, MOST_FACES, TURNED};
use super::phase_function::Phase;
use super::rows::{Counts, PlaceLanes, Places, VertexLanes, Vertices};
use super::source::{Arrival, Source, whether_projected};
use super::visibility::{Met, Visibility, add_along, add_in_own, find_chords, first_segment, steepness, visibility};
use crate::ahead::{FLAT, LEAST_CHANCE, OTHER_CONNECTIONS};
use crate::lengths::MOST_LENGTHS;

/// Of a density e^-x what lies behind this x is nothing to f32.
const GONE: f32 = 17.0;

/// Vertices that wait for their next-event estimation.
#[derive(Clone, Debug)]
pub struct NextEvents {
    pub vertices: Vertices,
    /// Where light comes through interfaces, the places on their lines that are to be connected: some of them.
    places: Places,
    /// Where light bends.
    pub scalar_connections: Vec<ScalarConnection>,
}

impl NextEvents {
    pub fn new(counted: bool) -> Self {
        Self { vertices: Vertices::new(counted), places: Places::new(counted), scalar_connections: Vec::new() }
    }
}

/// Estimates while so many wait.
#[inline(always)]
pub fn estimate_while<S: Simd>(
    simd: S,
    next_events: &mut NextEvents,
    many: usize,
    frame: &Frame<'_>,
    responses: &mut [f64],
) {
    while next_events.vertices.len() >= many {
        do_once::<S, false>(simd, next_events, frame, responses);
        while next_events.places.len() >= LANES {
            do_once::<S, true>(simd, next_events, frame, responses);
        }
    }
    while next_events.places.len() >= many {
        do_once::<S, true>(simd, next_events, frame, responses);
    }
}

/// Estimates from the first 16 vertices, or connects the first 16 places through interfaces (`PLACES`); those are then removed. Each is compiled once for all callers, each
/// of which would be as large as all the rest of a flight.
#[inline(never)]
fn do_once<S: Simd, const PLACES: bool>(
    simd: S,
    next_events: &mut NextEvents,
    frame: &Frame<'_>,
    responses: &mut [f64],
) {
    simd.vectorize(
        #[inline(always)]
        || {
            if PLACES {
                see_through_interfaces(simd, next_events, frame, responses);
                next_events.places.drop_first(simd);
            } else {
                estimate(simd, next_events, frame, responses);
                next_events.vertices.drop_first(simd);
            }
        },
    );
}

/// The first 16 vertices, or as many as there are: adds to the responses of their paths.
#[inline(always)]
fn estimate<S: Simd>(simd: S, next_events: &mut NextEvents, frame: &Frame<'_>, responses: &mut [f64]) {
    let count = next_events.vertices.len().min(LANES);
    let mut vertex = VertexLanes::zeros(simd);
    next_events.vertices.load(simd, &mut vertex);
    let ray = Ray { waiting: M::from_bitmask(simd, (1 << count) - 1), vertex };
    let channels = if frame.counts { frame.channels.len() } else { 1 };
    let mut deposit = Deposit { frame, channels, paths: &ray.vertex.response.as_slice()[..count], responses };
    // Of all lamps one sum: that a path's estimates are added one by one must not depend on which go together.
    let mut steady = [splat(simd, 0.0); MOST_CHANNELS];
    let mut met = Met::new();
    for source in &frame.sources {
        let line = line(simd, frame, source, &ray, &mut met);
        if frame.interfaces.is_some() {
            next_events.places.pack(line.asked, &line.place(&ray));
            continue;
        }
        let visibility = visibility(simd, frame, source, line.asked, line.r, &mut met);
        let seen = line.sees(simd, frame, source, &visibility, &met.chords);
        if frame.plane.as_ref().is_some_and(|plane| plane.scalar_connections) {
            let place = line.place(&ray);
            let tried = line.asked & tries(simd, frame, &place);
            line.leave(simd, &mut next_events.scalar_connections, &place, tried, |_| FoundInLanes::Unsure);
        }
        if source.is_lamp() {
            for ((sum, radiance), scale) in steady[..channels].iter_mut().zip(seen.radiance).zip(source.scales) {
                *sum += radiance * scale;
            }
        } else {
            deposit.add_projected(simd, &seen);
        }
    }
    if frame.sources.last().is_some_and(Source::is_lamp) {
        deposit.add_steady(&steady);
    }
}

/// Lanes that estimate.
struct Ray<S: Simd> {
    waiting: M<S>,
    vertex: VertexLanes<S>,
}

/// The line on which the next scattering is sampled.
struct Line<S: Simd> {
    asked: M<S>,
    r: V<S>,
    /// Unit vector along which the path comes there, and the optical depth of that.
    e: V<S>,
    passed: F<S>,
    /// With which probability connections other than the likeliest are tried.
    others: F<S>,
    phase: Phase<S>,
    /// Of what is scattered there, without what is lost on the line.
    fraction: F<S>,
    lengths: Counts<S>,
    /// Random numbers of the estimate: its block, and its place on the ray.
    block: U<S>,
    place: U<S>,
}

/// A point on a line that a lane connects to a source.
#[inline(always)]
fn line<S: Simd>(simd: S, frame: &Frame<'_>, source: &Source, ray: &Ray<S>, met: &mut Met<S>) -> Line<S> {
    let &Ray { waiting, vertex } = ray;
    let VertexLanes { r, came, own, weight, roulette, mu_a, mu_s, g, least, .. } = vertex;
    let VertexLanes { number, sample, pixel, body, mut lengths, .. } = vertex;
    let mu_t = mu_a + mu_s;
    let through = frame.interfaces.as_ref().map(|interfaces| interfaces.heading(simd, frame, body, r, least));
    let (towards, tau, interface, interface_body) = if let Some(heading) = &through {
        (heading.towards, heading.tau, splat(simd, 0.0), body)
    } else {
        let Visibility { towards, tau, .. } = visibility(simd, frame, source, waiting, r, met);
        let (interface, interface_body) = first_segment(simd, frame, body, r, &met.chords);
        (towards, tau, interface, interface_body)
    };

    // The line: along the path's own direction, or one from the lobe around the light. Rays that come in from outside have no choice.
    let (first, entry) = (number.simd_ge(FIRST), (number & (FIRST | ENTRY)).simd_eq(ENTRY));
    let turned = (number & (FIRST | ENTRY | TURNED)).simd_eq(TURNED);
    let (block, segment) = source.numbers(simd, number, frame.first - 1, first, entry);
    let word = segment | frame.channel;
    let [choice, b, c, u] = philox(simd, block, word, sample, pixel, &frame.keys);
    let phase = frame.phase_of_bodies(simd, g, body);
    let lobe = phase.sample(towards, unit(b), unit(c));
    let sure = first | turned;
    let given = sure | entry;
    let goes_on = (choice >> 31).simd_eq(0) | given;
    let e =
        V { x: choose(goes_on, own.x, lobe.x), y: choose(goes_on, own.y, lobe.y), z: choose(goes_on, own.z, lobe.z) };
    let balance = choose(given, splat(simd, 1.0), phase.twice_balance(came.dot(e), e.dot(towards)));
    let (steepness, incidence) = if let Some(Heading { normal, .. }) = &through {
        let cos = towards.dot(*normal);
        (e.dot(*normal) / cos, cos)
    } else {
        steepness(simd, frame, r, towards, (interface, interface_body, &met.normals), e)
    };
    // Nor are the camera's and those from interfaces subject to roulette. See `crate::ahead::depth`.
    let depth = tau * incidence.abs();
    let depth = choose(depth.simd_gt(least), depth, least);
    let mut inverse_survival = choose(sure, splat(simd, 1.0), inverse_survival(simd, depth, frame.tau_sure));
    let (mut roulette, mut others) = (roulette, splat(simd, OTHER_CONNECTIONS as f32));
    if through.is_some() {
        let scattered = weight * balance * phase.density(e.dot(towards)) * mu_s / mu_t;
        let inverse_chance = inverse_chance(simd, frame, body, scattered * expected(simd, steepness, tau));
        others = (inverse_chance.sqrt() * OTHER_CONNECTIONS as f32).min(splat(simd, 1.0));
        inverse_survival = inverse_survival.max(inverse_chance);
        // Those have a number of their own.
        roulette = choose(sure, unit(choice), roulette);
    }
    let chosen = waiting & (roulette * inverse_survival).simd_lt(1.0);
    let along = &mut met.chords;
    find_chords(simd, frame, r, e, along);
    let rate = falling(simd, steepness, mu_t);
    if !frame.ground.meshes.is_empty() {
        let until = choose(rate.simd_gt(mu_t * 0.1), GONE / rate, splat(simd, f32::INFINITY));
        frame.ground.add_ahead(simd, chosen, body, r, e, until, along);
    }
    let (length, _) = first_segment(simd, frame, body, r, along);
    let (s, inverse_density) = ahead(simd, rate, length, mu_t, unit(!u));
    if frame.counts {
        add_in_own(&mut lengths, frame, body, s);
    }
    Line {
        asked: chosen & length.simd_gt(0.0),
        r: r.plus(s, e),
        e,
        passed: mu_t * s,
        others,
        phase,
        fraction: weight * inverse_survival * (balance * inverse_density * mu_s),
        lengths,
        block,
        place: first.select(segment, U::splat(simd, 0)),
    }
}

impl<S: Simd> Line<S> {
    /// What its point sees of a source.
    #[inline(always)]
    fn sees(
        &self,
        simd: S,
        frame: &Frame<'_>,
        source: &Source,
        visibility: &Visibility<S>,
        chords: &[Chord<S>],
    ) -> Seen<S> {
        let zero = splat(simd, 0.0);
        let &Visibility { towards, tau, blocked, foot, gain, .. } = visibility;
        let Arrival { irradiance, lit, x, y } = source.arrives(simd, foot);
        let dark = self.passed + tau;
        let p = self.phase.density(self.e.dot(towards));
        let seen = self.asked & lit & !blocked & dark.simd_lt(DARK);
        let radiance = choose(seen, self.fraction * p * (irradiance * gain) * exp(-dark.min(splat(simd, DARK))), zero);
        // What each channel sees of it.
        let mut seen_in = [radiance; MOST_CHANNELS];
        if frame.counts {
            let mut lengths = self.lengths;
            add_along(simd, &mut lengths, frame, self.r, visibility, chords);
            for (of, excess) in seen_in.iter_mut().zip(&frame.channels) {
                if *excess == [0.0; MOST_LENGTHS] {
                    // It is that of the walk, to the last digit.
                    continue;
                }
                let depth = lengths.iter().zip(excess).fold(zero, |sum, (&length, &excess)| sum + length * excess);
                // Lengths of lanes that see nothing need not be numbers.
                *of = choose(seen, radiance * exp(-depth.min(splat(simd, DARK))), zero);
            }
        }
        Seen { radiance: seen_in, lit: seen, x, y }
    }

    /// The record of it.
    #[inline(always)]
    fn place(&self, ray: &Ray<S>) -> PlaceLanes<S> {
        let &Self { r, e, passed, others, fraction, lengths, block, place, phase, .. } = self;
        let VertexLanes { sample, pixel, response, body, .. } = ray.vertex;
        PlaceLanes { r, e, g: phase.g, fraction, passed, others, block, place, sample, pixel, response, body, lengths }
    }

    /// Leaves connections that lanes do not know to the scalar walker: one of them at random, or all of them.
    #[inline(always)]
    fn leave(
        &self,
        simd: S,
        scalar_connections: &mut Vec<ScalarConnection>,
        place: &PlaceLanes<S>,
        left: M<S>,
        found: impl Fn(usize) -> FoundInLanes,
    ) {
        let scattered = self.fraction * exp(-self.passed.min(splat(simd, DARK)));
        let (r, e) = (self.r, self.e);
        for i in bits(left.to_bitmask()) {
            scalar_connections.push(ScalarConnection {
                number: self.block.as_slice()[i],
                sample: place.sample.as_slice()[i],
                pixel: place.pixel.as_slice()[i],
                path: place.response.as_slice()[i],
                r: [r.x, r.y, r.z].map(|x| x.as_slice()[i]),
                e: [e.x, e.y, e.z].map(|x| x.as_slice()[i]),
                phase: self.phase.of_lane(i),
                fraction: scattered.as_slice()[i],
                lengths: std::array::from_fn(|k| self.lengths.get(k).map_or(0.0, |l| l.as_slice()[i])),
                place: self.place.as_slice()[i],
                found: found(i),
                others: place.others.as_slice()[i],
            });
        }
    }
}

/// Whether `Walker::reflected_connection`, or `Walker::sample_manifold`, tries at all.
#[inline(always)]
fn tries<S: Simd>(simd: S, frame: &Frame<'_>, at: &PlaceLanes<S>) -> M<S> {
    let word = whether_projected(simd, at.place) | frame.channel;
    let [draws, ..] = philox(simd, at.block, word, at.sample, at.pixel, &frame.keys);
    unit(draws).simd_lt(at.others)
}

/// Of the first 16 places every connection by one refraction, and others by manifold sampling, which the scalar walker does; where lanes do not know, all is left to
/// that. Adds to the responses of their paths.
#[inline(always)]
fn see_through_interfaces<S: Simd>(simd: S, next_events: &mut NextEvents, frame: &Frame<'_>, responses: &mut [f64]) {
    let (Some(interfaces), Some(source)) = (&frame.interfaces, frame.sources.first()) else { return };
    let NextEvents { places, scalar_connections, .. } = next_events;
    let count = places.len().min(LANES);
    let mut place = PlaceLanes::zeros(simd);
    places.load(simd, &mut place);
    let line = Line {
        asked: M::from_bitmask(simd, (1 << count) - 1),
        r: place.r,
        e: place.e,
        passed: place.passed,
        others: place.others,
        phase: frame.phase_of_bodies(simd, place.g, place.body),
        fraction: place.fraction,
        lengths: place.lengths,
        block: place.block,
        place: place.place,
    };
    let among_facets = !frame.ground.meshes.is_empty();
    if among_facets && frame.counts {
        return line.leave(simd, scalar_connections, &place, line.asked, |_| FoundInLanes::Unsure);
    }
    let channels = if frame.counts { frame.channels.len() } else { 1 };
    let mut deposit = Deposit { frame, channels, paths: &place.response.as_slice()[..count], responses };
    let mut met = Met::new();
    let mut refractions: [Option<Refraction<S>>; MOST_FACES] = std::array::from_fn(|_| None);
    // Of each lane the first connection that there is, and by bits the lanes that each of the others has found, too.
    let (mut first, mut others) = (Refraction::none(simd), [0; MOST_FACES]);
    let mut asked = line.asked;
    for mesh in &frame.ground.meshes {
        let own = asked & place.body.simd_eq(mesh.body);
        if own.any_true() {
            let refraction = interfaces.refraction_by_facets(simd, frame, mesh, own, line.r);
            first = first.or(!own, &refraction);
        }
        asked &= !own;
    }
    for (i, face) in interfaces.faces.iter().enumerate() {
        let mut refraction = interfaces.refraction(simd, frame, i, asked, line.r);
        if among_facets {
            interfaces.keep_open(simd, frame, (place.body, &[u32::MAX; LANES]), line.r, &mut refraction);
        }
        for same in face.same() {
            if let Some(before) = refractions.get(same).and_then(Option::as_ref) {
                refraction.found &= !before.found;
            }
        }
        others[i] = (refraction.found & first.found).to_bitmask();
        let mask = first.found | !refraction.found;
        first = first.or(mask, &refraction);
        refractions[i] = Some(refraction);
    }
    let found = first.found & !first.unsure;
    let several = others.iter().fold(0, |several, others| several | others) & found.to_bitmask();
    // Lane by lane where one has several: that a path's estimates are added one by one must not depend on which go together.
    let (mut start, mut rest) = (0, several);
    loop {
        let last = rest.trailing_zeros().min(LANES as u32 - 1);
        rest &= !(1 << last);
        let run = ((2_u64 << last) - 1) & !((1 << start) - 1);
        for (i, others) in [run].iter().chain(&others).enumerate() {
            let (refraction, seen) = match i {
                0 => (Some(&first), *others),
                _ => (refractions[i - 1].as_ref(), others & several & run & (1 << last)),
            };
            let seen = seen & found.to_bitmask();
            if let (Some(refraction), true) = (refraction, seen != 0) {
                let visibility = refraction.visibility(!M::from_bitmask(simd, seen));
                if frame.counts {
                    find_chords(simd, frame, line.r, refraction.towards, &mut met.chords);
                }
                let seen = line.sees(simd, frame, source, &visibility, &met.chords);
                deposit.add_projected(simd, &seen);
            }
        }
        start = last + 1;
        if start == LANES as u32 {
            break;
        }
    }
    let wholly = line.asked & !found;
    let tried = line.asked & !wholly & tries(simd, frame, &place);
    let dark = first.tau.max(splat(simd, 0.0)).min(splat(simd, DARK));
    let strength = source.arrives(simd, first.foot).irradiance * first.gain * exp(-dark);
    let (known, unsure, faceless) = (found.to_bitmask(), first.unsure.to_bitmask(), asked.to_bitmask());
    line.leave(simd, scalar_connections, &place, tried | wholly, |i| {
        let at = |v: V<S>| [v.x, v.y, v.z].map(|x| x.as_slice()[i]);
        let (strength, towards, normal) = (strength.as_slice()[i], at(first.towards), at(first.normal));
        match (known >> i & 1, unsure >> i & 1) {
            (1, _) => {
                FoundInLanes::Known(KnownConnection { strength, towards, normal, by_facet: faceless >> i & 1 == 0 })
            }
            (_, 1) => FoundInLanes::Unsure,
            _ => FoundInLanes::Nothing,
        }
    });
}

/// One over the probability of connecting; see `crate::ahead::inverse_survival`.
#[inline(always)]
pub fn inverse_survival<S: Simd>(simd: S, tau: F<S>, sure: f32) -> F<S> {
    let x = (tau * (1.0 / sure)).max(splat(simd, 1.0));
    let square = x * x;
    square * square
}

/// One over the probability with which estimates are made that are expected to bring so much; see `crate::ahead::inverse_chance`.
#[inline(always)]
fn inverse_chance<S: Simd>(simd: S, frame: &Frame<'_>, body: U<S>, expected: F<S>) -> F<S> {
    let mut worth = splat(simd, 0.0);
    for (j, &of) in frame.worth.iter().enumerate() {
        worth = choose(body.simd_eq(j as u32), splat(simd, of), worth);
    }
    let (inverse, most) = (worth / expected, splat(simd, (1.0 / LEAST_CHANCE) as f32));
    choose(inverse.simd_lt(most), inverse.max(splat(simd, 1.0)), most)
}

/// See `crate::ahead::expected`.
#[inline(always)]
fn expected<S: Simd>(simd: S, steepness: F<S>, tau: F<S>) -> F<S> {
    let (zero, dark) = (splat(simd, 0.0), splat(simd, DARK));
    let fall = 1.0 - steepness;
    let at_once = exp(-tau.min(dark));
    let left = choose(steepness.simd_gt(zero), exp(-(tau / steepness).min(dark)), zero);
    choose(fall.abs().simd_lt(FLAT as f32), tau * at_once, (at_once - left) / fall)
}

/// The rate of the density along the line by its steepness; see `crate::ahead::ahead`.
#[inline(always)]
fn falling<S: Simd>(simd: S, steepness: F<S>, mu_t: F<S>) -> F<S> {
    let known = steepness.simd_eq(steepness);
    choose(known, (1.0 - steepness).max(splat(simd, -1.0)).min(splat(simd, 2.0)), splat(simd, 1.0)) * mu_t
}

/// s in (0, length) from a density proportional to exp(-rate s), and one over that density; see `crate::ahead::ahead`.
#[inline(always)]
fn ahead<S: Simd>(simd: S, rate: F<S>, length: F<S>, mu_t: F<S>, u: F<S>) -> (F<S>, F<S>) {
    // On an infinite length only positive rates have a density.
    let endless = length.simd_ge(f32::MAX) & rate.simd_le(mu_t * 1e-4);
    let rate = choose(endless, mu_t, rate);
    let steep = (rate * length).abs();
    let rest = exp(-steep.min(splat(simd, DARK)));
    let mass = 1.0 - rest;
    // `u` is one minus the scalar's: fine where little is left.
    let left = rest + u * mass;
    let inverse = 1.0 / rate.abs();
    let fallen = (-ln(left) * inverse).min(length);
    // A growing density is a falling one seen from the other end.
    let s = choose(rate.simd_gt(0.0), fallen, length - fallen);
    let flat = steep.simd_lt(FLAT as f32);
    (choose(flat, (1.0 - u) * length, s), choose(flat, length, mass * inverse / left))
}
