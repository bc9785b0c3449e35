//! One flight of sixteen paths: how far, what it crosses, what is left of the path, and where it is scattered.

use fearless_simd::prelude::*;

use super::frame::{Frame, Leaving};
use super::free_flight::{Draw, FreeFlight};
use super::ground::Passage;
use super::in_flight::Packet;
use super::lane::{F, LANES, M, U, V, choose, spare, splat, unit_short};
use super::light_branch::sends;
use super::limits::TURNED;
use super::next_event::{estimate_while, inverse_survival};
use super::rows::{PathLanes, VertexLanes};
use super::scalar_fallback::LATE;
use crate::lengths::MOST_LENGTHS;
use crate::random::LIGHT_BRANCH;

/// Flights while they are made, from the paths at their start to the paths at their end.
pub(super) struct Flight<S: Simd> {
    pub(super) simd: S,
    pub(super) alive: M<S>,
    /// The paths before, and behind it: of these `r` is where it ends, and `w` is still that of the flight.
    pub(super) start: PathLanes<S>,
    pub(super) end: PathLanes<S>,
    /// Random numbers: the free flight, two of the angles, and one that decides on reflection or on next-event estimation.
    random: [U<S>; 4],
    /// Optical free flight by scattering; mm of it in the medium of the start.
    pub(super) tau: F<S>,
    pub(super) s: F<S>,
    /// Optical depth of absorption along it.
    pub(super) absorbed: F<S>,
    pub(super) passage: Passage<S>,
    /// As of surfaces other than meshes.
    clear_of_others: F<S>,
    /// Whether what is known of the distance to meshes is no more than a bound.
    pub(super) stale: M<S>,
    /// mm in the medium of the start, and in that of the end.
    pub(super) first: F<S>,
    pub(super) second: F<S>,
    /// It leaves all bodies and ends; it goes on into the next body; it is reflected back into its own.
    pub(super) escapes: M<S>,
    pub(super) crossed: M<S>,
    pub(super) turned: M<S>,
    /// Unit vector of a flight that is reflected.
    pub(super) mirrored: V<S>,
}

/// Lanes, by bits, after a flight.
pub(super) struct Outcome {
    /// How many flights were made.
    pub flights: usize,
    /// They meet a boundary: the scalar walker makes the flight from where they stand.
    pub divergent: u64,
    /// They have a next event that lanes may not know how to estimate.
    pub connecting: u64,
    /// They have left through an interface where light bends.
    pub out: u64,
}

/// What becomes of paths at the end of a flight.
pub(super) struct Fate<S: Simd> {
    /// They are left to the scalar walker; they are scattered, or reflected, and go on.
    pub(super) divergent: M<S>,
    pub(super) goes_on: M<S>,
    pub(super) out: M<S>,
    /// Those that go on are asked for next-event estimation, with a uniform random number against the optical distance of the nearest surface.
    next_events: M<S>,
    roulette: F<S>,
    least: F<S>,
}

