//! Flights in lanes that come to a boundary: straight on into the next body, or reflected where light bends.

use fearless_simd::prelude::*;

use super::bend::{Meeting, Plane};
use super::face::Interfaces;
use super::flight::Flight;
use super::frame::Frame;
use super::ground::Onward;
use super::in_flight::Packet;
use super::lane::{LANES, M, U, choose, splat};
use super::limits::ENTRY;
use super::next_event::estimate_while;
use super::rows::{PathLanes, VertexLanes};
use crate::lengths::MOST_LENGTHS;

impl<S: Simd> Packet<'_, S> {
    /// The rest of flights that cross a boundary in the next body, if they stay in that.
    #[inline(always)]
    pub(super) fn go_onward(&mut self, flight: &mut Flight<S>, branching: bool, responses: &mut [f64]) {
        let (simd, frame, no) = (self.simd, self.frame, M::splat(self.simd, false));
        let crosses = flight.passage.crosses;
        let start = &flight.start;
        let on = frame.ground.onward(simd, &frame.parts, crosses & flight.alive, start.body, start.r, start.w);
        flight.escapes = if frame.dark && frame.straight { crosses & on.escapes } else { no };
        // Where interfaces bend it, only into what touches.
        let into = if frame.straight { on.open } else { on.open & on.enters.simd_le(on.leaves) };
        flight.crossed = if frame.onward { crosses & into } else { no };
        if (flight.crossed & flight.alive).any_true() {
            flight.enter(frame, &on);
            if frame.next_events {
                self.queue_entries(flight, &on, branching, responses);
            }
            flight.passage.crosses &= !flight.crossed;
        }
    }

    /// Next-event estimation along the flight in what it has come into: in another medium, or behind a gap, for touching bodies of one medium are one.
    #[inline(always)]
    fn queue_entries(&mut self, flight: &Flight<S>, on: &Onward<S>, branching: bool, responses: &mut [f64]) {
        let (simd, frame, zero) = (self.simd, self.frame, splat(self.simd, 0.0));
        let Flight { start, end, .. } = flight;
        let elsewhere = !end.material.simd_eq(start.material) | on.enters.simd_gt(on.leaves);
        // The camera's ray was scored as far as it goes.
        let beyond = flight.crossed & elsewhere & !start.number.simd_eq(frame.first);
        let left = start.absorption_depth - (start.mu_a * on.leaves + start.absorption_lost);
        let entered = beyond & flight.alive & left.simd_ge(zero);
        if entered.all_false() {
            return;
        }
        let mut lengths = start.lengths;
        if frame.counts {
            for (m, &place) in frame.counted_in.iter().enumerate().filter(|(_, place)| **place < MOST_LENGTHS) {
                lengths[place] += choose(start.material.simd_eq(m as u32), on.leaves, zero);
            }
        }
        // Those of light-directed branches apart: which of them fly together must not show.
        let response = if branching { start.response + self.paths } else { start.response };
        self.next_events.vertices.pack(
            entered,
            &VertexLanes {
                r: start.r.plus(on.enters, start.w),
                came: start.w,
                own: start.w,
                weight: start.weight * start.mis_weight,
                roulette: flight.uniform(),
                mu_a: end.mu_a,
                mu_s: end.mu_s,
                g: end.g,
                least: zero,
                number: start.number | ENTRY,
                sample: start.sample,
                pixel: start.pixel,
                response,
                body: on.body,
                lengths,
            },
        );
        estimate_while(simd, &mut self.next_events, LANES, frame, responses);
    }
}

