//! A shard of a build that many processes share: its samples are brought up to date in the store, and the build that follows finds
//! them there. The folder has one builder, which is not among them.

use super::{Building, State, Stopped, WINDOW};
use crate::dataset::index::Points;
use crate::plan::shard::Shard;

/// What a shard did.
#[derive(Clone, Copy, Debug)]
pub struct Made {
    /// Within the limits of `keep`.
    pub samples: usize,
    pub hits: usize,
    pub ran: usize,
}

impl Building<'_> {
    /// Brings the samples of a shard up to date: a block of all points, those of the first split first.
    pub fn make(&self, shard: Shard) -> Result<Made, Stopped> {
        self.look_ahead()?;
        let splits = || self.dataset.splits.iter().enumerate();
        let all: Vec<(usize, u64)> =
            splits().flat_map(|(place, split)| split.indices.iter().map(move |&index| (place, index))).collect();
        let block = &all[shard.block(all.len())];
        let mut state = State { points: Points::for_points(block.len()), ..State::default() };
        let mut found = Vec::new();
        for window in block.chunk_by(|a, b| a.0 == b.0).flat_map(|of_split| of_split.chunks(WINDOW)) {
            let indices: Vec<u64> = window.iter().map(|(_, index)| *index).collect();
            self.window((window[0].0, 0), &indices, &mut found, &mut state)?;
            self.store.settle().map_err(|e| Stopped::Failed(e.to_string()))?;
        }
        self.store.finish().map_err(|e| Stopped::Failed(e.to_string()))?;
        if let Some(log) = &state.log {
            drop(log.end_of_parts(state.hits, state.ran));
        }
        Ok(Made { samples: found.len(), hits: state.hits, ran: state.ran })
    }
}
