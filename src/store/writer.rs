//! The pack that a process appends to.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Seek};
use std::path::Path;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use crate::digest::PartHasher;
use crate::leftover;
use crate::store::disk::{self, Identity};
use crate::store::error::StoreError;
use crate::store::frame::HEADER;
use crate::store::lock;
use crate::store::odd;
use crate::store::state::State;

/// A pack this long takes no further frames.
pub(super) const FULL: u64 = 64 << 20;
/// So many names are tried for a pack.
const NAMES: u32 = 100_000;
/// So many of them may fail to open: something is wrong with more than a name.
const FAILURES: usize = 1000;
/// Without locks a pack counts as free when nobody has appended to it for so long.
const SURELY_FREE: Duration = Duration::from_secs(86_400);

/// The pack that this process appends to, under a lock that says so.
pub(super) struct Writer {
    /// Id of the pack in [`State`].
    pub pack: u32,
    pub name: String,
    file: File,
    identity: Identity,
    /// Where locks keep others out: the lock and what tells its file from others.
    lock: Option<(File, Identity)>,
    /// What this process has appended lies between these.
    began: u64,
    end: u64,
    pub last_sync: Instant,
}

/// What became of a writer's pack since it last appended.
pub(super) enum Standing {
    Here {
        length: u64,
    },
    /// Somebody removed or replaced it; what this process appended can still be read through the open file.
    Gone,
    /// Somebody cut it short, or took away its lock: not to be appended to any more.
    Changed,
}

pub(super) fn now_ns() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_nanos()).unwrap_or(u64::MAX)
}

/// A name for the running kernel: file locks hold among exactly the processes that share one.
fn machine() -> Option<String> {
    let boot = fs::read("/proc/sys/kernel/random/boot_id").ok()?;
    Some(PartHasher::new("turbid pack writer v1").part("boot", &boot).finish().to_string()[..12].to_owned())
}

impl Writer {
    /// Takes over a pack that no process appends to, or begins a new one.
    ///
    /// A name at which something stands that is no file, or that cannot be opened or read, is left to the next one.
    /// `own`: no pack is taken over that another process began.
    pub fn adopt(root: &Path, state: &mut State, own: bool) -> Result<Self, StoreError> {
        let folder = root.join("packs");
        odd::make_folder(root, &folder).map_err(StoreError::io("create a folder of the store", &folder))?;
        let machine = machine();
        let mut failures: Vec<io::Error> = Vec::new();
        for n in 0..NAMES {
            // Where machines cannot be told apart, a lock may not reach every writer: then a name for this process only.
            let name = match &machine {
                Some(machine) if !own => format!("{machine}-{n:04}.pack"),
                _ => format!("{:016x}-{:08x}-{n:04}.pack", now_ns(), std::process::id()),
            };
            let path = folder.join(&name);
            match Self::open(root, state, name) {
                Ok(Some(writer)) => {
                    disk::sync_folder(&folder).map_err(StoreError::io("write to the store", &folder))?;
                    return Ok(writer);
                }
                Ok(None) => {}
                Err(error) if fs::symlink_metadata(&path).is_ok() && failures.len() < FAILURES => failures.push(error),
                // Removed between two calls: so is the next one, perhaps, but not for ever.
                Err(error) if error.kind() == io::ErrorKind::NotFound && failures.len() < FAILURES => {
                    odd::make_folder(root, &folder).map_err(StoreError::io("create a folder of the store", &folder))?;
                    failures.push(error);
                }
                Err(error) => return Err(StoreError::io("write to the store", &path)(error)),
            }
        }
        let error = failures.pop().unwrap_or_else(|| io::Error::other("no name is free for another pack"));
        Err(StoreError::io("write to the store", &folder)(error))
    }

