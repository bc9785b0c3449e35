//! Records as columns of f32 and u32, from which lanes are filled and into which they are packed.

use fearless_simd::prelude::*;

use super::lane::{F, LANES, M, U};
use crate::lengths::MOST_LENGTHS;

/// Lengths of sixteen paths, mm.
pub type Counts<S> = [F<S>; MOST_LENGTHS];

/// 31 records at most, and room behind them for a whole vector.
const ROOM: usize = 3 * LANES;

/// At most 31 records of `FLOATS` and `WORDS`, and of the lengths (mm) by which channels that share paths differ.
#[derive(Clone, Debug)]
pub struct Rows<const FLOATS: usize, const WORDS: usize> {
    floats: [[f32; ROOM]; FLOATS],
    lengths: [[f32; ROOM]; MOST_LENGTHS],
    /// Whether lengths are kept; where they are not, those of a record are any numbers.
    counted: bool,
    words: [[u32; ROOM]; WORDS],
    len: usize,
}

impl<const FLOATS: usize, const WORDS: usize> Rows<FLOATS, WORDS> {
    /// None yet.
    pub fn new(counted: bool) -> Self {
        let (floats, words) = ([[0.0; ROOM]; FLOATS], [[0; ROOM]; WORDS]);
        Self { floats, lengths: [[0.0; ROOM]; MOST_LENGTHS], counted, words, len: 0 }
    }

    pub fn len(&self) -> usize {
        self.len
    }

    /// Appends one record.
    #[inline]
    pub fn push(&mut self, floats: [f32; FLOATS], words: [u32; WORDS], lengths: [f32; MOST_LENGTHS]) {
        self.set(self.len, floats, words, lengths);
        self.len += 1;
    }

    #[inline]
    pub fn set(&mut self, i: usize, floats: [f32; FLOATS], words: [u32; WORDS], lengths: [f32; MOST_LENGTHS]) {
        for (column, x) in self.floats.iter_mut().zip(floats).chain(self.lengths.iter_mut().zip(lengths)) {
            column[i] = x;
        }
        for (column, x) in self.words.iter_mut().zip(words) {
            column[i] = x;
        }
    }

    pub fn get(&self, i: usize) -> ([f32; FLOATS], [u32; WORDS], [f32; MOST_LENGTHS]) {
        let (floats, words) = (std::array::from_fn(|k| self.floats[k][i]), std::array::from_fn(|k| self.words[k][i]));
        (floats, words, std::array::from_fn(|k| self.lengths[k][i]))
    }

    /// Appends the lanes in `mask`, in their order; there is room for 16.
    #[inline(always)]
    pub fn pack<S: Simd>(&mut self, mask: M<S>, floats: &[F<S>; FLOATS], words: &[U<S>; WORDS], lengths: &Counts<S>) {
        let at = self.len..self.len + LANES;
        for (column, x) in self.floats.iter_mut().zip(floats) {
            x.compress(mask).store_slice(&mut column[at.clone()]);
        }
        if self.counted {
            for (column, x) in self.lengths.iter_mut().zip(lengths) {
                x.compress(mask).store_slice(&mut column[at.clone()]);
            }
        }
        for (column, x) in self.words.iter_mut().zip(words) {
            x.compress(mask).store_slice(&mut column[at.clone()]);
        }
        self.len += mask.to_bitmask().count_ones() as usize;
    }

    /// Moves the last records into the lanes of `mask`, which holds as many at most.
    #[inline(always)]
    pub fn unpack<S: Simd>(
        &mut self,
        simd: S,
        mask: M<S>,
        floats: &mut [F<S>; FLOATS],
        words: &mut [U<S>; WORDS],
        lengths: &mut Counts<S>,
    ) {
        self.len -= mask.to_bitmask().count_ones() as usize;
        let at = self.len..self.len + LANES;
        for (column, x) in self.floats.iter().zip(floats) {
            *x = F::from_slice(simd, &column[at.clone()]).expand_merge(mask, *x);
        }
        if self.counted {
            for (column, x) in self.lengths.iter().zip(lengths) {
                *x = F::from_slice(simd, &column[at.clone()]).expand_merge(mask, *x);
            }
        }
        for (column, x) in self.words.iter().zip(words) {
            *x = U::from_slice(simd, &column[at.clone()]).expand_merge(mask, *x);
        }
    }

    /// The first 16 records.
    #[inline(always)]
    #[allow(clippy::type_complexity, reason = "three kinds of columns")]
    pub fn load<S: Simd>(&self, simd: S) -> ([F<S>; FLOATS], [U<S>; WORDS], Counts<S>) {
        // No `map`: what is not inlined loses the vector instructions.
        let (mut floats, mut words) = ([F::splat(simd, 0.0); FLOATS], [U::splat(simd, 0); WORDS]);
        let mut lengths = [F::splat(simd, 0.0); MOST_LENGTHS];
        for (x, column) in floats.iter_mut().zip(&self.floats) {
            *x = F::from_slice(simd, &column[..LANES]);
        }
        for (x, column) in words.iter_mut().zip(&self.words) {
            *x = U::from_slice(simd, &column[..LANES]);
        }
        if self.counted {
            for (x, column) in lengths.iter_mut().zip(&self.lengths) {
                *x = F::from_slice(simd, &column[..LANES]);
            }
        }
        (floats, words, lengths)
    }

    /// Overwrites the first 16.
    #[inline(always)]
    pub fn store<S: Simd>(&mut self, floats: &[F<S>; FLOATS], words: &[U<S>; WORDS], lengths: &Counts<S>) {
        if self.counted {
            for (column, x) in self.lengths.iter_mut().zip(lengths) {
                x.store_slice(&mut column[..LANES]);
            }
        }
        for (column, x) in self.floats.iter_mut().zip(floats) {
            x.store_slice(&mut column[..LANES]);
        }
        for (column, x) in self.words.iter_mut().zip(words) {
            x.store_slice(&mut column[..LANES]);
        }
    }

    /// Removes the first 16, or all if there are fewer.
    #[inline(always)]
    pub fn drop_first<S: Simd>(&mut self, simd: S) {
        for column in &mut self.floats {
            F::from_slice(simd, &column[LANES..2 * LANES]).store_slice(&mut column[..LANES]);
        }
        if self.counted {
            for column in &mut self.lengths {
                F::from_slice(simd, &column[LANES..2 * LANES]).store_slice(&mut column[..LANES]);
            }
        }
        for column in &mut self.words {
            U::from_slice(simd, &column[LANES..2 * LANES]).store_slice(&mut column[..LANES]);
        }
        self.len = self.len.saturating_sub(LANES);
    }
}

/// Columns: r, w, what is left of the absorption depth, what its rounding lost, weight, free path, mu_a, mu_s, g, window, distance
/// within which there is no surface that lanes do not know, MIS weight with a light-directed branch; block of random numbers, sample, pixel, response, material, body.
pub type Paths = Rows<16, 6>;
