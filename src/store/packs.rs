//! Packs: append-only files of frames. Each writing process appends to a pack of its own, so writers never meet.

use std::collections::BTreeSet;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Seek};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, RwLock};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use crate::digest::{Digest, PartHasher};
use crate::store::disk;
use crate::store::error::StoreError;
use crate::store::frame::{self, Kind};
use crate::store::index::{Map, Place};
use crate::store::lock;
use crate::store::record::head_end;
use crate::store::state::{State, read, read_payload, read_start};

/// A pack this long takes no further frames.
const FULL: u64 = 64 << 20;
/// What is published reaches the disk within about this time.
const SYNC_EVERY: Duration = Duration::from_secs(1);
/// More packs than this that still take frames are gathered into few (of which at most one still takes frames).
const MANY_SHORT_PACKS: usize = 64;
/// Few records have a longer head than this; one read takes it in.
const HEAD: usize = 1024;
/// A record's last use is noted once a day at most, so that a run of hits writes nothing.
const NOTE_USE_AFTER_S: u64 = 86_400;

/// The pack that this process appends to, under a lock that says so.
struct Writer {
    pack: u32,
    name: String,
    file: File,
    _lock: Option<File>,
    last_sync: Instant,
}

/// All packs of a store.
pub(super) struct Packs {
    root: PathBuf,
    state: RwLock<State>,
    writer: Mutex<Option<Writer>>,
    touched: Mutex<BTreeSet<Digest>>,
    /// Whether something in the packs was found damaged.
    damaged: AtomicBool,
    opened_s: u64,
}

pub(super) fn now_ns() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_nanos()).unwrap_or(u64::MAX)
}

impl Packs {
    /// Reads the index and whatever the packs hold beyond it; creates nothing.
    pub fn open(root: &Path) -> Result<Self, StoreError> {
        Ok(Self {
            root: root.to_owned(),
            state: RwLock::new(State::load(root)?),
            writer: Mutex::new(None),
            touched: Mutex::new(BTreeSet::new()),
            damaged: AtomicBool::new(false),
            opened_s: now_ns() / 1_000_000_000,
        })
    }

