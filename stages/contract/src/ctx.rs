//! What a running stage may ask of the world: seed, cancellation, progress, measurements, files, checkpoints.

use std::io::{self, Read, Write};
use std::sync::{Arc, OnceLock};

use serde_json::Value;

use crate::artifact::Artifact;
use crate::error::Error;

/// The engine's side of [`Ctx`]. All methods may be called from any thread.
pub trait Host: Sync {
    /// Seed of all random streams of this instance.
    fn seed(&self) -> u64;
    fn cancelled(&self) -> bool;
    /// Whether `limit_s` seconds have passed since this instance began: what a stage stops by. The only clock that a stage ever sees; whoever asks it
    /// says by [`reached`](Self::reached) where it stopped. When to keep a checkpoint is another question, [`checkpoint_is_due`](Self::checkpoint_is_due).
    fn time_is_up(&self, limit_s: f64) -> bool;
    /// Which stopping params ([`Stage::STOPPING`](crate::Stage::STOPPING)) ask for just what this run made, all others of them left out: a run that a
    /// clock stopped at 320 paths says `[("samples", 320)]`. It is kept under these params too, and what is added to it later (another port) is
    /// computed with them, where no clock would stop at the same place again.
    fn reached(&self, _params: &[(&str, Value)]) {}
    /// `done` of `total` units of work; `None` where the total is unknown.
    fn progress(&self, done: f64, total: Option<f64>, unit: &str);
    /// Shows people what there is so far of the output `port`, at the same `done`, `total` and unit as [`progress`](Self::progress). `so_far` is called
    /// on this thread if somebody may look and the last picture is old enough for its cost; it may leave out what is dear to make, such as
    /// standard errors. No result depends on whether it was called.
    fn partial(&self, _port: &str, _done: (f64, Option<f64>, &str), _so_far: &dyn Fn() -> Option<Artifact>) {}
    /// A figure for the record (never for an output). One named `error: WHAT` stands in the summary of a run, with its unit: of each unit the first
    /// that is measured. One named `unknown: THINGS` stands there too: of how many of them nothing is known, and so no error.
    fn measure(&self, name: &str, value: f64, unit: &str);
    fn warn(&self, message: &str);
    /// For the record: the kernel that does the work, and what keeps faster ones from doing it (as in
    /// [`StagePlan`](crate::StagePlan)).
    fn kernel(&self, _name: &str, _refused: &[String]) {}
    /// Whether the optional port `port` is to be computed.
    fn wants(&self, port: &str) -> bool;
    /// Bytes of the input file that the field `at` names: the bytes that were hashed.
    fn file(&self, at: &str) -> Option<Arc<[u8]>>;
    /// Keeps `state` so that a longer or a killed run can continue; `progress` orders checkpoints of one state.
    fn checkpoint(&self, state: &[u8], progress: u64);
    /// The same of a state that is too large to stand in memory twice: `write` writes it piece by piece.
    fn checkpoint_with(&self, progress: u64, write: &dyn Fn(&mut dyn Write) -> io::Result<()>) {
        let mut state = Vec::new();
        write(&mut state).expect("a vector takes whatever is written");
        self.checkpoint(&state, progress);
    }
    /// Whether so much time has gone by since the last checkpoint that another one is worth writing.
    fn checkpoint_is_due(&self) -> bool {
        false
    }
    /// The furthest checkpoint whose progress does not exceed `at_most`.
    fn resume(&self, at_most: u64) -> Option<Vec<u8>>;
    /// The same for a state that is too large to stand in memory twice: `read` reads it piece by piece. Whether there is one.
    fn resume_with(&self, at_most: u64, read: &mut dyn FnMut(&mut dyn Read)) -> bool {
        self.resume(at_most).map(|state| read(&mut state.as_slice())).is_some()
    }
    /// Does `work(0) .. work(n - 1)` on the threads of the run, in any order.
    fn tiles(&self, n: usize, work: &(dyn Fn(usize) + Sync));
    /// How many threads `tiles` may use; never let it show in an output.
    fn threads(&self) -> usize;
    /// The level of vector instructions that is asked for: `baseline`, `v3`, `v4`, or empty for the best there is.
    /// Results do not depend on it.
    fn simd(&self) -> &str {
        ""
    }
}

/// A running stage's view of the world.
#[derive(Clone, Copy)]
pub struct Ctx<'a> {
    host: &'a dyn Host,
}

impl<'a> Ctx<'a> {
    pub fn new(host: &'a dyn Host) -> Self {
        Self { host }
    }

    /// Does `work` for each tile on all threads; results in tile order, whatever the thread count.
    ///
    /// Error: [`Error::Interrupted`] when the run was cancelled; tiles not yet begun are then left out.
    pub fn map_tiles<T: Send + Sync>(&self, n: usize, work: impl Fn(usize) -> T + Sync) -> Result<Vec<T>, Error> {
        let slots: Vec<OnceLock<T>> = (0..n).map(|_| OnceLock::new()).collect();
        self.host.tiles(n, &|i| {
            if !self.host.cancelled() {
                let _ = slots[i].set(work(i));
            }
        });
        slots.into_iter().map(OnceLock::into_inner).collect::<Option<Vec<T>>>().ok_or(Error::Interrupted)
    }

    /// [`Error::Interrupted`] once the run was cancelled; call it between pieces of serial work.
    pub fn checked(&self) -> Result<(), Error> {
        if self.host.cancelled() { Err(Error::Interrupted) } else { Ok(()) }
    }

    pub fn warn(&self, message: impl AsRef<str>) {
        self.host.warn(message.as_ref());
    }
}

impl<'a> std::ops::Deref for Ctx<'a> {
    type Target = dyn Host + 'a;
    fn deref(&self) -> &Self::Target {
        self.host
    }
}
