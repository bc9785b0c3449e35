//! Copies of paths in lanes, until they go.

use std::ops::Range;

use turbid_optics::elementary::ln;
use turbid_optics::philox::unit_fine;

use super::lane::LANES;
use crate::lengths::MOST_LENGTHS;
use crate::random::{COPY, Purpose, Stream};

/// A path as `Paths` holds it.
pub type Row = ([f32; 16], [u32; 6], [f32; MOST_LENGTHS]);

/// Copies of the paths in flight that wait for the lane of their path, of each the last first: what a path brings is so added up in an order of its own.
#[derive(Default)]
pub struct Copies {
    waiting: [Vec<Row>; LANES],
    /// Lanes, by bits, for which some wait.
    pub lanes: u64,
}

impl Copies {
    pub fn push(&mut self, lane: usize, row: Row) {
        self.waiting[lane].push(row);
        self.lanes |= 1 << lane;
    }

    /// Copies of a path after a collision, whose random numbers are their own from there on; see `Walker::push_copies`.
    pub fn add(
        &mut self,
        lane: usize,
        (mut floats, mut words, lengths): Row,
        numbers: Range<u32>,
        key: [u32; 2],
        high: u32,
    ) {
        let [next, sample, pixel, ..] = words;
        let stream = Stream::new(key, pixel, sample, high >> 16);
        for number in numbers {
            let [sample, a, b, _] = stream.block(Purpose::Copy(u64::from(next - 2), number));
            (floats[6], floats[7]) = (-ln(unit_fine(a, b)) as f32, 0.0);
            words[1] = sample | COPY;
            self.push(lane, (floats, words, lengths));
        }
    }

    pub fn pop(&mut self, lane: usize) -> Row {
        let row = self.waiting[lane].pop().expect("some wait");
        self.lanes ^= u64::from(self.waiting[lane].is_empty()) << lane;
        row
    }
}
