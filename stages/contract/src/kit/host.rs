//! A host in memory: no engine, no store, threads of its own.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use serde_json::Value;

use crate::artifact::Artifact;
use crate::ctx::Host;
use crate::file::Files;

/// A host for tests and for use of a stage as a library: what a stage says is kept here, and what it asks for is set here.
///
/// The default has seed 0, one thread, no files, wants no optional port, and its clock never runs out.
#[derive(Default)]
pub struct MemoryHost {
    pub seed: u64,
    /// Optional ports that are to be computed.
    pub wanted: Vec<String>,
    /// Content of the input files, by the field that names them.
    pub files: Files,
    /// With 0 or 1 tiles are done one after the other; with more on so many threads, the last tile first, so that no order is taken for granted.
    pub threads: usize,
    /// The level of vector instructions that is asked for; empty for the best there is.
    pub simd: String,
    /// How many more times `time_is_up` says no; `None`: always.
    pub patience: Mutex<Option<u64>>,
    pub warnings: Mutex<Vec<String>>,
    pub measures: Mutex<BTreeMap<String, f64>>,
    /// By progress. What is put here before a run is what it goes on from.
    pub checkpoints: Mutex<BTreeMap<u64, Vec<u8>>>,
    /// The stopping params that the stage says it reached.
    pub reached: Mutex<BTreeMap<String, Value>>,
    /// Whether somebody looks on: then whatever a stage shows of an output meanwhile is kept below.
    pub looks_on: bool,
    /// Output, units of work done, and what there was.
    pub seen: Mutex<Vec<(String, f64, Artifact)>>,
}

impl MemoryHost {
    /// With this seed and number of threads, asked for these optional ports.
    pub fn new(seed: u64, wanted: &[&str], threads: usize) -> Self {
        Self { seed, wanted: wanted.iter().map(|&port| port.to_owned()).collect(), threads, ..Self::default() }
    }

    /// What the stage warned of so far.
    pub fn warned(&self) -> Vec<String> {
        open(&self.warnings).clone()
    }

    /// A figure that the stage measured.
    pub fn measured(&self, name: &str) -> Option<f64> {
        open(&self.measures).get(name).copied()
    }
}

/// What is kept here stays readable after the panic of a test.
fn open<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Host for MemoryHost {
    fn seed(&self) -> u64 {
        self.seed
    }
    fn cancelled(&self) -> bool {
        false
    }
    fn time_is_up(&self, _: f64) -> bool {
        match &mut *open(&self.patience) {
            None => false,
            Some(0) => true,
            Some(left) => {
                *left -= 1;
                false
            }
        }
    }
    fn reached(&self, params: &[(&str, Value)]) {
        *open(&self.reached) = params.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect();
    }
    fn progress(&self, _: f64, _: Option<f64>, _: &str) {}
    fn partial(&self, port: &str, (done, ..): (f64, Option<f64>, &str), so_far: &dyn Fn() -> Option<Artifact>) {
        if self.looks_on {
            open(&self.seen).extend(so_far().map(|artifact| (port.to_owned(), done, artifact)));
        }
    }
    fn measure(&self, name: &str, value: f64, _: &str) {
        assert!(value.is_finite(), "measure {name} = {value}");
        open(&self.measures).insert(name.to_owned(), value);
    }
    fn warn(&self, message: &str) {
        open(&self.warnings).push(message.to_owned());
    }
    fn wants(&self, port: &str) -> bool {
        self.wanted.iter().any(|wanted| wanted == port)
    }
    fn file(&self, at: &str) -> Option<Arc<[u8]>> {
        self.files.get(at)
    }
    fn checkpoint(&self, state: &[u8], progress: u64) {
        open(&self.checkpoints).insert(progress, state.to_vec());
    }
    fn resume(&self, at_most: u64) -> Option<Vec<u8>> {
        open(&self.checkpoints).range(..=at_most).next_back().map(|(_, state)| state.clone())
    }
    fn tiles(&self, n: usize, work: &(dyn Fn(usize) + Sync)) {
        if self.threads <= 1 {
            return (0..n).for_each(work);
        }
        let next = AtomicUsize::new(0);
        let some = || {
            while let Some(last) = n.checked_sub(1 + next.fetch_add(1, Ordering::Relaxed)) {
                work(last);
            }
        };
        std::thread::scope(|scope| {
            for _ in 0..self.threads {
                scope.spawn(some);
            }
        });
    }
    fn threads(&self) -> usize {
        self.threads.max(1)
    }
    fn simd(&self) -> &str {
        &self.simd
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each tile once, on one thread in order and on several from the last.
    #[test]
    fn every_tile_is_done_once() {
        for threads in [0, 1, 3] {
            let done = Mutex::new(Vec::new());
            MemoryHost::new(0, &[], threads).tiles(7, &|i| open(&done).push(i));
            let mut done = done.into_inner().expect("no tile panics");
            assert!(threads > 1 || done.is_sorted(), "{done:?}");
            done.sort_unstable();
            assert_eq!(done, [0, 1, 2, 3, 4, 5, 6], "{threads} threads");
        }
    }

    #[test]
    fn the_clock_runs_out_when_it_is_told_to() {
        let host = MemoryHost { patience: Mutex::new(Some(2)), ..MemoryHost::default() };
        assert_eq!([1.0; 4].map(|s| host.time_is_up(s)), [false, false, true, true]);
        assert!(!MemoryHost::default().time_is_up(0.0));
    }
}
