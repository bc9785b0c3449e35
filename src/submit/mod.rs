//! Shards handed over to engines that others run: jobs, arrays of tasks, how they are followed.

pub mod batches;
pub mod engine;
pub mod follow;
mod hyperqueue;
pub mod job;
pub mod program;
mod slurm;
pub mod stand;

pub use engine::{Engine, Trouble};
pub use job::{Job, Work};

/// The engines, by the names that `--engine` takes.
pub const ENGINES: [&str; 2] = ["hq", "slurm"];

/// The engine of this name.
pub fn engine(name: &str) -> Option<Box<dyn Engine>> {
    match name {
        "hq" => Some(Box::new(hyperqueue::HyperQueue::found())),
        "slurm" => Some(Box::new(slurm::Slurm)),
        _ => None,
    }
}
