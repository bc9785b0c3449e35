//! What this process knows of the packs: the open files, and the index over their frames.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::digest::Digest;
use crate::store::disk::{self, Identity};
use crate::store::error::StoreError;
use crate::store::frame::{self, Frame, HEADER, Kind};
use crate::store::index::{self, Covered, Index, Map, Place};

/// No pack is longer: writers end it near 64 MiB. Something longer is not read, least of all into memory.
pub(super) const LONGEST: u64 = 1 << 30;

/// Memory for more bytes is taken only where the file has them.
const LARGE: u64 = 64 << 10;

/// Fewer frames are read again faster than an index is written.
const FRESH: usize = 4096;

pub(super) struct Pack {
    pub name: String,
    pub file: Arc<File>,
    identity: Identity,
    /// The index knows all frames up to here.
    pub covered: u64,
    /// Length at the last look.
    pub length: u64,
}

/// What is known of the packs.
#[derive(Default)]
pub(super) struct State {
    /// By id. An id stands for one open file: it is never used again, and a pack that is gone leaves a gap.
    pub packs: BTreeMap<u32, Pack>,
    next: u32,
    pub index: Index,
    /// Blobs of packs that are gone. What this process found once it can still read: the files are open.
    gone_blobs: Map<(Place, Arc<File>)>,
    /// Whether the index file lacks something that `index` holds.
    pub stale: bool,
    /// Frames that were taken in since it was written.
    fresh: usize,
    /// Frames that the index file names and that the packs no longer hold.
    pub lost: u64,
    /// Bytes between the frames that were read.
    pub garbage: u64,
    /// Packs that the last look could not look at, open or read to their end: nothing is known of what is in them.
    pub unread: Vec<(PathBuf, io::Error)>,
    /// Whether something that was found once may be gone: packs that vanished, blobs that were found damaged.
    pub shrunk: bool,
}

impl State {
    pub fn load(root: &Path) -> Result<Self, StoreError> {
        let mut state = Self::default();
        let saved = disk::read_regular(&root.join("index")).ok().and_then(|bytes| index::decode(&bytes));
        let Some((packs, index)) = saved else {
            state.stale = true;
            state.refresh(root)?;
            return Ok(state);
        };
        let mut all_there = true;
        for covered in &packs {
            // The number of a pack in the index file becomes its id, so places hold as they are.
            all_there &= match Pack::open(root, &covered.name) {
                Ok(pack) if pack.length >= covered.length && pack.first() == covered.first => {
                    state.packs.insert(state.next, Pack { covered: covered.length, ..pack });
                    true
                }
                _ => false,
            };
            state.next += 1;
        }
        if all_there {
            state.index = index;
            state.refresh(root)?;
            return Ok(state);
        }
        // Another frame of a lost key may stand in another pack: read it all.
        state.packs.values_mut().for_each(|pack| pack.covered = 0);
        state.stale = true;
        state.refresh(root)?;
        if !state.unread.is_empty() {
            return Ok(state);
        }
        let lost = |named: &Map<Place>, found: &Map<Place>| {
            named.iter().filter(|(key, place)| place.is_here() && !found.contains_key(*key)).count() as u64
        };
        state.lost = lost(&index.records, &state.index.records) + lost(&index.blobs, &state.index.blobs);
        Ok(state)
    }

    pub fn find(&self, kind: Kind, key: &Digest) -> Option<(Place, Arc<File>)> {
        let map = if kind == Kind::Record { &self.index.records } else { &self.index.blobs };
        let place = map.get(key).filter(|place| place.is_here())?;
        Some((*place, self.packs.get(&place.pack)?.file.clone()))
    }

    /// A blob to read: in a pack, or in one that is gone and still open.
    pub fn find_blob(&self, digest: &Digest) -> Option<(Place, Arc<File>)> {
        self.find(Kind::Blob, digest).or_else(|| self.gone_blobs.get(digest).cloned())
    }

    pub fn stamp_of(&self, kind: Kind, key: &Digest) -> Option<u64> {
        match kind {
            Kind::Record | Kind::ForgetRecord => self.index.records.get(key),
            Kind::Blob | Kind::ForgetBlob => self.index.blobs.get(key),
            Kind::Used | Kind::Release => None,
        }
        .map(|place| place.stamp)
    }

    pub fn id_of(&self, name: &str) -> Option<u32> {
        self.packs.iter().find(|(_, pack)| pack.name == name).map(|(id, _)| *id)
    }

