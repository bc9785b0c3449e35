//! `cache gc`: makes the store fit into a size, the least recently used first.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use serde::Serialize;

use crate::digest::Digest;
use crate::store::Store;
use crate::store::backend::Backend;
use crate::store::checkpoint::Checkpoint;
use crate::store::compact::gone;
use crate::store::disk;
use crate::store::error::StoreError;
use crate::store::frame::HEADER;
use crate::store::lock::{self, Try, guard};
use crate::store::network;
use crate::store::record::{Blob, InstanceRecord};

/// What `gc` removed and kept. Bytes are those of files, the index left out.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct GcReport {
    pub bytes_before: u64,
    pub bytes_after: u64,
    pub records_removed: u64,
    pub records_kept: u64,
    pub checkpoints_removed: u64,
    /// Records among the roots that had to go, because the roots alone exceed the size.
    pub roots_removed: u64,
}

/// Something that is kept or removed as a whole.
enum Item {
    Record(Box<InstanceRecord>, u64),
    Checkpoint(Checkpoint),
}

impl Store {
    /// Removes what no record names, and the least recently used records with their blobs, and checkpoints, until the
    /// store's files take at most `max_size` bytes. What `roots` (keys of records) name goes last.
    ///
    /// To be called when no other thread works on the store. Errors: [`StoreError::Busy`] while another process uses it,
    /// [`StoreError::NoLocks`] and [`StoreError::OtherMachines`] where nobody can tell; something cannot be read: then nothing was removed.
    pub fn gc(&self, max_size: u64, roots: &[Digest]) -> Result<GcReport, StoreError> {
        self.alone(|| self.collect(max_size, roots))
    }

    fn collect(&self, max_size: u64, roots: &[Digest]) -> Result<GcReport, StoreError> {
        let roots: BTreeSet<&Digest> = roots.iter().collect();
        let mut items: Vec<(bool, u64, Item)> = Vec::new();
        for (key, place) in self.folder.packs.records() {
            let head = self.folder.record_head(&key)?;
            let Some(record) = head.and_then(|bytes| InstanceRecord::decode_head(&key, &bytes)) else { continue };
            // A record that no run would accept only takes room.
            if self.holds_all(&record)? {
                let item = Item::Record(Box::new(record), HEADER as u64 + u64::from(place.length));
                items.push((roots.contains(&key), u64::from(place.used), item));
            }
        }
        for checkpoint in self.checkpoints.all()? {
            items.push((false, checkpoint.written, Item::Checkpoint(checkpoint)));
        }
        let (loose, mut rest) = (self.folder.loose()?, Vec::new());
        for folder in ["quarantine", "tmp"].map(|name| self.root.join(name)) {
            rest.extend(disk::list(&folder).map_err(StoreError::io("read the store", &folder))?);
        }
        items.sort_by_key(|(root, used, _)| (std::cmp::Reverse(*root), std::cmp::Reverse(*used)));

        let before = self.stat()?;
        let mut report = GcReport { bytes_before: before.bytes, ..GcReport::default() };
        let (mut records, mut blobs) = (BTreeSet::new(), BTreeSet::new());
        let (mut size, mut full) = (0, false);
        for (root, _, item) in &items {
            let (fresh, cost) = match item {
                Item::Record(record, bytes) => {
                    let room = |blob: &Blob| match self.is_released(blob) {
                        true => 0,
                        false => blob.bytes + self.frame_header(&blob.digest),
                    };
                    let fresh: BTreeMap<Digest, u64> = record
                        .blobs()
                        .filter(|blob| !blobs.contains(&blob.digest))
                        .map(|blob| (blob.digest, room(blob)))
                        .collect();
                    let cost = bytes + fresh.values().sum::<u64>();
                    (fresh, cost)
                }
                Item::Checkpoint(checkpoint) => (BTreeMap::new(), checkpoint.bytes),
            };
            // Once something does not fit, nothing that was used less recently stays either.
            full |= size + cost > max_size;
            match item {
                Item::Record(..) if full => {
                    report.records_removed += 1;
                    report.roots_removed += u64::from(*root);
                }
                Item::Record(record, _) => {
                    size += cost;
                    records.insert(record.key);
                    blobs.extend(fresh.into_keys());
                }
                Item::Checkpoint(checkpoint) if full => {
                    rest.push(checkpoint.path.clone());
                    report.checkpoints_removed += 1;
                }
                Item::Checkpoint(_) => size += cost,
            }
        }
        report.records_kept = records.len() as u64;
        // Records first: a crash between leaves blobs that nobody names, not records whose blobs are gone.
        self.folder.packs.compact(&records, &blobs)?;
        rest.extend(loose.into_iter().filter(|(digest, ..)| !blobs.contains(digest)).map(|(_, path, _)| path));
        rest.iter().try_for_each(|path| remove(path))?;
        report.bytes_after = self.stat()?.bytes;
        Ok(report)
    }

    fn holds_all(&self, record: &InstanceRecord) -> Result<bool, StoreError> {
        for blob in record.blobs() {
            if !self.folder.holds(blob)? && !self.is_released(blob) {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Length of the frame around a packed blob.
    fn frame_header(&self, digest: &Digest) -> u64 {
        if self.folder.packs.blob_length(digest).is_some() { HEADER as u64 } else { 0 }
    }

    /// Rewrites the packs into few, without what newer entries replace, without what is damaged, and without the records
    /// of `unfit`.
    ///
    /// Errors: [`StoreError::Busy`] while another process uses the store, [`StoreError::NoLocks`],
    /// [`StoreError::OtherMachines`], a full disk, an old pack that cannot be read.
    pub(super) fn gather_packs(&self, unfit: &BTreeSet<Digest>) -> Result<(), StoreError> {
        let packs = &self.folder.packs;
        self.alone(|| {
            let keys = |all: Vec<(Digest, _)>| all.into_iter().map(|(key, _)| key).collect::<BTreeSet<_>>();
            let blobs = keys(packs.blobs()).into_iter().chain(packs.released()).collect();
            packs.compact(&(&keys(packs.records()) - unfit), &blobs)
        })
    }

    /// Does `work` while no other process uses the store.
    fn alone<T>(&self, work: impl FnOnce() -> Result<T, StoreError>) -> Result<T, StoreError> {
        let mut in_use = guard(&self.in_use);
        *in_use = None;
        let path = self.lock_path();
        match lock::try_exclusive(&path) {
            Try::Held => Err(StoreError::Busy { path: self.root.clone() }),
            _ if self.read_only => Err(StoreError::Busy { path: self.root.clone() }),
            Try::Taken(held) if lock::is_exclusive(&path) => {
                // What this machine's locks prove they prove of its own processes.
                if let Some(kind) = network::kind(&held).filter(|_| !self.no_other_machine) {
                    return Err(StoreError::OtherMachines { path: self.root.clone(), kind });
                }
                self.folder.packs.read_again()?;
                let done = work();
                drop(held);
                done
            }
            Try::Taken(_) | Try::Unsupported => Err(StoreError::NoLocks { path: self.root.clone() }),
        }
    }
}

/// Removes a file, or whatever else was set aside, if it is there.
fn remove(path: &Path) -> Result<(), StoreError> {
    let is_folder = fs::symlink_metadata(path).is_ok_and(|meta| meta.is_dir());
    let removed = if is_folder { fs::remove_dir_all(path) } else { fs::remove_file(path) };
    gone(removed).map_err(StoreError::io("remove a file of the store", path))
}
