//! Which paths are walked side by side.

use std::ops::Range;

/// Of each (pixel, first sample) the `count` samples from there on, one batch after the other.
#[derive(Clone, Copy)]
pub struct Batches<'a> {
    pub of: &'a [(u32, u32)],
    pub count: u32,
}

impl Batches<'_> {
    /// How many paths there are.
    pub fn paths(&self) -> usize {
        self.of.len() * self.count as usize
    }

    /// (pixel, sample) of a path.
    #[inline]
    pub fn path(&self, i: usize) -> (u32, u32) {
        let count = self.count as usize;
        let (pixel, first) = self.of[i / count];
        (pixel, first + (i % count) as u32)
    }
}

/// The same samples of all of `pixels`.
pub fn alike(pixels: Range<usize>, samples: &Range<u32>) -> Vec<(u32, u32)> {
    pixels.map(|pixel| (pixel as u32, samples.start)).collect()
}