impl<S: Simd> Packet<'_, S> {
    /// A flight of every lane that lives; in plain frames all until one does not stay in its medium (where that does not end its path), lanes are to be filled,
    /// or the queue of next events is full.
    #[inline(always)]
    pub(super) fn fly(&mut self, branching: bool, responses: &mut [f64]) -> Outcome {
        let (simd, frame) = (self.simd, self.frame);
        let (flights, free) = match frame.leaving {
            _ if !frame.plain => (0, Some(FreeFlight::of(frame, &self.path, Draw::of(simd, frame, 0, &self.path)))),
            Leaving::Unknown => self.within::<false, false>(branching, responses),
            Leaving::Ends => self.within::<true, false>(branching, responses),
            Leaving::Plane => self.within::<true, true>(branching, responses),
        };
        let Some(free) = free else { return Outcome { flights, divergent: 0, connecting: 0, out: 0 } };
        let flights = flights + self.alive.count_ones() as usize;
        let mut flight = Flight::of(simd, self.path, M::from_bitmask(simd, self.alive), free);
        flight.pass_meshes(frame);
        if frame.others {
            self.ask(&mut flight);
        }
        if (frame.straight || frame.onward) && flight.any_crosses() {
            self.go_onward(&mut flight, branching, responses);
        }
        if let Some(plane) = &frame.plane
            && frame.turns
            && flight.any_crosses()
        {
            flight.turn_at_plane(frame, plane);
        }
        if let Some(interfaces) = &frame.interfaces
            && frame.turns
            && flight.any_crosses()
        {
            flight.turn_at_interfaces(frame, interfaces);
        }
        Outcome { flights, ..self.end(flight, branching, responses) }
    }

    /// What comes after its end.
    #[inline(always)]
    fn end(&mut self, mut flight: Flight<S>, branching: bool, responses: &mut [f64]) -> Outcome {
        let frame = self.frame;
        let fate = flight.fate::<false>(frame, branching);
        let own = flight.mirrored.or(flight.turned, flight.scattered(frame));
        flight.turned &= fate.goes_on;
        self.queue_turned(&flight, own, responses);
        self.queue_next_events(&flight, &fate, own);
        let mis_weight = self.queue_light_branches(&flight, &fate, own, branching);
        if (frame.lamps || !frame.next_events) && fate.next_events.any_true() {
            self.set_aside(&flight, &fate, own);
        }
        self.advance(&flight, &fate, (own, mis_weight), branching);
        Outcome {
            flights: 0,
            divergent: fate.divergent.to_bitmask(),
            connecting: fate.next_events.to_bitmask(),
            out: fate.out.to_bitmask(),
        }
    }

    /// Flights that go further than it is known that no other surface is met: the scalar walker asks how far that is.
    #[inline(always)]
    fn ask(&mut self, flight: &mut Flight<S>) {
        let asks = flight.s.simd_ge(flight.start.known_clear);
        self.asking = (asks & !flight.passage.crosses & flight.alive).to_bitmask();
        flight.s.store_array(&mut self.steps);
        flight.passage.crosses |= asks;
        flight.passage.clear = flight.passage.clear.min(flight.start.known_clear - flight.s);
    }

    /// Reflected paths are estimated along their flight to come.
    #[inline(always)]
    pub(super) fn queue_turned(&mut self, flight: &Flight<S>, own: V<S>, responses: &mut [f64]) {
        let (simd, frame) = (self.simd, self.frame);
        let (Flight { start, turned, .. }, zero) = (flight, splat(simd, 0.0));
        if !frame.blind && turned.any_true() {
            let vertex = VertexLanes { came: own, weight: start.weight, ..flight.vertex(own, zero, zero) };
            self.next_events.vertices.pack(*turned, &VertexLanes { number: vertex.number | TURNED, ..vertex });
            estimate_while(simd, &mut self.next_events, LANES, frame, responses);
        }
    }

    /// Scattered paths are estimated from where they are.
    #[inline(always)]
    pub(super) fn queue_next_events(&mut self, flight: &Flight<S>, fate: &Fate<S>, own: V<S>) {
        if self.frame.next_events && fate.next_events.any_true() {
            let vertex = flight.vertex(own, fate.roulette, fate.least);
            let weight = flight.end.weight * flight.start.mis_weight;
            self.next_events.vertices.pack(fate.next_events, &VertexLanes { weight, ..vertex });
        }
    }

    /// Collisions from which light-directed branches may go; the MIS weight that is left to what each path's own next flight sees.
    #[inline(always)]
    fn queue_light_branches(&mut self, flight: &Flight<S>, fate: &Fate<S>, own: V<S>, branching: bool) -> F<S> {
        let (simd, one) = (self.simd, splat(self.simd, 1.0));
        if self.frame.light_branches.is_empty() || branching || fate.next_events.all_false() {
            return one;
        }
        let &Flight { start, end, .. } = flight;
        let directions = (end.r, start.w, own);
        let (sending, left) = sends(simd, self.frame, fate.next_events, end.material, directions, end.g, fate.least);
        if sending.any_true() {
            let response = end.response + self.paths;
            self.light_branches.collisions.pack(sending, &PathLanes { mis_weight: one, response, ..end });
        }
        left
    }

    /// For `next_event_singly` (in `walk.rs`).
    #[inline(always)]
    fn set_aside(&mut self, flight: &Flight<S>, fate: &Fate<S>, own: V<S>) {
        self.memory.store(&flight.end);
        let columns = [own.x, own.y, own.z, fate.roulette, flight.passage.clear];
        for (column, x) in self.singly.iter_mut().zip(columns) {
            x.store_array(column);
        }
    }

    /// Paths that go on stand at the end of their flight, all others where they were.
    #[inline(always)]
    fn advance(&mut self, flight: &Flight<S>, fate: &Fate<S>, (own, mis_weight): (V<S>, F<S>), branching: bool) {
        let Flight { start, end, .. } = flight;
        let end = PathLanes { w: own, mis_weight, number: start.number + 2, ..*end };
        self.path = end.or(fate.goes_on, start, self.frame.counts);
        let divergent = fate.divergent.to_bitmask();
        self.alive = if branching { divergent } else { fate.goes_on.to_bitmask() | divergent };
        if let Some(window) = self.frame.weight_windows.as_ref().filter(|_| !branching) {
            self.keep_in_windows(fate.goes_on & !flight.turned, start.w, flight.passage.clear, window);
        }
    }
}

