//! Paths walked side by side in f32.

use fearless_simd::prelude::*;
use glam::DVec3;
use turbid_optics::at_level;

use super::flight::Outcome;
use super::frame::Frame;
use super::in_flight::Packet;
use super::lane::{LANES, M};
use super::next_event::estimate_while;
use super::rows::PathRow;
use super::scalar_connections::make_scalar_connections;
use super::scalar_fallback::scalar_fallback;
use super::start::Starts;
use crate::batches::Batches;
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

impl<S: Simd> Packet<'_, S> {
    #[inline(always)]
    fn run(mut self, walker: &mut Walker<'_>, mut starts: Starts<'_>, responses: &mut [f64]) {
        let simd = self.simd;
        let mut flights = 0;
        loop {
            if self.frame.weight_windows.is_some() {
                self.revive();
            }
            // The last light-directed branches go when all paths have ended.
            let last = self.alive == 0 && starts.ready.len() == 0 && !starts.more();
            let branching = self.light_branches.muster(simd, walker, self.frame, last);
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
                starts.ready.unpack(simd, filling, &mut self.path);
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
            let Outcome { flights: made, divergent, connecting, out } = self.fly(branching, responses);
            // On its way to infinity a path makes one more.
            flights += made + out.count_ones() as usize;
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
            estimate_while(simd, &mut self.next_events, LANES, self.frame, responses);
            if !self.next_events.scalar_connections.is_empty() {
                make_scalar_connections(walker, self.frame, &mut self.next_events);
            }
        }
        estimate_while(simd, &mut self.next_events, 1, self.frame, responses);
        make_scalar_connections(walker, self.frame, &mut self.next_events);
        walker.count_flights(flights);
    }

    /// Next-event estimation that lanes cannot make.
    #[inline(never)]
    fn next_event_singly(&mut self, walker: &mut Walker<'_>, connecting: u64) {
        let mut lanes = connecting;
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            let mut place = self.frame.place(self.memory.get(lane));
            place.number += 2;
            let [x, y, z, roulette, clear] = self.singly.map(|column| f64::from(column[lane]));
            place.clear = clear;
            let own = DVec3::new(x, y, z);
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
        self.memory.store(&self.path);
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
                    self.memory.set(lane, &PathRow { known_clear: known, ..row });
                    continue;
                }
            }
            let goes_on = scalar_fallback(walker, self.frame, &mut place);
            self.take_copies(walker, lane);
            if goes_on {
                self.memory.set(lane, &self.frame.row(&place));
            } else {
                self.alive &= !(1 << lane);
            }
        }
        self.memory.load(self.simd, &mut self.path);
    }
}
