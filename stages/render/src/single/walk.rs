//! Paths walked side by side in f32.

use fearless_simd::prelude::*;
use turbid_optics::at_level;

use super::copies::Copies;
use super::frame::Frame;
use super::lane::{F, LANES, M, U, V, choose, ln, philox, spare, splat, unit, unit_short};
use super::light_branch::{LightBranches, sends};
use super::limits::{ENTRY, TURNED};
use super::next_event::{NextEvents, estimate_while, inverse_survival};
use super::rows::{Counts, Paths};
use super::scalar_connections::make_scalar_connections;
use super::scalar_fallback::{LATE, scalar_fallback};
use super::start::Starts;
use crate::batches::Batches;
use crate::lengths::MOST_LENGTHS;
use crate::random::LIGHT_BRANCH;
use crate::walker::Walker;

/// Walks the batches and leaves the responses of their paths in the walker, in order.
pub fn walk(walker: &mut Walker<'_>, frame: &Frame<'_>, batches: Batches<'_>) {
    walker.light_branches.clone_from(&frame.light_branches);
    walker.clear_responses(batches.paths());
    let mut responses = walker.take_single();
    let starts = Starts::new(batches, frame.counts);
    at_level!(walker.level(), simd => simd.vectorize(#[inline(always)] || {
        Packet::new(simd, frame, batches.paths()).run(walker, starts, &mut responses);
    }));
    walker.gather();
    walker.add_single(responses);
    walker.light_branches.clear();
}

fn with_room(mut floats: [f32; 16], known: f32) -> [f32; 16] {
    floats[14] = known;
    floats
}

/// The paths in flight.
pub(super) struct Packet<'a, S: Simd> {
    pub(super) simd: S,
    pub(super) frame: &'a Frame<'a>,
    pub(super) floats: [F<S>; 16],
    pub(super) words: [U<S>; 6],
    /// By which channels differ, mm.
    pub(super) lengths: Counts<S>,
    /// By bits.
    pub(super) alive: u64,
    /// Flights that only ask how far they may go, by bits, and the lengths of all.
    asking: u64,
    steps: [f32; LANES],
    next_events: NextEvents,
    /// For what goes through memory.
    memory: Paths,
    /// Copies of paths, and memory for what is done with them.
    pub(super) copies: Copies,
    pub(super) aside: Paths,
    pub(super) light_branches: LightBranches,
    /// The paths that rest while light-directed branches fly, and by bits those that live.
    pub(super) resting: Paths,
    pub(super) resting_alive: u64,
    /// How many responses there are of each kind: after those of paths come those of light-directed branches where they end, and where they come in.
    paths: u32,
}

impl<'a, S: Simd> Packet<'a, S> {
    #[inline(always)]
    fn new(simd: S, frame: &'a Frame<'a>, paths: usize) -> Self {
        let (floats, words) = ([splat(simd, 0.0); 16], [U::splat(simd, 0); 6]);
        let counted = frame.counts;
        Self {
            simd,
            frame,
            floats,
            words,
            lengths: [splat(simd, 0.0); MOST_LENGTHS],
            alive: 0,
            asking: 0,
            steps: [0.0; LANES],
            next_events: NextEvents::new(counted),
            memory: Paths::new(counted),
            copies: Copies::default(),
            aside: Paths::new(counted),
            light_branches: LightBranches::new(counted),
            resting: Paths::new(counted),
            resting_alive: 0,
            paths: paths as u32,
        }
    }

