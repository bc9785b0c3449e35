//! Looks for light one scattering ahead, in f32 lanes: `Walker::look_ahead` for worlds of few transparent bodies.

use fearless_simd::prelude::*;

use super::bend::Detour;
use super::frame::{Frame, Lamp, MOST_CHANNELS};
use super::ground::Span;
use super::lane::{F, LANES, M, U, V, choose, exp, hg_denominator, hg_sample, ln, philox, sin_cos_turns, splat, unit};
use super::mesh::bits;
use super::rows::Rows;
use crate::channels::MOST_LENGTHS;
use crate::link::DETOURS;
use crate::look::FLAT;
use crate::nee::{ENTERED, TAU_SURE};
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
    frame: &Frame,
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
    frame: &Frame,
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

/// The first 16 looks, or as many as there are: adds to the responses of their paths, which are as
/// [`Layout`](crate::response::Layout) says.
#[inline(always)]
fn look<S: Simd, const LENGTHS: usize>(
    simd: S,
    looks: &mut Looks<LENGTHS>,
    frame: &Frame,
    key: [u32; 2],
    high: u32,
    responses: &mut [f64],
) {
    let (floats, [number, sample, pixel, path, body], mut lengths) = looks.rays.load(simd);
    let [rx, ry, rz, cx, cy, cz, ox, oy, oz, weight, roulette, mu_a, mu_s, g, least] = floats;
    let (r, came, own) = (V { x: rx, y: ry, z: rz }, V { x: cx, y: cy, z: cz }, V { x: ox, y: oy, z: oz });
    let (zero, mu_t) = (splat(simd, 0.0), mu_a + mu_s);
    let count = looks.rays.len().min(LANES);
    let waiting = M::from_bitmask(simd, (1 << count) - 1);
    let Sight { towards, spans: to_light, normals, tau, .. } = sight(simd, frame, waiting, r);
    let (wall, wall_body) = first_piece(simd, frame, body, &to_light);

    // The line: along the path's own direction, or one from the lobe around the light. Rays that come in from outside have no choice.
    let (first, entry) = (number.simd_ge(FIRST), (number & (FIRST | ENTRY)).simd_eq(ENTRY));
    let wall_look = (number & (FIRST | ENTRY | WALL)).simd_eq(WALL);
    let block = first.select(U::splat(simd, frame.first - 1), number & (WALL - 1));
    let piece = entry.select(U::splat(simd, ENTERED), U::splat(simd, 0));
    let high = first.select(number & (FIRST - 1), piece) | high;
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
    let (length, _) = first_piece(simd, frame, body, &along);
    let (s, inverse_density) = ahead(simd, rate, length, mu_t, unit(!u));
    let r1 = r.plus(s, e);
    let looked = chosen & length.simd_gt(0.0);
    let sight1 = sight(simd, frame, looked, r1);
    let Sight { towards: towards1, tau: tau1, blocked, foot, gain, .. } = sight1;
    let (irradiance, lit, x, y) = arrives(simd, &frame.light, foot);
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
        let mut tried = (looked & chance.simd_lt((DETOURS * 4_294_967_296.0) as u32)).to_bitmask() & ((1 << count) - 1);
        let scattered = fraction * exp(-(mu_t * s).min(splat(simd, DARK)));
        while tried != 0 {
            let i = tried.trailing_zeros() as usize;
            tried &= tried - 1;
            looks.detours.push(Detour {
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
    let (stride, channels) = (frame.stride, if LENGTHS == 0 { 1 } else { frame.channels.len() });
    let mut add = |place: usize, x: F<S>, irradiance: f64| {
        for (&path, &x) in path.as_slice()[..count].iter().zip(x.as_slice()) {
            responses[path as usize * stride + place] += f64::from(x) * irradiance;
        }
    };
    // What each channel sees of it.
    let mut seen_in = [radiance; MOST_CHANNELS];
    if LENGTHS > 0 {
        add_along(simd, &mut lengths, frame, r1, &sight1);
        for (of, channel) in seen_in.iter_mut().zip(&frame.channels) {
            if channel.excess == [0.0; MOST_LENGTHS] {
                // It is that of the walk, to the last digit.
                continue;
            }
            let depth = lengths.iter().zip(channel.excess).fold(zero, |sum, (&length, excess)| sum + length * excess);
            // Lengths of lanes that see nothing need not be numbers.
            *of = choose(seen, radiance * exp(-depth.min(splat(simd, DARK))), zero);
        }
    }
    let irradiance =
        |channel: usize| if LENGTHS == 0 { frame.light.irradiance } else { frame.channels[channel].irradiance };
    let width = stride / channels;
    for (channel, &radiance) in seen_in[..channels].iter().enumerate() {
        add(channel * width, radiance, irradiance(channel));
    }
    for (j, &[along_x, along_y, start]) in frame.carriers.iter().enumerate() {
        // Outside the field the place on its plane means nothing, not even a number.
        let (x, y) = (choose(seen, x, zero), choose(seen, y, zero));
        let (sin, cos) = sin_cos_turns(x * along_x + y * along_y + start);
        for (channel, &radiance) in seen_in[..channels].iter().enumerate() {
            add(channel * width + 1 + 2 * j, radiance * cos, irradiance(channel));
            add(channel * width + 2 + 2 * j, radiance * sin, irradiance(channel));
        }
    }
}

/// Adds a stretch within the own body to the lengths by which channels differ.
#[inline(always)]
fn add_in_own<S: Simd, const LENGTHS: usize>(lengths: &mut [F<S>; LENGTHS], frame: &Frame, body: U<S>, s: F<S>) {
    let zero = splat(s.token(), 0.0);
    for (j, &place) in frame.counted.iter().enumerate().filter(|(_, place)| **place < LENGTHS) {
        lengths[place] += choose(body.simd_eq(j as u32), s, zero);
    }
}

/// Adds what the lines to the light have in each body and is not carved out; as in [`optical_depth`].
#[inline(always)]
fn add_along<S: Simd, const LENGTHS: usize>(
    simd: S,
    lengths: &mut [F<S>; LENGTHS],
    frame: &Frame,
    p: V<S>,
    sight: &Sight<S>,
) {
    let (zero, before) = (splat(simd, 0.0), *lengths);
    let Sight { towards, spans, length: distance, again, .. } = sight;
    for (j, &place) in frame.counted.iter().enumerate().filter(|(_, place)| **place < LENGTHS) {
        for set in 0..1_usize << j {
            let (mut enter, mut leave) = (spans[j].enter.max(zero), spans[j].leave.min(*distance));
            for (k, span) in spans[..j].iter().enumerate() {
                if set >> k & 1 == 1 {
                    (enter, leave) = (span.enter.max(enter), span.leave.min(leave));
                }
            }
            let common = (leave - enter).max(zero);
            lengths[place] = if set.count_ones() % 2 == 0 { lengths[place] + common } else { lengths[place] - common };
        }
    }
    for lane in bits(*again) {
        let mut sums = before.map(|length| length.as_slice()[lane]);
        for (j, length) in frame.ground.pieces_to_light(simd, lane, (p, *towards, *distance), spans) {
            if frame.counted[j] < LENGTHS {
                sums[frame.counted[j]] += length;
            }
        }
        for (length, sum) in lengths.iter_mut().zip(sums) {
            let mut lanes = length.to_array();
            lanes[lane] = sum;
            *length = F::load_array(simd, lanes);
        }
    }
}

/// Unit vector to the light, and the distance.
#[inline(always)]
fn to_light<S: Simd>(p: V<S>, lamp: &Lamp) -> (V<S>, F<S>) {
    let d = p.from(lamp.position).times(splat(p.x.token(), -1.0));
    let distance = d.dot(d).sqrt();
    (d.times(1.0 / distance), distance)
}

/// What lies between points and the light.
struct Sight<S: Simd> {
    /// Unit vector from the point against the light, and where its line meets the bodies.
    towards: V<S>,
    spans: Spans<S>,
    /// Of meshes, where the line first meets each.
    normals: [V<S>; MOST_BODIES],
    tau: F<S>,
    /// mm of that line, and by bits the lanes in which it comes back to a mesh.
    length: F<S>,
    again: u64,
    blocked: M<S>,
    /// From where light comes straight from the projector, and what of the irradiance there reaches the point.
    foot: V<S>,
    gain: F<S>,
}

/// Of those lanes that are asked; of the others the meshes are left out.
#[inline(always)]
fn sight<S: Simd>(simd: S, frame: &Frame, asked: M<S>, p: V<S>) -> Sight<S> {
    let zero = splat(simd, 0.0);
    let mut normals = [V { x: zero, y: zero, z: zero }; MOST_BODIES];
    let Some(plane) = &frame.plane else {
        let (towards, distance) = to_light(p, &frame.light);
        let mut spans = spans(simd, frame, p, towards);
        let mut again = 0;
        if !frame.ground.meshes.is_empty() {
            again = frame.ground.add_towards_light(simd, asked, p, towards, distance, &mut spans, &mut normals);
        }
        let mut tau = optical_depth(simd, frame, &spans, distance);
        if again != 0 {
            let mut depths = tau.to_array();
            for lane in bits(again) {
                let pieces = frame.ground.pieces_to_light(simd, lane, (p, towards, distance), &spans);
                depths[lane] = pieces.iter().map(|&(j, length)| frame.mu_t[j] * length).sum();
            }
            tau = F::load_array(simd, depths);
        }
        let blocked = blocked(simd, frame, &spans, distance);
        return Sight {
            towards,
            spans,
            normals,
            tau,
            length: distance,
            again,
            blocked,
            foot: p,
            gain: splat(simd, 1.0),
        };
    };
    let way = plane.way(simd, &frame.light, p);
    let inside = spans(simd, frame, p, way.towards);
    let tau = optical_depth(simd, frame, &inside, way.length);
    let stopped = blocked(simd, frame, &inside, way.length);
    let (towards, length) = (way.towards, way.length);
    let (foot, gain) = (way.foot, way.gain);
    Sight { towards, spans: inside, normals, tau, length, again: 0, blocked: stopped, foot, gain }
}

/// (irradiance, whether it is lit, where on the pattern's plane) by the straight line.
#[inline(always)]
fn arrives<S: Simd>(simd: S, lamp: &Lamp, p: V<S>) -> (F<S>, M<S>, F<S>, F<S>) {
    let (towards, distance) = to_light(p, lamp);
    // Along the ray from the light by what the plane is away from p: no digits are lost where that is little.
    let d = p.from(lamp.position);
    let f = (lamp.plane - p.z) / d.z;
    let (x, y) = (p.x + f * d.x, p.y + f * d.y);
    let (u, v) = (x - lamp.center[0], y - lamp.center[1]);
    let across = (u * lamp.right[0] + v * lamp.right[1]).abs().simd_le(lamp.half[0]);
    let along = (u * lamp.top[0] + v * lamp.top[1]).abs().simd_le(lamp.half[1]);
    // Behind the light 1 + f < 0.
    let ahead = (1.0 + f).simd_gt(0.0) & f.abs().simd_lt(f32::INFINITY);
    let strength = if lamp.flat {
        // On the plane E = I cos / R^2 with R = h / cos.
        let cos = towards.z.abs();
        lamp.strength / (cos * cos * cos)
    } else {
        splat(simd, lamp.strength)
    };
    (strength / (distance * distance), ahead & across & along, x, y)
}

pub type Spans<S> = [Span<S>; MOST_BODIES];

/// Meshes apart.
#[inline(always)]
fn spans<S: Simd>(simd: S, frame: &Frame, r: V<S>, w: V<S>) -> Spans<S> {
    let nowhere = Span { enter: splat(simd, 0.0), leave: splat(simd, 0.0) };
    let mut spans = [nowhere; MOST_BODIES];
    for (j, span) in spans.iter_mut().enumerate().take(frame.ground.bodies()) {
        if !frame.ground.is_mesh(j) {
            *span = frame.ground.span(simd, j, r, w);
        }
    }
    spans
}

/// Where the piece of the own body that a ray starts in ends, and at which body's surface.
#[inline(always)]
fn first_piece<S: Simd>(simd: S, frame: &Frame, body: U<S>, spans: &Spans<S>) -> (F<S>, U<S>) {
    let (mut distance, mut wall) = (splat(simd, f32::INFINITY), U::splat(simd, 0));
    for (j, span) in spans.iter().enumerate().take(frame.ground.bodies()) {
        let j = j as u32;
        // Its own body ends it by its exit, one of higher priority by its entry: not one that is missed or behind. A ray may start where such a
        // one ends, whatever rounding says: its middle tells.
        let own = body.simd_eq(j);
        let carves = body.simd_gt(j) & span.enter.simd_lt(span.leave) & (span.enter + span.leave).simd_gt(0.0);
        let end = choose(own, span.leave, span.enter);
        let nearer = (carves | own) & end.simd_lt(distance);
        distance = choose(nearer, end, distance);
        wall = nearer.select(U::splat(simd, j), wall);
    }
    (distance, wall)
}

/// Along the first `distance` of rays: what of each body is not carved out by those of higher priority, by inclusion and exclusion.
#[inline(always)]
fn optical_depth<S: Simd>(simd: S, frame: &Frame, spans: &Spans<S>, distance: F<S>) -> F<S> {
    let (zero, mut tau) = (splat(simd, 0.0), splat(simd, 0.0));
    for (j, &mu_t) in frame.mu_t.iter().enumerate() {
        if mu_t == 0.0 {
            continue;
        }
        // Lengths common to body j and to every one of a set of higher bodies, the set by its bits.
        for set in 0..1_usize << j {
            let sign = if set.count_ones() % 2 == 0 { mu_t } else { -mu_t };
            let (mut enter, mut leave) = (spans[j].enter.max(zero), spans[j].leave.min(distance));
            for (k, span) in spans[..j].iter().enumerate() {
                if set >> k & 1 == 1 {
                    (enter, leave) = (span.enter.max(enter), span.leave.min(leave));
                }
            }
            tau += (leave - enter).max(zero) * sign;
        }
    }
    tau
}

/// Whether an opaque body stands in the first `distance` of rays; nothing carves those.
#[inline(always)]
fn blocked<S: Simd>(simd: S, frame: &Frame, spans: &Spans<S>, distance: F<S>) -> M<S> {
    let mut blocked = M::splat(simd, false);
    for (span, _) in spans.iter().zip(&frame.opaque).filter(|(_, opaque)| **opaque) {
        blocked |= span.enter.simd_lt(span.leave) & span.leave.simd_gt(0.0) & span.enter.simd_lt(distance);
    }
    blocked
}

/// (e . n) / (L . n), n the normal of the wall through which the light comes (its distance, its body, and normals of meshes); and L . n.
#[inline(always)]
fn steepness<S: Simd>(
    simd: S,
    frame: &Frame,
    r: V<S>,
    towards: V<S>,
    (wall, wall_body, normals): (F<S>, U<S>, &[V<S>; MOST_BODIES]),
    e: V<S>,
) -> (F<S>, F<S>) {
    let (mut ratio, mut cos) = (splat(simd, 0.0), splat(simd, 1.0));
    let p = r.plus(wall, towards);
    for (j, &facet) in normals.iter().enumerate().take(frame.ground.bodies()) {
        let n = if frame.ground.is_mesh(j) { facet } else { frame.ground.normal(simd, j, p) };
        let (through, its) = (towards.dot(n), wall_body.simd_eq(j as u32));
        ratio = choose(its, e.dot(n) / through, ratio);
        cos = choose(its, through / n.dot(n).sqrt(), cos);
    }
    (ratio, cos)
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
