//! What this process knows of the packs: the open files, and the index over their frames.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io;
use std::path::Path;
use std::sync::Arc;

use crate::digest::Digest;
use crate::store::disk;
use crate::store::error::StoreError;
use crate::store::frame::{self, Frame, HEADER, Kind};
use crate::store::index::{self, Index, Place};

pub(super) struct Pack {
    pub name: String,
    pub file: Arc<File>,
    /// The index knows all frames up to here.
    pub covered: u64,
}

/// What is known of the packs.
pub(super) struct State {
    pub packs: Vec<Pack>,
    pub index: Index,
    /// Whether the index file lacks something that `index` holds.
    pub stale: bool,
    /// Frames that the index file names and that the packs no longer hold.
    pub lost: u64,
    /// Bytes between the frames that were read.
    pub garbage: u64,
}

impl State {
    pub fn empty() -> Self {
        Self { packs: Vec::new(), index: Index::default(), stale: false, lost: 0, garbage: 0 }
    }

    pub fn load(root: &Path) -> Result<Self, StoreError> {
        let mut state = Self::empty();
        let saved = fs::read(root.join("index")).ok().and_then(|bytes| index::decode(&bytes));
        let Some((packs, index)) = saved else {
            state.stale = true;
            state.refresh(root)?;
            return Ok(state);
        };
        let mut lengths = Vec::with_capacity(packs.len());
        for (name, covered) in packs {
            let file = File::open(root.join("packs").join(&name)).ok();
            let length = file.as_ref().and_then(|f| f.metadata().ok()).map_or(0, |m| m.len());
            state.stale |= length < covered;
            // A pack that is gone keeps its number; `refresh` drops it.
            let Some(file) = file else {
                lengths.push(None);
                continue;
            };
            lengths.push(Some((state.packs.len() as u32, length)));
            state.packs.push(Pack { name, file: Arc::new(file), covered: covered.min(length) });
        }
        if state.stale || lengths.iter().any(Option::is_none) {
            // Pieces are missing: forget them, and let what is left be read again below.
            let keep = |place: &mut Place| {
                if !place.is_here() {
                    return true;
                }
                match lengths.get(place.pack as usize) {
                    Some(Some((pack, length))) if place.end() <= *length => {
                        place.pack = *pack;
                        true
                    }
                    _ => false,
                }
            };
            state.index = index;
            for map in [&mut state.index.records, &mut state.index.blobs] {
                let before = map.len();
                map.retain(|_, place| keep(place));
                state.lost += (before - map.len()) as u64;
            }
            state.stale = true;
            // An older frame of a lost key may stand in another pack.
            state.packs.iter_mut().for_each(|pack| pack.covered = 0);
        } else {
            state.index = index;
        }
        state.refresh(root)?;
        Ok(state)
    }

    pub fn find(&self, kind: Kind, key: &Digest) -> Option<(Place, Arc<File>)> {
        let map = if kind == Kind::Record { &self.index.records } else { &self.index.blobs };
        let place = map.get(key).filter(|place| place.is_here())?;
        Some((*place, self.packs.get(place.pack as usize)?.file.clone()))
    }

    pub fn stamp_of(&self, kind: Kind, key: &Digest) -> Option<u64> {
        match kind {
            Kind::Record | Kind::ForgetRecord => self.index.records.get(key),
            Kind::Blob | Kind::ForgetBlob => self.index.blobs.get(key),
            Kind::Used => None,
        }
        .map(|place| place.stamp)
    }

    pub fn take_in(&mut self, pack: u32, offset: u64, frame: &Frame, payload: &[u8]) {
        self.index.apply(pack, offset, frame);
        if frame.kind == Kind::Used {
            frame::used_pairs(payload).for_each(|(key, time_s)| self.index.mark_used(&key, time_s));
        }
        let covered = &mut self.packs[pack as usize].covered;
        *covered = (*covered).max(offset + HEADER as u64 + frame.length);
        self.stale = true;
    }

    pub fn refresh(&mut self, root: &Path) -> Result<(), StoreError> {
        let folder = root.join("packs");
        let mut names = BTreeSet::new();
        match fs::read_dir(&folder) {
            Ok(entries) => {
                for entry in entries.flatten() {
                    if let Ok(name) = entry.file_name().into_string()
                        && name.ends_with(".pack")
                    {
                        names.insert(name);
                    }
                }
            }
            Err(e) if e.kind() == io::ErrorKind::NotFound => {}
            Err(e) => return Err(StoreError::io("read the store", &folder)(e)),
        }
        if self.packs.iter().any(|pack| !names.contains(&pack.name)) {
            // `gc` has written fresh packs, or somebody removed one: what is known may be wrong, so read it all.
            let lost = self.lost;
            *self = Self { stale: true, lost, ..Self::empty() };
        }
        for name in names {
            let known = self.packs.iter().position(|pack| pack.name == name);
            let pack = match known {
                Some(pack) => pack,
                None => {
                    let Ok(file) = File::open(folder.join(&name)) else { continue };
                    self.packs.push(Pack { name, file: Arc::new(file), covered: 0 });
                    self.packs.len() - 1
                }
            };
            // What cannot be read now is a miss now.
            let _ = self.read_tail(pack);
        }
        Ok(())
    }

    /// Takes in the frames beyond what is covered.
    pub fn read_tail(&mut self, pack: usize) -> io::Result<()> {
        let Pack { file, covered, .. } = &self.packs[pack];
        let (file, covered) = (file.clone(), *covered);
        let Some(fresh) = file.metadata()?.len().checked_sub(covered).filter(|&n| n > 0) else { return Ok(()) };
        let bytes = disk::read_at(&file, covered, fresh as usize)?;
        let scan = frame::scan(&bytes);
        self.garbage += scan.garbage;
        for (at, frame) in scan.frames {
            let start = at as usize + HEADER;
            let payload = &bytes[start..start + frame.length as usize];
            self.take_in(pack as u32, covered + at, &frame, payload);
        }
        Ok(())
    }

    pub fn save(&mut self, root: &Path) -> Result<(), StoreError> {
        let packs: Vec<_> = self.packs.iter().map(|pack| (pack.name.clone(), pack.covered)).collect();
        let path = root.join("index");
        disk::publish(&root.join("tmp"), &path, &index::encode(&packs, &self.index), false, false)
            .map_err(StoreError::io("write the index of the store", &path))?;
        self.stale = false;
        Ok(())
    }
}

/// What stands where the payload should be.
pub(super) fn read_payload(file: &File, place: &Place) -> Option<Vec<u8>> {
    read_start(file, place, usize::try_from(place.length).ok()?)
}

/// What stands where the first `length` bytes of the payload should be, less where it is shorter.
pub(super) fn read_start(file: &File, place: &Place, length: usize) -> Option<Vec<u8>> {
    let length = usize::try_from(place.length).map_or(length, |all| all.min(length));
    disk::read_at(file, place.offset + HEADER as u64, length).ok()
}

/// The payload of an undamaged frame of `kind` and `key`.
pub(super) fn read(file: &File, place: &Place, kind: Kind, key: &Digest) -> Option<Vec<u8>> {
    let mut bytes = disk::read_at(file, place.offset, HEADER + usize::try_from(place.length).ok()?).ok()?;
    frame::decode(&bytes).filter(|(frame, _)| frame.kind == kind && frame.key == *key)?;
    bytes.drain(..HEADER);
    Some(bytes)
}
