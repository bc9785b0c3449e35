//! Where the random numbers of a path come from.

use turbid_optics::philox::philox4x32;

/// Random numbers of one path: blocks of four, addressed by number.
#[derive(Clone, Copy)]
pub(crate) struct Stream {
    key: [u32; 2],
    pixel: u32,
    sample: u32,
    channel: u32,
}

impl Stream {
    pub(crate) fn new(key: [u32; 2], pixel: u32, sample: u32, channel: u32) -> Self {
        Self { key, pixel, sample, channel }
    }

    #[inline]
    pub(crate) fn block(&self, number: u64) -> [u32; 4] {
        philox4x32(counter(number, self.channel, self.sample, self.pixel), self.key)
    }

    /// Random numbers for what few scenes need, apart from all others: four bits each for `source` and `place`, seven for `decision`.
    /// Beyond that numbers are used again, for other things.
    pub(crate) fn aside(&self, number: u64, source: usize, place: usize, decision: u32) -> [u32; 4] {
        let aside = Self { channel: self.channel | ASIDE, ..*self };
        aside.block(u64::from(aside_code(source, place, decision)) << 32 | number)
    }
}

/// The bit of a channel's number that is set in [`Stream::aside`].
pub(crate) const ASIDE: u32 = 1 << 15;

/// What stands there above the lower 32 bits of the block's number.
pub(crate) fn aside_code(source: usize, place: usize, decision: u32) -> u32 {
    (source.min(15) << 12 | place.min(15) << 8) as u32 | decision.min(127) << 1
}

/// Where a block of random numbers stands: 2^48 blocks a path, 2^15 channels (twice).
#[inline(always)]
pub(crate) fn counter(number: u64, channel: u32, sample: u32, pixel: u32) -> [u32; 4] {
    [number as u32, (number >> 32) as u32 | (channel << 16), sample, pixel]
}