    #[inline(always)]
    fn run(mut self, walker: &mut Walker<'_>, mut starts: Starts<'_>, responses: &mut [f64]) {
        let simd = self.simd;
        let (key, high) = (walker.setting().key, walker.setting().channel << 16);
        let mut flights = 0;
        loop {
            if self.frame.weight_windows.is_some() {
                self.revive();
            }
            // The last light-directed branches go when all paths have ended.
            let last = self.alive == 0 && starts.ready.len() == 0 && !starts.more();
            let branching = self.light_branches.muster(simd, walker, self.frame, last, key, high);
            let dead = !self.alive & 0xFFFF;
            if branching {
                self.rest();
            } else if dead != 0 {
                let wanted = dead.count_ones() as usize;
                while starts.ready.len() < wanted && starts.more() {
                    starts.make(simd, walker, self.frame, &mut self.next_events, responses);
                }
                let mut filled = dead;
                while filled.count_ones() as usize > starts.ready.len() {
                    filled &= filled - 1;
                }
                let filling = M::from_bitmask(simd, filled);
                starts.ready.unpack(simd, filling, &mut self.floats, &mut self.words, &mut self.lengths);
                self.alive |= filled;
                if walker.endless() {
                    break;
                }
                if self.alive == 0 {
                    if self.light_branches.is_empty() && walker.sent.is_empty() {
                        break;
                    }
                    continue;
                }
            }
            flights += self.alive.count_ones() as usize;
            let (divergent, connecting, out) = self.fly(branching, key, high, responses);
            // On its way to infinity a path makes one more.
            flights += out.count_ones() as usize;
            if connecting != 0 && (self.frame.lamps || !self.frame.next_events) {
                self.next_event_singly(walker, connecting);
            }
            if divergent != 0 {
                flights -= divergent.count_ones() as usize;
                self.scalar_fallback(walker, divergent, branching);
            }
            if branching {
                self.resume();
            }
            estimate_while(simd, &mut self.next_events, LANES, self.frame, key, high, responses);
            if !self.next_events.scalar_connections.is_empty() {
                make_scalar_connections(walker, self.frame, &mut self.next_events);
            }
        }
        estimate_while(simd, &mut self.next_events, 1, self.frame, key, high, responses);
        make_scalar_connections(walker, self.frame, &mut self.next_events);
        walker.count_flights(flights);
    }

