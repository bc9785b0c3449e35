//! Looks for light one scattering ahead, in f32 lanes: `Walker::look_ahead` for worlds of few transparent bodies.

use fearless_simd::prelude::*;

use super::bend::{Detour, KnownWay};
use super::deposit::{Deposit, Seen};
use super::facets::bits;
use super::frame::Frame;
use super::lane::{F, LANES, M, U, V, choose, exp, hg_denominator, hg_sample, ln, philox, splat, unit};
use super::limits::{DARK, ENTRY, FIRST, MOST_CHANNELS, MOST_FACES, WALL};
use super::rows::{Counts, Rows};
use super::sight::{Sight, add_along, add_in_own, first_piece, sight, spans, steepness};
use super::source::{Arrival, Source, whether_projected};
use super::walls::Way;
use crate::lengths::MOST_LENGTHS;
use crate::link::DETOURS;
use crate::look::{FLAT, TAU_SURE};

/// Of a density e^-x what lies behind this x is nothing to f32.
const GONE: f32 = 17.0;

/// Columns: r, the direction in which the path came, the one in which it goes on, weight, roulette, mu_a, mu_s, g, optical distance of
/// the nearest surface; number, sample, pixel, response, body.
pub type Rays = Rows<15, 5>;

/// What waits for being looked at.
#[derive(Clone, Debug)]
pub struct Looks {
    pub rays: Rays,
    /// Where light bends.
    pub detours: Vec<Detour>,
}

impl Looks {
    pub fn new(counted: bool) -> Self {
        Self { rays: Rays::new(counted), detours: Vec::new() }
    }
}

/// Looks for light while so many wait.
#[inline(always)]
pub fn look_while<S: Simd>(
    simd: S,
    looks: &mut Looks,
    many: usize,
    frame: &Frame<'_>,
    key: [u32; 2],
    high: u32,
    responses: &mut [f64],
) {
    while looks.rays.len() >= many {
        look_once(simd, looks, frame, key, high, responses);
    }
}

/// Compiled once for all callers, each of which would be as large as all the rest of a flight.
#[inline(never)]
fn look_once<S: Simd>(simd: S, looks: &mut Looks, frame: &Frame<'_>, key: [u32; 2], high: u32, responses: &mut [f64]) {
    simd.vectorize(
        #[inline(always)]
        || {
            look(simd, looks, frame, key, high, responses);
            looks.rays.drop_first(simd);
        },
    );
}

/// The first 16 looks, or as many as there are: adds to the responses of their paths.
#[inline(always)]
fn look<S: Simd>(simd: S, looks: &mut Looks, frame: &Frame<'_>, key: [u32; 2], high: u32, responses: &mut [f64]) {
    let (floats, words, lengths) = looks.rays.load(simd);
    let [rx, ry, rz, cx, cy, cz, ox, oy, oz, weight, roulette, mu_a, mu_s, g, least] = floats;
    let [number, sample, pixel, path, body] = words;
    let (r, came, own) = (V { x: rx, y: ry, z: rz }, V { x: cx, y: cy, z: cz }, V { x: ox, y: oy, z: oz });
    let count = looks.rays.len().min(LANES);
    let waiting = M::from_bitmask(simd, (1 << count) - 1);
    let ray = Ray {
        waiting,
        r,
        came,
        own,
        weight,
        roulette,
        mu_a,
        mu_s,
        g,
        least,
        number,
        sample,
        pixel,
        path,
        body,
        lengths,
    };
    let channels = if frame.counts { frame.channels.len() } else { 1 };
    let mut deposit = Deposit { frame, channels, paths: &path.as_slice()[..count], responses };
    // Of all lamps one sum: that a path's looks are added one by one must not depend on which go together.
    let mut steady = [splat(simd, 0.0); MOST_CHANNELS];
    for source in &frame.sources {
        let line = line(simd, frame, source, key, high, &ray);
        if frame.walls.is_some() {
            see_through_walls(simd, &mut looks.detours, source, key, high, &ray, &line, &mut deposit);
            continue;
        }
        let sight = sight(simd, frame, source, line.looked, line.r);
        let seen = line.sees(simd, frame, source, &sight);
        if frame.plane.as_ref().is_some_and(|plane| plane.detours) {
            let tried = line.looked & tries(simd, key, high, &ray, &line);
            line.leave(simd, &mut looks.detours, &ray, tried, |_| None);
        }
        if source.is_lamp() {
            for ((sum, radiance), share) in steady[..channels].iter_mut().zip(seen.radiance).zip(source.shares) {
                *sum += radiance * share;
            }
        } else {
            deposit.add_projected(simd, &seen);
        }
    }
    if frame.sources.last().is_some_and(Source::is_lamp) {
        deposit.add_steady(&steady);
    }
}

