//! Rounds of paths over tiles of pixels, folded in order, until a stopping rule holds.

use std::ops::Range;

use self::round::{BATCH, Batch, Part, Parts, batches_between};
use turbid_contract::{Artifact, Ctx, Error};
use turbid_optics::philox;

use crate::allocation;
use crate::batches::Batches;
use crate::channels::{Group, groups};
use crate::control_variate::ControlVariates;
use crate::image_part::{ImagePart, part_of, parts_along};
use crate::level::named;
use crate::moments::Moments;
use crate::packet;
use crate::params::{Allocate, Params};
use crate::projected::Projected;
use crate::rig::Rig;
use crate::setting::{Nee, Setting};
use crate::single::limits::range;
use crate::so_far::is_due;
use crate::state::State;
use crate::stopping_criterion::StoppingCriterion;
use crate::walker::Walker;

mod round;

/// Batches of a tile: enough paths that lanes run dry for a small part of its time only.
const TILE: usize = 1024;
/// Tiles and batches of a round are chosen so that it holds about this many batches of a pixel.
pub const ROUND: usize = 1 << 15;
/// Batches whose sums are held beside the state at a time; a multiple of the tile. More than this in a round are walked in parts.
pub const ROUND_PART: usize = 1 << 19;
/// After so many paths per pixel it is decided where control variates are worth their time.
pub const PILOT: u32 = 16;
/// Tells the paths beside the even ones apart.
const MORE: u64 = 1 << 63;

/// What there is of the frames: of a state and the paths of each pixel.
pub type Preview<'a> = dyn Fn(&State, &[u32]) -> Option<Artifact> + Sync + 'a;

/// What to trace, and how to judge it.
pub struct Task<'a> {
    pub params: &'a Params,
    pub rig: &'a Rig,
    pub projected: &'a Projected,
    /// Which pixels.
    pub pixels: &'a [u32],
    /// Control variates that are walked with the scene by the same random numbers: then the sums of all channels are followed by those of
    /// the differences scene - control variate (of nothing, in pixels without one).
    pub controls: Option<&'a ControlVariates>,
    /// Told apart from other tasks of one seed.
    pub salt: u64,
    /// Whether it is kept for a longer run to continue.
    pub kept: bool,
    /// The error target is tested after this many paths per pixel and after every doubling.
    pub first_test: u32,
    pub allocate: Allocate,
    pub criterion: &'a dyn StoppingCriterion,
    /// What there is of the frames, for people who look on.
    pub so_far: Option<&'a Preview<'a>>,
}

/// What was traced.
pub struct Sums {
    /// Of every channel.
    pub channels: Vec<Moments>,
    /// Paths per pixel, on average.
    pub samples: u32,
    /// Those of each pixel.
    pub paths: Vec<u32>,
    /// The pixels whose paths were all walked in their control variate, too.
    pub with_control: Option<Vec<bool>>,
    /// In the scene, and in control variates.
    pub flights: [u64; 2],
}

impl Task<'_> {
    /// How many sums per pixel there are.
    fn fields(&self) -> usize {
        self.rig.worlds.len() * if self.controls.is_some() { 2 } else { 1 }
    }

    /// Paths of each pixel.
    fn paths(&self, state: &State) -> Vec<u32> {
        let Some(more) = &state.more else { return vec![state.samples; self.pixels.len()] };
        let batches = state.samples / BATCH;
        // What is left of a batch is even.
        let even = allocation::even(batches) * BATCH + state.samples % BATCH;
        let from = allocation::doubling(batches).unwrap_or(batches);
        more.done(from, batches).iter().map(|more| even + BATCH * more).collect()
    }
}

