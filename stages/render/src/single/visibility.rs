//! What lies between points and a light, and ahead of them, in f32 lanes.

use arrayvec::ArrayVec;
use fearless_simd::prelude::*;

use super::facets::bits;
use super::frame::Frame;
use super::ground::{Chord, Chords};
use super::lane::{F, M, U, V, apart, choose, splat};
use super::limits::{MOST_BODIES, SLIVER};
use super::rows::Counts;
use super::source::Source;
use crate::lengths::MOST_LENGTHS;

/// Where lines to the light meet bodies. It is filled in place: too large to be handed over.
pub struct Met<S: Simd> {
    pub chords: Chords<S>,
    /// Where there are meshes, of each body; that of a mesh where the line first meets it. Neither their lengths nor their signs matter.
    pub normals: ArrayVec<V<S>, MOST_BODIES>,
}

impl<S: Simd> Met<S> {
    #[inline(always)]
    pub fn new() -> Self {
        Self { chords: Chords::new(), normals: ArrayVec::new() }
    }
}

/// What lies between points and the light.
pub struct Visibility<S: Simd> {
    /// Unit vector from the point against the light.
    pub towards: V<S>,
    pub tau: F<S>,
    /// mm of that line, and by bits the lanes in which it comes back to a mesh.
    pub length: F<S>,
    pub again: u64,
    pub blocked: M<S>,
    /// From where light comes straight from the projector, and what of the irradiance there reaches the point.
    pub foot: V<S>,
    pub gain: F<S>,
}

/// Of those lanes that are asked, with where their lines have `met` bodies; of the others the meshes are left out.
#[inline(always)]
pub fn visibility<S: Simd>(
    simd: S,
    frame: &Frame<'_>,
    source: &Source,
    asked: M<S>,
    p: V<S>,
    Met { chords, normals }: &mut Met<S>,
) -> Visibility<S> {
    apart::<S, _>(
        #[inline(always)]
        || {
            normals.clear();
            let Some(plane) = &frame.plane else {
                let (towards, distance) = source.towards(p);
                find_chords(simd, frame, p, towards, chords);
                let mut again = 0;
                if !frame.ground.meshes.is_empty() {
                    let zero = splat(simd, 0.0);
                    normals.extend((0..frame.ground.bodies()).map(|_| V { x: zero, y: zero, z: zero }));
                    again = frame.ground.add_towards_light(simd, asked, p, towards, distance, chords, normals);
                }
                let mut tau = optical_depth(simd, frame, chords, distance);
                if again != 0 {
                    let mut depths = tau.to_array();
                    for lane in bits(again) {
                        let segments = frame.ground.segments_to_light(simd, lane, (p, towards, distance), chords);
                        depths[lane] = segments.iter().map(|&(j, length)| frame.mu_t[j] * length).sum();
                    }
                    tau = F::load_array(simd, depths);
                }
                let blocked = blocked(simd, frame, chords, distance);
                return Visibility { towards, tau, length: distance, again, blocked, foot: p, gain: splat(simd, 1.0) };
            };
            let refraction = plane.refraction(simd, source.position, p);
            find_chords(simd, frame, p, refraction.towards, chords);
            let tau = optical_depth(simd, frame, chords, refraction.length);
            let stopped = blocked(simd, frame, chords, refraction.length);
            let (towards, length) = (refraction.towards, refraction.length);
            let (foot, gain) = (refraction.foot, refraction.gain);
            Visibility { towards, tau, length, again: 0, blocked: stopped, foot, gain }
        },
    )
}

/// Meshes apart.
#[inline(always)]
pub fn chords<S: Simd>(simd: S, frame: &Frame<'_>, r: V<S>, w: V<S>) -> Chords<S> {
    let mut chords = Chords::new();
    find_chords(simd, frame, r, w, &mut chords);
    chords
}

/// The same in place of what was there.
#[inline(always)]
pub fn find_chords<S: Simd>(simd: S, frame: &Frame<'_>, r: V<S>, w: V<S>, chords: &mut Chords<S>) {
    let nowhere = Chord { enter: splat(simd, 0.0), leave: splat(simd, 0.0) };
    chords.clear();
    for j in 0..frame.ground.bodies() {
        chords.push(if frame.ground.is_mesh(j) { nowhere } else { frame.ground.chord(simd, j, r, w) });
    }
}

