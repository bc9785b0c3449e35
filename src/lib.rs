//! turbid: declarative pipelines that design and simulate spatial frequency domain imaging systems.
//!
//! Data flows one way: YAML -> [`spec`] -> [`plan`] -> [`key`] -> [`run`] -> [`store`]; `docs/architecture.md` is the map.

pub mod cli;
pub mod digest;
pub mod explain;
pub mod export;
pub mod key;
pub mod memo;
pub mod plan;
pub mod preview;
pub mod recipe;
pub mod registry;
pub mod resolve;
pub mod run;
pub mod spec;
pub mod store;