/// The sums of every channel, and the paths per pixel that they hold.
///
/// Continues the furthest checkpoint that a fresh run would have passed through.
pub fn trace(task: &Task<'_>, ctx: Ctx<'_>) -> Result<Sums, Error> {
    let params = task.params;
    let job = Job::new(task, ctx);
    // Connections that are missing.
    let mut given_up = 0;
    let cap = params.samples.unwrap_or(u32::MAX);
    let whole = cap / BATCH * BATCH;
    let mut state = resume(task, whole, ctx);
    let resumed_at = state.samples;
    let stopped = |state: &State| {
        let reached = params.target_error.is_some_and(|target| state.history.iter().any(|&(_, e)| e <= target.0));
        let part = || task.criterion.part(state.with_control.as_deref());
        reached || (state.samples > 0 && params.max_seconds.is_some_and(|limit| ctx.time_is_up(part() * limit.0)))
    };
    while state.samples < whole && !stopped(&state) {
        if state.samples >= PILOT && task.controls.is_some() && state.with_control.is_none() {
            state.with_control = Some(job.with_control(&state));
        }
        job.plan(&mut state);
        let mut next_test = task.first_test;
        while next_test <= state.samples {
            next_test = next_test.saturating_mul(2);
        }
        let until = whole.min(next_test);
        let until = if task.controls.is_some() && state.samples < PILOT { until.min(PILOT) } else { until };
        let most = (ROUND / (task.pixels.len() * task.fields())).max(1) as u32 * BATCH;
        let until = until.min(state.samples.saturating_add(most));
        let before = state.samples;
        match job.round(&mut state, until) {
            Ok(connections) => given_up += connections,
            Err(interrupted) => {
                if state.samples > resumed_at && task.kept && state.is_whole {
                    keep(&state, ctx);
                }
                return Err(interrupted);
            }
        }
        if state.samples == next_test {
            let error = task.criterion.error(&state.sums(), &task.paths(&state), state.with_control.as_deref());
            // Where nothing is lit there is nothing to wait for.
            state.history.push((state.samples, error.unwrap_or(0.0)));
        }
        let done = (f64::from(state.samples), params.samples.map(f64::from), "paths per pixel");
        ctx.progress(done.0, done.1, done.2);
        if let Some(so_far) = task.so_far.filter(|_| is_due(before, state.samples, BATCH) && state.samples < whole) {
            ctx.partial("frames", done, &|| so_far(&state, &task.paths(&state)));
        }
        if task.kept && ctx.checkpoint_is_due() {
            keep(&state, ctx);
        }
    }
    if state.samples > resumed_at && task.kept {
        keep(&state, ctx);
    }
    let cut_short = stopped(&state);
    if whole < cap && params.samples.is_some() && !cut_short {
        // The last, partial batch is not part of any checkpoint: a longer run has it whole.
        given_up += job.round(&mut state, cap)?;
    }
    if given_up > 0 {
        ctx.measure("ways of light given up", given_up as f64, "1");
        ctx.warn("some light connections through curved walls are too rare to be weighed, and are missing");
    }
    let (samples, paths, flights, with_control) =
        (state.samples, task.paths(&state), state.flights, state.with_control.take());
    Ok(Sums { channels: state.into_sums(), samples, paths, with_control, flights })
}

/// Keeps a state for a longer run, or for one after a kill, to continue.
fn keep(state: &State, ctx: Ctx<'_>) {
    ctx.checkpoint_with(u64::from(state.samples), &|to| state.write_to(to));
}

/// The furthest checkpoint at which a fresh run would not have stopped before.
fn resume(task: &Task<'_>, whole: u32, ctx: Ctx<'_>) -> State {
    // Made when needed: its zeros take no room before they are written over.
    let empty = || State::new(task.fields(), task.pixels.len(), task.projected.layout, task.allocate);
    let mut at_most = whole;
    // The host counts what it hands over as work of this run: it is not asked in vain.
    loop {
        let mut read = None;
        let found =
            task.kept && ctx.resume_with(u64::from(at_most), &mut |from| read = State::read_from(from, empty()));
        if !found {
            return empty();
        }
        let Some(state) = read else {
            ctx.warn("a checkpoint of this render could not be read; it starts anew");
            return empty();
        };
        let target = task.params.target_error;
        let met = target.and_then(|t| state.history.iter().find(|(_, e)| *e <= t.0)).map(|h| h.0);
        match met {
            Some(n) if n < state.samples => at_most = n,
            _ => return state,
        }
    }
}

