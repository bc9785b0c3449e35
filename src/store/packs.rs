//! Packs: append-only files of frames. Each writing process appends to a pack of its own, so writers never meet.

use std::collections::BTreeSet;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};
use std::time::Duration;

use crate::digest::Digest;
use crate::store::disk;
use crate::store::error::StoreError;
use crate::store::frame::{self, HEADER, Kind};
use crate::store::lock::guard;
use crate::store::place::{Named, Place};
use crate::store::record::head_end;
use crate::store::state::{LONGEST, State, read, read_key, read_payload, read_start};
use crate::store::writer::{FULL, Standing, Writer, now_ns};

/// What is published reaches the disk within about this time.
const SYNC_EVERY: Duration = Duration::from_secs(1);
/// More packs than this that still take frames are gathered into few (of which at most one still takes frames).
const MANY_SHORT_PACKS: usize = 64;
/// Few records have a longer head than this; one read takes it in.
const HEAD: usize = 1024;
/// A record's last use is noted once a day at most, so that a run of hits writes nothing.
const NOTE_USE_AFTER_S: u64 = 86_400;
/// As many bytes may be dead beside as many that are not, and these beyond them ...
const DEAD: u64 = 16 << 20;
/// So many blobs are released by one frame.
pub(super) const RELEASED: usize = 4096;
/// So often a run that ends writes again what vanishes under it.
const RESCUES: usize = 3;
/// As many entries are kept in memory at most before they go into a file of the index.
const MOST_RECENT: usize = 1 << 18;

/// All packs of a store. Of the two locks `writer` is always taken first.
pub(super) struct Packs {
    pub(super) root: PathBuf,
    state: RwLock<State>,
    pub(super) writer: Mutex<Option<Writer>>,
    touched: Mutex<BTreeSet<Digest>>,
    /// Whether something in the packs was found damaged.
    pub(super) damaged: AtomicBool,
    /// So many entries in memory are too many. More, where they could not be written.
    pub(super) most_recent: AtomicUsize,
    opened_s: u64,
    among_many: bool,
}

impl Packs {
    /// Reads the index and whatever the packs hold beyond it; creates nothing.
    ///
    /// `among_many`: other processes, perhaps on other machines, are at work on the same store. Then it appends to a pack of its
    /// own, and neither writes the index nor wants packs to be gathered.
    pub fn open(root: &Path, among_many: bool) -> Result<Self, StoreError> {
        Ok(Self {
            root: root.to_owned(),
            state: RwLock::new(State::load(root)?),
            writer: Mutex::new(None),
            touched: Mutex::new(BTreeSet::new()),
            damaged: AtomicBool::new(false),
            most_recent: AtomicUsize::new(MOST_RECENT),
            opened_s: now_ns() / 1_000_000_000,
            among_many,
        })
    }

