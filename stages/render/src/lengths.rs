//! How far paths have come in the media that tell channels apart, and what that makes of what they bring.

use crate::lamp::Source;

/// Media whose lengths a path counts; channels that differ in more of them are walked apart.
pub const MOST_LENGTHS: usize = 3;

/// mm of a path in each counted medium; the last place is for all others, and means nothing.
pub type Lengths = [f64; MOST_LENGTHS + 1];

/// Before the first medium.
pub const NO_LENGTHS: Lengths = [0.0; MOST_LENGTHS + 1];

/// Of two stretches together.
#[inline]
pub fn sum(a: &Lengths, b: &Lengths) -> Lengths {
    std::array::from_fn(|i| a[i] + b[i])
}

/// What tells the channels of a group apart.
#[derive(Clone, Debug, PartialEq)]
pub struct Shared {
    /// For each material of the world, its place in [`Lengths`].
    pub counted: Vec<usize>,
    pub channels: Vec<ChannelScale>,
}

/// One of several channels.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelScale {
    /// Absorption beyond that of the walk, mm^-1, of each counted medium.
    pub excess: [f64; MOST_LENGTHS],
    /// Power of the projector over that of the group's first channel.
    pub projector: f64,
    /// The same of every lamp.
    pub lamps: Vec<f64>,
    /// The same of light from infinity.
    pub ambient: f64,
}

/// Adds a stretch through a material to the lengths by which channels differ.
#[inline(always)]
pub(crate) fn count(shared: Option<&Shared>, lengths: &mut Lengths, material: usize, length: f64) {
    if let Some(shared) = shared {
        lengths[shared.counted[material]] += length;
    }
}

impl ChannelScale {
    /// What a path of these lengths brings to the channel, over what it brings to the walk.
    pub fn weight(&self, lengths: &Lengths) -> f64 {
        // A length may be infinite.
        let counts = self.excess.iter().zip(lengths).filter(|(excess, _)| **excess > 0.0);
        libm::exp(-counts.map(|(excess, length)| excess * length).sum::<f64>())
    }

    /// Light of a source over that which the walk sees.
    pub fn of(&self, source: Source<'_>) -> f64 {
        match source {
            Source::Projector(_) => self.projector,
            Source::Lamp(i, _) => self.lamps[i],
        }
    }
}