struct Job<'a> {
    task: &'a Task<'a>,
    ctx: Ctx<'a>,
    /// The channels, each group by one walk.
    groups: Vec<Group>,
    /// For each control variate, the same groups.
    paired: Vec<Vec<Group>>,
    /// Into so many parts along each side the image is cut, each with an origin of its own; of the pixels of a part are those of a tile.
    parts: usize,
}

impl<'a> Job<'a> {
    fn new(task: &'a Task<'a>, ctx: Ctx<'a>) -> Self {
        let groups = groups(task.rig, &task.projected.carriers, &task.projected.projected_images);
        let controls = task.controls.iter().flat_map(|with_control| &with_control.variates);
        let paired = controls
            .map(|control| groups.iter().map(|g| Group::of(control.paired.channels(), g.channels.clone())).collect());
        let mut job = Self { task, ctx, paired: paired.collect(), groups, parts: 1 };
        let all = || job.groups.iter().chain(job.paired.iter().flatten());
        let parts = all().map(|group| {
            let setting = job.setting(group, [0; 2]);
            parts_along(&setting, range(setting.world))
        });
        job.parts = parts.max().unwrap_or(1);
        job
    }

    /// Of the paths of a group.
    fn setting<'b>(&'b self, group: &'b Group, key: [u32; 2]) -> Setting<'b> {
        let (Task { rig, projected, .. }, channel) = (self.task, group.channels[0]);
        Setting {
            world: &group.world,
            camera: &rig.camera,
            light: &rig.lights[channel],
            steady: &rig.steady[channel],
            carriers: &projected.carriers,
            projected_images: &projected.projected_images,
            key,
            channel: channel as u32,
            nee: Nee::Line,
            shared: group.shared.as_ref(),
        }
    }

    /// The part of the image that a pixel lies in, by its place among those that are traced.
    fn part_of(&self, place: u32) -> [usize; 2] {
        part_of(&self.task.rig.camera, self.parts, self.task.pixels[place as usize] as usize)
    }
}

