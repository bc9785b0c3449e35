//! Rounds of paths over tiles of pixels, folded in order, until a stopping rule holds.

use std::ops::Range;

use turbid_contract::{Ctx, Error};
use turbid_optics::philox;

use crate::flock;
use crate::level::named;
use crate::moments::Moments;
use crate::params::Params;
use crate::path::{Nee, Setting, Walker};
use crate::reference::References;
use crate::rig::Rig;
use crate::shown::Shown;
use crate::state::State;

/// Paths per pixel that are summed before they are added to the image: in f64, and always the same ones, so that neither the
/// thread count nor a stop in between shows in the result.
const BATCH: u32 = 8;
/// Pixels of a tile: enough paths (with a batch of each) that lanes run dry for a small part of its time only.
const TILE: usize = 1024;
/// Tiles and batches of a round are chosen so that it holds about this many batches of a pixel.
const ROUND: usize = 1 << 15;
/// Seconds between checkpoints.
const CHECKPOINT_EVERY_S: f64 = 10.0;

/// What to trace, and how to judge it.
pub struct Task<'a> {
    pub params: &'a Params,
    pub rig: &'a Rig,
    pub shown: &'a Shown,
    /// Which pixels.
    pub pixels: &'a [u32],
    /// Stand-ins that are walked beside the scene by the same random numbers: then the sums of all channels are followed by those of
    /// the differences scene - stand-in (of nothing, in pixels without a stand-in).
    pub beside: Option<&'a References>,
    /// Told apart from other tasks of one seed.
    pub salt: u64,
    /// Whether it is kept for a longer run to continue.
    pub kept: bool,
    /// The error target is tested after this many paths per pixel and after every doubling.
    pub first_test: u32,
    /// Relative error of the image that sums of all channels give; `None` where it is dark.
    pub error: &'a (dyn Fn(&[Moments], u32) -> Option<f64> + Sync),
}

impl Task<'_> {
    /// How many sums per pixel there are.
    fn fields(&self) -> usize {
        self.rig.worlds.len() * if self.beside.is_some() { 2 } else { 1 }
    }
}

/// The sums of every channel, and the paths per pixel that they hold.
///
/// Continues the furthest checkpoint that a fresh run would have passed through.
pub fn trace(task: &Task<'_>, ctx: Ctx<'_>) -> Result<(Vec<Moments>, u32), Error> {
    let params = task.params;
    let q = task.shown.layout.width();
    let job = Job { task, ctx };
    let cap = params.samples.unwrap_or(u32::MAX);
    let whole = cap / BATCH * BATCH;
    let mut state = resume(task, q, whole, ctx);
    let resumed_at = state.samples;
    let mut next_checkpoint_s = CHECKPOINT_EVERY_S;
    let stopped = |state: &State| {
        let reached = params.target_error.is_some_and(|target| state.history.iter().any(|&(_, e)| e <= target.0));
        reached || (state.samples > 0 && params.max_seconds.is_some_and(|limit| ctx.time_is_up(limit.0)))
    };
    while state.samples < whole && !stopped(&state) {
        let mut next_test = task.first_test;
        while next_test <= state.samples {
            next_test = next_test.saturating_mul(2);
        }
        let until = whole.min(next_test);
        let most = (ROUND / (task.pixels.len() * task.fields())).max(1) as u32 * BATCH;
        let until = until.min(state.samples.saturating_add(most));
        if let Err(interrupted) = job.round(&mut state, until) {
            if state.samples > resumed_at && task.kept {
                ctx.checkpoint(&state.to_bytes(), u64::from(state.samples));
            }
            return Err(interrupted);
        }
        if state.samples == next_test {
            let error = (task.error)(&state.channels, state.samples);
            // Where nothing is lit there is nothing to wait for.
            state.history.push((state.samples, error.unwrap_or(0.0)));
        }
        ctx.progress(f64::from(state.samples), params.samples.map(f64::from), "paths per pixel");
        if task.kept && ctx.time_is_up(next_checkpoint_s) {
            while ctx.time_is_up(next_checkpoint_s) {
                next_checkpoint_s += CHECKPOINT_EVERY_S;
            }
            ctx.checkpoint(&state.to_bytes(), u64::from(state.samples));
        }
    }
    if state.samples > resumed_at && task.kept {
        ctx.checkpoint(&state.to_bytes(), u64::from(state.samples));
    }
    let cut_short = stopped(&state);
    if whole < cap && params.samples.is_some() && !cut_short {
        // The last, partial batch is not part of any checkpoint: a longer run has it whole.
        job.round(&mut state, cap)?;
    }
    ctx.measure("flights", state.flights as f64, "1");
    Ok((state.channels, state.samples))
}

/// The furthest checkpoint at which a fresh run would not have stopped before.
fn resume(task: &Task<'_>, q: usize, whole: u32, ctx: Ctx<'_>) -> State {
    let (channels, pixels) = (task.fields(), task.pixels.len());
    let mut at_most = whole;
    while let Some(bytes) = ctx.resume(u64::from(at_most)).filter(|_| task.kept) {
        let Some(state) = State::from_bytes(&bytes, channels, pixels, q) else {
            ctx.warn("a checkpoint of this render could not be read; it starts anew");
            break;
        };
        let target = task.params.target_error;
        let met = target.and_then(|t| state.history.iter().find(|(_, e)| *e <= t.0)).map(|h| h.0);
        match met {
            Some(n) if n < state.samples => at_most = n,
            _ => return state,
        }
    }
    State::new(channels, pixels, q)
}

