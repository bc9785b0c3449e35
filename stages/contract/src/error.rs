//! Why a stage could not finish.

use std::fmt;

use crate::problem::{At, Problem};

/// What stops a stage while it runs. Mistakes that can be seen before belong into `check`.
#[derive(Clone, Debug)]
pub enum Error {
    /// Params or inputs turned out wrong only once the inputs were there.
    Invalid(Problem),
    /// The stage could not do its work: what happened and, where known, the way out.
    Failed { what: String, way_out: Option<String> },
    /// The user or the engine asked to stop; nothing of it is cached but checkpoints.
    Interrupted,
}

impl Error {
    pub fn failed(what: impl Into<String>) -> Self {
        Self::Failed { what: what.into(), way_out: None }
    }

    pub fn failed_with_hint(what: impl Into<String>, way_out: impl Into<String>) -> Self {
        Self::Failed { what: what.into(), way_out: Some(way_out.into()) }
    }

    pub fn invalid(path: impl Into<String>, message: impl Into<String>) -> Self {
        Self::Invalid(Problem { at: At::With, path: path.into(), message: message.into(), hint: None })
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Invalid(problem) => problem.fmt(f),
            Self::Failed { what, way_out: None } => f.write_str(what),
            Self::Failed { what, way_out: Some(way_out) } => write!(f, "{what} ({way_out})"),
            Self::Interrupted => f.write_str("interrupted"),
        }
    }
}

impl std::error::Error for Error {}
