//! The kit for those who write a stage: inputs and a host in memory, a stage called as the engine calls it, and the rules that it must keep.
//!
//! ```text
//! let trial = Trial::of::<MyStage>(json!({"sigma": 2})).input("maps", maps);
//! trial.refuses("sigma", "must be > 0");                    // where that is wrong
//! let made = trial.run().unwrap();
//! let smooth: Maps = made.get("maps");
//! trial.keeps_the_rules();                                  // same bytes on 1 and 3 threads, units, finite values, ...
//! ```
//! `docs/add-a-stage.md` says all rules. Nothing here is part of a run.

mod host;
mod inputs;
mod rules;
mod trial;

pub use host::MemoryHost;
pub use inputs::Inputs;
pub use trial::{Made, Trial};
