//! What this process knows of the packs: the open files, and the index over their frames.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::digest::{Digest, DigestMap};
use crate::store::disk::{self, Identity};
use crate::store::error::StoreError;
use crate::store::frame::{self, Frame, HEADER, Kind};
use crate::store::index::Index;
use crate::store::place::{Entry, Named, Place};
use crate::store::saved::{Merged, Source};
use crate::store::sorted::{Covered, Sorted};

/// No pack is longer: writers end it near 64 MiB. Something longer is not read, least of all into memory.
pub(super) const LONGEST: u64 = 1 << 30;

/// Memory for more bytes is taken only where the file has them.
const LARGE: u64 = 64 << 10;

/// Fewer entries are read again faster than a file of the index is written.
const FRESH: usize = 4096;

pub(super) struct Pack {
    pub name: String,
    pub file: Arc<File>,
    identity: Identity,
    /// The index knows all frames up to here ...
    pub covered: u64,
    /// ... and its files those up to here.
    saved: u64,
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
    gone_blobs: DigestMap<(Place, Arc<File>)>,
    /// Whether the files of the index lack something that `index` holds, or are not as they should be.
    pub stale: bool,
    /// Frames that the files of the index name and that the packs no longer hold.
    pub lost: u64,
    /// Bytes between the frames that were read.
    pub garbage: u64,
    /// Packs that the last look could not look at, open or read to their end: nothing is known of what is in them.
    unread: Vec<(PathBuf, io::Error)>,
    /// The same of looks since, while the index was mended: what was not found meanwhile may be there.
    missed: Vec<(PathBuf, io::Error)>,
    /// Whether something that was found once may be gone: packs that vanished, blobs that were found damaged.
    pub shrunk: bool,
}