struct Job<'a> {
    task: &'a Task<'a>,
    ctx: Ctx<'a>,
}

impl Job<'_> {
    /// Adds the paths `state.samples .. until` of every pixel.
    fn round(&self, state: &mut State, until: u32) -> Result<(), Error> {
        let (rig, all) = (self.task.rig, self.task.pixels);
        let tiles = all.len().div_ceil(TILE);
        let key = philox::key(self.ctx.seed() ^ self.task.salt);
        let batches = (until - state.samples).div_ceil(BATCH) as usize;
        let from = state.samples;
        // Batch after batch, each over all tiles: the order in which they are folded below.
        let parts = self.ctx.map_tiles(rig.worlds.len() * batches * tiles, |i| {
            let (channel, batch, tile) = (i / tiles / batches, (i / tiles % batches) as u32, i % tiles);
            let setting = Setting {
                world: &rig.worlds[channel],
                camera: &rig.camera,
                light: &rig.lights[channel],
                steady: &rig.steady[channel],
                carriers: &self.task.shown.carriers,
                pictures: &self.task.shown.pictures,
                key,
                channel: channel as u32,
                nee: Nee::Line,
            };
            let first = from + batch * BATCH;
            let samples = first..until.min(first.saturating_add(BATCH));
            let pixels = &all[tile * TILE..all.len().min((tile + 1) * TILE)];
            self.tile(setting, pixels, samples)
        })?;
        let channels = rig.worlds.len();
        // Nothing of a round that did not come to its end may enter the state.
        self.ctx.checked()?;
        if parts.iter().any(|part| part.endless) {
            return Err(Error::failed_with_hint(
                "a path of light does not end: it is in a closed space that absorbs nothing",
                "give a surface a reflectance below 1, or a medium some absorption",
            ));
        }
        for (i, part) in parts.into_iter().enumerate() {
            let (channel, first) = (i / tiles / batches, (i % tiles) * TILE);
            state.channels[channel].fold(first, &part.moments);
            if let Some(differences) = &part.differences {
                state.channels[channels + channel].fold(first, differences);
            }
            state.flights += part.flights;
        }
        state.samples = until;
        Ok(())
    }

    fn tile(&self, setting: Setting<'_>, pixels: &[u32], samples: Range<u32>) -> Part {
        let mut walker = Walker::new(setting, named(self.ctx.simd()));
        walker.excludes_specular = self.task.rig.excludes_specular;
        let width = self.task.shown.layout.width();
        let mut part =
            Part { moments: Moments::new(pixels.len(), width), differences: None, flights: 0, endless: false };
        // What was begun is thrown away with the whole round.
        if self.ctx.cancelled() {
            return part;
        }
        flock::walk_among(&mut walker, pixels, samples.clone());
        for path in 0..pixels.len() * samples.len() {
            part.moments.add(path / samples.len(), walker.response(path));
        }
        if let Some(beside) = self.task.beside {
            let mut differences = Moments::new(pixels.len(), width);
            for k in 0..beside.references.len() {
                part.flights += self.pair(&walker, beside, k, pixels, samples.clone(), &mut differences);
            }
            part.differences = Some(differences);
        }
        (part.flights, part.endless) = (part.flights + walker.take_flights(), walker.endless());
        part
    }

    /// Walks those pixels that have the stand-in `k` in it, and adds how far the scene's paths in `walker` differ; the flights made.
    fn pair(
        &self,
        walker: &Walker<'_>,
        beside: &References,
        k: usize,
        pixels: &[u32],
        samples: Range<u32>,
        differences: &mut Moments,
    ) -> u64 {
        let places: Vec<usize> =
            (0..pixels.len()).filter(|&i| beside.of_pixel[pixels[i] as usize] == Some(k)).collect();
        if places.is_empty() {
            return 0;
        }
        let scene = *walker.setting();
        let rig = &beside.references[k].paired;
        let setting = Setting { world: &rig.worlds[scene.channel as usize], ..scene };
        let mut other = Walker::new(setting, walker.level());
        other.excludes_specular = rig.excludes_specular;
        let some: Vec<u32> = places.iter().map(|&i| pixels[i]).collect();
        flock::walk_among(&mut other, &some, samples.clone());
        let mut difference = vec![0.0; self.task.shown.layout.width()];
        for (among, &place) in places.iter().enumerate() {
            for sample in 0..samples.len() {
                let ours = walker.response(place * samples.len() + sample);
                let theirs = other.response(among * samples.len() + sample);
                difference.iter_mut().zip(ours.iter().zip(theirs)).for_each(|(d, (a, b))| *d = a - b);
                differences.add(place, &difference);
            }
        }
        other.take_flights()
    }
}

struct Part {
    moments: Moments,
    differences: Option<Moments>,
    flights: u64,
    endless: bool,
}