    /// One flight of every lane that lives. Those that meet a boundary, to be made by the scalar walker from where they stand;
    /// those with a next event, queued where lanes can estimate it; and those that have left through a plane where light bends.
    #[inline(always)]
    fn fly(&mut self, branching: bool, key: [u32; 2], high: u32, responses: &mut [f64]) -> (u64, u64, u64) {
        let (simd, frame) = (self.simd, self.frame);
        let [
            rx,
            ry,
            rz,
            wx,
            wy,
            wz,
            absorption_depth,
            lost,
            weight,
            free_path,
            mu_a,
            mu_s,
            g,
            window,
            known,
            mis_weight,
        ] = self.floats;
        let [number, sample, pixel, path, material, body] = self.words;
        let (r, w) = (V { x: rx, y: ry, z: rz }, V { x: wx, y: wy, z: wz });
        let alive = M::from_bitmask(simd, self.alive);
        let [a, b, c, d] = philox(simd, number, U::splat(simd, high), sample, pixel, key);
        let tau = -ln(unit(a));
        let s = tau * free_path;
        let mut end = r.plus(s, w);
        let mut absorbed = mu_a * s;
        let mut passage = frame.ground.pass(simd, body, r, w, s, end);
        let no = M::splat(simd, false);
        let (meshes, mut left_known, mut stale) = (!frame.ground.meshes.is_empty(), known - s, no);
        let passage_clear = passage.clear;
        if meshes {
            let asks = s.simd_ge(known) & !passage.crosses & alive;
            stale = !asks;
            if asks.any_true() {
                let (meets, clear) = frame.ground.pass_meshes(simd, asks, body, r, w, s, end);
                passage.crosses |= meets;
                left_known = choose(asks, clear, left_known);
            }
            passage.clear = passage.clear.min(left_known);
        }
        if frame.others {
            let asks = s.simd_ge(known);
            self.asking = (asks & !passage.crosses & alive).to_bitmask();
            s.store_array(&mut self.steps);
            passage.crosses |= asks;
            passage.clear = passage.clear.min(known - s);
        }
        let (mut here, mut body, mut material) = ([free_path, mu_a, mu_s, g, window], body, material);
        let (mut lengths, was_in) = (self.lengths, material);
        let (mut first, mut second_in) = (s, splat(simd, 0.0));
        let (mut escapes, mut crossed, mut turned, mut out) = (no, no, no, no);
        let mut mirrored = V { x: wx, y: wy, z: -wz };
        if (frame.straight || frame.onward) && (passage.crosses & alive).any_true() {
            // The rest of the flight in the next body, if it stays in that.
            let on = frame.ground.onward(simd, &frame.parts, passage.crosses & alive, body, r, w);
            escapes = if frame.dark && frame.straight { passage.crosses & on.escapes } else { no };
            // Where interfaces bend it, only into what touches.
            let on_into = if frame.straight { on.open } else { on.open & on.enters.simd_le(on.leaves) };
            crossed = if frame.onward { passage.crosses & on_into } else { no };
            if (crossed & alive).any_true() {
                let mut there = here;
                let mut its = material;
                for (j, part) in frame.parts.iter().enumerate() {
                    let (m, at) = (&frame.media[part.material], on.body.simd_eq(j as u32));
                    for (x, y) in there.iter_mut().zip([m.free_path, m.mu_a, m.mu_s, m.g, m.window]) {
                        *x = choose(at, splat(simd, y), *x);
                    }
                    its = at.select(U::splat(simd, part.material as u32), its);
                }
                let rest = (tau - on.leaves / free_path).max(splat(simd, 0.0)) * there[0];
                let from = r.plus(on.enters, w);
                let to = r.plus(on.enters + rest, w);
                let mut second = frame.ground.pass(simd, on.body, from, w, rest, to);
                if meshes {
                    let into = crossed & alive & !second.crosses;
                    let (meets, clear) = frame.ground.pass_meshes(simd, into, on.body, from, w, rest, to);
                    second.crosses |= meets;
                    second.clear = second.clear.min(clear);
                    left_known = choose(crossed, clear, left_known);
                    stale &= !crossed;
                }
                crossed &= !second.crosses & !to.dot(to).simd_gt(frame.range_squared);
                absorbed = choose(crossed, mu_a * on.leaves + there[1] * rest, absorbed);
                end = to.or(crossed, end);
                for (x, y) in here.iter_mut().zip(there) {
                    *x = choose(crossed, y, *x);
                }
                // In another medium, or behind a gap: touching bodies of one medium are one. The camera's ray was scored as far as it goes.
                let beyond =
                    crossed & (!its.simd_eq(material) | on.enters.simd_gt(on.leaves)) & !number.simd_eq(frame.first);
                let entered = beyond & alive & (absorption_depth - (mu_a * on.leaves + lost)).simd_ge(splat(simd, 0.0));
                if frame.next_events && entered.any_true() {
                    let (zero, [_, mu_a, mu_s, g, _]) = (splat(simd, 0.0), here);
                    let mut before = self.lengths;
                    if frame.counts {
                        for (m, &place) in
                            frame.counted_in.iter().enumerate().filter(|(_, place)| **place < MOST_LENGTHS)
                        {
                            before[place] += choose(was_in.simd_eq(m as u32), on.leaves, zero);
                        }
                    }
                    let (seen, roulette) = (weight * mis_weight, unit_short(d));
                    // Those of light-directed branches apart: which of them fly together must not show.
                    let path = if branching { path + self.paths } else { path };
                    self.next_events.rays.pack(
                        entered,
                        &[from.x, from.y, from.z, wx, wy, wz, wx, wy, wz, seen, roulette, mu_a, mu_s, g, zero],
                        &[number | ENTRY, sample, pixel, path, on.body],
                        &before,
                    );
                    estimate_while(simd, &mut self.next_events, LANES, frame, key, high, responses);
                }
                if frame.counts {
                    (first, second_in) = (choose(crossed, on.leaves, first), choose(crossed, rest, second_in));
                }
                (material, body) = (crossed.select(its, material), crossed.select(on.body, body));
                passage.clear = choose(crossed, second.clear, passage.clear);
                passage.crosses &= !crossed;
            }
        }
        if let Some(plane) = &frame.plane
            && frame.turns
            && (passage.crosses & alive).any_true()
        {
            // Up to the plane, if nothing else is met before; there Fresnel decides.
            let meeting = plane.meet(simd, r, w);
            let fresh = number.simd_eq(frame.first);
            let meets = passage.crosses & meeting.towards & meeting.distance.simd_le(s) & !fresh;
            let meets = meets & frame.ground.is_free(simd, &frame.parts, body, r, w, meeting.distance);
            let reflected = unit_short(d).simd_lt(meeting.reflectance);
            turned = meets & reflected & !meeting.place.dot(meeting.place).simd_gt(frame.range_squared);
            escapes = if frame.dark { meets & !reflected } else { no };
            absorbed = choose(turned | escapes, mu_a * meeting.distance, absorbed);
            first = choose(turned, meeting.distance, first);
            end = meeting.place.or(turned, end);
            passage.crosses &= !turned;
        }
        if let Some(interfaces) = &frame.interfaces
            && frame.turns
            && (passage.crosses & alive).any_true()
        {
            let (meeting, back, free) = interfaces.meet(simd, frame, body, r, w);
            let fresh = number.simd_eq(frame.first);
            let meets = passage.crosses & meeting.towards & meeting.distance.simd_le(s) & !fresh;
            let reflected = unit_short(d).simd_lt(meeting.reflectance);
            turned = meets & reflected & !meeting.place.dot(meeting.place).simd_gt(frame.range_squared);
            escapes = if frame.dark { meets & !reflected & free } else { no };
            absorbed = choose(turned | escapes, mu_a * meeting.distance, absorbed);
            first = choose(turned, meeting.distance, first);
            end = meeting.place.or(turned, end);
            mirrored = back;
            passage.crosses &= !turned;
        }
        let flight = if branching { number & (LIGHT_BRANCH - 1) } else { number };
        let far = end.dot(end).simd_gt(frame.range_squared) | flight.simd_ge(LATE);
        turned &= !far;
        if frame.counts {
            for (m, &place) in frame.counted_in.iter().enumerate().filter(|(_, place)| **place < MOST_LENGTHS) {
                let within = |it: U<S>, length: F<S>| choose(it.simd_eq(m as u32), length, splat(simd, 0.0));
                lengths[place] += within(was_in, first) + within(material, second_in);
            }
        }
        let [free_path, mu_a, mu_s, g, window] = here;
        // Compensated: at high albedo each flight takes less than the last digit of what is left.
        let taken = -absorbed - lost;
        let left = absorption_depth + taken;
        let lost = (left - absorption_depth) - taken;
        let dies = left.simd_lt(0.0);
        if frame.turns {
            out = escapes & alive & !dies;
        }
        let crosses = passage.crosses | (far & !crossed);
        let divergent = alive & crosses & !escapes;
        let mut gone = (dies & !crosses) | escapes;
        let mut heavier = weight;
        if frame.windows && !branching && frame.weight_windows.is_none() {
            // Roulette of deep paths, for W/2 and above.
            let x = passage.clear * window + 1.0;
            let (x2, zero) = (x * x, splat(simd, 0.0));
            let deep = x2 * x2;
            let plays = weight.simd_lt(deep * 0.5) & window.simd_gt(zero) & !turned;
            gone |= plays & (spare(b, c, d) * deep).simd_ge(weight) & !crosses;
            heavier = choose(plays, deep, weight);
        }
        let (roulette, mut least) = (unit_short(d), (mu_a + mu_s) * passage.clear);
        let mut near = (roulette * inverse_survival(simd, least)).simd_lt(1.0);
        if meshes {
            // An estimate costs more than to ask how far the surface really is.
            let asks = near & stale & alive & !crosses & !dies;
            if asks.any_true() {
                let clear = frame.ground.from_meshes(simd, asks, body, end);
                left_known = choose(asks, clear, left_known);
                least = choose(asks, (mu_a + mu_s) * clear.min(passage_clear), least);
                near &= (roulette * inverse_survival(simd, least)).simd_lt(1.0);
            }
        }
        let goes_on = alive & !crosses & !gone;
        let next_events = if frame.blind { no } else { near & goes_on & !turned };
        let e = frame.phase_of_media(simd, g, material).sample(w, unit_short(b), unit_short(c));
        let e = mirrored.or(turned, e);
        let turned = turned & goes_on;
        if !frame.blind && turned.any_true() {
            let zero = splat(simd, 0.0);
            self.next_events.rays.pack(
                turned,
                &[end.x, end.y, end.z, e.x, e.y, e.z, e.x, e.y, e.z, weight, zero, mu_a, mu_s, g, zero],
                &[(number + 1) | TURNED, sample, pixel, path, body],
                &lengths,
            );
            estimate_while(simd, &mut self.next_events, LANES, frame, key, high, responses);
        }
        if frame.next_events && next_events.any_true() {
            self.next_events.rays.pack(
                next_events,
                &[end.x, end.y, end.z, wx, wy, wz, e.x, e.y, e.z, heavier * mis_weight, roulette, mu_a, mu_s, g, least],
                &[number + 1, sample, pixel, path, body],
                &lengths,
            );
        }
        let mut left_mis_weight = splat(simd, 1.0);
        if !frame.light_branches.is_empty() && !branching && next_events.any_true() {
            let sending;
            (sending, left_mis_weight) = sends(simd, frame, next_events, material, (end, w, e), g, least);
            if sending.any_true() {
                let one = splat(simd, 1.0);
                self.light_branches.collisions.pack(
                    sending,
                    &[
                        end.x, end.y, end.z, wx, wy, wz, left, lost, heavier, free_path, mu_a, mu_s, g, window,
                        left_known, one,
                    ],
                    &[number, sample, pixel, path + self.paths, material, body],
                    &lengths,
                );
            }
        }
        if (frame.lamps || !frame.next_events) && next_events.any_true() {
            let mut floats = self.floats;
            let words = [number, sample, pixel, path, material, body];
            (floats[0], floats[1], floats[2]) = (end.x, end.y, end.z);
            (floats[6], floats[7], floats[8]) = (e.x, e.y, e.z);
            floats[9] = heavier;
            (floats[10], floats[12]) = (roulette, passage.clear);
            self.memory.store(&floats, &words, &lengths);
        }
        if frame.counts {
            for (length, new) in self.lengths.iter_mut().zip(lengths) {
                *length = choose(goes_on, new, *length);
            }
        }
        let old = self.floats;
        let step = |new: F<S>, old: F<S>| choose(goes_on, new, old);
        self.floats = [
            step(end.x, rx),
            step(end.y, ry),
            step(end.z, rz),
            step(e.x, wx),
            step(e.y, wy),
            step(e.z, wz),
            step(left, absorption_depth),
            step(lost, old[7]),
            step(heavier, weight),
            step(free_path, old[9]),
            step(mu_a, old[10]),
            step(mu_s, old[11]),
            step(g, old[12]),
            step(window, old[13]),
            step(left_known, old[14]),
            step(left_mis_weight, mis_weight),
        ];
        self.words = [
            goes_on.select(number + 2, number),
            sample,
            pixel,
            path,
            goes_on.select(material, self.words[4]),
            goes_on.select(body, self.words[5]),
        ];
        let divergent = divergent.to_bitmask();
        self.alive = if branching { divergent } else { goes_on.to_bitmask() | divergent };
        if let Some(window) = frame.weight_windows.as_ref().filter(|_| !branching) {
            self.keep_in_windows(goes_on & !turned, w, passage.clear, window, key, high);
        }
        (divergent, next_events.to_bitmask(), out.to_bitmask())
    }

