//! Sixteen points or rays side by side.

use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x16, mask32x16, u32x16};

use super::block::Crossing;

pub const LANES: usize = 16;

pub(in super::super) type F<S> = f32x16<S>;
pub(super) type U<S> = u32x16<S>;
pub(super) type M<S> = mask32x16<S>;
/// Three coordinates.
pub type V<S> = [f32x16<S>; 3];

/// p + t w.
#[derive(Clone, Copy)]
pub struct Rays<S: Simd> {
    pub p: V<S>,
    pub w: V<S>,
}

/// What lies on the way of each, in order.
#[derive(Clone, Debug, Default)]
pub struct Crossings {
    pub(super) list: Vec<Crossing>,
    /// Where each lane's end in the list.
    pub(super) ends: [usize; LANES],
}

impl Crossings {
    #[inline]
    pub fn of(&self, lane: usize) -> &[Crossing] {
        let start = lane.checked_sub(1).map_or(0, |before| self.ends[before]);
        &self.list[start..self.ends[lane]]
    }

    /// With what is sorted by lanes.
    pub(super) fn fill(&mut self, all: &[(usize, Crossing)]) {
        self.list.clear();
        self.list.extend(all.iter().map(|(_, crossing)| crossing));
        self.ends = std::array::from_fn(|lane| all.partition_point(|(l, _)| *l <= lane));
    }

    pub(super) fn clear(&mut self) {
        self.list.clear();
        self.ends = [0; LANES];
    }
}

/// The lanes that are set.
#[inline(always)]
pub fn bits(mut mask: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(
        #[inline(always)]
        move || {
            let lane = mask.trailing_zeros() as usize;
            mask &= mask.wrapping_sub(1);
            (lane < LANES).then_some(lane)
        },
    )
}

#[inline(always)]
pub(in super::super) fn dot<S: Simd>(a: &V<S>, b: &V<S>) -> F<S> {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
pub(super) fn lane_of<S: Simd>(v: &V<S>, lane: usize) -> [f32; 3] {
    [v[0].as_slice()[lane], v[1].as_slice()[lane], v[2].as_slice()[lane]]
}