/// Lanes that look, as in [`Rays`].
struct Ray<S: Simd> {
    waiting: M<S>,
    r: V<S>,
    came: V<S>,
    own: V<S>,
    weight: F<S>,
    roulette: F<S>,
    mu_a: F<S>,
    mu_s: F<S>,
    g: F<S>,
    least: F<S>,
    number: U<S>,
    sample: U<S>,
    pixel: U<S>,
    path: U<S>,
    body: U<S>,
    lengths: Counts<S>,
}

/// Where the next scattering is looked for.
struct Line<S: Simd> {
    looked: M<S>,
    r: V<S>,
    /// Unit vector along which the path comes there, and mm.
    e: V<S>,
    s: F<S>,
    mu_t: F<S>,
    g: F<S>,
    /// Of what is scattered there, without what is lost on the line.
    fraction: F<S>,
    lengths: Counts<S>,
    /// Random numbers of the look: its block, and its place on the ray.
    block: U<S>,
    place: U<S>,
}

/// A point on a line from where a lane looks for a source.
#[inline(always)]
fn line<S: Simd>(simd: S, frame: &Frame<'_>, source: &Source, key: [u32; 2], high: u32, ray: &Ray<S>) -> Line<S> {
    let &Ray { waiting, r, came, own, weight, roulette, mu_a, mu_s, g, least, .. } = ray;
    let &Ray { number, sample, pixel, body, mut lengths, .. } = ray;
    let mu_t = mu_a + mu_s;
    let (to_light, known) = if let Some(walls) = &frame.walls {
        walls.heading(simd, frame, waiting, r)
    } else {
        (sight(simd, frame, source, waiting, r), M::splat(simd, true))
    };
    let Sight { towards, spans: to_light, normals, tau, .. } = to_light;
    let (wall, wall_body) = first_piece(simd, frame, body, r, &to_light);

    // The line: along the path's own direction, or one from the lobe around the light. Rays that come in from outside have no choice.
    let (first, entry) = (number.simd_ge(FIRST), (number & (FIRST | ENTRY)).simd_eq(ENTRY));
    let wall_look = (number & (FIRST | ENTRY | WALL)).simd_eq(WALL);
    let (block, piece) = source.numbers(simd, number, frame.first - 1, first, entry);
    let high = piece | high;
    let [choice, b, c, u] = philox(simd, block, high, sample, pixel, key);
    let lobe = hg_sample(g, towards, unit(b), unit(c));
    let sure = first | wall_look;
    let given = sure | entry;
    let goes_on = (choice >> 31).simd_eq(0) | given;
    let e =
        V { x: choose(goes_on, own.x, lobe.x), y: choose(goes_on, own.y, lobe.y), z: choose(goes_on, own.z, lobe.z) };
    let ratio = hg_denominator(g, came.dot(e)) / hg_denominator(g, e.dot(towards));
    let balance = choose(given, splat(simd, 1.0), 2.0 / (1.0 + ratio * ratio.sqrt()));
    let (mut steepness, mut incidence) = steepness(simd, frame, r, towards, (wall, wall_body, &normals), e);
    if frame.walls.is_some() {
        steepness = choose(known, steepness, splat(simd, 0.0));
        incidence = choose(known, incidence, splat(simd, 1.0));
    }
    // Nor are the camera's and those from walls looked for by roulette. See `nee::depth`.
    let depth = tau * incidence.abs();
    let depth = choose(depth.simd_gt(least), depth, least);
    let rarity = choose(sure, splat(simd, 1.0), rarity(simd, depth));
    let chosen = waiting & (roulette * rarity).simd_lt(1.0);
    let mut along = spans(simd, frame, r, e);
    let rate = falling(simd, steepness, mu_t);
    if !frame.ground.meshes.is_empty() {
        let until = choose(rate.simd_gt(mu_t * 0.1), GONE / rate, splat(simd, f32::INFINITY));
        frame.ground.add_ahead(simd, chosen, body, r, e, until, &mut along);
    }
    let (length, _) = first_piece(simd, frame, body, r, &along);
    let (s, inverse_density) = ahead(simd, rate, length, mu_t, unit(!u));
    if frame.counts {
        add_in_own(&mut lengths, frame, body, s);
    }
    Line {
        looked: chosen & length.simd_gt(0.0),
        r: r.plus(s, e),
        e,
        s,
        mu_t,
        g,
        fraction: weight * rarity * (balance * inverse_density * mu_s),
        lengths,
        block,
        place: first.select(piece, U::splat(simd, 0)),
    }
}