    fn state(&self) -> std::sync::RwLockReadGuard<'_, State> {
        self.state.read().expect("no holder panics")
    }

    fn state_mut(&self) -> std::sync::RwLockWriteGuard<'_, State> {
        self.state.write().expect("no holder panics")
    }

    /// The payload of the record of `key`; `None` where there is none or where it is damaged.
    pub fn record(&self, key: &Digest) -> Option<Vec<u8>> {
        let (place, file) = self.state().find(Kind::Record, key)?;
        let bytes = read(&file, &place, Kind::Record, key);
        if bytes.is_none() {
            self.note_damage();
        }
        bytes
    }

    /// At least the head of the record of `key`, as it is. This is a use of the record.
    pub fn record_head(&self, key: &Digest) -> Option<Vec<u8>> {
        let (place, file) = self.state().find(Kind::Record, key)?;
        let head = read_start(&file, &place, HEAD);
        let head = match head.as_deref().and_then(head_end) {
            Some(end) if end > HEAD => read_start(&file, &place, end),
            _ => head,
        };
        if place.used.saturating_add(NOTE_USE_AFTER_S) < self.opened_s {
            self.touched.lock().expect("no holder panics").insert(*key);
        }
        head
    }

    /// Length of a packed blob.
    pub fn blob_length(&self, digest: &Digest) -> Option<u64> {
        self.state().index.blobs.get(digest).filter(|p| p.is_here()).map(|p| p.length)
    }

    /// The bytes where the blob should be, damaged or not (`None`: not packed, or beyond reading).
    pub fn blob(&self, digest: &Digest) -> Option<Vec<u8>> {
        let (place, file) = self.state().find(Kind::Blob, digest)?;
        read_payload(&file, &place)
    }

    /// What is damaged is left behind when the packs are next gathered, at the end of this run if it is alone.
    pub fn note_damage(&self) {
        self.damaged.store(true, Ordering::Relaxed);
    }

    /// Whether gathering the packs would be worth it: damage, or many packs that still take frames.
    pub fn wants_gathering(&self) -> bool {
        let state = self.state();
        let short = state.packs.iter().filter(|pack| pack.covered < FULL).count();
        self.damaged.load(Ordering::Relaxed) || state.garbage > 0 || short > MANY_SHORT_PACKS
    }

    /// All records with their place, the newest first.
    pub fn records(&self) -> Vec<(Digest, Place)> {
        let mut all: Vec<_> = here(&self.state().index.records);
        all.sort_by_key(|(key, place)| (std::cmp::Reverse(place.stamp), *key));
        all
    }

    pub fn blobs(&self) -> Vec<(Digest, Place)> {
        here(&self.state().index.blobs)
    }

    /// Number of packs and their bytes.
    pub fn size(&self) -> (usize, u64) {
        let state = self.state();
        (state.packs.len(), state.packs.iter().map(|p| p.file.metadata().map_or(0, |m| m.len())).sum())
    }

    /// Frames that the index file named when it was read and that no pack held.
    pub fn lost(&self) -> u64 {
        self.state().lost
    }

    /// Appends a frame. After an error nothing that is in the packs is worse than before.
    pub fn append(&self, kind: Kind, key: &Digest, payload: &[u8]) -> Result<(), StoreError> {
        let mut slot = self.writer.lock().expect("no holder panics");
        if slot.as_ref().is_some_and(|w| w.file.metadata().is_ok_and(|m| m.len() >= FULL)) {
            sync(&self.root, &mut slot)?;
            *slot = None;
        }
        if slot.is_none() {
            *slot = Some(self.adopt()?);
        }
        let writer = slot.as_mut().expect("it was filled");
        let last = self.state().stamp_of(kind, key);
        let stamp = now_ns().max(last.map_or(0, |stamp| stamp.saturating_add(1)));
        let bytes = frame::encode(kind, key, stamp, payload);
        let written = writer.append(&bytes);
        let path = self.root.join("packs").join(&writer.name);
        match written {
            Ok(offset) => {
                let (frame, _) = frame::decode(&bytes).expect("it was encoded here");
                self.state_mut().take_in(writer.pack, offset, &frame, payload);
            }
            Err((cut_back, error)) => {
                if !cut_back {
                    // A torn frame stays behind; others go into another pack.
                    *slot = None;
                }
                return Err(StoreError::io("write to the store", &path)(error));
            }
        }
        // One sync for many records: a power cut may cost the last second, never the order of blobs and records.
        if kind == Kind::Record && writer.last_sync.elapsed() > SYNC_EVERY {
            sync(&self.root, &mut slot)?;
        }
        Ok(())
    }

    /// Takes over a pack that no process appends to, or begins a new one.
    fn adopt(&self) -> Result<Writer, StoreError> {
        let folder = self.root.join("packs");
        fs::create_dir_all(&folder).map_err(StoreError::io("create a folder of the store", &folder))?;
        let machine = machine();
        for n in 0.. {
            // Where machines cannot be told apart, a lock may not reach every writer: then a name for this process only.
            let name = match &machine {
                Some(machine) => format!("{machine}-{n:04}.pack"),
                None => format!("{:016x}-{:08x}-{n:04}.pack", now_ns(), std::process::id()),
            };
            let path = folder.join(&name);
            let lock = match lock::try_exclusive(&self.root.join("locks").join(&name)) {
                lock::Try::Taken(file) => Some(file),
                lock::Try::Held => continue,
                lock::Try::Unsupported if path.exists() => continue,
                lock::Try::Unsupported => None,
            };
            let mut options = OpenOptions::new();
            options.read(true).append(true);
            if lock.is_some() {
                options.create(true)
            } else {
                options.create_new(true)
            };
            let file = match options.open(&path) {
                Ok(file) => file,
                Err(e) if lock.is_none() && e.kind() == io::ErrorKind::AlreadyExists => continue,
                Err(e) => return Err(StoreError::io("write to the store", &path)(e)),
            };
            let mut state = self.state_mut();
            state.refresh(&self.root)?;
            let Some(pack) = state.packs.iter().position(|p| p.name == name) else {
                // Somebody removed it between the two calls.
                continue;
            };
            // An error here must not pass for a torn tail: what could not be read is not to be cut off.
            state.read_tail(pack).map_err(StoreError::io("read the store", &path))?;
            let covered = state.packs[pack].covered;
            let length = file.metadata().map_err(StoreError::io("read the store", &path))?.len();
            if covered >= FULL {
                continue;
            }
            if length > covered {
                // Its last writer was killed in mid-frame; this lock says that nobody writes on.
                file.set_len(covered).map_err(StoreError::io("write to the store", &path))?;
            }
            disk::sync_folder(&folder);
            let pack = u32::try_from(pack).expect("fewer than 2^32 packs");
            return Ok(Writer { pack, name, file, _lock: lock, last_sync: Instant::now() });
        }
        unreachable!("the numbers of packs do not end")
    }

    /// Takes in what other processes have appended, packs that are new and packs that are gone.
    pub fn refresh(&self) -> Result<(), StoreError> {
        self.state_mut().refresh(&self.root)
    }

    /// Brings everything to the disk and writes the index file if it lacks something.
    pub fn finish(&self) -> Result<(), StoreError> {
        let touched = std::mem::take(&mut *self.touched.lock().expect("no holder panics"));
        if !touched.is_empty() {
            let mut payload = Vec::with_capacity(40 * touched.len());
            for key in &touched {
                payload.extend_from_slice(&key.0);
                payload.extend_from_slice(&self.opened_s.to_le_bytes());
            }
            // Only gc asks for it: no reason to fail a run of hits on a full disk.
            let _ = self.append(Kind::Used, &Digest::of(&payload), &payload);
        }
        sync(&self.root, &mut self.writer.lock().expect("no holder panics"))?;
        self.refresh()?;
        let mut state = self.state_mut();
        if state.stale {
            // Only a cache: without it the next opening is slower.
            let _ = state.save(&self.root);
        }
        Ok(())
    }

    /// Writes the kept records and blobs into fresh packs and removes all others. Needs the store alone.
    pub fn compact(&self, records: &BTreeSet<Digest>, blobs: &BTreeSet<Digest>) -> Result<(), StoreError> {
        let mut writer = self.writer.lock().expect("no holder panics");
        *writer = None;
        let mut state = self.state_mut();
        let folder = self.root.join("packs");
        let mut kept: Vec<(u32, u64, Kind, Digest)> = Vec::new();
        let mut used = Vec::new();
        for (kind, map, keep) in
            [(Kind::Blob, &state.index.blobs, blobs), (Kind::Record, &state.index.records, records)]
        {
            for (key, place) in map.iter().filter(|(key, place)| place.is_here() && keep.contains(*key)) {
                kept.push((place.pack, place.offset, kind, *key));
                if kind == Kind::Record && place.used > place.stamp / 1_000_000_000 {
                    used.push((*key, place.used));
                }
            }
        }
        // In the order of the packs: old neighbours stay neighbours.
        kept.sort_unstable();
        used.sort_unstable();
        let mut fresh: Vec<(PathBuf, File)> = Vec::new();
        let mut length = FULL;
        let mut write = |bytes: &[u8]| -> Result<(), StoreError> {
            if length >= FULL {
                let path = folder.join(format!("c{:016x}-{:04}.pack", now_ns(), fresh.len()));
                let file = OpenOptions::new().append(true).create_new(true).open(&path);
                fresh.push((path.clone(), file.map_err(StoreError::io("write to the store", &path))?));
                length = 0;
            }
            let (path, file) = fresh.last_mut().expect("one was just opened");
            length += bytes.len() as u64;
            disk::write(file, bytes).map_err(StoreError::io("write to the store", path))
        };
        let mut written = Ok(());
        for (pack, offset, kind, key) in kept {
            let (place, file) = state.find(kind, &key).expect("it is in the index");
            debug_assert_eq!((place.pack, place.offset), (pack, offset));
            // What is damaged is left behind; a blob is whole if its bytes have its digest, whatever became of its header.
            let payload = match kind {
                Kind::Blob => read_payload(&file, &place).filter(|bytes| Digest::of(bytes) == key),
                _ => read(&file, &place, kind, &key),
            };
            if let Some(payload) = payload {
                written = written.and_then(|()| write(&frame::encode(kind, &key, place.stamp, &payload)));
            }
        }
        if !used.is_empty() {
            let payload: Vec<u8> =
                used.iter().flat_map(|(key, time)| [&key.0[..], &time.to_le_bytes()].concat()).collect();
            written =
                written.and_then(|()| write(&frame::encode(Kind::Used, &Digest::of(&payload), now_ns(), &payload)));
        }
        for (path, file) in &fresh {
            written = written.and_then(|()| file.sync_all().map_err(StoreError::io("write to the store", path)));
        }
        if let Err(error) = written {
            // The old packs still hold everything.
            fresh.iter().for_each(|(path, _)| drop(fs::remove_file(path)));
            return Err(error);
        }
        disk::sync_folder(&folder);
        for pack in &state.packs {
            let path = folder.join(&pack.name);
            fs::remove_file(&path).map_err(StoreError::io("remove an old pack", &path))?;
            let _ = fs::remove_file(self.root.join("locks").join(&pack.name));
        }
        *state = State::empty();
        self.damaged.store(false, Ordering::Relaxed);
        state.refresh(&self.root)?;
        state.save(&self.root)
    }

    /// Checks every frame of every pack: what no whole frame covers, in bytes, by pack.
    ///
    /// The end of a pack that is torn (a writer was killed, or is at work) is not damage.
    pub fn garbage(&self) -> Vec<(String, u64)> {
        let state = self.state();
        let scanned = state.packs.iter().map(|pack| {
            let bytes = fs::read(self.root.join("packs").join(&pack.name)).unwrap_or_default();
            (pack.name.clone(), frame::scan(&bytes).garbage)
        });
        scanned.filter(|(_, garbage)| *garbage > 0).collect()
    }
}