    /// Takes in a frame that stands at `offset` of a pack; nothing happens where the pack is gone.
    pub fn take_in(&mut self, id: u32, offset: u64, frame: &Frame, payload: &[u8]) {
        let Some(pack) = self.packs.get_mut(&id) else { return };
        pack.covered = pack.covered.max(offset + HEADER as u64 + frame.length);
        self.index.apply(id, offset, frame);
        match frame.kind {
            Kind::Used => frame::used_pairs(payload).for_each(|(key, time_s)| self.index.mark_used(&key, time_s)),
            Kind::Release => frame::released(payload).for_each(|digest| {
                self.index.release(digest, frame.stamp);
                self.gone_blobs.remove(&digest);
            }),
            // Its maker says that these bytes are damaged.
            Kind::ForgetBlob => {
                self.gone_blobs.remove(&frame.key);
                self.shrunk = true;
            }
            _ => {}
        }
        self.fresh += 1;
        self.stale = true;
    }

    /// Whether the index file lacks a fourth of what there is, and enough to be worth a file.
    pub fn lacks_much(&self) -> bool {
        self.stale && self.fresh > FRESH + (self.index.records.len() + self.index.blobs.len()) / 4
    }

    /// Takes in packs that are new, packs that have grown, and packs that are gone, cut short or replaced by another
    /// file of their name. What is in the place of a pack and no file is left alone; what cannot be read now is a miss now,
    /// and is in `unread`.
    ///
    /// Error: the folder is there and cannot be read.
    pub fn refresh(&mut self, root: &Path) -> Result<(), StoreError> {
        let there = list(&root.join("packs"))?;
        let is_gone = |pack: &Pack| match there.get(&pack.name) {
            Some(Ok((identity, n))) => *identity != pack.identity || *n < pack.covered,
            Some(Err(_)) => false,
            None => true,
        };
        let gone: BTreeSet<u32> = self.packs.iter().filter(|(_, pack)| is_gone(pack)).map(|(id, _)| *id).collect();
        if !gone.is_empty() {
            self.forget(&gone);
        }
        self.unread.clear();
        for (name, found) in there {
            let path = root.join("packs").join(&name);
            match (self.packs.values_mut().find(|pack| pack.name == name), found) {
                (Some(pack), Ok((_, length))) => pack.length = length,
                (None, Ok(_)) => self.add(root, &name),
                (_, Err(error)) => self.unread.push((path, error)),
            }
        }
        let grown: Vec<u32> = self.packs.iter().filter(|(_, p)| p.length > p.covered).map(|(id, _)| *id).collect();
        for id in grown {
            if let Err(error) = self.read_tail(id)
                && error.kind() != io::ErrorKind::FileTooLarge
            {
                self.unread.push((root.join("packs").join(&self.packs[&id].name), error));
            }
        }
        Ok(())
    }

    fn add(&mut self, root: &Path, name: &str) {
        match Pack::open(root, name) {
            // Ids end after 4 billion packs; what comes then is a miss.
            Ok(pack) if self.next < Place::RELEASED => {
                self.packs.insert(self.next, pack);
                self.next += 1;
            }
            Ok(_) => {}
            // Gone since, or no file.
            Err(error) if disk::is_absent(&error) || error.kind() == io::ErrorKind::InvalidInput => {}
            Err(error) => self.unread.push((root.join("packs").join(name), error)),
        }
    }

    /// Error: a pack could not be read. What is in it must not pass for gone.
    pub fn is_complete(&self) -> Result<(), StoreError> {
        self.unread.first().map_or(Ok(()), |(path, error)| {
            let again = error.raw_os_error().map_or_else(|| error.kind().into(), io::Error::from_raw_os_error);
            Err(StoreError::io("read the store", path)(again))
        })
    }

    /// Forgets packs that are gone. What they said of a key may have hidden an older frame in another: all is read again.
    fn forget(&mut self, gone: &BTreeSet<u32>) {
        for (digest, place) in self.index.blobs.iter().filter(|(_, place)| gone.contains(&place.pack)) {
            if let Some(pack) = self.packs.get(&place.pack) {
                self.gone_blobs.insert(*digest, (*place, pack.file.clone()));
            }
        }
        self.packs.retain(|id, _| !gone.contains(id));
        self.packs.values_mut().for_each(|pack| pack.covered = 0);
        self.index = Index::default();
        self.garbage = 0;
        (self.stale, self.shrunk) = (true, true);
    }

    /// Knows nothing any more: the packs were rewritten, without what was not to be kept.
    pub fn clear(&mut self) {
        self.packs.clear();
        self.forget(&BTreeSet::new());
        self.gone_blobs = Map::default();
    }

    /// Reads all packs again and adds what the index lacks; a place whose frame has a damaged header stays known.
    pub fn read_again(&mut self, root: &Path) -> Result<(), StoreError> {
        self.packs.values_mut().for_each(|pack| pack.covered = 0);
        self.garbage = 0;
        self.refresh(root)
    }

