//! The engine's side of `Ctx` for one running instance.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Read, Write};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{self, ThreadId};
use std::time::{Duration, Instant};

use cpu_time::ThreadTime;
use rayon::prelude::*;
use serde_json::Value;
use turbid_contract::{Artifact, Files, Host};

use crate::digest::Digest;
use crate::panics::lock;
use crate::resolve::Keyed;

use super::partial::Partial;
use super::worker::Worker;

/// Between checkpoints of one instance.
const CHECKPOINT_EVERY: Duration = Duration::from_secs(10);

/// Everything a running instance can reach.
pub struct InstanceHost<'a> {
    worker: Worker<'a>,
    job: &'a Keyed,
    label: &'a str,
    wanted: &'a BTreeSet<&'static str>,
    /// Content of the input files, by the field that names them.
    files: Files,
    began: Instant,
    /// The thread on which the stage runs, and its CPU time then.
    own: (ThreadId, Duration),
    /// CPU time spent in tiles, on any thread.
    tile_cpu_ns: AtomicU64,
    /// That of the stage's own thread that went into live pictures: nobody's work.
    picture_cpu_ns: AtomicU64,
    /// Whether its tiles are not worth the way to other threads.
    is_light: bool,
    /// Live pictures, where somebody may look at them.
    partial: Option<Partial<'a>>,
    /// Whether the stage asked the clock, and whether the clock told it to stop.
    asked_the_clock: AtomicBool,
    time_was_up: AtomicBool,
    /// What the stage says of where it stopped, as stopping params.
    reached: Mutex<Option<BTreeMap<String, Value>>>,
    measures: Mutex<Vec<(String, f64, String)>>,
    warnings: Mutex<Vec<String>>,
    /// Name, and what refused faster ones.
    kernel: Mutex<Option<(String, Vec<String>)>>,
    last_checkpoint: Mutex<Instant>,
    /// CPU seconds behind the checkpoint that the stage goes on from.
    resumed_cpu_s: Mutex<f64>,
    /// Of a run from the start: its own checkpoints, and how they compare with stored ones. `None`: goes on from what is stored.
    fresh: Option<Mutex<Fresh>>,
}

/// What a run from the start has written and found.
#[derive(Default)]
struct Fresh {
    /// Progress of its own checkpoints.
    written: BTreeSet<u64>,
    /// Stored checkpoints of the same progress: whether there was one of the same bytes, and one of others.
    same: bool,
    other: bool,
}

impl<'a> InstanceHost<'a> {
    pub fn new(
        worker: Worker<'a>,
        job: &'a Keyed,
        label: &'a str,
        wanted: &'a BTreeSet<&'static str>,
        files: Files,
        partial: Option<Partial<'a>>,
        from_the_start: bool,
    ) -> Self {
        Self {
            worker,
            job,
            label,
            wanted,
            files,
            began: Instant::now(),
            own: (thread::current().id(), ThreadTime::now().as_duration()),
            tile_cpu_ns: AtomicU64::new(0),
            picture_cpu_ns: AtomicU64::new(0),
            is_light: false,
            partial,
            asked_the_clock: AtomicBool::new(false),
            time_was_up: AtomicBool::new(false),
            reached: Mutex::default(),
            measures: Mutex::default(),
            warnings: Mutex::default(),
            kernel: Mutex::default(),
            last_checkpoint: Mutex::new(Instant::now()),
            resumed_cpu_s: Mutex::default(),
            fresh: from_the_start.then(Mutex::default),
        }
    }

    /// The same, whose tiles run where they are asked for: they take less time than the way to other threads.
    #[must_use]
    pub fn light(self, is_light: bool) -> Self {
        Self { is_light, ..self }
    }

    /// Removes the checkpoints of this work, those of this run too: two results of one key differ, and who is wrong is not known.
    pub fn forget_checkpoints(&self) {
        if let Some(key) = &self.job.state_key {
            self.worker.resolver.store.forget_checkpoints(key, &BTreeSet::new());
        }
    }

    /// After a run from the start: checkpoints stay only beside a result that they agree with. `agrees`: whether its outputs are those stored before,
    /// if there were any to compare.
    pub fn settle_checkpoints(&self, agrees: Option<bool>) {
        if !self.worker.options.keep_states {
            if self.began.elapsed() >= CHECKPOINT_EVERY {
                self.forget_checkpoints();
            }
            return;
        }
        let (Some(fresh), Some(key)) = (&self.fresh, &self.job.state_key) else { return };
        let fresh = lock(fresh);
        let wrong = fresh.other || agrees == Some(false);
        if wrong || !(fresh.same || agrees == Some(true)) {
            self.worker.resolver.store.forget_checkpoints(key, &fresh.written);
        }
    }