    /// Next-event estimation that lanes cannot make.
    #[inline(never)]
    fn next_event_singly(&mut self, walker: &mut Walker<'_>, connecting: u64) {
        let mut lanes = connecting;
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            let row = self.memory.get(lane);
            let (floats, mut place) = (row.0, self.frame.place(row));
            place.number += 2;
            (place.weight, place.clear) = (f64::from(floats[9]), f64::from(floats[12]));
            let roulette = f64::from(floats[10]);
            let own = [floats[6], floats[7], floats[8]].map(f64::from).into();
            if self.frame.next_events {
                walker.next_event_to_lamps(&place, own, roulette);
            } else {
                walker.next_event_ahead(&mut place, own, roulette);
            }
        }
    }

    /// Lets the scalar walker make divergent flights.
    #[inline(never)]
    fn scalar_fallback(&mut self, walker: &mut Walker<'_>, divergent: u64, branching: bool) {
        self.memory.store(&self.floats, &self.words, &self.lengths);
        let mut lanes = divergent;
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            let row = self.memory.get(lane);
            let mut place = self.frame.place(row);
            place.light_branch = branching;
            if self.asking >> lane & 1 == 1 {
                let known = (self.frame.clearance(place.r) * (1.0 - 1e-6)) as f32;
                if self.steps[lane] < known {
                    // The same flight again, with more room.
                    self.memory.set(lane, with_room(row.0, known), row.1, row.2);
                    continue;
                }
            }
            let goes_on = scalar_fallback(walker, self.frame, &mut place);
            self.take_copies(walker, lane);
            if goes_on {
                let (floats, words, lengths) = self.frame.row(&place);
                self.memory.set(lane, floats, words, lengths);
            } else {
                self.alive &= !(1 << lane);
            }
        }
        (self.floats, self.words, self.lengths) = self.memory.load(self.simd);
    }
}
