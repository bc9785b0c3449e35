//! The batches of paths that a round walks, and what it brings.

use crate::moments::Moments;

/// Paths per pixel that are summed before they are added to the image: in f64, and always the same ones, so that neither the
/// thread count nor a stop in between shows in the result.
pub const BATCH: u32 = 8;

/// The next `count` paths of a pixel, by its place among those that are traced.
#[derive(Clone, Copy)]
pub struct Batch {
    pub place: u32,
    pub first: u32,
    pub count: u32,
}

/// Those between `done` and `due` batches of each pixel, pixel by pixel.
pub fn batches_between(done: &[u32], due: &[u32]) -> Vec<Batch> {
    let of = |(place, (&done, &due)): (usize, (&u32, &u32))| {
        (done..due).map(move |batch| Batch { place: place as u32, first: batch * BATCH, count: BATCH })
    };
    done.iter().zip(due).enumerate().flat_map(of).collect()
}

/// The sums of a tile's batches, one after the other.
pub struct Part {
    /// Of every channel of the group.
    pub moments: Vec<Moments>,
    /// The same of the differences from control variates; empty where there are none.
    pub differences: Vec<Moments>,
    pub flights: [u64; 2],
    pub given_up: u64,
    pub endless: bool,
}

/// What a round brings.
#[derive(Default)]
pub struct Parts {
    /// Walk by walk, each of all tiles.
    pub parts: Vec<Part>,
    /// For each tile the places of its batches.
    pub places: Vec<Vec<u32>>,
    pub flights: [u64; 2],
    pub given_up: u64,
    pub endless: bool,
}
