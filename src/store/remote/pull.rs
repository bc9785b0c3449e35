//! A local store with one elsewhere, and pulling from it.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::AddAssign;
use std::sync::Arc;

use serde::Serialize;

use crate::digest::Digest;
use crate::store::Store;
use crate::store::backend::{Backend, PACKED_BELOW};
use crate::store::error::StoreError;
use crate::store::record::{Blob, InstanceRecord};

use super::aside::side_by_side;
use super::{Remote, Through};

/// What a pull brought here.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Pulled {
    pub records: u64,
    /// Blobs in packs, and blobs that are files of their own.
    pub small_blobs: u64,
    pub large_blobs: u64,
    /// Records some of whose blobs are not to be had.
    pub left_out: u64,
}

impl AddAssign for Pulled {
    fn add_assign(&mut self, more: Self) {
        self.records += more.records;
        self.small_blobs += more.small_blobs;
        self.large_blobs += more.large_blobs;
        self.left_out += more.left_out;
    }
}

impl Store {
    /// This store with another one behind it: what is a miss here is looked for there and brought in, records with what is asked of them. One list of manifests
    /// and those that are not known yet are read.
    ///
    /// Errors: the store elsewhere cannot be read, or this one is in use by a `gc` and cannot be waited for.
    pub fn with_remote(mut self, remote: Remote) -> Result<Self, StoreError> {
        self.begin_use(&|| false)?;
        remote.look(&self.root)?;
        let remote = Arc::new(remote);
        self.backend = Arc::new(Through { folder: self.folder.clone(), remote: remote.clone() });
        self.remote = Some(remote);
        Ok(self)
    }

    /// The store elsewhere.
    pub fn remote(&self) -> Option<&Remote> {
        self.remote.as_deref()
    }

    /// Brings in the records of these keys with their small blobs, in few requests, as far as they are elsewhere; large blobs come when they are read.
    ///
    /// Error: the store elsewhere cannot be read, or this one not be written.
    pub fn bring_records(&self, keys: &[Digest]) -> Result<Pulled, StoreError> {
        let Some(remote) = &self.remote else { return Ok(Pulled::default()) };
        self.pull_records(remote, keys)
    }

    fn pull_records(&self, remote: &Remote, keys: &[Digest]) -> Result<Pulled, StoreError> {
        let mut wanted = BTreeSet::new();
        for key in keys {
            let Some(best) = remote.listings(key).into_iter().next() else { continue };
            let held = self.here(key)?.map_or(0, |record| record.ports.len());
            if best.ports as usize > held {
                wanted.insert(*key);
            }
        }
        let records = remote.fetch(&self.folder, wanted, BTreeSet::new())?;
        let small = self.missing(keys, |blob| blob.bytes < PACKED_BELOW)?.into_keys().collect();
        let blobs = remote.fetch(&self.folder, BTreeSet::new(), small)?;
        Ok(Pulled {
            records: records.records + blobs.records,
            small_blobs: records.blobs + blobs.blobs,
            ..Pulled::default()
        })
    }

    /// Brings in the records of these keys (all that there are without) with all their blobs.
    ///
    /// Error: as [`Store::bring_records`]. What came until then is here.
    pub fn pull(&self, keys: Option<&[Digest]>, told: &(dyn Fn(u64, u64) + Sync)) -> Result<Pulled, StoreError> {
        let Some(remote) = &self.remote else { return Ok(Pulled::default()) };
        let all: Vec<Digest>;
        let keys = match keys {
            Some(keys) => keys,
            None => {
                all = remote.known().keys().into_iter().collect();
                &all
            }
        };
        let mut pulled = self.pull_records(remote, keys)?;
        let large: Vec<Blob> = self.missing(keys, |blob| blob.bytes >= PACKED_BELOW)?.into_values().collect();
        let all = large.iter().map(|blob| blob.bytes).sum();
        let done = std::sync::atomic::AtomicU64::new(0);
        let came = side_by_side(&large, |blob| {
            let came = remote.fetch_large(&self.folder, blob);
            let before = done.fetch_add(blob.bytes, std::sync::atomic::Ordering::Relaxed);
            told(before + blob.bytes, all);
            came
        });
        for came in came {
            pulled.large_blobs += u64::from(came?);
        }
        for key in keys {
            if let Some(record) = self.here(key)? {
                let whole = record.blobs().map(|blob| self.folder.holds(blob)).collect::<Result<Vec<_>, _>>()?;
                pulled.left_out += u64::from(whole.contains(&false));
            }
        }
        self.folder.packs.finish()?;
        Ok(pulled)
    }

    /// The record that is here, whether or not its blobs are.
    fn here(&self, key: &Digest) -> Result<Option<InstanceRecord>, StoreError> {
        Ok(self.folder.record_head(key)?.and_then(|head| InstanceRecord::decode_head(key, &head)))
    }

    /// The blobs of these records that are not here, as far as they are of this kind.
    fn missing(&self, keys: &[Digest], of: impl Fn(&Blob) -> bool) -> Result<BTreeMap<Digest, Blob>, StoreError> {
        let mut missing = BTreeMap::new();
        for key in keys {
            for blob in self.here(key)?.iter().flat_map(InstanceRecord::blobs).filter(|blob| of(blob)) {
                if !self.folder.holds(blob)? {
                    missing.insert(blob.digest, *blob);
                }
            }
        }
        Ok(missing)
    }
}