fn here(map: &Map<Place>) -> Vec<(Digest, Place)> {
    map.iter().filter(|(_, place)| place.is_here()).map(|(key, place)| (*key, *place)).collect()
}

fn sync(root: &Path, slot: &mut Option<Writer>) -> Result<(), StoreError> {
    if let Some(writer) = slot {
        let path = root.join("packs").join(&writer.name);
        writer.file.sync_data().map_err(StoreError::io("write to the store", &path))?;
        writer.last_sync = Instant::now();
    }
    Ok(())
}

/// A name for the running kernel: file locks hold among exactly the processes that share one.
fn machine() -> Option<String> {
    let boot = fs::read("/proc/sys/kernel/random/boot_id").ok()?;
    Some(PartHasher::new("turbid pack writer v1").part("boot", &boot).finish().to_string()[..12].to_owned())
}

impl Writer {
    /// Appends; on success the offset, on failure whether the torn bytes could be cut off again.
    fn append(&mut self, bytes: &[u8]) -> Result<u64, (bool, io::Error)> {
        let before = self.file.metadata().map_err(|e| (true, e))?.len();
        disk::write(&mut self.file, bytes)
            // Where the kernel has put it: right even if a lock did not keep another writer away.
            .and_then(|()| self.file.stream_position())
            .map(|end| end - bytes.len() as u64)
            .map_err(|error| (self.file.set_len(before).is_ok(), error))
    }
}