/// Where the segment of the own medium that a ray starts in ends, and at which body's surface.
#[inline(always)]
pub fn first_segment<S: Simd>(simd: S, frame: &Frame<'_>, body: U<S>, r: V<S>, chords: &[Chord<S>]) -> (F<S>, U<S>) {
    apart::<S, _>(
        #[inline(always)]
        || {
            let (mut distance, mut interface) = (splat(simd, f32::INFINITY), U::splat(simd, 0));
            for (j, chord) in chords.iter().enumerate() {
                let j = j as u32;
                // Its own body ends it by its exit, one of higher priority by its entry: not one that is missed or behind. A ray may start where such a
                // one ends, whatever rounding says: its middle tells.
                let own = body.simd_eq(j);
                let carves =
                    body.simd_gt(j) & chord.enter.simd_lt(chord.leave) & (chord.enter + chord.leave).simd_gt(0.0);
                let end = choose(own, chord.leave, chord.enter);
                let nearer = (carves | own) & end.simd_lt(distance);
                distance = choose(nearer, end, distance);
                interface = nearer.select(U::splat(simd, j), interface);
            }
            if frame.repeated {
                go_on(simd, frame, body, r, chords, &mut distance, &mut interface);
            }
            (distance, interface)
        },
    )
}

/// On through bodies of the same medium: where they touch they are one.
#[inline(always)]
fn go_on<S: Simd>(
    simd: S,
    frame: &Frame<'_>,
    body: U<S>,
    r: V<S>,
    chords: &[Chord<S>],
    distance: &mut F<S>,
    interface: &mut U<S>,
) {
    let (zero, never) = (splat(simd, 0.0), splat(simd, f32::INFINITY));
    let mut medium = U::splat(simd, 0);
    for (j, part) in frame.parts.iter().enumerate() {
        medium = body.simd_eq(j as u32).select(U::splat(simd, part.material as u32), medium);
    }
    let size = r.x.abs().max(r.y.abs().max(r.z.abs()));
    let mut goes_on = M::splat(simd, true);
    // A line is in each body once, so that there are no more segments.
    for _ in 1..2 * MOST_BODIES {
        let reached = distance.max(zero);
        let behind = reached + (reached + size) * SLIVER;
        let (mut its, mut end, mut ends) = (U::splat(simd, 0), never, *interface);
        // From the lowest priority upwards: what holds the place ends there, or where a higher body begins.
        for (j, (chord, part)) in chords.iter().zip(&frame.parts).enumerate().rev() {
            let hit = chord.enter.simd_lt(chord.leave) & chord.leave.simd_gt(behind);
            let holds = hit & chord.enter.simd_le(behind);
            let comes = hit & !holds & chord.enter.simd_lt(end);
            its = holds.select(U::splat(simd, part.material as u32), its);
            end = choose(holds, chord.leave, choose(comes, chord.enter, end));
            ends = (holds | comes).select(U::splat(simd, j as u32), ends);
        }
        goes_on &= its.simd_eq(medium) & end.simd_lt(never);
        if goes_on.all_false() {
            break;
        }
        *distance = choose(goes_on, end, *distance);
        *interface = goes_on.select(ends, *interface);
    }
}

/// Optical depth along the first `distance` of rays.
#[inline(always)]
fn optical_depth<S: Simd>(simd: S, frame: &Frame<'_>, chords: &[Chord<S>], distance: F<S>) -> F<S> {
    let mut tau = splat(simd, 0.0);
    for (j, &mu_t) in frame.mu_t.iter().enumerate().filter(|(_, mu_t)| **mu_t > 0.0) {
        tau += own_length(simd, chords, j, distance) * mu_t;
    }
    tau
}

