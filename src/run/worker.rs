//! What all instances of a run share.

use crate::resolve::Resolver;

use super::inputs::Kept;
use super::interrupt::Interrupt;
use super::options::Options;
use super::progress::Progress;

/// What all instances of a run share.
#[derive(Clone, Copy)]
pub struct Worker<'a> {
    pub resolver: &'a Resolver<'a>,
    pub pool: &'a rayon::ThreadPool,
    pub options: &'a Options,
    pub progress: &'a dyn Progress,
    pub interrupt: &'a Interrupt,
    pub kept: &'a Kept,
}