    /// Compares a checkpoint of a run from the start with the stored one that it is going to replace. Once they differ, none of the others is to be trusted.
    fn compare(
        &self,
        fresh: &Mutex<Fresh>,
        key: &Digest,
        progress: u64,
        write: &dyn Fn(&mut dyn Write) -> io::Result<()>,
    ) {
        let store = self.worker.resolver.store;
        let mut fresh = lock(fresh);
        if !fresh.written.insert(progress) {
            return;
        }
        let mut same = None;
        store.resume_with(key, progress, &mut |stored, from| {
            if stored == progress {
                let mut compared = Compared { with: behind_cost(from).1, same: true };
                same = Some(write(&mut compared).is_ok() && compared.same_to_the_end());
            }
        });
        match same {
            Some(true) => fresh.same = true,
            Some(false) if !fresh.other => {
                fresh.other = true;
                let text = "a stored checkpoint came out different from what was computed from the start; checkpoints of this work are removed";
                self.worker.progress.warn(self.label, text);
                store.forget_checkpoints(key, &fresh.written);
            }
            _ => {}
        }
    }

    pub fn wall(&self) -> Duration {
        self.began.elapsed()
    }

    /// CPU seconds of the work so far: of tiles, of the stage's own thread (asked there), and of the runs whose checkpoint this one went on from.
    pub fn cpu_s(&self) -> f64 {
        let tiles = Duration::from_nanos(self.tile_cpu_ns.load(Ordering::Relaxed));
        let (thread, began) = self.own;
        let here = thread::current().id() == thread;
        let pictures = Duration::from_nanos(self.picture_cpu_ns.load(Ordering::Relaxed));
        let own = if here { ThreadTime::now().as_duration().saturating_sub(began + pictures) } else { Duration::ZERO };
        (own + tiles).as_secs_f64() + *lock(&self.resumed_cpu_s)
    }

    /// Whether the clock, and so not only the params, decided where the stage stopped.
    pub fn stopped_by_time(&self) -> bool {
        self.time_was_up.load(Ordering::Relaxed)
    }

    /// The stopping params that ask for just what was made, where the stage may have stopped by the clock.
    pub fn reached(&self) -> Option<BTreeMap<String, Value>> {
        let asked = self.asked_the_clock.load(Ordering::Relaxed);
        lock(&self.reached).clone().filter(|_| asked)
    }

    pub fn measures(&self) -> Vec<(String, f64, String)> {
        lock(&self.measures).clone()
    }

    /// What the stage said of its kernel.
    pub fn kernel_taken(&self) -> Option<(String, Vec<String>)> {
        lock(&self.kernel).clone()
    }

    pub fn warnings(&self) -> Vec<String> {
        lock(&self.warnings).clone()
    }
}