/// Along the first `distance` of rays what of body j is not carved out by those of higher priority, the first in `chords`: by inclusion and exclusion over the sets of these
/// that have a part in common with it. Each set follows the one without its last body, so those of which no lane meets a common part are passed over with all that hold them.
#[inline(always)]
pub fn own_length<S: Simd>(simd: S, chords: &[Chord<S>], j: usize, distance: F<S>) -> F<S> {
    apart::<S, _>(
        #[inline(always)]
        || {
            let zero = splat(simd, 0.0);
            let Chord { enter, leave } = chords[j];
            let whole = Chord { enter: enter.max(zero), leave: leave.min(distance) };
            let mut length = (whole.leave - whole.enter).max(zero);
            // What the sets up to the present one have in common, and the last body of each.
            let (mut common, mut last, mut next) =
                (ArrayVec::<_, MOST_BODIES>::new(), ArrayVec::<_, MOST_BODIES>::new(), 0);
            loop {
                if next == j {
                    common.pop();
                    let Some(k) = last.pop() else { break };
                    next = k + 1;
                    continue;
                }
                let (inner, outer) = (chords[next], *common.last().unwrap_or(&whole));
                let both = Chord { enter: inner.enter.max(outer.enter), leave: inner.leave.min(outer.leave) };
                if both.enter.simd_lt(both.leave).any_true() {
                    let part = (both.leave - both.enter).max(zero);
                    length = if last.len() % 2 == 0 { length - part } else { length + part };
                    common.push(both);
                    last.push(next);
                }
                next += 1;
            }
            length
        },
    )
}

/// Whether an opaque body stands in the first `distance` of rays; nothing carves those.
#[inline(always)]
fn blocked<S: Simd>(simd: S, frame: &Frame<'_>, chords: &[Chord<S>], distance: F<S>) -> M<S> {
    let mut blocked = M::splat(simd, false);
    for (chord, _) in chords.iter().zip(&frame.opaque).filter(|(_, opaque)| **opaque) {
        blocked |= chord.enter.simd_lt(chord.leave) & chord.leave.simd_gt(0.0) & chord.enter.simd_lt(distance);
    }
    blocked
}

/// (e . n) / (L . n), n the normal of the interface through which the light comes (its distance, its body, and normals of meshes); and L . n.
#[inline(always)]
pub fn steepness<S: Simd>(
    simd: S,
    frame: &Frame<'_>,
    r: V<S>,
    towards: V<S>,
    (interface, interface_body, normals): (F<S>, U<S>, &[V<S>]),
    e: V<S>,
) -> (F<S>, F<S>) {
    apart::<S, _>(
        #[inline(always)]
        || {
            let (mut ratio, mut cos) = (splat(simd, 0.0), splat(simd, 1.0));
            let p = r.plus(interface, towards);
            for j in 0..frame.ground.bodies() {
                let n = match normals.get(j) {
                    Some(&facet) if frame.ground.is_mesh(j) => facet,
                    _ => frame.ground.normal(simd, j, p),
                };
                let (through, its) = (towards.dot(n), interface_body.simd_eq(j as u32));
                ratio = choose(its, e.dot(n) / through, ratio);
                cos = choose(its, through / n.dot(n).sqrt(), cos);
            }
            (ratio, cos)
        },
    )
}

/// Adds a stretch within the own body to the lengths by which channels differ.
#[inline(always)]
pub fn add_in_own<S: Simd>(lengths: &mut Counts<S>, frame: &Frame<'_>, body: U<S>, s: F<S>) {
    let zero = splat(s.token(), 0.0);
    for (j, &place) in frame.counted.iter().enumerate().filter(|(_, place)| **place < MOST_LENGTHS) {
        lengths[place] += choose(body.simd_eq(j as u32), s, zero);
    }
}

/// Adds what the lines to the light have in each body and is not carved out.
#[inline(always)]
pub fn add_along<S: Simd>(
    simd: S,
    lengths: &mut Counts<S>,
    frame: &Frame<'_>,
    p: V<S>,
    visibility: &Visibility<S>,
    chords: &[Chord<S>],
) {
    let before = *lengths;
    let Visibility { towards, length: distance, again, .. } = visibility;
    for (j, &place) in frame.counted.iter().enumerate().filter(|(_, place)| **place < MOST_LENGTHS) {
        lengths[place] += own_length(simd, chords, j, *distance);
    }
    for lane in bits(*again) {
        let mut sums = before.map(|length| length.as_slice()[lane]);
        for (j, length) in frame.ground.segments_to_light(simd, lane, (p, *towards, *distance), chords) {
            if frame.counted[j] < MOST_LENGTHS {
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
