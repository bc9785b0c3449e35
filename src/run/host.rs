//! The engine's side of `Ctx` for one running instance.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use cpu_time::ThreadTime;
use rayon::prelude::*;
use turbid_contract::Host;

use crate::resolve::Job;

use super::execute::Worker;

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
}

impl<'a> InstanceHost<'a> {
    pub fn new(
        worker: Worker<'a>,
        job: &'a Job,
        label: &'a str,
        wanted: &'a BTreeSet<&'static str>,
        files: BTreeMap<String, Arc<[u8]>>,
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
        self.measures.lock().expect("no holder panics").clone()
    }

    pub fn warnings(&self) -> Vec<String> {
        self.warnings.lock().expect("no holder panics").clone()
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
        let mut measures = self.measures.lock().expect("no holder panics");
        measures.retain(|(known, _, _)| known != name);
        measures.push((name.to_owned(), value, unit.to_owned()));
    }

    fn warn(&self, message: &str) {
        let mut warnings = self.warnings.lock().expect("no holder panics");
        if !warnings.iter().any(|known| known == message) {
            self.worker.progress.warn(self.label, message);
            warnings.push(message.to_owned());
        }
    }

    fn wants(&self, port: &str) -> bool {
        self.wanted.contains(port)
    }

    fn file(&self, at: &str) -> Option<Arc<[u8]>> {
        self.files.get(at).cloned()
    }

    fn checkpoint(&self, state: &[u8], progress: u64) {
        if let Some(key) = &self.job.state_key
            && let Err(error) = self.worker.resolver.store.checkpoint(key, progress, state)
        {
            self.warn(&format!("a checkpoint could not be kept: {error}"));
        }
    }

    fn resume(&self, at_most: u64) -> Option<Vec<u8>> {
        let key = self.job.state_key.as_ref()?;
        self.worker.resolver.store.resume(key, at_most).map(|(_, state)| state)
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
