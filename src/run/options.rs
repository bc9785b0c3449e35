//! How to run.

use std::path::PathBuf;

use crate::plan::StageId;

/// How to run.
#[derive(Clone, Debug)]
pub struct Options {
    /// Threads of the run, and at most this many instances at once.
    pub jobs: usize,
    /// Go on with what does not depend on a failed instance.
    pub keep_going: bool,
    /// Stages that run even where the store holds their outputs.
    pub force: Vec<StageId>,
    /// Store what they make even where it differs from what is stored.
    pub replace: bool,
    /// `baseline`, `v3`, `v4`, or empty for the best level of vector instructions.
    pub simd: String,
    /// Keep the state in which a stage ended, from which a longer run goes on. Without, states are written for a run that is killed alone.
    pub keep_states: bool,
    /// Bytes of memory that instances may take together; `None` where nobody knows.
    pub memory: Option<u64>,
    /// The outputs folder, below whose `latest` pictures of what runs are drawn meanwhile; `None` where nobody looks at single ones.
    pub live: Option<PathBuf>,
}

#[cfg(test)]
impl Options {
    /// What the tests of this folder run with.
    pub fn of_tests(jobs: usize) -> Self {
        let (force, simd) = (Vec::new(), String::new());
        Self { jobs, keep_going: true, force, replace: false, simd, keep_states: true, memory: None, live: None }
    }
}
