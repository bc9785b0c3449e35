//! Looks for light one scattering ahead, in f32 lanes: `Walker::look_ahead` for worlds of few transparent bodies.

use fearless_simd::prelude::*;

use super::bend::Detour;
use super::deposit::{Deposit, Seen};
use super::frame::{Frame, MOST_CHANNELS};
use super::lane::{F, LANES, M, U, V, choose, exp, hg_denominator, hg_sample, ln, philox, splat, unit};
use super::mesh::bits;
use super::rows::Rows;
use super::sight::{Sight, add_along, add_in_own, first_piece, sight, spans, steepness};
use super::source::{Arrival, Source};
use crate::channels::MOST_LENGTHS;
use crate::link::DETOURS;
use crate::look::FLAT;
use crate::nee::TAU_SURE;
use crate::stream::{ASIDE, aside_code};

/// Optical depth (optical distance to the light) beyond which it counts as none: e^-80 of it.
pub const DARK: f32 = 80.0;

/// Of a density e^-x what lies behind this x is nothing to f32.
const GONE: f32 = 17.0;

/// Overlaps are resolved for so many bodies at most.
pub const MOST_BODIES: usize = 4;

/// The number of a look along a camera's ray, whose lower bits say in which piece of it, among those that scatter.
pub const FIRST: u32 = 1 << 31;
/// The number of a look from where a flight, by its block of random numbers, comes into a medium from elsewhere. Others have the (odd) block behind
/// their flight's.
pub const ENTRY: u32 = 1 << 30;
/// The same of a look along a flight that a wall has turned.
pub const WALL: u32 = 1 << 29;

/// Columns: r, the direction in which the path came, the one in which it goes on, weight, roulette, mu_a, mu_s, g, optical distance of
/// the nearest surface; number, sample, pixel, response, body.
pub type Rays<const LENGTHS: usize> = Rows<15, 5, LENGTHS>;

/// What waits for being looked at.
#[derive(Clone, Debug, Default)]
pub struct Looks<const LENGTHS: usize> {
    pub rays: Rays<LENGTHS>,
    /// Where light bends.
    pub detours: Vec<Detour>,
}

/// Looks for light while so many wait.
#[inline(always)]
pub fn look_while<S: Simd, const LENGTHS: usize>(
    simd: S,
    looks: &mut Looks<LENGTHS>,
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
fn look_once<S: Simd, const LENGTHS: usize>(
    simd: S,
    looks: &mut Looks<LENGTHS>,
    frame: &Frame<'_>,
    key: [u32; 2],
    high: u32,
    responses: &mut [f64],
) {
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
fn look<S: Simd, const LENGTHS: usize>(
    simd: S,
    looks: &mut Looks<LENGTHS>,
    frame: &Frame<'_>,
    key: [u32; 2],
    high: u32,
    responses: &mut [f64],
) {
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
    let channels = if LENGTHS == 0 { 1 } else { frame.channels.len() };
    let mut deposit = Deposit { frame, channels, paths: &path.as_slice()[..count], responses };
    // Of all lamps one sum: that a path's looks are added one by one must not depend on which go together.
    let mut steady = [splat(simd, 0.0); MOST_CHANNELS];
    for source in &frame.sources {
        let seen = see(simd, &mut looks.detours, frame, source, key, high, &ray);
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
struct Ray<S: Simd, const LENGTHS: usize> {
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
    lengths: [F<S>; LENGTHS],
}

/// What they see of a source.
#[inline(always)]
fn see<S: Simd, const LENGTHS: usize>(
    simd: S,
    detours: &mut Vec<Detour>,
    frame: &Frame<'_>,
    source: &Source,
    key: [u32; 2],
    high: u32,
    ray: &Ray<S, LENGTHS>,
) -> Seen<S> {
    let &Ray { waiting, r, came, own, weight, roulette, mu_a, mu_s, g, least, .. } = ray;
    let &Ray { number, sample, pixel, path, body, mut lengths, .. } = ray;
    let (zero, mu_t) = (splat(simd, 0.0), mu_a + mu_s);
    let Sight { towards, spans: to_light, normals, tau, .. } = sight(simd, frame, source, waiting, r);
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
    let (steepness, incidence) = steepness(simd, frame, r, towards, (wall, wall_body, &normals), e);
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
    let r1 = r.plus(s, e);
    let looked = chosen & length.simd_gt(0.0);
    let sight1 = sight(simd, frame, source, looked, r1);
    let Sight { towards: towards1, tau: tau1, blocked, foot, gain, .. } = sight1;
    let Arrival { irradiance, lit, x, y } = source.arrives(simd, foot);
    let dark = mu_t * s + tau1;
    let q = hg_denominator(g, e.dot(towards1));
    let p = (1.0 - g) * (1.0 + g) * (0.25 * std::f32::consts::FRAC_1_PI) / (q * q.sqrt());
    let seen = looked & lit & !blocked & dark.simd_lt(DARK);
    let fraction = weight * rarity * (balance * inverse_density * mu_s);
    let radiance = choose(seen, fraction * p * (irradiance * gain) * exp(-dark.min(splat(simd, DARK))), zero);

    if LENGTHS > 0 {
        add_in_own(&mut lengths, frame, body, s);
    }
    if frame.plane.as_ref().is_some_and(|plane| plane.detours) {
        // The first decision of `Walker::detour`.
        let high = high | (ASIDE << 16 | aside_code(0, 0, 1));
        let [chance, ..] = philox(simd, block, high, sample, pixel, key);
        let tried = looked & chance.simd_lt((DETOURS * 4_294_967_296.0) as u32);
        let scattered = fraction * exp(-(mu_t * s).min(splat(simd, DARK)));
        for i in bits(tried.to_bitmask()) {
            detours.push(Detour {
                number: block.as_slice()[i],
                sample: sample.as_slice()[i],
                pixel: pixel.as_slice()[i],
                path: path.as_slice()[i],
                r: [r1.x, r1.y, r1.z].map(|x| x.as_slice()[i]),
                e: [e.x, e.y, e.z].map(|x| x.as_slice()[i]),
                g: g.as_slice()[i],
                fraction: scattered.as_slice()[i],
                lengths: std::array::from_fn(|k| lengths.get(k).map_or(0.0, |l| l.as_slice()[i])),
            });
        }
    }
    // What each channel sees of it.
    let mut seen_in = [radiance; MOST_CHANNELS];
    if LENGTHS > 0 {
        add_along(simd, &mut lengths, frame, r1, &sight1);
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
