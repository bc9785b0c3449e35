//! States of unfinished work: what a run keeps, and goes on from.

use std::collections::BTreeSet;
use std::io;

use crate::digest::Digest;
use crate::store::Store;
use crate::store::error::StoreError;

impl Store {
    /// Keeps a state from which a killed or longer run can go on; `progress` orders the states of one key.
    ///
    /// The furthest state of each of the three highest octaves of progress is kept.
    pub fn checkpoint(&self, state_key: &Digest, progress: u64, state: &[u8]) -> Result<(), StoreError> {
        self.begin_use(&|| false)?;
        self.checkpoints.write(state_key, progress, &|to| to.write_all(state))
    }

    /// The same of a state that `write` writes piece by piece, the same bytes each time it is called.
    pub fn checkpoint_with(
        &self,
        state_key: &Digest,
        progress: u64,
        write: &dyn Fn(&mut dyn io::Write) -> io::Result<()>,
    ) -> Result<(), StoreError> {
        self.begin_use(&|| false)?;
        self.checkpoints.write(state_key, progress, write)
    }

    /// The furthest undamaged checkpoint with `progress <= at_most`.
    pub fn resume(&self, state_key: &Digest, at_most: u64) -> Option<(u64, Vec<u8>)> {
        let (mut found, mut state) = (None, Vec::new());
        self.resume_with(state_key, at_most, &mut |progress, from| {
            found = from.read_to_end(&mut state).is_ok().then_some(progress);
        });
        Some((found?, state))
    }

    /// The same for a state that `read` reads piece by piece, after its progress. Whether there is one.
    pub fn resume_with(&self, state_key: &Digest, at_most: u64, read: &mut dyn FnMut(u64, &mut dyn io::Read)) -> bool {
        self.checkpoints.resume(state_key, at_most, read)
    }

    /// Removes the checkpoints of a state but those of these progresses: what a run from the start has shown to be wrong, or could not compare.
    pub fn forget_checkpoints(&self, state_key: &Digest, but: &BTreeSet<u64>) {
        self.checkpoints.forget(state_key, but);
    }
}
