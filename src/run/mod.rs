//! Runs what is stale, side by side within a budget of threads and memory.
//!
//! [`state`] says where each instance stands, [`schedule`] what begins next and what follows from an end, [`threads`] brings instances to
//! threads.

mod admission;
mod caption;
mod execute;
mod host;
mod inputs;
mod interrupt;
pub mod latest;
pub mod log;
mod name;
pub mod progress;
mod schedule;
mod state;
mod summary;
mod threads;

use std::time::Instant;

use crate::resolve::{Resolver, Survey};

pub use interrupt::Interrupt;
pub use progress::Progress;
pub use summary::{End, Summary};

use schedule::Schedule;

/// How to run.
#[derive(Clone, Debug)]
pub struct Options {
    /// Threads of the run, and at most this many instances at once.
    pub jobs: usize,
    /// Go on with what does not depend on a failed instance.
    pub keep_going: bool,
    /// Stages that run even where the store holds their outputs.
    pub force: Vec<usize>,
    /// Store what they make even where it differs from what is stored.
    pub replace: bool,
    /// `baseline`, `v3`, `v4`, or empty for the best level of vector instructions.
    pub simd: String,
    /// Bytes of memory that instances may take together; `None` where nobody knows.
    pub memory: Option<u64>,
}

/// Runs what the survey found stale. The survey must be free of errors.
///
/// Error: the system starts no threads.
pub fn run(
    resolver: &Resolver<'_>,
    survey: Survey,
    options: &Options,
    progress: &dyn Progress,
    interrupt: &Interrupt,
) -> Result<Summary, String> {
    let began = Instant::now();
    let mut schedule = Schedule::new(resolver, survey, options, progress);
    if !schedule.is_over() {
        threads::work(&mut schedule, interrupt)?;
    }
    let ends = schedule.into_ends();
    Ok(Summary { ends, seconds: began.elapsed().as_secs_f64(), interrupted: interrupt.requested() })
}

#[cfg(test)]
mod tests;
