//! `store: shards_only`: what the samples of a shard left in the store is given back once the shard is there.

use std::collections::{HashMap, HashSet};

use crate::brief::Brief;
use crate::digest::Digest;
use crate::store::{Blob, Names, Store, StoreError};

/// What a build gives back. Never what a record outside of the data set names.
#[derive(Default)]
pub struct Releases {
    /// Blobs of samples whose shards are there, with the number of records of the data set that name them.
    due: HashMap<Digest, (Blob, u32)>,
    /// The first bytes of the keys of these records: each counts once.
    records: HashSet<u64>,
    names: Names,
}

impl Releases {
    /// An instance of a sample, whose outputs may go but for those `but`.
    pub fn add(&mut self, store: &Store, brief: &Brief, but: &[&str]) {
        let kept: HashSet<Digest> = but.iter().filter_map(|port| Some(brief.outputs.get(port)?.digest)).collect();
        let goes = |blob: &&Blob| !kept.contains(&blob.digest) && !store.is_released(blob);
        let blobs: HashSet<&Blob> = brief.outputs.iter().map(|(_, blob)| blob).filter(goes).collect();
        let first = u64::from_le_bytes(*brief.key.0.first_chunk().expect("a digest has 32 bytes"));
        let fresh = !blobs.is_empty() && self.records.insert(first);
        for blob in blobs {
            let (_, own) = self.due.entry(blob.digest).or_insert((*blob, u32::from(!fresh)));
            *own += u32::from(fresh);
        }
    }

    /// Gives back those that no other record names by now. What samples of later shards share with these waits for them.
    ///
    /// Error: it could not be written.
    pub fn release(&mut self, store: &Store) -> Result<(), StoreError> {
        if self.due.is_empty() {
            return Ok(());
        }
        store.count_names(&mut self.names)?;
        let names = &self.names;
        let mut blobs: Vec<Blob> =
            self.due.values().filter(|(blob, own)| names.of(blob) <= *own).map(|(blob, _)| *blob).collect();
        blobs.sort_unstable();
        store.release(&blobs)?;
        self.due.retain(|digest, _| blobs.binary_search_by_key(digest, |blob| blob.digest).is_err());
        Ok(())
    }
}