    // A thread that panicked with the state changed nothing by halves: packs and places are taken in one by one.
    pub(super) fn state(&self) -> RwLockReadGuard<'_, State> {
        self.state.read().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn state_mut(&self) -> RwLockWriteGuard<'_, State> {
        self.state.write().unwrap_or_else(PoisonError::into_inner)
    }

    /// What is known of something. Where a file of the index turns out damaged meanwhile, what it covered is read again from the packs.
    fn look<T>(&self, find: impl Fn(&State) -> T) -> T {
        loop {
            let state = self.state();
            let found = find(&state);
            if !state.is_hurt() {
                return found;
            }
            drop(state);
            self.state_mut().mend(&self.root);
        }
    }

    /// The payload of the record of `key`; `None` where there is none or where it is damaged.
    pub fn record(&self, key: &Digest) -> io::Result<Option<Vec<u8>>> {
        let Some((place, file)) = self.look(|state| state.find(Named::Record, key)) else { return Ok(None) };
        let bytes = read(&file, &place, Kind::Record, key)?;
        if bytes.is_none() {
            self.note_damage();
        }
        Ok(bytes)
    }

    /// The frame of a record or blob with its stamp, as it was appended; `None` as of [`Packs::record`].
    pub fn frame(&self, kind: Kind, key: &Digest) -> io::Result<Option<(u64, Vec<u8>)>> {
        let named = if kind == Kind::Record { Named::Record } else { Named::Blob };
        let Some((place, file)) = self.look(|state| state.find(named, key)) else { return Ok(None) };
        let payload = read(&file, &place, kind, key)?;
        Ok(payload.map(|payload| (place.stamp, frame::encode(kind, key, place.stamp, &payload))))
    }

    /// At least the head of the record of `key`, as it is. This is a use of the record.
    pub fn record_head(&self, key: &Digest) -> io::Result<Option<Vec<u8>>> {
        let Some((place, file)) = self.look(|state| state.find(Named::Record, key)) else { return Ok(None) };
        let head = read_start(&file, &place, HEAD)?;
        let head = match head.as_deref().and_then(head_end) {
            Some(end) if end > HEAD => read_start(&file, &place, end)?,
            _ => head,
        };
        if u64::from(place.used).saturating_add(NOTE_USE_AFTER_S) < self.opened_s {
            guard(&self.touched).insert(*key);
        }
        Ok(head)
    }

    /// Key of the latest record of a label, work or kind of stage. It may have been replaced or forgotten since.
    pub fn latest(&self, named: Named, digest: &Digest) -> Option<Digest> {
        let (place, file) = self.look(|state| state.find(named, digest))?;
        read_key(&file, &place).ok()?
    }

    /// Whether anything may be in the packs.
    pub fn has_entries(&self) -> bool {
        self.state().index.has_entries()
    }

    /// Stamp of the newest frame of a record.
    pub fn record_stamp(&self, key: &Digest) -> Option<u64> {
        self.look(|state| state.find(Named::Record, key)).map(|(place, _)| place.stamp)
    }

    fn blob_place(&self, digest: &Digest) -> Option<Place> {
        self.look(|state| state.index.find(Named::Blob, digest))
    }

    /// Length of a packed blob.
    pub fn blob_length(&self, digest: &Digest) -> Option<u64> {
        self.blob_place(digest).filter(Place::is_here).map(|place| u64::from(place.length))
    }

    /// The pack of a blob, and where its bytes begin and how many they are.
    pub fn place_of(&self, digest: &Digest) -> Option<(PathBuf, u64, u64)> {
        let place = self.blob_place(digest).filter(Place::is_here)?;
        let state = self.state();
        let path = self.root.join("packs").join(&state.packs.get(&place.pack)?.name);
        Some((path, u64::from(place.offset) + HEADER as u64, u64::from(place.length)))
    }

    /// Whether the bytes of a blob were given back on purpose, and have not come since.
    pub fn is_released(&self, digest: &Digest) -> bool {
        self.releases() && self.blob_place(digest).is_some_and(|place| place.is_released())
    }

    /// Whether there may be a released blob at all.
    pub fn releases(&self) -> bool {
        self.state().index.releases()
    }

    /// Gives back the bytes of blobs: from now on a pack holds no bytes of them. On the disk when this returns.
    pub fn release(&self, digests: &[Digest]) -> Result<(), StoreError> {
        let mut slot = guard(&self.writer);
        for digests in digests.chunks(RELEASED) {
            self.settle(&mut slot)?;
            let last = digests.iter().filter_map(|digest| self.stamp_of(Kind::Blob, digest)).max();
            let payload: Vec<u8> = digests.iter().flat_map(|digest| digest.0).collect();
            let frame = frame::encode(Kind::Release, &Digest::of(&payload), stamp_after(last), &payload);
            self.append_frame(&mut slot, &frame)?;
        }
        slot.as_mut().map_or(Ok(()), |writer| writer.sync(&self.root))
    }

    /// The bytes where the blob should be, damaged or not (`None`: not packed, or its pack is shorter).
    pub fn blob(&self, digest: &Digest) -> io::Result<Option<Vec<u8>>> {
        let Some((place, file)) = self.look(|state| state.find_blob(digest)) else { return Ok(None) };
        read_payload(&file, &place)
    }

    /// What is damaged is left behind when the packs are next gathered, at the end of this run if it is alone.
    pub fn note_damage(&self) {
        self.damaged.store(true, Ordering::Relaxed);
    }

    /// Whether gathering the packs would be worth it: damage, many packs that still take frames, or more dead bytes than others.
    pub fn wants_gathering(&self) -> bool {
        if self.among_many {
            return false;
        }
        let state = self.state();
        let short = state.packs.values().filter(|pack| pack.covered < FULL).count();
        if self.damaged.load(Ordering::Relaxed) || state.garbage > 0 || short > MANY_SHORT_PACKS {
            return true;
        }
        let seems = is_mostly_dead(&state);
        drop(state);
        // Counted as frames came: some may have been counted twice.
        seems && {
            self.count_dead();
            is_mostly_dead(&self.state())
        }
    }

    /// Counts the bytes that no entry needs.
    fn count_dead(&self) {
        let mut state = self.state_mut();
        let live = state.fold(&self.root, |live: &mut i64, entry| *live += entry.room());
        let all: u64 = state.packs.values().map(|pack| pack.covered).sum();
        state.index.set_dead(i64::try_from(all).unwrap_or(i64::MAX) - live);
    }

    /// Error: a pack cannot be read.
    pub fn is_complete(&self) -> Result<(), StoreError> {
        self.state().is_complete()
    }

    /// Where the packs are.
    pub fn paths(&self) -> Vec<PathBuf> {
        let folder = self.root.join("packs");
        self.state().packs.values().map(|pack| folder.join(&pack.name)).collect()
    }

    /// Number of packs and their bytes.
    pub fn size(&self) -> (usize, u64) {
        let state = self.state();
        (state.packs.len(), state.packs.values().map(|p| p.file.metadata().map_or(0, |m| m.len())).sum())
    }

    /// Frames that the index file named when it was read and that no pack held.
    pub fn lost(&self) -> u64 {
        self.state().lost
    }

    /// Whether something that was found before may be gone by now. Asking forgets it.
    pub fn take_shrunk(&self) -> bool {
        std::mem::take(&mut self.state_mut().shrunk)
    }

    /// Appends a frame. After an error nothing that is in the packs is worse than before.
    pub fn append(&self, kind: Kind, key: &Digest, payload: &[u8]) -> Result<(), StoreError> {
        let mut slot = guard(&self.writer);
        self.settle(&mut slot)?;
        let last = self.stamp_of(kind, key);
        self.append_frame(&mut slot, &frame::encode(kind, key, stamp_after(last), payload))?;
        self.keep_little_in_memory();
        // One sync for many records: a power cut may cost the last second, never the order of blobs and records.
        match slot.as_mut() {
            Some(writer) if kind == Kind::Record && writer.last_sync.elapsed() > SYNC_EVERY => writer.sync(&self.root),
            _ => Ok(()),
        }
    }

    fn stamp_of(&self, kind: Kind, key: &Digest) -> Option<u64> {
        self.look(|state| state.stamp_of(kind, key))
    }

    /// Lets the files of the index take what is in memory, if it is much.
    fn keep_little_in_memory(&self) {
        let recent = self.state().index.recent();
        if !self.among_many && recent > self.most_recent.load(Ordering::Relaxed) {
            let most = if self.save(false).is_ok() { MOST_RECENT } else { 2 * recent };
            self.most_recent.store(most, Ordering::Relaxed);
        }
    }

    /// Appends the bytes of a frame to the writer's pack, and takes one over if there is none.
    fn append_frame(&self, slot: &mut Option<Writer>, bytes: &[u8]) -> Result<(), StoreError> {
        let mut writer = match slot.take() {
            Some(writer) => writer,
            None => Writer::adopt(&self.root, &mut self.state_mut(), self.among_many)?,
        };
        let path = self.root.join("packs").join(&writer.name);
        match writer.append(bytes) {
            Ok(offset) => {
                let (frame, payload) = frame::decode(bytes).expect("these are the bytes of one frame");
                self.state_mut().take_in(writer.pack, offset, &frame, payload);
                *slot = Some(writer);
                Ok(())
            }
            Err((cut_back, error)) => {
                // Where a torn frame stays behind, others go into another pack.
                *slot = cut_back.then_some(writer);
                Err(StoreError::io("write to the store", &path)(error))
            }
        }
    }

    /// Lets go of a pack that takes no further frames. What this process has written to one that is gone, it writes again.
    fn settle(&self, slot: &mut Option<Writer>) -> Result<(), StoreError> {
        let Some(writer) = slot else { return Ok(()) };
        match writer.standing(&self.root) {
            Standing::Here { length } if length < FULL => return Ok(()),
            Standing::Here { .. } => {
                writer.sync(&self.root)?;
                *slot = None;
                return Ok(());
            }
            Standing::Changed => {
                writer.sync(&self.root)?;
                *slot = None;
                return self.state_mut().refresh(&self.root);
            }
            Standing::Gone => {}
        }
        let bytes = writer.own_frames();
        // Gives the lock back first: the name is free for this process again.
        *slot = None;
        self.state_mut().refresh(&self.root)?;
        for (at, frame) in frame::scan(&bytes).frames {
            let end = at as usize + HEADER + frame.length as usize;
            self.append_frame(slot, &bytes[at as usize..end])?;
        }
        Ok(())
    }

    /// Takes in what other processes have appended, packs that are new and packs that are gone.
    pub fn refresh(&self) -> Result<(), StoreError> {
        self.settle(&mut guard(&self.writer))?;
        self.state_mut().refresh(&self.root)
    }

    /// Reads all packs again from their beginning, beside what the index says. Error: also where one cannot be read.
    pub fn read_again(&self) -> Result<(), StoreError> {
        self.settle(&mut guard(&self.writer))?;
        let mut state = self.state_mut();
        state.read_again(&self.root)?;
        state.is_complete()
    }

    /// Brings everything to the disk and writes what the files of the index lack.
    pub fn finish(&self) -> Result<(), StoreError> {
        self.sync_all()?;
        if self.state().stale && !self.among_many {
            // Only a cache: without it the next opening is slower.
            let _ = self.save(false);
        }
        Ok(())
    }

    /// The same, but writes a file of the index only if they lack enough: what is read again after a crash is little.
    pub fn finish_for_now(&self) -> Result<(), StoreError> {
        self.sync_all()?;
        if self.state().lacks_much() && !self.among_many {
            let _ = self.save(false);
        }
        Ok(())
    }

    fn sync_all(&self) -> Result<(), StoreError> {
        let touched = std::mem::take(&mut *guard(&self.touched));
        if !touched.is_empty() {
            let mut payload = Vec::with_capacity(40 * touched.len());
            for key in &touched {
                payload.extend_from_slice(&key.0);
                payload.extend_from_slice(&self.opened_s.to_le_bytes());
            }
            // Only gc asks for it: no reason to fail a run of hits on a full disk.
            let _ = self.append(Kind::Used, &Digest::of(&payload), &payload);
        }
        {
            let mut slot = guard(&self.writer);
            for _ in 0..RESCUES {
                self.settle(&mut slot)?;
                let Some(writer) = slot.as_mut() else { break };
                writer.sync(&self.root)?;
                if matches!(writer.standing(&self.root), Standing::Here { .. }) {
                    break;
                }
            }
        }
        self.refresh()
    }

    /// Writes the index anew, as one file.
    pub fn save_index(&self) -> Result<(), StoreError> {
        self.save(true)
    }

    fn save(&self, whole: bool) -> Result<(), StoreError> {
        self.state_mut().save(&self.root, whole, now_ns())
    }

    /// Checks every frame of every pack: what no whole frame covers, in bytes, by pack; or why a pack cannot be read
    /// ([`io::ErrorKind::FileTooLarge`]: it is none of ours).
    ///
    /// The end of a pack that is torn (a writer was killed, or is at work) is not damage.
    pub fn garbage(&self) -> Vec<(PathBuf, io::Result<u64>)> {
        let state = self.state();
        let scan = |file| {
            let length = File::metadata(file)?.len();
            if length > LONGEST {
                return Err(io::ErrorKind::FileTooLarge.into());
            }
            Ok(frame::scan(&disk::read_at(file, 0, length as usize)?).garbage)
        };
        let scanned = state.packs.values().map(|pack| (self.root.join("packs").join(&pack.name), scan(&*pack.file)));
        scanned.filter(|(_, garbage)| !matches!(garbage, Ok(0))).collect()
    }

    /// The packs of which nothing is known, and why.
    pub fn unread(&self) -> Vec<(PathBuf, String)> {
        self.state().unread().map(|(path, error)| (path.clone(), error.to_string())).collect()
    }
}

/// A stamp of now, and later than one.
pub(super) fn stamp_after(last: Option<u64>) -> u64 {
    now_ns().max(last.map_or(0, |stamp| stamp.saturating_add(1)))
}

/// Whether most of the packs is what newer frames replace or release, as far as it was counted: rewriting them gives more room
/// back than it takes work.
fn is_mostly_dead(state: &State) -> bool {
    let all: u64 = state.packs.values().map(|pack| pack.covered).sum();
    let dead = u64::try_from(state.index.dead()).unwrap_or(0).min(all);
    dead > (all - dead) + DEAD
}