impl Host for InstanceHost<'_> {
    fn seed(&self) -> u64 {
        self.job.seed
    }

    fn cancelled(&self) -> bool {
        self.worker.interrupt.requested()
    }

    fn time_is_up(&self, limit_s: f64) -> bool {
        self.asked_the_clock.store(true, Ordering::Relaxed);
        let up = self.began.elapsed().as_secs_f64() >= limit_s;
        if up {
            self.time_was_up.store(true, Ordering::Relaxed);
        }
        up
    }

    fn reached(&self, params: &[(&str, Value)]) {
        let named = params.iter().map(|(name, value)| ((*name).to_owned(), value.clone()));
        *lock(&self.reached) = Some(named.collect());
    }

    fn progress(&self, done: f64, total: Option<f64>, unit: &str) {
        self.worker.progress.advanced(self.label, done, total, unit);
    }

    fn partial(&self, port: &str, done: (f64, Option<f64>, &str), so_far: &dyn Fn() -> Option<Artifact>) {
        let Some(partial) = &self.partial else { return };
        let began = ThreadTime::now();
        partial.offer(port, done, so_far);
        if thread::current().id() == self.own.0 {
            self.picture_cpu_ns.fetch_add(began.elapsed().as_nanos() as u64, Ordering::Relaxed);
        }
    }

    fn measure(&self, name: &str, value: f64, unit: &str) {
        assert!(value.is_finite(), "{}: measure {name} = {value}", self.label);
        let mut measures = lock(&self.measures);
        measures.retain(|(known, _, _)| known != name);
        measures.push((name.to_owned(), value, unit.to_owned()));
    }

    fn warn(&self, message: &str) {
        let mut warnings = lock(&self.warnings);
        if !warnings.iter().any(|known| known == message) {
            self.worker.progress.warn(self.label, message);
            warnings.push(message.to_owned());
        }
    }

    fn kernel(&self, name: &str, refused: &[String]) {
        *lock(&self.kernel) = Some((name.to_owned(), refused.to_vec()));
    }

    fn wants(&self, port: &str) -> bool {
        self.wanted.contains(port)
    }

    fn file(&self, at: &str) -> Option<Arc<[u8]>> {
        self.files.get(at)
    }

    fn checkpoint_is_due(&self) -> bool {
        lock(&self.last_checkpoint).elapsed() >= CHECKPOINT_EVERY
    }

    fn checkpoint(&self, state: &[u8], progress: u64) {
        self.checkpoint_with(progress, &|to| to.write_all(state));
    }

    fn checkpoint_with(&self, progress: u64, write: &dyn Fn(&mut dyn Write) -> io::Result<()>) {
        // The last state is nobody's to go on from; those of a long run are there in case that it is killed.
        if !self.worker.options.keep_states && !self.checkpoint_is_due() {
            return;
        }
        *lock(&self.last_checkpoint) = Instant::now();
        let Some(key) = &self.job.state_key else { return };
        if let Some(fresh) = &self.fresh {
            self.compare(fresh, key, progress, write);
        }
        let spent = self.cpu_s().to_le_bytes();
        let with_cost = |to: &mut dyn Write| {
            to.write_all(COST)?;
            to.write_all(&spent)?;
            write(to)
        };
        if let Err(error) = self.worker.resolver.store.checkpoint_with(key, progress, &with_cost) {
            self.warn(&format!("a checkpoint could not be kept: {error}"));
        }
    }

    fn resume(&self, at_most: u64) -> Option<Vec<u8>> {
        let mut state = Vec::new();
        let mut whole = true;
        let found = self.resume_with(at_most, &mut |from| whole = from.read_to_end(&mut state).is_ok());
        (found && whole).then_some(state)
    }

    fn resume_with(&self, at_most: u64, read: &mut dyn FnMut(&mut dyn Read)) -> bool {
        // To start from the start is what it was forced for.
        let Some(key) = self.job.state_key.as_ref().filter(|_| self.fresh.is_none()) else { return false };
        *lock(&self.resumed_cpu_s) = 0.0;
        self.worker.resolver.store.resume_with(key, at_most, &mut |_, from| {
            let (spent, mut state) = behind_cost(from);
            read(&mut state);
            // A stage that gave up reading starts anew, and owes nothing to what was spent on it.
            let whole = state.read(&mut [0]).is_ok_and(|left| left == 0);
            *lock(&self.resumed_cpu_s) = if whole { spent } else { 0.0 };
        })
    }

    fn tiles(&self, n: usize, work: &(dyn Fn(usize) + Sync)) {
        // Their time is that of the stage's own thread.
        if self.is_light && thread::current().id() == self.own.0 {
            return (0..n).for_each(work);
        }
        self.worker.pool.install(|| {
            (0..n).into_par_iter().with_max_len(1).for_each(|i| {
                let began = ThreadTime::now();
                work(i);
                self.tile_cpu_ns.fetch_add(began.elapsed().as_nanos() as u64, Ordering::Relaxed);
            });
        });
    }

    fn threads(&self) -> usize {
        self.worker.pool.current_num_threads()
    }

    fn simd(&self) -> &str {
        &self.worker.options.simd
    }
}

/// Before the state of a stage in a checkpoint: that CPU seconds follow (8 bytes).
const COST: &[u8; 16] = b"turbid cpu s 1\n\0";

/// What a checkpoint cost, 0 where it is of a time when it did not say, and the state behind that.
fn behind_cost(from: &mut dyn Read) -> (f64, impl Read + '_) {
    let mut head = Vec::new();
    // What cannot be read is no state: whoever reads on sees that it ends early.
    let _ = from.take(COST.len() as u64 + 8).read_to_end(&mut head);
    let cost = head.strip_prefix(COST).and_then(|rest| rest.first_chunk::<8>()).map(|cost| f64::from_le_bytes(*cost));
    if cost.is_some() {
        head.clear();
    }
    (cost.unwrap_or(0.0), io::Cursor::new(head).chain(from))
}

/// Compares what is written with what there is to be read.
struct Compared<R> {
    with: R,
    same: bool,
}

impl<R: Read> Compared<R> {
    fn same_to_the_end(mut self) -> bool {
        let ends = |error: &io::Error| error.kind() == io::ErrorKind::UnexpectedEof;
        self.same && self.with.read_exact(&mut [0]).is_err_and(|error| ends(&error))
    }
}

impl<R: Read> Write for Compared<R> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut stored = vec![0; bytes.len()];
        self.same = self.same && self.with.read_exact(&mut stored).is_ok() && stored == bytes;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn states_are_told_from_what_they_cost() {
        let told = [&COST[..], &2.5_f64.to_le_bytes(), b"state"].concat();
        for (bytes, cost) in [(told.as_slice(), 2.5), (b"state", 0.0), (b"", 0.0)] {
            let mut from = bytes;
            let (spent, mut state) = behind_cost(&mut from);
            let mut read = Vec::new();
            state.read_to_end(&mut read).unwrap();
            assert_eq!((spent, read.as_slice()), (cost, if bytes.is_empty() { b"" } else { &b"state"[..] }));
        }
    }

    #[test]
    fn states_are_compared_to_the_end() {
        for (written, same) in
            [(&["sta", "te"][..], true), (&["sta"], false), (&["states"], false), (&["stale"], false)]
        {
            let mut compared = Compared { with: &b"state"[..], same: true };
            written.iter().for_each(|piece| compared.write_all(piece.as_bytes()).unwrap());
            assert_eq!(compared.same_to_the_end(), same, "{written:?}");
        }
    }
}
