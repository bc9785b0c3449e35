//! A photon's random numbers: a function of seed, stream, photon and draw.

use turbid_optics::philox::{key, philox4x32, unit};

/// Uniform numbers of one photon, drawn in order.
#[derive(Clone, Debug)]
pub struct Stream {
    key: [u32; 2],
    counter: [u32; 4],
    block: [u32; 4],
    used: usize,
}

impl Stream {
    /// The numbers of photon `photon` of the reading `reading`; independent of all others.
    pub fn new(seed: u64, reading: u32, photon: u64) -> Self {
        let counter = [0, photon as u32, (photon >> 32) as u32, reading];
        Self { key: key(seed), counter, block: [0; 4], used: 4 }
    }

    /// Uniform in (0, 1), 32 bits.
    #[inline(always)]
    pub fn uniform(&mut self) -> f64 {
        if self.used == 4 {
            self.block = philox4x32(self.counter, self.key);
            self.counter[0] = self.counter[0].wrapping_add(1);
            self.used = 0;
        }
        let bits = self.block[self.used];
        self.used += 1;
        unit(bits)
    }
}

/// The reading's number for a medium: follows from its properties alone, so that a list may grow without changing what was there.
///
/// 0 to 15 stay free for the readings that normalise.
pub fn of_medium(properties: &[f64]) -> u32 {
    let mut state = [0; 4];
    for value in properties {
        // -0 is 0.
        let bits = (value + 0.0).to_bits();
        state[0] ^= bits as u32;
        state[1] ^= (bits >> 32) as u32;
        state = philox4x32(state, [0, 0]);
    }
    state[0] | 16
}