impl<S: Simd> Line<S> {
    /// What its point sees of a source.
    #[inline(always)]
    fn sees(&self, simd: S, frame: &Frame<'_>, source: &Source, sight: &Sight<S>) -> Seen<S> {
        let zero = splat(simd, 0.0);
        let &Sight { towards, tau, blocked, foot, gain, .. } = sight;
        let Arrival { irradiance, lit, x, y } = source.arrives(simd, foot);
        let dark = self.mu_t * self.s + tau;
        let q = hg_denominator(self.g, self.e.dot(towards));
        let p = (1.0 - self.g) * (1.0 + self.g) * (0.25 * std::f32::consts::FRAC_1_PI) / (q * q.sqrt());
        let seen = self.looked & lit & !blocked & dark.simd_lt(DARK);
        let radiance = choose(seen, self.fraction * p * (irradiance * gain) * exp(-dark.min(splat(simd, DARK))), zero);
        // What each channel sees of it.
        let mut seen_in = [radiance; MOST_CHANNELS];
        if frame.counts {
            let mut lengths = self.lengths;
            add_along(simd, &mut lengths, frame, self.r, sight);
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

    /// Leaves ways that lanes do not know to the scalar walker: one of them by chance, or all of them.
    #[inline(always)]
    fn leave(
        &self,
        simd: S,
        detours: &mut Vec<Detour>,
        ray: &Ray<S>,
        left: M<S>,
        known: impl Fn(usize) -> Option<KnownWay>,
    ) {
        let scattered = self.fraction * exp(-(self.mu_t * self.s).min(splat(simd, DARK)));
        let (r, e) = (self.r, self.e);
        for i in bits(left.to_bitmask()) {
            detours.push(Detour {
                number: self.block.as_slice()[i],
                sample: ray.sample.as_slice()[i],
                pixel: ray.pixel.as_slice()[i],
                path: ray.path.as_slice()[i],
                r: [r.x, r.y, r.z].map(|x| x.as_slice()[i]),
                e: [e.x, e.y, e.z].map(|x| x.as_slice()[i]),
                g: self.g.as_slice()[i],
                fraction: scattered.as_slice()[i],
                lengths: std::array::from_fn(|k| self.lengths.get(k).map_or(0.0, |l| l.as_slice()[i])),
                place: self.place.as_slice()[i],
                known: known(i),
            });
        }
    }
}

/// Whether `Walker::detour`, or `Walker::by_chance`, looks at all.
#[inline(always)]
fn tries<S: Simd>(simd: S, key: [u32; 2], high: u32, ray: &Ray<S>, line: &Line<S>) -> M<S> {
    let word = whether_projected(simd, line.place) | high;
    let [chance, ..] = philox(simd, line.block, word, ray.sample, ray.pixel, key);
    chance.simd_lt((DETOURS * 4_294_967_296.0) as u32)
}

/// Every way by one refraction, and others by chance; where lanes know none, or do not know, all is left to the scalar walker.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "all that a look is made of")]
fn see_through_walls<S: Simd>(
    simd: S,
    detours: &mut Vec<Detour>,
    source: &Source,
    key: [u32; 2],
    high: u32,
    ray: &Ray<S>,
    line: &Line<S>,
    deposit: &mut Deposit<'_>,
) {
    let frame = deposit.frame;
    let Some(walls) = &frame.walls else { return };
    let mut ways: [Option<Way<S>>; MOST_FACES] = [None; MOST_FACES];
    // Of each lane the first way that there is, and by bits the lanes that each of the others has found, too.
    let mut first = walls.way(simd, frame, 0, line.looked, line.r);
    let mut others = [0; MOST_FACES];
    ways[0] = Some(first);
    for (i, face) in walls.faces.iter().enumerate().skip(1) {
        let mut way = walls.way(simd, frame, i, line.looked, line.r);
        for same in face.same() {
            if let Some(before) = ways.get(same).and_then(Option::as_ref) {
                way.found &= !before.found;
            }
        }
        others[i] = (way.found & first.found).to_bitmask();
        ways[i] = Some(way);
        first = first.or(first.found | !way.found, &way);
    }
    let found = first.found & !first.unsure;
    let several = others.iter().fold(0, |several, others| several | others) & found.to_bitmask();
    // Lane by lane where one has several: that a path's looks are added one by one must not depend on which go together.
    let (mut start, mut rest) = (0, several);
    loop {
        let last = rest.trailing_zeros().min(LANES as u32 - 1);
        rest &= !(1 << last);
        let segment = ((2_u64 << last) - 1) & !((1 << start) - 1);
        for (i, others) in [segment].iter().chain(&others).enumerate() {
            let (way, seen) = match i {
                0 => (Some(&first), *others),
                _ => (ways[i - 1].as_ref(), others & several & segment & (1 << last)),
            };
            let seen = seen & found.to_bitmask();
            if let (Some(way), true) = (way, seen != 0) {
                let seen = line.sees(simd, frame, source, &way.sight(!M::from_bitmask(simd, seen)));
                deposit.add_projected(simd, &seen);
            }
        }
        start = last + 1;
        if start == LANES as u32 {
            break;
        }
    }
    let wholly = line.looked & !found;
    let tried = line.looked & !wholly & tries(simd, key, high, ray, line);
    let dark = first.tau.max(splat(simd, 0.0)).min(splat(simd, DARK));
    let strength = source.arrives(simd, first.foot).irradiance * first.gain * exp(-dark);
    let known = found.to_bitmask();
    line.leave(simd, detours, ray, tried | wholly, |i| {
        let at = |v: V<S>| [v.x, v.y, v.z].map(|x| x.as_slice()[i]);
        let (strength, towards, normal) = (strength.as_slice()[i], at(first.towards), at(first.normal));
        (known >> i & 1 == 1).then_some(KnownWay { strength, towards, normal })
    });
}

/// One over the probability of looking; see `nee::rarity`.
#[inline(always)]
pub fn rarity<S: Simd>(simd: S, tau: F<S>) -> F<S> {
    let x = (tau * (1.0 / TAU_SURE as f32)).max(splat(simd, 1.0));
    let square = x * x;
    square * square
}

/// The rate of the density along the line by its steepness; see `crate::look::ahead`.
#[inline(always)]
fn falling<S: Simd>(simd: S, steepness: F<S>, mu_t: F<S>) -> F<S> {
    let known = steepness.simd_eq(steepness);
    choose(known, (1.0 - steepness).max(splat(simd, -1.0)).min(splat(simd, 2.0)), splat(simd, 1.0)) * mu_t
}

/// s in (0, length) from a density proportional to exp(-rate s), and one over that density; see `crate::look::ahead`.
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