impl Job<'_> {
    /// In which pixels control variates are worth their time, by the paths so far.
    fn with_control(&self, state: &State) -> Vec<bool> {
        let of_pixel = &self.task.controls.expect("there are stand-ins").of_pixel;
        let pairs = of_pixel.iter().flatten().count();
        let walks = self.groups.len();
        let per_path =
            |flights: u64, pixels: usize| flights as f64 / (f64::from(state.samples) * (walks * pixels).max(1) as f64);
        let flights = [per_path(state.flights[0], of_pixel.len()), per_path(state.flights[1], pairs)];
        self.task.criterion.with_control(&state.sums(), &self.task.paths(state), flights)
    }

    /// At a doubling, what each pixel gets until the next.
    fn plan(&self, state: &mut State) {
        let batches = state.samples / BATCH;
        let Some(from) = allocation::doubling(batches).filter(|_| state.more.is_some()) else { return };
        let paths = vec![allocation::even(batches) * BATCH; self.task.pixels.len()];
        let Some(more) = &mut state.more else { return };
        if from < batches || !more.planned.is_empty() {
            return;
        }
        let needs = self.task.criterion.needs(&state.channels, &paths, state.with_control.as_deref());
        more.planned = allocation::plan(&needs, &more.before, from);
    }

    /// Goes on to `until` paths per pixel on average, not beyond the next doubling. What is left of a batch is even.
    /// How many connections were given up.
    fn round(&self, state: &mut State, until: u32) -> Result<u64, Error> {
        let (at, to) = (state.samples / BATCH, until / BATCH);
        let (first, last) = match state.more {
            None => (state.samples, until),
            Some(_) => (allocation::even(at) * BATCH, allocation::even(to) * BATCH + until % BATCH),
        };
        if state.more.is_none() && self.alike_count(&(first..last)) > ROUND_PART {
            return self.long_round(state, first..last);
        }
        let even = self.walk(state, &self.alike(first..last), 0)?;
        let more = match &state.more {
            None => Parts::default(),
            Some(more) => {
                let from = allocation::doubling(at).unwrap_or(at);
                let (done, due) = (more.done(from, at), more.done(from, to));
                self.walk(state, &batches_between(&done, &due), MORE)?
            }
        };
        // Nothing of a round that did not come to its end may enter the state.
        self.ctx.checked()?;
        if even.endless || more.endless {
            return Err(endless());
        }
        self.fold(&even, &mut state.channels);
        for flights in [even.flights, more.flights] {
            state.flights[0] += flights[0];
            state.flights[1] += flights[1];
        }
        if let Some(sums) = &mut state.more {
            self.fold(&more, &mut sums.channels);
            sums.turn(at, to);
        }
        state.samples = until;
        Ok(even.given_up + more.given_up)
    }

    /// A round whose batches are so many that their sums would take as much memory as the state: part by part, in the order in which
    /// [`fold`](Self::fold) adds them. One that does not come to its end leaves a state that is not whole.
    fn long_round(&self, state: &mut State, samples: Range<u32>) -> Result<u64, Error> {
        let mut given_up = 0;
        let until = samples.end;
        // Of each pixel the batches follow each other from part to part as they do in a short round.
        for first in samples.step_by(BATCH as usize) {
            let count = (until - first).min(BATCH);
            for start in (0..self.task.pixels.len()).step_by(ROUND_PART) {
                let places = start..self.task.pixels.len().min(start + ROUND_PART);
                let batches: Vec<Batch> = places.map(|place| Batch { place: place as u32, first, count }).collect();
                let parts = self.walk(state, &batches, 0)?;
                self.ctx.checked()?;
                if parts.endless {
                    return Err(endless());
                }
                state.is_whole = false;
                self.fold(&parts, &mut state.channels);
                state.flights[0] += parts.flights[0];
                state.flights[1] += parts.flights[1];
                given_up += parts.given_up;
            }
        }
        (state.samples, state.is_whole) = (until, true);
        Ok(given_up)
    }

    /// How many batches [`alike`](Self::alike) has.
    fn alike_count(&self, samples: &Range<u32>) -> usize {
        (samples.end - samples.start).div_ceil(BATCH) as usize * self.task.pixels.len()
    }

    /// The same samples of all pixels, batch after batch, the last perhaps smaller.
    fn alike(&self, samples: Range<u32>) -> Vec<Batch> {
        let firsts = samples.clone().step_by(BATCH as usize);
        let of = |first: u32| (0..self.task.pixels.len() as u32).map(move |place| (place, first));
        let count = |first: u32| (samples.end - first).min(BATCH);
        firsts
            .flat_map(|first| of(first).map(move |(place, first)| Batch { place, first, count: count(first) }))
            .collect()
    }

    /// Walks batches of paths in the scene, and in control variates with it.
    fn walk(&self, state: &State, batches: &[Batch], salt: u64) -> Result<Parts, Error> {
        let key = philox::key(self.ctx.seed() ^ self.task.salt ^ salt);
        let mut sorted = Vec::new();
        if self.parts > 1 {
            // Those of a pixel stay in their order.
            sorted.extend_from_slice(batches);
            sorted.sort_by_cached_key(|batch| self.part_of(batch.place));
        }
        let batches = if self.parts > 1 { &sorted } else { batches };
        // Tiles of batches of one size in one part.
        let alike = |a: &Batch, b: &Batch| {
            a.count == b.count && (self.parts == 1 || self.part_of(a.place) == self.part_of(b.place))
        };
        let tiles: Vec<&[Batch]> = batches.chunk_by(alike).flat_map(|b| b.chunks(TILE)).collect();
        let parts = self.ctx.map_tiles(self.groups.len() * tiles.len(), |i| {
            let (place, tile) = (i / tiles.len(), tiles[i % tiles.len()]);
            self.tile(self.setting(&self.groups[place], key), place, tile, state.with_control.as_deref())
        })?;
        let mut all = Parts::default();
        for part in &parts {
            all.flights[0] += part.flights[0];
            all.flights[1] += part.flights[1];
            all.given_up += part.given_up;
            all.endless |= part.endless;
        }
        let places = tiles.iter().map(|tile| tile.iter().map(|batch| batch.place).collect());
        (all.parts, all.places) = (parts, places.collect());
        Ok(all)
    }

    /// Adds parts to the sums of channels, in the order in which they were to be walked.
    fn fold(&self, parts: &Parts, sums: &mut [Moments]) {
        let (tiles, channels) = (parts.places.len().max(1), self.task.rig.worlds.len());
        for (i, part) in parts.parts.iter().enumerate() {
            let (group, places) = (&self.groups[i / tiles], &parts.places[i % tiles]);
            for (batch, &place) in places.iter().enumerate() {
                for (of, &channel) in group.channels.iter().enumerate() {
                    sums[channel].fold_one(place as usize, &part.moments[of], batch);
                    if let Some(differences) = part.differences.get(of) {
                        sums[channels + channel].fold_one(place as usize, differences, batch);
                    }
                }
            }
        }
    }

    /// A tile of the `group`-th walk.
    fn tile(&self, setting: Setting<'_>, group: usize, tile: &[Batch], with_control: Option<&[bool]>) -> Part {
        let mut walker = Walker::new(setting, named(self.ctx.simd()));
        walker.excludes_specular = self.task.rig.excludes_specular;
        walker.image_part = ImagePart::of(self.parts, self.part_of(tile[0].place));
        let layout = self.task.projected.layout;
        let sums = Moments::new(tile.len(), layout.width()).with_steady(layout.steady);
        let fresh = || vec![sums.clone(); setting.channels()];
        let mut part = Part { moments: fresh(), differences: Vec::new(), flights: [0; 2], given_up: 0, endless: false };
        // What was begun is thrown away with the whole round.
        if self.ctx.cancelled() {
            return part;
        }
        let count = tile[0].count;
        let of: Vec<(u32, u32)> = tile.iter().map(|b| (self.task.pixels[b.place as usize], b.first)).collect();
        packet::walk_among(&mut walker, Batches { of: &of, count });
        for path in 0..of.len() * count as usize {
            for (channel, moments) in part.moments.iter_mut().enumerate() {
                moments.add(path / count as usize, walker.response_in(path, channel));
            }
        }
        if let Some(controls) = self.task.controls {
            let mut differences = fresh();
            for k in 0..controls.variates.len() {
                let has = |pixel: usize| controls.of_pixel[pixel] == Some(k) && with_control.is_none_or(|b| b[pixel]);
                let places: Vec<usize> = (0..of.len()).filter(|&i| has(of[i].0 as usize)).collect();
                if !places.is_empty() {
                    let control = &self.paired[k][group];
                    let there = Setting { world: &control.world, shared: control.shared.as_ref(), ..setting };
                    let mut other = Walker::new(there, walker.level());
                    other.excludes_specular = controls.variates[k].paired.excludes_specular;
                    other.image_part = walker.image_part;
                    pair(&walker, &mut other, Batches { of: &of, count }, &places, &mut differences);
                    part.flights[1] += other.take_flights();
                }
            }
            part.differences = differences;
        }
        (part.flights[0], part.endless) = (walker.take_flights(), walker.endless());
        part.given_up = walker.given_up();
        part
    }
}

/// Walks the batches at `places` in a control variate, too, and adds how far the scene's paths in `walker` differ, channel by channel.
fn pair(
    walker: &Walker<'_>,
    control: &mut Walker<'_>,
    batches: Batches<'_>,
    places: &[usize],
    differences: &mut [Moments],
) {
    let some: Vec<(u32, u32)> = places.iter().map(|&i| batches.of[i]).collect();
    packet::walk_among(control, Batches { of: &some, ..batches });
    let (mut difference, count) = (vec![0.0; walker.setting().layout().width()], batches.count as usize);
    for (among, &place) in places.iter().enumerate() {
        for sample in 0..count {
            let (in_scene, with_control) = (place * count + sample, among * count + sample);
            for (channel, differences) in differences.iter_mut().enumerate() {
                let (ours, theirs) =
                    (walker.response_in(in_scene, channel), control.response_in(with_control, channel));
                difference.iter_mut().zip(ours.iter().zip(theirs)).for_each(|(d, (a, b))| *d = a - b);
                differences.add(place, &difference);
            }
        }
    }
}

fn endless() -> Error {
    Error::failed_with_hint(
        "a path of light does not end: it is in a closed space that absorbs nothing",
        "give a surface a reflectance below 1, or a medium some absorption",
    )
}
