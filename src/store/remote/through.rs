//! The local store with one elsewhere behind it: what is missing here is looked for there, and kept here.

use std::collections::BTreeSet;
use std::sync::Arc;

use crate::digest::Digest;
use crate::store::backend::{Backend, Folder, PACKED_BELOW};
use crate::store::error::StoreError;
use crate::store::record::Blob;

use super::Remote;

/// Reads fall through to the store elsewhere; writes stay here until they are pushed.
pub(in crate::store) struct Through {
    pub folder: Arc<Folder>,
    pub remote: Arc<Remote>,
}

impl Through {
    /// Whether the record was brought in.
    fn bring_record(&self, key: &Digest) -> Result<bool, StoreError> {
        if self.remote.listings(key).is_empty() {
            return Ok(false);
        }
        self.remote.fetch(&self.folder, BTreeSet::from([*key]), BTreeSet::new())?;
        Ok(true)
    }
}

impl Backend for Through {
    fn record(&self, key: &Digest) -> Result<Option<Vec<u8>>, StoreError> {
        match self.folder.record(key)? {
            None if self.bring_record(key)? => self.folder.record(key),
            found => Ok(found),
        }
    }

    fn record_head(&self, key: &Digest) -> Result<Option<Vec<u8>>, StoreError> {
        match self.folder.record_head(key)? {
            None if self.bring_record(key)? => self.folder.record_head(key),
            found => Ok(found),
        }
    }

    fn publish(&self, key: &Digest, bytes: &[u8]) -> Result<(), StoreError> {
        self.folder.publish(key, bytes)
    }

    fn holds(&self, blob: &Blob) -> Result<bool, StoreError> {
        Ok(self.folder.holds(blob)? || self.remote.holds(blob))
    }

    fn read(&self, blob: &Blob) -> Result<Option<Vec<u8>>, StoreError> {
        match self.folder.read(blob)? {
            None => {
                self.bring(blob)?;
                self.folder.read(blob)
            }
            found => Ok(found),
        }
    }

    fn bring(&self, blob: &Blob) -> Result<(), StoreError> {
        if self.folder.holds(blob)? {
            return Ok(());
        }
        if blob.bytes < PACKED_BELOW {
            self.remote.fetch(&self.folder, BTreeSet::new(), BTreeSet::from([blob.digest]))?;
        } else {
            self.remote.fetch_large(&self.folder, blob)?;
        }
        Ok(())
    }

    fn write(&self, blob: &Blob, bytes: &[u8]) -> Result<(), StoreError> {
        self.folder.write(blob, bytes)
    }

    fn quarantine(&self, blob: &Blob) -> Result<(), StoreError> {
        self.folder.quarantine(blob)
    }
}
