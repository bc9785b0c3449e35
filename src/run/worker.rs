//! What all instances of a run share.

use crate::resolve::Resolver;

use super::{Interrupt, Options, Progress};

/// What all instances of a run share.
#[derive(Clone, Copy)]
pub struct Worker<'a> {
    pub resolver: &'a Resolver<'a>,
    pub pool: &'a rayon::ThreadPool,
    pub options: &'a Options,
    pub progress: &'a dyn Progress,
    pub interrupt: &'a Interrupt,
}
