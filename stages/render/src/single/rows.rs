//! Records as columns of f32 and u32, from which lanes are filled and into which they are packed.

use fearless_simd::prelude::*;

use super::lane::{F, LANES, M, U};

/// 31 records at most, and room behind them for a whole vector.
const ROOM: usize = 3 * LANES;

/// At most 31 records of `FLOATS` and `WORDS`.
#[derive(Clone, Debug)]
pub struct Rows<const FLOATS: usize, const WORDS: usize> {
    floats: [[f32; ROOM]; FLOATS],
    words: [[u32; ROOM]; WORDS],
    len: usize,
}

impl<const FLOATS: usize, const WORDS: usize> Default for Rows<FLOATS, WORDS> {
    fn default() -> Self {
        Self { floats: [[0.0; ROOM]; FLOATS], words: [[0; ROOM]; WORDS], len: 0 }
    }
}

impl<const FLOATS: usize, const WORDS: usize> Rows<FLOATS, WORDS> {
    pub fn len(&self) -> usize {
        self.len
    }

    /// Appends one record.
    #[inline]
    pub fn push(&mut self, floats: [f32; FLOATS], words: [u32; WORDS]) {
        self.set(self.len, floats, words);
        self.len += 1;
    }

    #[inline]
    pub fn set(&mut self, i: usize, floats: [f32; FLOATS], words: [u32; WORDS]) {
        for (column, x) in self.floats.iter_mut().zip(floats) {
            column[i] = x;
        }
        for (column, x) in self.words.iter_mut().zip(words) {
            column[i] = x;
        }
    }

    pub fn get(&self, i: usize) -> ([f32; FLOATS], [u32; WORDS]) {
        (self.floats.map(|column| column[i]), self.words.map(|column| column[i]))
    }

    /// Appends the lanes in `mask`, in their order; there is room for 16.
    #[inline(always)]
    pub fn pack<S: Simd>(&mut self, mask: M<S>, floats: &[F<S>; FLOATS], words: &[U<S>; WORDS]) {
        let at = self.len..self.len + LANES;
        for (column, x) in self.floats.iter_mut().zip(floats) {
            x.compress(mask).store_slice(&mut column[at.clone()]);
        }
        for (column, x) in self.words.iter_mut().zip(words) {
            x.compress(mask).store_slice(&mut column[at.clone()]);
        }
        self.len += mask.to_bitmask().count_ones() as usize;
    }

    /// Moves the last records into the lanes of `mask`, which holds as many at most.
    #[inline(always)]
    pub fn unpack<S: Simd>(&mut self, simd: S, mask: M<S>, floats: &mut [F<S>; FLOATS], words: &mut [U<S>; WORDS]) {
        self.len -= mask.to_bitmask().count_ones() as usize;
        let at = self.len..self.len + LANES;
        for (column, x) in self.floats.iter().zip(floats) {
            *x = F::from_slice(simd, &column[at.clone()]).expand_merge(mask, *x);
        }
        for (column, x) in self.words.iter().zip(words) {
            *x = U::from_slice(simd, &column[at.clone()]).expand_merge(mask, *x);
        }
    }

    /// The first 16 records.
    #[inline(always)]
    pub fn load<S: Simd>(&self, simd: S) -> ([F<S>; FLOATS], [U<S>; WORDS]) {
        let floats = self.floats.each_ref().map(|column| F::from_slice(simd, &column[..LANES]));
        (floats, self.words.each_ref().map(|column| U::from_slice(simd, &column[..LANES])))
    }

    /// Overwrites the first 16.
    #[inline(always)]
    pub fn store<S: Simd>(&mut self, floats: &[F<S>; FLOATS], words: &[U<S>; WORDS]) {
        for (column, x) in self.floats.iter_mut().zip(floats) {
            x.store_slice(&mut column[..LANES]);
        }
        for (column, x) in self.words.iter_mut().zip(words) {
            x.store_slice(&mut column[..LANES]);
        }
    }

    /// Removes the first 16, or all if there are fewer.
    #[inline(always)]
    pub fn drop_first(&mut self) {
        for column in &mut self.floats {
            column.copy_within(LANES..2 * LANES, 0);
        }
        for column in &mut self.words {
            column.copy_within(LANES..2 * LANES, 0);
        }
        self.len = self.len.saturating_sub(LANES);
    }
}