impl<S: Simd> Flight<S> {
    /// As far as it is free.
    #[inline(always)]
    pub(super) fn of(simd: S, start: PathLanes<S>, alive: M<S>, free: FreeFlight<S>) -> Self {
        let FreeFlight { draw: Draw { random, tau }, s, r, passage } = free;
        let no = M::splat(simd, false);
        Self {
            simd,
            alive,
            start,
            end: PathLanes { r, known_clear: start.known_clear - s, ..start },
            random,
            tau,
            s,
            absorbed: start.mu_a * s,
            clear_of_others: passage.clear,
            passage,
            stale: no,
            first: s,
            second: splat(simd, 0.0),
            escapes: no,
            crossed: no,
            turned: no,
            mirrored: V { x: start.w.x, y: start.w.y, z: -start.w.z },
        }
    }

    /// Meets meshes where the flight goes further than it is known to be clear of them.
    #[inline(always)]
    fn pass_meshes(&mut self, frame: &Frame<'_>) {
        if frame.ground.meshes.is_empty() {
            return;
        }
        let start = &self.start;
        let asks = self.s.simd_ge(start.known_clear) & !self.passage.crosses & self.alive;
        self.stale = !asks;
        if asks.any_true() {
            let (meets, clear) =
                frame.ground.pass_meshes(self.simd, asks, start.body, start.r, start.w, self.s, self.end.r);
            self.passage.crosses |= meets;
            self.end.known_clear = choose(asks, clear, self.end.known_clear);
        }
        self.passage.clear = self.passage.clear.min(self.end.known_clear);
    }

    #[inline(always)]
    pub(super) fn any_crosses(&self) -> bool {
        (self.passage.crosses & self.alive).any_true()
    }

    /// For reflection.
    #[inline(always)]
    pub(super) fn uniform(&self) -> F<S> {
        unit_short(self.random[3])
    }

    /// Absorption, roulette, and who goes on.
    #[inline(always)]
    pub(super) fn fate<const WITHIN: bool>(&mut self, frame: &Frame<'_>, branching: bool) -> Fate<S> {
        let (simd, start, alive) = (self.simd, &self.start, self.alive);
        let flight = if branching { start.number & (LIGHT_BRANCH - 1) } else { start.number };
        let far = self.end.r.dot(self.end.r).simd_gt(frame.range_squared) | flight.simd_ge(LATE);
        self.turned &= !far;
        if !WITHIN && frame.counts {
            self.count(frame);
        }
        let dies = self.absorb();
        let out = if frame.turns { self.escapes & alive & !dies } else { M::splat(simd, false) };
        let crosses = self.passage.crosses | (far & !self.crossed);
        let divergent = alive & crosses & !self.escapes;
        let mut gone = (dies & !crosses) | self.escapes;
        if frame.windows && !branching && frame.weight_windows.is_none() {
            gone |= self.end_deep() & !crosses;
        }
        let (roulette, least, near) = self.near::<WITHIN>(frame, alive & !crosses & !dies);
        let goes_on = alive & !crosses & !gone;
        let next_events = if frame.blind { M::splat(simd, false) } else { near & goes_on & !self.turned };
        Fate { divergent, goes_on, out, next_events, roulette, least }
    }

    /// Adds to the lengths by which channels differ.
    #[inline(always)]
    fn count(&mut self, frame: &Frame<'_>) {
        let zero = splat(self.simd, 0.0);
        for (m, &place) in frame.counted_in.iter().enumerate().filter(|(_, place)| **place < MOST_LENGTHS) {
            let first = choose(self.start.material.simd_eq(m as u32), self.first, zero);
            let second = choose(self.end.material.simd_eq(m as u32), self.second, zero);
            // By numbers that are known when this is compiled: else all of the flight would be kept in memory.
            for (k, length) in self.end.lengths.iter_mut().enumerate() {
                if k == place {
                    *length += first + second;
                }
            }
        }
    }

    /// Takes absorption from what is left of it; who is absorbed.
    #[inline(always)]
    fn absorb(&mut self) -> M<S> {
        let start = &self.start;
        // Compensated: at high albedo each flight takes less than the last digit of what is left.
        let taken = -self.absorbed - start.absorption_lost;
        let left = start.absorption_depth + taken;
        (self.end.absorption_depth, self.end.absorption_lost) = (left, (left - start.absorption_depth) - taken);
        left.simd_lt(0.0)
    }

