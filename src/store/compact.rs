//! Rewriting the packs into few: without what newer entries replace, what is damaged and what is not kept.

use std::collections::BTreeSet;
use std::fs::{self, File, OpenOptions};
use std::io;
use std::path::PathBuf;
use std::sync::atomic::Ordering;

use crate::digest::Digest;
use crate::store::disk;
use crate::store::error::StoreError;
use crate::store::frame::{self, Kind};
use crate::store::lock::guard;
use crate::store::odd;
use crate::store::packs::{Packs, RELEASED, stamp_after};
use crate::store::place::{Entry, Named};
use crate::store::state::{LONGEST, Pack, State, read, read_payload};
use crate::store::writer::{FULL, now_ns};

/// Fresh packs; they are removed again unless they are kept.
struct Fresh {
    folder: PathBuf,
    files: Vec<(PathBuf, File)>,
    /// Of the last one.
    length: u64,
    keep: bool,
}

impl Packs {
    /// Writes the kept records and blobs into fresh packs and removes all others. Needs the store alone.
    ///
    /// Error: an old pack could not be read or the fresh ones not be written, and the old ones are as they were; or an old one could not be removed,
    /// which says nothing that the fresh ones do not say.
    pub fn compact(&self, records: &BTreeSet<Digest>, blobs: &BTreeSet<Digest>) -> Result<(), StoreError> {
        let mut writer = guard(&self.writer);
        *writer = None;
        let mut state = self.state_mut();
        // First, as it reads packs again where the index turns out damaged.
        let is_kept = |Entry { digest, named, place }: &Entry| match named {
            Named::Record => place.is_here() && records.contains(digest),
            Named::Blob => (place.is_here() || place.is_released()) && blobs.contains(digest),
            _ => false,
        };
        let kept = |kept: &mut Vec<Entry>, entry| kept.extend(Some(entry).filter(is_kept));
        let kept = state.fold(&self.root, kept);
        state.is_complete()?;
        let folder = self.root.join("packs");
        odd::make_folder(&self.root, &folder).map_err(StoreError::io("create a folder of the store", &folder))?;
        let mut fresh = Fresh { folder, files: Vec::new(), length: FULL, keep: false };
        fresh.write_kept(&state, kept)?;
        fresh.sync()?;
        fresh.keep = true;
        let removed = state.packs.values().map(|pack| self.remove(pack)).fold(Ok(()), Result::and);
        state.clear();
        state.refresh(&self.root)?;
        removed?;
        self.damaged.store(false, Ordering::Relaxed);
        state.save(&self.root, true, now_ns())
    }

    fn remove(&self, pack: &Pack) -> Result<(), StoreError> {
        let path = self.root.join("packs").join(&pack.name);
        let there = disk::look(&path).map_err(StoreError::io("read the store", &path))?;
        // None of ours; or somebody appends to it, whatever the locks say: it stays, and the next rewriting sees to it.
        if pack.length > LONGEST || there.is_some_and(|meta| meta.len() > pack.length) {
            return Ok(());
        }
        gone(fs::remove_file(&path)).map_err(StoreError::io("remove an old pack", &path))?;
        // An empty file that nobody asks for any more.
        let _ = fs::remove_file(self.root.join("locks").join(&pack.name));
        Ok(())
    }
}

/// What is not there need not be removed.
pub(super) fn gone(removed: io::Result<()>) -> io::Result<()> {
    removed.or_else(|e| if e.kind() == io::ErrorKind::NotFound { Ok(()) } else { Err(e) })
}

impl Fresh {
    fn write_kept(&mut self, state: &State, kept: Vec<Entry>) -> Result<(), StoreError> {
        let is_used = |e: &&Entry| e.named == Named::Record && u64::from(e.place.used) > e.place.stamp / 1_000_000_000;
        let mut used: Vec<_> = kept.iter().filter(is_used).map(|e| (e.digest, u64::from(e.place.used))).collect();
        // In order already.
        let (released, mut kept): (Vec<Entry>, Vec<Entry>) = kept.into_iter().partition(|e| e.place.is_released());
        // In the order of the packs: old neighbours stay neighbours.
        kept.sort_unstable_by_key(|e| (e.place.pack, e.place.offset, e.named, e.digest));
        used.sort_unstable();
        for Entry { digest: key, named, place } in kept {
            let Some(Pack { file, name, .. }) = state.packs.get(&place.pack) else { continue };
            let kind = if named == Named::Blob { Kind::Blob } else { Kind::Record };
            // What was read and is damaged is left behind; a blob is whole if its bytes have its digest, whatever became of
            // its header.
            let payload = match kind {
                Kind::Blob => read_payload(file, &place).map(|read| read.filter(|bytes| Digest::of(bytes) == key)),
                _ => read(file, &place, kind, &key),
            };
            let path = self.folder.join(name);
            if let Some(payload) = payload.map_err(StoreError::io("read the store", &path))? {
                self.write(&frame::encode(kind, &key, place.stamp, &payload))?;
            }
        }
        // That bytes were given back is all that is left of them.
        for released in released.chunks(RELEASED) {
            let payload: Vec<u8> = released.iter().flat_map(|entry| entry.digest.0).collect();
            let stamp = stamp_after(released.iter().map(|entry| entry.place.stamp).max());
            self.write(&frame::encode(Kind::Release, &Digest::of(&payload), stamp, &payload))?;
        }
        if !used.is_empty() {
            let payload: Vec<u8> =
                used.iter().flat_map(|(key, time)| [&key.0[..], &time.to_le_bytes()].concat()).collect();
            self.write(&frame::encode(Kind::Used, &Digest::of(&payload), now_ns(), &payload))?;
        }
        Ok(())
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), StoreError> {
        if self.length >= FULL {
            let path = self.folder.join(format!("c{:016x}-{:04}.pack", now_ns(), self.files.len()));
            let file = OpenOptions::new().append(true).create_new(true).open(&path);
            self.files.push((path.clone(), file.map_err(StoreError::io("write to the store", &path))?));
            self.length = 0;
        }
        let Some((path, file)) = self.files.last_mut() else { return Ok(()) };
        self.length += bytes.len() as u64;
        disk::write(file, bytes).map_err(StoreError::io("write to the store", path))
    }

    fn sync(&self) -> Result<(), StoreError> {
        for (path, file) in &self.files {
            file.sync_all().map_err(StoreError::io("write to the store", path))?;
        }
        disk::sync_folder(&self.folder).map_err(StoreError::io("write to the store", &self.folder))
    }
}

impl Drop for Fresh {
    fn drop(&mut self) {
        if !self.keep {
            // The old packs still hold everything; a fresh one that stays only says it twice.
            self.files.iter().for_each(|(path, _)| drop(fs::remove_file(path)));
        }
    }
}
