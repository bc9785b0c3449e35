//! turbid: declarative pipelines that design and simulate spatial frequency domain imaging systems.
//!
//! Data flows one way: YAML -> [`spec`] -> [`plan`] -> [`key`] -> [`run`] -> [`store`]; `docs/architecture.md` is the map.

pub mod brief;
#[cfg(test)]
mod child;
pub mod cli;
pub mod dataset;
pub mod digest;
pub mod estimate;
pub mod explain;
pub mod export;
mod ids;
pub mod input_file;
pub mod key;
mod leftover;
pub mod memo;
pub mod memory;
mod missing;
mod panics;
pub mod plan;
pub mod preview;
pub mod recipe;
pub mod registry;
mod regular;
pub mod report;
pub mod resolve;
pub mod run;
pub mod spec;
mod stamp;
pub mod statistics;
pub mod store;
pub mod study;
pub mod submit;
mod terminal;
mod threads;
pub mod unchanged;
mod warned;
mod whole_file;