    /// Roulette of deep paths, for W/2 and above: who ends by it.
    #[inline(always)]
    fn end_deep(&mut self) -> M<S> {
        let (weight, window) = (self.start.weight, self.end.window);
        let [_, b, c, d] = self.random;
        let x = self.passage.clear * window + 1.0;
        let (x2, zero) = (x * x, splat(self.simd, 0.0));
        let deep = x2 * x2;
        let plays = weight.simd_lt(deep * 0.5) & window.simd_gt(zero) & !self.turned;
        self.end.weight = choose(plays, deep, weight);
        plays & (spare(b, c, d) * deep).simd_ge(weight)
    }

    /// Who is near enough to a surface, by roulette, for next-event estimation: its random number, the least optical distance of a surface, and whether.
    #[inline(always)]
    fn near<const WITHIN: bool>(&mut self, frame: &Frame<'_>, scattered: M<S>) -> (F<S>, F<S>, M<S>) {
        let simd = self.simd;
        let mu_t = self.end.mu_a + self.end.mu_s;
        let (roulette, mut least) = (self.uniform(), mu_t * self.passage.clear);
        let mut near = (roulette * inverse_survival(simd, least, frame.tau_sure)).simd_lt(1.0);
        if !WITHIN && !frame.ground.meshes.is_empty() {
            // An estimate costs more than to ask how far the surface really is.
            let asks = near & self.stale & scattered;
            if asks.any_true() {
                let clear = frame.ground.from_meshes(simd, asks, self.end.body, self.end.r);
                self.end.known_clear = choose(asks, clear, self.end.known_clear);
                least = choose(asks, mu_t * clear.min(self.clear_of_others), least);
                near &= (roulette * inverse_survival(simd, least, frame.tau_sure)).simd_lt(1.0);
            }
        }
        (roulette, least, near)
    }

    /// Where those go on that are scattered at the end.
    #[inline(always)]
    pub(super) fn scattered(&self, frame: &Frame<'_>) -> V<S> {
        let [_, b, c, _] = self.random;
        let phase = frame.phase_of_media(self.simd, self.end.g, self.end.material);
        phase.sample(self.start.w, unit_short(b), unit_short(c))
    }

    /// What is estimated from the end.
    #[inline(always)]
    fn vertex(&self, own: V<S>, roulette: F<S>, least: F<S>) -> VertexLanes<S> {
        let &Flight { start, end, .. } = self;
        VertexLanes {
            r: end.r,
            came: start.w,
            own,
            weight: end.weight,
            roulette,
            mu_a: end.mu_a,
            mu_s: end.mu_s,
            g: end.g,
            least,
            number: start.number + 1,
            sample: start.sample,
            pixel: start.pixel,
            response: start.response,
            body: end.body,
            lengths: end.lengths,
        }
    }
}

impl<S: Simd> PathLanes<S> {
    /// Those of `mask` become `end`, which is in the same medium; of plain frames.
    #[inline(always)]
    pub(super) fn go_on(&mut self, mask: M<S>, end: &Self) {
        self.r = end.r.or(mask, self.r);
        self.w = end.w.or(mask, self.w);
        self.absorption_depth = choose(mask, end.absorption_depth, self.absorption_depth);
        self.absorption_lost = choose(mask, end.absorption_lost, self.absorption_lost);
        self.weight = choose(mask, end.weight, self.weight);
        self.number = mask.select(end.number, self.number);
    }

    /// Takes over what [`Self::go_on`] may have changed.
    #[inline(always)]
    pub(super) fn moved(&mut self, path: &Self) {
        let Self { r, w, absorption_depth, absorption_lost, weight, number, .. } = *path;
        *self = Self { r, w, absorption_depth, absorption_lost, weight, number, ..*self };
    }

    /// These where `mask` says so, else the others; lengths only where they are kept.
    #[inline(always)]
    fn or(self, mask: M<S>, other: &Self, counts: bool) -> Self {
        let mut lengths = other.lengths;
        if counts {
            for (length, new) in lengths.iter_mut().zip(self.lengths) {
                *length = choose(mask, new, *length);
            }
        }
        Self {
            r: self.r.or(mask, other.r),
            w: self.w.or(mask, other.w),
            absorption_depth: choose(mask, self.absorption_depth, other.absorption_depth),
            absorption_lost: choose(mask, self.absorption_lost, other.absorption_lost),
            weight: choose(mask, self.weight, other.weight),
            free_path: choose(mask, self.free_path, other.free_path),
            mu_a: choose(mask, self.mu_a, other.mu_a),
            mu_s: choose(mask, self.mu_s, other.mu_s),
            g: choose(mask, self.g, other.g),
            window: choose(mask, self.window, other.window),
            known_clear: choose(mask, self.known_clear, other.known_clear),
            mis_weight: choose(mask, self.mis_weight, other.mis_weight),
            number: mask.select(self.number, other.number),
            material: mask.select(self.material, other.material),
            body: mask.select(self.body, other.body),
            lengths,
            ..*other
        }
    }
}
