//! The engine's side of `Ctx` for one running instance.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Read, Write};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use cpu_time::ThreadTime;
use rayon::prelude::*;
use turbid_contract::Host;

use crate::digest::Digest;
use crate::panics::lock;
use crate::resolve::Job;

use super::execute::Worker;

/// Between checkpoints of one instance.
const CHECKPOINT_EVERY: Duration = Duration::from_secs(10);

/// Everything a running instance can reach.
pub struct InstanceHost<'a> {
    worker: Worker<'a>,
    job: &'a Job,
    label: &'a str,
    wanted: &'a BTreeSet<&'static str>,
    /// Content of the input files, by the field that names them.
    files: BTreeMap<String, Arc<[u8]>>,
    began: Instant,
    /// CPU time spent in tiles, on any thread.
    tile_cpu_ns: AtomicU64,
    time_was_up: AtomicBool,
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
        job: &'a Job,
        label: &'a str,
        wanted: &'a BTreeSet<&'static str>,
        files: BTreeMap<String, Arc<[u8]>>,
        from_the_start: bool,
    ) -> Self {
        Self {
            worker,
            job,
            label,
            wanted,
            files,
            began: Instant::now(),
            tile_cpu_ns: AtomicU64::new(0),
            time_was_up: AtomicBool::new(false),
            measures: Mutex::default(),
            warnings: Mutex::default(),
            kernel: Mutex::default(),
            last_checkpoint: Mutex::new(Instant::now()),
            resumed_cpu_s: Mutex::default(),
            fresh: from_the_start.then(Mutex::default),
        }
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
        let (Some(fresh), Some(key)) = (&self.fresh, &self.job.state_key) else { return };
        let fresh = lock(fresh);
        let wrong = fresh.other || agrees == Some(false);
        if wrong || !(fresh.same || agrees == Some(true)) {
            self.worker.resolver.store.forget_checkpoints(key, &fresh.written);
        }
    }

    /// Compares a checkpoint of a run from the start with the stored one that it is going to replace. Once they differ, none of the others is to be trusted.
    fn compare(&self, fresh: &Mutex<Fresh>, key: &Digest, progress: u64, state: Digest) {
        let store = self.worker.resolver.store;
        let mut fresh = lock(fresh);
        if !fresh.written.insert(progress) {
            return;
        }
        let mut stored = None;
        if store.has_checkpoint(key, progress) {
            store.resume_with(key, progress, &mut |from| stored = Some(state_digest(from) == Some(state)));
        }
        match stored {
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

    pub fn tile_cpu(&self) -> Duration {
        Duration::from_nanos(self.tile_cpu_ns.load(Ordering::Relaxed))
    }

    /// Whether the clock, and so not only the params, decided where the stage stopped.
    pub fn stopped_by_time(&self) -> bool {
        self.time_was_up.load(Ordering::Relaxed)
    }

    pub fn measures(&self) -> Vec<(String, f64, String)> {
        lock(&self.measures).clone()
    }

    /// What the stage said of its kernel.
    pub fn kernel_taken(&self) -> Option<(String, Vec<String>)> {
        lock(&self.kernel).clone()
    }

    /// CPU seconds that earlier runs spent on what this one went on from.
    pub fn resumed_cpu_s(&self) -> f64 {
        *lock(&self.resumed_cpu_s)
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
        let up = self.began.elapsed().as_secs_f64() >= limit_s;
        if up {
            self.time_was_up.store(true, Ordering::Relaxed);
        }
        up
    }

    fn progress(&self, done: f64, total: Option<f64>, unit: &str) {
        self.worker.progress.advanced(self.label, done, total, unit);
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
        self.files.get(at).cloned()
    }

    fn checkpoint_is_due(&self) -> bool {
        lock(&self.last_checkpoint).elapsed() >= CHECKPOINT_EVERY
    }

    fn checkpoint(&self, state: &[u8], progress: u64) {
        *lock(&self.last_checkpoint) = Instant::now();
        let spent = self.tile_cpu().as_secs_f64() + self.resumed_cpu_s();
        if let (Some(fresh), Some(key)) = (&self.fresh, &self.job.state_key) {
            self.compare(fresh, key, progress, Digest::of(state));
        }
        if let Some(key) = &self.job.state_key
            && let Err(error) = self.worker.resolver.store.checkpoint(key, progress, &with_cost(state, spent))
        {
            self.warn(&format!("a checkpoint could not be kept: {error}"));
        }
    }

    fn checkpoint_with(&self, progress: u64, write: &dyn Fn(&mut dyn Write) -> io::Result<()>) {
        *lock(&self.last_checkpoint) = Instant::now();
        let spent = (self.tile_cpu().as_secs_f64() + self.resumed_cpu_s()).to_le_bytes();
        let with_cost = |to: &mut dyn Write| {
            to.write_all(COST)?;
            to.write_all(&spent)?;
            write(to)
        };
        if let (Some(fresh), Some(key)) = (&self.fresh, &self.job.state_key) {
            let mut hasher = blake3::Hasher::new();
            write(&mut hasher).expect("a hash takes whatever is written");
            self.compare(fresh, key, progress, Digest(*hasher.finalize().as_bytes()));
        }
        if let Some(key) = &self.job.state_key
            && let Err(error) = self.worker.resolver.store.checkpoint_with(key, progress, &with_cost)
        {
            self.warn(&format!("a checkpoint could not be kept: {error}"));
        }
    }

    fn resume_with(&self, at_most: u64, read: &mut dyn FnMut(&mut dyn Read)) -> bool {
        let Some(key) = self.job.state_key.as_ref().filter(|_| self.fresh.is_none()) else { return false };
        *lock(&self.resumed_cpu_s) = 0.0;
        self.worker.resolver.store.resume_with(key, at_most, &mut |from| {
            let (mut state, spent) = without_cost_of(from);
            *lock(&self.resumed_cpu_s) = spent;
            read(&mut state);
        })
    }

    fn resume(&self, at_most: u64) -> Option<Vec<u8>> {
        // To start from the start is what it was forced for.
        let key = self.job.state_key.as_ref().filter(|_| self.fresh.is_none())?;
        *lock(&self.resumed_cpu_s) = 0.0;
        let (state, spent) = without_cost(self.worker.resolver.store.resume(key, at_most)?.1);
        *lock(&self.resumed_cpu_s) = spent;
        Some(state)
    }

    fn tiles(&self, n: usize, work: &(dyn Fn(usize) + Sync)) {
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

/// A state behind what it cost.
fn with_cost(state: &[u8], cpu_s: f64) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(COST.len() + 8 + state.len());
    bytes.extend_from_slice(COST);
    bytes.extend_from_slice(&cpu_s.to_le_bytes());
    bytes.extend_from_slice(state);
    bytes
}

/// BLAKE3 of the state behind what it cost.
fn state_digest(from: &mut dyn Read) -> Option<Digest> {
    let mut hasher = blake3::Hasher::new();
    io::copy(&mut without_cost_of(from).0, &mut hasher).ok()?;
    Some(Digest(*hasher.finalize().as_bytes()))
}

/// The same as [`without_cost`], of what is read piece by piece.
fn without_cost_of<'a>(from: &'a mut dyn Read) -> (impl Read + 'a, f64) {
    let mut head = Vec::new();
    // What cannot be read is no state: the stage sees that it ends early.
    let _ = from.take(COST.len() as u64 + 8).read_to_end(&mut head);
    let (begin, spent) = without_cost(head);
    (io::Cursor::new(begin).chain(from), spent)
}

/// The state, and what it cost; 0 where the checkpoint is of a time when it did not say.
fn without_cost(mut bytes: Vec<u8>) -> (Vec<u8>, f64) {
    let after = bytes.strip_prefix(COST).and_then(|rest| rest.first_chunk::<8>());
    let Some(cpu_s) = after.map(|cost| f64::from_le_bytes(*cost)) else { return (bytes, 0.0) };
    bytes.drain(..COST.len() + 8);
    (bytes, cpu_s)
}
