//! Images of f64 of one size, for what a calibration works with.

use std::ops::Range;
use std::sync::Mutex;

use fearless_simd::Level;
use turbid_contract::{Ctx, Error};
use turbid_optics::level::named;

/// Rows that a thread fills at a time: enough that those within reach of a wide Gaussian are few beside them.
const BLOCK: usize = 128;

/// Where planes come from, and go back to: memory that was used once need not be taken from the system again, page by page.
pub struct Room<'a> {
    pub rows: usize,
    pub columns: usize,
    pub level: Level,
    ctx: Ctx<'a>,
    free: Mutex<Vec<Vec<f64>>>,
}

/// A row-major image.
pub struct Plane<'r> {
    pub pixels: Vec<f64>,
    free: &'r Mutex<Vec<Vec<f64>>>,
}

impl Drop for Plane<'_> {
    fn drop(&mut self) {
        if let Ok(mut free) = self.free.lock() {
            free.push(std::mem::take(&mut self.pixels));
        }
    }
}

impl<'a> Room<'a> {
    pub fn new(rows: usize, columns: usize, ctx: Ctx<'a>) -> Self {
        Self { rows, columns, level: named(ctx.simd()), ctx, free: Mutex::default() }
    }

    /// A plane that `work` fills, block by block of rows on all threads: it gets the rows of a block and their pixels, which hold anything.
    ///
    /// Error: the run was cancelled.
    pub fn fill(&self, work: impl Fn(Range<usize>, &mut [f64]) + Sync) -> Result<Plane<'_>, Error> {
        let kept = self.free.lock().ok().and_then(|mut free| free.pop());
        let mut plane = Plane { pixels: kept.unwrap_or_else(|| vec![0.0; self.rows * self.columns]), free: &self.free };
        let blocks: Vec<Mutex<&mut [f64]>> = plane.pixels.chunks_mut(BLOCK * self.columns).map(Mutex::new).collect();
        self.ctx.map_tiles(blocks.len(), |i| {
            let mut pixels = blocks[i].lock().expect("each block is taken once");
            let start = i * BLOCK;
            work(start..start + pixels.len() / self.columns, &mut pixels);
        })?;
        drop(blocks);
        Ok(plane)
    }
}