impl State {
    pub fn load(root: &Path) -> Result<Self, StoreError> {
        let mut state = Self { index: Index::open(root), ..Self::default() };
        // What a pack that is gone said of a key may have hidden an older frame in another: a file that names one is of no use.
        let mut opened = BTreeMap::new();
        let mut saved = std::mem::take(&mut state.index.saved);
        let useless = saved.keep_those(|file| state.ids_of(root, file, &mut opened));
        saved.drop_covered();
        state.index.saved = saved;
        state.stale = state.index.saved.has_useless();
        state.cover_what_is_saved();
        state.refresh(root)?;
        if state.unread.is_empty() && !useless.is_empty() {
            let entries = Merged::of(useless.iter().map(|file| Box::new(file.entries()) as Source<'_>)).flatten();
            let is_lost = |entry: &Entry| {
                let stands = matches!(entry.named, Named::Record | Named::Blob) && entry.place.is_here();
                stands && state.index.find(entry.named, &entry.digest).is_none()
            };
            state.lost = entries.filter(is_lost).count() as u64;
        }
        Ok(state)
    }

    /// Ids of the packs that a file of the index covers; `None` where one is gone, cut short or another.
    fn ids_of(
        &mut self,
        root: &Path,
        file: &Sorted,
        opened: &mut BTreeMap<String, Option<(u32, [u8; 16])>>,
    ) -> Option<Vec<u32>> {
        let mut id_of = |covered: &Covered| {
            let (id, first) = (*opened.entry(covered.name.clone()).or_insert_with(|| {
                let id = self.add(root, &covered.name)?;
                Some((id, self.packs[&id].first()))
            }))?;
            (self.packs[&id].length >= covered.to && first == covered.first).then_some(id)
        };
        file.foot.packs.iter().map(&mut id_of).collect()
    }

    /// Lets the files of the index say how far packs are known.
    fn cover_what_is_saved(&mut self) {
        let reach = self.index.saved.reach();
        for (id, pack) in &mut self.packs {
            pack.saved = reach.get(id).copied().unwrap_or(0);
            pack.covered = pack.saved;
        }
    }

    /// Whether a file of the index was found damaged, so that what was looked up may not have been found.
    pub fn is_hurt(&self) -> bool {
        self.index.saved.is_hurt()
    }

    /// Leaves out files of the index that were found damaged, and reads again what they covered. What cannot be read is in `missed`.
    pub fn mend(&mut self, root: &Path) {
        if !self.is_hurt() {
            return;
        }
        self.index.saved.drop_hurt();
        self.stale = true;
        self.cover_what_is_saved();
        if let Err(StoreError::Io { path, source, .. }) = self.take_stock(root) {
            self.missed.push((path, source));
        }
        self.missed.append(&mut self.unread);
    }

    /// What could not be read.
    pub fn unread(&self) -> impl Iterator<Item = &(PathBuf, io::Error)> {
        self.unread.iter().chain(&self.missed)
    }

    /// What `add` makes of all entries, in the order of their digests.
    pub fn fold<T: Default>(&mut self, root: &Path, add: impl Fn(&mut T, Entry)) -> T {
        loop {
            let (recent, mut all) = (self.index.sorted(), T::default());
            let mut entries = self.index.entries(&recent);
            let whole = entries.try_for_each(|entry| entry.map(|entry| add(&mut all, entry)));
            drop(entries);
            if whole.is_ok() {
                return all;
            }
            self.mend(root);
        }
    }

    pub fn find(&self, named: Named, digest: &Digest) -> Option<(Place, Arc<File>)> {
        let place = self.index.find(named, digest).filter(Place::is_here)?;
        Some((place, self.packs.get(&place.pack)?.file.clone()))
    }

    /// A blob to read: in a pack, or in one that is gone and still open.
    pub fn find_blob(&self, digest: &Digest) -> Option<(Place, Arc<File>)> {
        self.find(Named::Blob, digest).or_else(|| self.gone_blobs.get(digest).cloned())
    }

    pub fn stamp_of(&self, kind: Kind, key: &Digest) -> Option<u64> {
        let named = match kind {
            Kind::Record | Kind::ForgetRecord => Named::Record,
            Kind::Blob | Kind::ForgetBlob => Named::Blob,
            Kind::Used | Kind::Release => return None,
        };
        self.index.find(named, key).map(|place| place.stamp)
    }

    pub fn id_of(&self, name: &str) -> Option<u32> {
        self.packs.iter().find(|(_, pack)| pack.name == name).map(|(id, _)| *id)
    }

    /// Takes in a frame that stands at `offset` of a pack; nothing happens where the pack is gone.
    pub fn take_in(&mut self, id: u32, offset: u64, frame: &Frame, payload: &[u8]) {
        let Some(pack) = self.packs.get_mut(&id) else { return };
        pack.covered = pack.covered.max(offset + HEADER as u64 + frame.length);
        self.index.apply(id, offset, frame, payload);
        match frame.kind {
            Kind::Release => frame::released(payload).for_each(|digest| drop(self.gone_blobs.remove(&digest))),
            // Its maker says that these bytes are damaged.
            Kind::ForgetBlob => {
                self.gone_blobs.remove(&frame.key);
                self.shrunk = true;
            }
            _ => {}
        }
        self.stale = true;
    }

    /// Whether the files of the index lack enough to be worth another one.
    pub fn lacks_much(&self) -> bool {
        self.stale && self.index.recent() > FRESH
    }

    /// Takes in packs that are new, packs that have grown, and packs that are gone, cut short or replaced by another
    /// file of their name. What is in the place of a pack and no file is left alone; what cannot be read now is a miss now,
    /// and is in `unread`.
    ///
    /// Error: the folder is there and cannot be read.
    pub fn refresh(&mut self, root: &Path) -> Result<(), StoreError> {
        self.missed.clear();
        self.take_stock(root)
    }

    fn take_stock(&mut self, root: &Path) -> Result<(), StoreError> {
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
        let ids: BTreeMap<String, u32> = self.packs.iter().map(|(id, pack)| (pack.name.clone(), *id)).collect();
        for (name, found) in there {
            match (ids.get(&name).and_then(|id| self.packs.get_mut(id)), found) {
                (Some(pack), Ok((_, length))) => pack.length = length,
                (None, Ok(_)) => drop(self.add(root, &name)),
                (_, Err(error)) => self.unread.push((root.join("packs").join(&name), error)),
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

    /// Opens a pack; its id.
    fn add(&mut self, root: &Path, name: &str) -> Option<u32> {
        match Pack::open(root, name) {
            // Ids end after 4 billion packs; what comes then is a miss.
            Ok(pack) if self.next < Place::UNKNOWN => {
                self.packs.insert(self.next, pack);
                self.next += 1;
                return Some(self.next - 1);
            }
            Ok(_) => {}
            // Gone since, or no file.
            Err(error) if disk::is_absent(&error) || error.kind() == io::ErrorKind::InvalidInput => {}
            Err(error) => self.unread.push((root.join("packs").join(name), error)),
        }
        None
    }

    /// Error: a pack could not be read. What is in it must not pass for gone.
    pub fn is_complete(&self) -> Result<(), StoreError> {
        self.unread().next().map_or(Ok(()), |(path, error)| {
            let again = error.raw_os_error().map_or_else(|| error.kind().into(), io::Error::from_raw_os_error);
            Err(StoreError::io("read the store", path)(again))
        })
    }

    /// Forgets packs that are gone. What they said of a key may have hidden an older frame in another: all that files of the index
    /// say beside them is forgotten too, and read again.
    fn forget(&mut self, gone: &BTreeSet<u32>) {
        let recent = self.index.sorted();
        for entry in self.index.entries(&recent).flatten() {
            let Entry { digest, named, place } = entry;
            if let Some(pack) =
                self.packs.get(&place.pack).filter(|_| named == Named::Blob && gone.contains(&place.pack))
            {
                self.gone_blobs.insert(digest, (place, pack.file.clone()));
            }
        }
        self.packs.retain(|id, _| !gone.contains(id));
        let is_there = |file: &Sorted| file.ids().iter().all(|id| self.packs.contains_key(id));
        self.index.saved.keep_those(|file| is_there(file).then(|| file.ids().to_vec()));
        self.index.forget_recent();
        self.cover_what_is_saved();
        self.garbage = 0;
        (self.stale, self.shrunk) = (true, true);
    }

    /// Knows nothing any more: the packs were rewritten, without what was not to be kept.
    pub fn clear(&mut self) {
        self.packs.clear();
        self.index.saved.keep_those(|_| None);
        self.forget(&BTreeSet::new());
        self.gone_blobs = DigestMap::default();
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

    /// Writes what the files of the index lack, into one with the shorter of them or (`whole`) with all.
    pub fn save(&mut self, root: &Path, whole: bool, id: u64) -> Result<(), StoreError> {
        loop {
            let mut fresh = self.index.fresh(id);
            let named: BTreeSet<u32> = fresh.entries.iter().map(|entry| entry.place.pack).collect();
            // In a part that is read again the files know all, and more.
            let part = |(_, pack): (&u32, &Pack)| Covered {
                name: pack.name.clone(),
                from: pack.saved.min(pack.covered),
                to: pack.covered,
                first: pack.first(),
            };
            let is_new = |(id, pack): &(&u32, &Pack)| pack.covered > pack.saved || named.contains(*id);
            fresh.covered = self.packs.iter().filter(is_new).map(part).collect();
            let names: BTreeMap<u32, &str> = self.packs.iter().map(|(id, pack)| (*id, pack.name.as_str())).collect();
            match self.index.saved.write(root, &fresh, whole, &names) {
                Ok(()) => break,
                Err(_) if self.is_hurt() => self.mend(root),
                Err(error) => return Err(StoreError::io("write the index of the store", &root.join("index"))(error)),
            }
        }
        self.index.forget_recent();
        let reach = self.index.saved.reach();
        for (id, pack) in &mut self.packs {
            pack.saved = reach.get(id).copied().unwrap_or(0);
        }
        self.stale = false;
        Ok(())
    }
}

impl Pack {
    fn open(root: &Path, name: &str) -> io::Result<Self> {
        let file = disk::open_regular(&root.join("packs").join(name))?;
        let meta = file.metadata()?;
        let (identity, length) = (disk::identity(&meta), meta.len());
        Ok(Self { name: name.to_owned(), file: Arc::new(file), identity, covered: 0, saved: 0, length })
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

/// The key of the undamaged frame that begins there.
pub(super) fn read_key(file: &File, place: &Place) -> io::Result<Option<Digest>> {
    let bytes = read_place(file, u64::from(place.offset), HEADER as u64)?;
    Ok(bytes.and_then(|bytes| frame::header(&bytes)).map(|frame| frame.key))
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
