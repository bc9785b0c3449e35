//! Paths that rest while light-directed branches fly in their lanes.

use fearless_simd::prelude::*;

use super::in_flight::Packet;
use super::lane::LANES;

impl<S: Simd> Packet<'_, S> {
    /// Puts light-directed branches into lanes, as many as go in, and what is there aside.
    #[inline(always)]
    pub(super) fn rest(&mut self) {
        self.resting.store(&self.path);
        self.light_branches.waiting.load(self.simd, &mut self.path);
        self.resting_alive =
            std::mem::replace(&mut self.alive, (1 << self.light_branches.waiting.len().min(LANES)) - 1);
        self.light_branches.waiting.drop_first(self.simd);
    }

    /// The paths again: light-directed branches make one flight.
    #[inline(always)]
    pub(super) fn resume(&mut self) {
        self.resting.load(self.simd, &mut self.path);
        self.alive = self.resting_alive;
    }
}
