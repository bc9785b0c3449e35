//! Which files of large blobs this process knows to hold what their names say.

use std::collections::HashMap;
use std::fs::File;
use std::sync::Mutex;

use crate::digest::Digest;
use crate::panics::lock;
use crate::stamp::Stamp;
use crate::store::record::Blob;

/// Files of large blobs that this process wrote or compared with their digests: while one is as it was, it is not read once more to compare it again.
#[derive(Default)]
pub(super) struct Compared(Mutex<HashMap<Digest, Stamp>>);

impl Compared {
    /// Whether the file is the one that holds just this blob, and was not touched since that was seen.
    pub fn holds(&self, blob: &Blob, file: &File) -> bool {
        let known = lock(&self.0).get(&blob.digest).copied();
        known.is_some_and(|known| known.length == blob.bytes && stamp(file) == Some(known))
    }

    /// The file holds just this blob.
    pub fn note(&self, blob: &Blob, file: &File) {
        if let Some(stamp) = stamp(file) {
            lock(&self.0).insert(blob.digest, stamp);
        }
    }
}

fn stamp(file: &File) -> Option<Stamp> {
    // Where no number tells one file from another, none is known again.
    file.metadata().ok().map(|meta| Stamp::of(&meta)).filter(|stamp| stamp.inode != 0)
}
