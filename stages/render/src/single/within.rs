//! Flights of plain frames, made in registers one after the other while paths stay in their medium.

use fearless_simd::prelude::*;

use super::flight::Flight;
use super::free_flight::{Draw, FreeFlight};
use super::in_flight::Packet;
use super::lane::{LANES, M};
use super::rows::PathLanes;

/// Idle lanes that are filled together: to fill them costs more than the flights that a few lanes miss.
const FILLED_TOGETHER: u32 = 4;

impl<S: Simd> Packet<'_, S> {
    /// How many flights were made, and the next one if that is not so plain; `None` where lanes are to be filled, or the queue of next events is full. `LONE`:
    /// there is one body, and those that leave it end; `PLANE`: unless its surface reflects them.
    #[inline(never)]
    pub(super) fn within<const LONE: bool, const PLANE: bool>(
        &mut self,
        branching: bool,
        responses: &mut [f64],
    ) -> (usize, Option<FreeFlight<S>>) {
        self.simd.vectorize(
            #[inline(always)]
            || self.go_on_within::<LONE, PLANE>(branching, responses),
        )
    }

    #[inline(always)]
    fn go_on_within<const LONE: bool, const PLANE: bool>(
        &mut self,
        branching: bool,
        responses: &mut [f64],
    ) -> (usize, Option<FreeFlight<S>>) {
        let (simd, frame) = (self.simd, self.frame);
        let (mut start, mut alive) = (self.path, M::from_bitmask(simd, self.alive));
        let (mut flights, mut draw) = (0, Draw::of(simd, frame, 0, &start));
        let free = loop {
            // Where few are interrupted the next one is drawn while this one waits for its results.
            let next = if LONE { Draw::of(simd, frame, 2, &start) } else { draw };
            let free = FreeFlight::of(frame, &start, draw);
            if !LONE && (free.passage.crosses & alive).any_true() {
                break Some(free);
            }
            let mut flight = Flight::of(simd, start, alive, free);
            if LONE && !PLANE {
                flight.escapes = free.passage.crosses;
            }
            if PLANE
                && let Some(plane) = &frame.plane
                && flight.any_crosses()
            {
                flight.turn_at_plane(frame, plane);
            }
            let fate = flight.fate::<true>(frame, branching);
            if fate.divergent.any_true() {
                break Some(free);
            }
            flights += self.alive.count_ones() as usize;
            let mut own = flight.scattered(frame);
            if PLANE {
                flights += fate.out.to_bitmask().count_ones() as usize;
                own = flight.mirrored.or(flight.turned, own);
                flight.turned &= fate.goes_on;
                self.queue_turned(&flight, own, responses);
            }
            self.queue_next_events(&flight, &fate, own);
            start.go_on(fate.goes_on, &PathLanes { w: own, number: start.number + 2, ..flight.end });
            let goes_on = fate.goes_on.to_bitmask();
            let idle = goes_on != self.alive && LANES as u32 - goes_on.count_ones() >= FILLED_TOGETHER;
            (self.alive, alive) = (goes_on, fate.goes_on);
            if idle || self.next_events.vertices.len() >= LANES {
                break None;
            }
            draw = if LONE { next } else { Draw::of(simd, frame, 0, &start) };
        };
        self.path.moved(&start);
        (flights, free)
    }
}