impl<S: Simd> Flight<S> {
    /// Ends those that cross into the next body there, unless they would leave that as well.
    #[inline(always)]
    fn enter(&mut self, frame: &Frame<'_>, on: &Onward<S>) {
        let (simd, zero) = (self.simd, splat(self.simd, 0.0));
        let start = self.start;
        let there = start.in_medium_of(simd, frame, on.body);
        let rest = (self.tau - on.leaves / start.free_path).max(zero) * there.free_path;
        let from = start.r.plus(on.enters, start.w);
        let to = start.r.plus(on.enters + rest, start.w);
        let mut second = frame.ground.pass(simd, on.body, from, start.w, rest, to);
        if !frame.ground.meshes.is_empty() {
            let into = self.crossed & self.alive & !second.crosses;
            let (meets, clear) = frame.ground.pass_meshes(simd, into, on.body, from, start.w, rest, to);
            second.crosses |= meets;
            second.clear = second.clear.min(clear);
            self.end.known_clear = choose(self.crossed, clear, self.end.known_clear);
            self.stale &= !self.crossed;
        }
        self.crossed &= !second.crosses & !to.dot(to).simd_gt(frame.range_squared);
        let crossed = self.crossed;
        self.absorbed = choose(crossed, start.mu_a * on.leaves + there.mu_a * rest, self.absorbed);
        self.end = PathLanes {
            r: to.or(crossed, self.end.r),
            free_path: choose(crossed, there.free_path, start.free_path),
            mu_a: choose(crossed, there.mu_a, start.mu_a),
            mu_s: choose(crossed, there.mu_s, start.mu_s),
            g: choose(crossed, there.g, start.g),
            window: choose(crossed, there.window, start.window),
            material: crossed.select(there.material, start.material),
            body: crossed.select(on.body, start.body),
            ..self.end
        };
        if frame.counts {
            (self.first, self.second) = (choose(crossed, on.leaves, self.first), choose(crossed, rest, self.second));
        }
        self.passage.clear = choose(crossed, second.clear, self.passage.clear);
    }

    /// Those that come to the plane before anything else: there Fresnel decides.
    #[inline(always)]
    pub(super) fn turn_at_plane(&mut self, frame: &Frame<'_>, plane: &Plane) {
        let (simd, start) = (self.simd, &self.start);
        let meeting = plane.meet(simd, start.r, start.w);
        let meets =
            meeting.towards & frame.ground.is_free(simd, &frame.parts, start.body, start.r, start.w, meeting.distance);
        self.turn(frame, &meeting, meets, M::splat(simd, true));
    }

    #[inline(always)]
    pub(super) fn turn_at_interfaces(&mut self, frame: &Frame<'_>, interfaces: &Interfaces) {
        let start = &self.start;
        let asked = self.passage.crosses & self.alive;
        let (meeting, mirrored, free) =
            interfaces.meet(self.simd, frame, asked, self.uniform(), (start.body, start.r, start.w));
        self.mirrored = mirrored;
        self.turn(frame, &meeting, meeting.towards, free);
    }

    /// Reflects those that meet an interface, or lets them out where nothing else is met behind it (`free`).
    #[inline(always)]
    fn turn(&mut self, frame: &Frame<'_>, meeting: &Meeting<S>, meets: M<S>, free: M<S>) {
        let start = &self.start;
        // The camera's ray has come in there.
        let fresh = start.number.simd_eq(frame.first);
        let meets = self.passage.crosses & meets & meeting.distance.simd_le(self.s) & !fresh;
        let reflected = self.uniform().simd_lt(meeting.reflectance);
        self.turned = meets & reflected & !meeting.place.dot(meeting.place).simd_gt(frame.range_squared);
        self.escapes = if frame.dark { meets & !reflected & free } else { M::splat(self.simd, false) };
        self.absorbed = choose(self.turned | self.escapes, start.mu_a * meeting.distance, self.absorbed);
        self.first = choose(self.turned, meeting.distance, self.first);
        self.end.r = meeting.place.or(self.turned, self.end.r);
        // There it stands at a surface: of a mesh, perhaps.
        self.end.known_clear = choose(self.turned, self.end.known_clear.min(frame.known), self.end.known_clear);
        self.passage.crosses &= !self.turned;
    }
}

impl<S: Simd> PathLanes<S> {
    /// With the coefficients of the media that fill these bodies.
    #[inline(always)]
    fn in_medium_of(mut self, simd: S, frame: &Frame<'_>, body: U<S>) -> Self {
        for (j, part) in frame.parts.iter().enumerate() {
            let (m, at) = (&frame.media[part.material], body.simd_eq(j as u32));
            let fields = [&mut self.free_path, &mut self.mu_a, &mut self.mu_s, &mut self.g, &mut self.window];
            for (x, y) in fields.into_iter().zip([m.free_path, m.mu_a, m.mu_s, m.g, m.window]) {
                *x = choose(at, splat(simd, y), *x);
            }
            self.material = at.select(U::splat(simd, part.material as u32), self.material);
        }
        self
    }
}