    /// Takes in the frames beyond what is covered.
    pub fn read_tail(&mut self, id: u32) -> io::Result<()> {
        let Some(Pack { file, covered, .. }) = self.packs.get(&id) else { return Ok(()) };
        let (file, covered) = (file.clone(), *covered);
        let Some(fresh) = file.metadata()?.len().checked_sub(covered).filter(|&n| n > 0) else { return Ok(()) };
        if covered + fresh > LONGEST {
            return Err(io::ErrorKind::FileTooLarge.into());
        }
        let bytes = disk::read_at(&file, covered, fresh as usize)?;
        let scan = frame::scan(&bytes);
        self.garbage += scan.garbage;
        for (at, frame) in scan.frames {
            let start = at as usize + HEADER;
            self.take_in(id, covered + at, &frame, &bytes[start..start + frame.length as usize]);
        }
        Ok(())
    }

    pub fn save(&mut self, root: &Path) -> Result<(), StoreError> {
        let covered = |pack: &Pack| Covered { name: pack.name.clone(), length: pack.covered, first: pack.first() };
        let packs: Vec<_> = self.packs.values().map(covered).collect();
        let numbers: BTreeMap<u32, u32> = self.packs.keys().copied().zip(0..).collect();
        let path = root.join("index");
        let write = |to: &mut dyn io::Write| index::write(&packs, |id| numbers.get(&id).copied(), &self.index, to);
        disk::publish_with(root, &path, &write).map_err(StoreError::io("write the index of the store", &path))?;
        (self.stale, self.fresh) = (false, 0);
        Ok(())
    }
}

impl Pack {
    fn open(root: &Path, name: &str) -> io::Result<Self> {
        let file = disk::open_regular(&root.join("packs").join(name))?;
        let meta = file.metadata()?;
        let (identity, length) = (disk::identity(&meta), meta.len());
        Ok(Self { name: name.to_owned(), file: Arc::new(file), identity, covered: 0, length })
    }

    /// The check in the header of the first frame: it covers a time in ns and a key, so no two packs share it.
    fn first(&self) -> [u8; 16] {
        disk::read_at(&self.file, HEADER as u64 - 16, 16).ok().and_then(|b| b.try_into().ok()).unwrap_or_default()
    }
}

/// The files in the folder of packs, or why one of them cannot be looked at.
fn list(folder: &Path) -> Result<BTreeMap<String, io::Result<(Identity, u64)>>, StoreError> {
    let mut found = BTreeMap::new();
    // Whoever writes sets aside what stands in the place of the folder.
    for path in disk::list(folder).map_err(StoreError::io("read the store", folder))? {
        let Some(name) = path.file_name().and_then(|name| name.to_str()).filter(|name| name.ends_with(".pack")) else {
            continue;
        };
        match disk::look(&path) {
            Ok(Some(meta)) if meta.is_file() => found.insert(name.to_owned(), Ok((disk::identity(&meta), meta.len()))),
            Ok(_) => None,
            Err(error) => found.insert(name.to_owned(), Err(error)),
        };
    }
    Ok(found)
}

/// What stands where the payload should be; none where the pack is shorter. Error: it cannot be read.
pub(super) fn read_payload(file: &File, place: &Place) -> io::Result<Option<Vec<u8>>> {
    read_start(file, place, usize::MAX)
}

/// What stands where the first `length` bytes of the payload should be, less where it is shorter.
pub(super) fn read_start(file: &File, place: &Place, length: usize) -> io::Result<Option<Vec<u8>>> {
    read_place(file, u64::from(place.offset) + HEADER as u64, u64::from(place.length).min(length as u64))
}

/// The payload of an undamaged frame of `kind` and `key`.
pub(super) fn read(file: &File, place: &Place, kind: Kind, key: &Digest) -> io::Result<Option<Vec<u8>>> {
    let bytes = read_place(file, u64::from(place.offset), u64::from(place.length) + HEADER as u64)?;
    let is_right =
        |bytes: &Vec<u8>| frame::decode(bytes).is_some_and(|(frame, _)| frame.kind == kind && frame.key == *key);
    Ok(bytes.filter(is_right).map(|mut bytes| {
        bytes.drain(..HEADER);
        bytes
    }))
}

/// The bytes there; none where there are not so many.
fn read_place(file: &File, offset: u64, length: u64) -> io::Result<Option<Vec<u8>>> {
    let Some(end) = offset.checked_add(length).filter(|&end| end <= LONGEST) else { return Ok(None) };
    // An index may claim more than its pack holds: that is no reason to take the memory.
    if length > LARGE && end > file.metadata()?.len() {
        return Ok(None);
    }
    match disk::read_at(file, offset, length as usize) {
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(None),
        read => read.map(Some),
    }
}
