//! Runs what is stale, side by side within a budget of threads and memory.
//!
//! [`state`] says where each instance stands, [`schedule`] what begins next and what follows from an end, [`threads`] brings instances to
//! threads.

mod admission;
mod caption;
mod dependents;
mod elsewhere;
mod execute;
mod host;
mod inputs;
mod interrupt;
pub mod latest;
pub mod log;
pub(crate) mod name;
mod options;
mod partial;
mod peak;
pub mod progress;
mod schedule;
mod state;
mod summary;
mod threads;
mod worker;

use std::time::Instant;

use crate::resolve::{Resolver, Survey};

pub use interrupt::Interrupt;
pub use options::Options;
pub use progress::Progress;
pub use summary::{End, Summary};

use schedule::Schedule;

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
    if schedule.has_work() {
        threads::work(&mut schedule, interrupt)?;
    }
    let ends = schedule.into_ends();
    Ok(Summary { ends, seconds: began.elapsed().as_secs_f64(), interrupted: interrupt.requested() })
}

#[cfg(test)]
mod tests;
