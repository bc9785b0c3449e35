//! Copies of paths in lanes, until they go.

use std::ops::Range;

use turbid_optics::elementary::ln;
use turbid_optics::philox::unit_fine;

use super::lane::LANES;
use super::rows::PathRow;
use crate::random::{COPY, Purpose, Stream};

/// Copies of the paths in flight that wait for the lane of their path, of each the last first: what a path brings is so added up in an order of its own.
#[derive(Default)]
pub struct Copies {
    waiting: [Vec<PathRow>; LANES],
    /// Lanes, by bits, for which some wait.
    pub lanes: u64,
}

impl Copies {
    pub fn push(&mut self, lane: usize, row: PathRow) {
        self.waiting[lane].push(row);
        self.lanes |= 1 << lane;
    }

    /// Copies of a path after a collision, whose random numbers are their own from there on; see `Walker::push_copies`.
    pub fn add(&mut self, lane: usize, mut copy: PathRow, numbers: Range<u32>, stream: Stream) {
        let last = u64::from(copy.number - 2);
        for number in numbers {
            let [sample, a, b, _] = stream.block(Purpose::Copy(last, number));
            (copy.absorption_depth, copy.absorption_lost) = (-ln(unit_fine(a, b)) as f32, 0.0);
            copy.sample = sample | COPY;
            self.push(lane, copy);
        }
    }

    pub fn pop(&mut self, lane: usize) -> PathRow {
        let row = self.waiting[lane].pop().expect("some wait");
        self.lanes ^= u64::from(self.waiting[lane].is_empty()) << lane;
        row
    }
}
