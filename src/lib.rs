//! turbid: declarative pipelines that design and simulate spatial frequency domain imaging systems.

pub mod digest;
pub mod export;
pub mod preview;
pub mod registry;
pub mod spec;
pub mod store;