    /// Takes over or begins the pack `name`; none where another process has it or it is of no use.
    fn open(root: &Path, state: &mut State, name: String) -> io::Result<Option<Self>> {
        let (path, lock_path) = (root.join("packs").join(&name), root.join("locks").join(&name));
        let lock = match lock::try_exclusive(&lock_path) {
            lock::Try::Held => return Ok(None),
            // A lock that keeps nobody out is none.
            lock::Try::Taken(file) if lock::is_exclusive(&lock_path) => {
                let identity = disk::identity(&file.metadata()?);
                Some((file, identity))
            }
            _ => None,
        };
        let there = fs::symlink_metadata(&path).is_ok();
        if there && lock.is_none() && !leftover::is_older(&path, SURELY_FREE) {
            return Ok(None);
        }
        let mut options = OpenOptions::new();
        options.read(true).append(true);
        if lock.is_some() {
            options.create(true);
        } else if !there {
            options.create_new(true);
        }
        let file = match disk::open_regular_with(&path, &mut options) {
            Err(e) if lock.is_none() && e.kind() == io::ErrorKind::AlreadyExists => return Ok(None),
            opened => opened?,
        };
        let meta = file.metadata()?;
        let (identity, mut length) = (disk::identity(&meta), meta.len());
        state.refresh(root).map_err(io::Error::other)?;
        let Some(pack) = state.id_of(&name) else { return Ok(None) };
        // An error here must not pass for a torn tail: what could not be read is not to be cut off.
        state.read_tail(pack)?;
        let Some(covered) = state.packs.get(&pack).map(|pack| pack.covered) else { return Ok(None) };
        if covered >= FULL {
            return Ok(None);
        }
        if length > covered && lock.is_some() {
            // Its last writer was killed in mid-frame; this lock says that nobody writes on.
            file.set_len(covered)?;
            length = covered;
        }
        Ok(Some(Self { pack, name, file, identity, lock, began: length, end: length, last_sync: Instant::now() }))
    }

    pub fn standing(&self, root: &Path) -> Standing {
        let at = |folder: &str| {
            disk::look(&root.join(folder).join(&self.name))?.ok_or_else(|| io::Error::from(io::ErrorKind::NotFound))
        };
        let length = match at("packs") {
            Ok(meta) if meta.is_file() && disk::identity(&meta) == self.identity => meta.len(),
            // Nothing is known of it: another pack, for what comes now.
            Err(error) if !disk::is_absent(&error) => return Standing::Changed,
            _ => return Standing::Gone,
        };
        let locked =
            self.lock.as_ref().is_none_or(|(_, identity)| at("locks").is_ok_and(|m| disk::identity(&m) == *identity));
        if length < self.end || !locked { Standing::Changed } else { Standing::Here { length } }
    }

    /// The frames that this process has appended, as bytes; those that can no longer be read are left out.
    pub fn own_frames(&self) -> Vec<u8> {
        let length = usize::try_from(self.end - self.began).unwrap_or(0);
        disk::read_at(&self.file, self.began, length).unwrap_or_default()
    }

    /// Appends a frame; on success the offset, on failure whether the torn bytes could be cut off again.
    pub fn append(&mut self, bytes: &[u8]) -> Result<u64, (bool, io::Error)> {
        debug_assert!(bytes.len() >= HEADER);
        let before = self.file.metadata().map_err(|e| (true, e))?.len();
        let written = disk::write(&mut self.file, bytes)
            // Where the kernel has put it: right even if a lock did not keep another writer away.
            .and_then(|()| self.file.stream_position());
        match written {
            Ok(end) => {
                self.end = end;
                Ok(end.saturating_sub(bytes.len() as u64))
            }
            // Only what nobody else can have written is cut off.
            Err(error) => Err((self.lock.is_some() && self.file.set_len(before).is_ok(), error)),
        }
    }

    /// Brings what was appended to the disk.
    pub fn sync(&mut self, root: &Path) -> Result<(), StoreError> {
        let path = root.join("packs").join(&self.name);
        self.file.sync_data().map_err(StoreError::io("write to the store", &path))?;
        self.last_sync = Instant::now();
        Ok(())
    }
}
