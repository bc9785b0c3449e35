//! Released blobs: digest and length stay in the records, the bytes are gone on purpose.
//!
//! Such a record is a hit, and keys whoever reads its ports. Who needs the bytes runs the instance again, and the digest must agree.

use std::collections::{HashMap, HashSet};
use std::fs;

use crate::digest::Digest;
use crate::store::Store;
use crate::store::backend::Backend;
use crate::store::compact::gone;
use crate::store::error::StoreError;
use crate::store::record::{Blob, InstanceRecord};

/// How many records name each blob.
///
/// By the first bytes of digests. Of two blobs that begin alike both count as named by the records of either: one that is
/// still named never passes for one that is not.
#[derive(Default)]
pub struct Names {
    counted: HashSet<u64>,
    by: HashMap<u64, u32>,
}

fn first(digest: &Digest) -> u64 {
    u64::from_le_bytes(*digest.0.first_chunk().expect("a digest has 32 bytes"))
}

impl Names {
    /// Records that name the blob.
    pub fn of(&self, blob: &Blob) -> u32 {
        self.by.get(&first(&blob.digest)).copied().unwrap_or(0)
    }

    fn add(&mut self, record: &InstanceRecord) {
        // A record that names a blob at two ports is one.
        let named: HashSet<u64> = record.blobs().map(|blob| first(&blob.digest)).collect();
        named.into_iter().for_each(|blob| *self.by.entry(blob).or_default() += 1);
    }
}

impl Store {
    /// Whether the bytes of a blob were given back on purpose and have not come since.
    pub fn is_released(&self, blob: &Blob) -> bool {
        // A loose one may have come again without a word in the packs.
        self.folder.packs.is_released(&blob.digest) && !self.backend.holds(blob).unwrap_or(true)
    }

    /// Whether there may be a released blob at all.
    pub fn has_released(&self) -> bool {
        self.folder.packs.releases()
    }

    /// Counts the records that were not there when this was last done, those of other runs too.
    ///
    /// Error: the store cannot be read; what is not known may name any blob.
    pub fn count_names(&self, names: &mut Names) -> Result<(), StoreError> {
        self.folder.packs.refresh()?;
        self.folder.packs.is_complete()?;
        for key in self.folder.packs.keys_but(|key| names.counted.contains(&first(key))) {
            let head = self.folder.record_head(&key)?;
            if let Some(record) = head.and_then(|head| InstanceRecord::decode_head(&key, &head)) {
                names.add(&record);
            }
            names.counted.insert(first(&key));
        }
        // Also while they were listed and looked up.
        self.folder.packs.is_complete()
    }

    /// Gives back the bytes of blobs. All of a pack's are dead with one frame; the packs are rewritten when most of them is
    /// dead and no other process uses the store ([`Store::finish`]), files of their own are removed here.
    ///
    /// Error: it could not be written; what is not released stays as it was.
    pub fn release(&self, blobs: &[Blob]) -> Result<(), StoreError> {
        let digests: Vec<Digest> = blobs.iter().map(|blob| blob.digest).collect();
        if digests.is_empty() {
            return Ok(());
        }
        self.begin_use(&|| false)?;
        let packed: Vec<bool> = digests.iter().map(|digest| self.folder.packs.blob_length(digest).is_some()).collect();
        // First the word, then the bytes: killed between the two, a file is still there and is released by the next call.
        self.folder.packs.release(&digests)?;
        for (blob, packed) in blobs.iter().zip(packed) {
            let path = self.folder.loose_path(blob);
            if !packed {
                gone(fs::remove_file(&path)).map_err(StoreError::io("remove a file of the store", &path))?;
            }
        }
        Ok(())
    }
}
