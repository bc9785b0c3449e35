//! The content-addressed store: blobs under the digest of their bytes, one record per instance key.
//!
//! A torn or missing piece is a miss, never an error and never a wrong hit: records carry a checksum that every
//! look-up verifies, and a blob's bytes are compared with its digest whenever they are read (of a file that this process wrote or
//! compared itself, while nobody touches it, once). `docs/store.md` describes
//! the files. Only this module knows EXR and Parquet.

mod backend;
mod checkpoint;
mod codec;
mod columns;
mod compact;
mod compared;
mod disk;
mod earlier;
mod error;
mod exr;
mod format;
mod frame;
mod gc;
mod index;
mod kernel;
mod key_lock;
mod labels;
mod large;
mod listing;
mod lock;
mod look;
mod network;
mod odd;
mod packs;
mod parquet;
mod place;
mod record;
mod release;
mod remote;
mod resume;
mod saved;
mod sorted;
mod state;
mod verify;
mod writer;

#[cfg(test)]
mod tests;

use std::collections::BTreeSet;
use std::fs;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use turbid_contract::{Artifact, ArtifactKind, Extent};

use crate::digest::Digest;
use crate::leftover;
use backend::{Backend, Folder};
use checkpoint::Checkpoints;
use key_lock::KeyLocks;
use lock::{Try, guard};

pub use backend::extension;
pub use codec::{decode, encode, encode_pieces};
pub use error::StoreError;
pub use gc::GcReport;
pub use kernel::return_large_memory;
pub use key_lock::KeyLock;
pub use labels::Label;
pub use large::OpenedImages;
pub use record::{Blob, Cost, InstanceRecord, PortRecord, Provenance, Recipe};
pub use release::Names;
pub use remote::{Address, Pulled, Pushed, Remote, RemoteError, Traffic};
pub use verify::{Finding, Stat, VerifyReport};

/// Temporary files of turbid up to 0.1 are not locked while they are written: only their age tells.
const UNLOCKED: (&str, Duration) = ("new-", Duration::from_secs(3600));

/// A store; shared by all threads of a run. Ends with [`Store::finish`] (dropping it does the same).
pub struct Store {
    root: PathBuf,
    read_only: bool,
    /// The local store: what looks after its files works on it.
    folder: Arc<Folder>,
    /// What look-ups, reads and writes go through: the folder, or the folder with a store elsewhere behind it.
    backend: Arc<dyn Backend>,
    remote: Option<Arc<Remote>>,
    checkpoints: Checkpoints,
    locks: KeyLocks,
    /// Shared lock that keeps `gc` out, taken with the first write or read of a blob.
    in_use: Mutex<Option<Use>>,
    /// Keys that were called a hit, or published, since the store was opened.
    vouched: Mutex<BTreeSet<Digest>>,
    /// The last record or look for a blob that failed.
    unread: Mutex<Option<String>>,
    /// Whether somebody gave his word that no other machine uses the store.
    no_other_machine: bool,
}

/// How a store was left by [`Store::finish`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Finished {
    /// Keys that this store called a hit, or published, and that are a miss now: a blob or the record was found damaged and
    /// left behind, or somebody removed it. Each is named once.
    pub dropped: BTreeSet<Digest>,
}

/// How this process keeps `gc` out.
enum Use {
    #[expect(dead_code, reason = "held, not read: closing the file gives the lock back")]
    Locked(fs::File),
    /// The file system has no locks.
    Unlocked,
}

impl Store {
    /// Opens the store below `outputs` for runs; creates what is missing.
    ///
    /// Errors: `outputs` is not a folder or cannot be written to; the store is of a newer format.
    pub fn open(outputs: &Path) -> Result<Self, StoreError> {
        Self::open_to_write(outputs, false)
    }

    /// The same for a run among many on many machines: it appends to a pack of its own, and leaves the index and the gathering
    /// of packs to others.
    pub fn open_for_shard(outputs: &Path) -> Result<Self, StoreError> {
        Self::open_to_write(outputs, true)
    }

    fn open_to_write(outputs: &Path, among_many: bool) -> Result<Self, StoreError> {
        let root = outputs.join("store");
        if !format::check(&root)? {
            fs::create_dir_all(&root).map_err(StoreError::io("create the outputs folder", &root))?;
            format::write(&root).map_err(StoreError::io("write to the outputs folder", &root))?;
        }
        remove_leftovers(&root.join("tmp"));
        Self::at(root, false, among_many)
    }

    /// Opens the store for looking only: nothing is created or changed, a missing store is an empty one.
    pub fn open_read_only(outputs: &Path) -> Result<Self, StoreError> {
        let root = outputs.join("store");
        format::check(&root)?;
        Self::at(root, true, false)
    }

    /// Whether a run could write to `outputs`; leaves no trace. Errors as [`Store::open`].
    pub fn check(outputs: &Path) -> Result<(), StoreError> {
        let root = outputs.join("store");
        format::check(&root)?;
        let nearest = root.ancestors().find(|p| p.exists()).unwrap_or(Path::new("."));
        let nearest = if nearest.as_os_str().is_empty() { Path::new(".") } else { nearest };
        tempfile::tempfile_in(nearest).map(drop).map_err(StoreError::io("write to the outputs folder", nearest))
    }

    fn at(root: PathBuf, read_only: bool, among_many: bool) -> Result<Self, StoreError> {
        let folder = Arc::new(Folder::open(&root, among_many)?);
        Ok(Self {
            read_only,
            backend: folder.clone(),
            folder,
            remote: None,
            checkpoints: Checkpoints::new(&root),
            locks: KeyLocks::new(&root),
            in_use: Mutex::new(None),
            vouched: Mutex::default(),
            unread: Mutex::default(),
            no_other_machine: false,
            root,
        })
    }

    /// The record of an instance, if it is undamaged and every blob that it names is there in full length, or was
    /// [released](Store::release).
    ///
    /// Blobs are not read. Never waits; finds what other runs published before this store was opened or before the
    /// last [`Store::lock`] or [`Store::refresh`].
    pub fn record(&self, key: &Digest) -> Option<Arc<InstanceRecord>> {
        let record = self.whole_record(key)?;
        self.vouch(key);
        Some(record)
    }

    fn vouch(&self, key: &Digest) {
        guard(&self.vouched).insert(*key);
    }

    fn whole_record(&self, key: &Digest) -> Option<Arc<InstanceRecord>> {
        let head = self.told(self.backend.record_head(key))??;
        let Some(record) = InstanceRecord::decode_head(key, &head) else {
            self.folder.packs.note_damage();
            return None;
        };
        let whole = record.blobs().all(|blob| self.holds(blob) || self.is_released(blob));
        whole.then(|| Arc::new(record))
    }

    /// Whether a blob is there, as far as one can tell.
    fn holds(&self, blob: &Blob) -> bool {
        self.told(self.backend.holds(blob)).unwrap_or(false)
    }

    /// What was read; an error is a miss, and kept for [`Store::unread`].
    fn told<T>(&self, read: Result<T, StoreError>) -> Option<T> {
        read.map_err(|error| *guard(&self.unread) = Some(error.to_string())).ok()
    }

    /// Why some of the store could not be read, so that what is a miss may be there nevertheless; `None` where all could.
    pub fn unread(&self) -> Option<String> {
        guard(&self.unread).clone().or_else(|| {
            let (path, error) = self.folder.packs.unread().into_iter().next()?;
            Some(format!("cannot read the store ({}): {error}", path.display()))
        })
    }

    /// Encodes and writes an artifact. Does nothing where the same bytes are there already.
    ///
    /// Errors: [`StoreError::Unfit`] names the layer or column and the position of what is not finite; a full disk.
    pub fn put(&self, artifact: &Artifact) -> Result<Blob, StoreError> {
        if let Artifact::Images(stack) = artifact
            && large::is_large(stack)
        {
            self.begin_use(&|| false)?;
            return large::put(&self.root, &self.folder, stack);
        }
        let bytes = encode(artifact)?;
        let blob = Blob { digest: Digest::of(&bytes), kind: artifact.kind(), bytes: bytes.len() as u64 };
        self.begin_use(&|| false)?;
        self.backend.write(&blob, &bytes)?;
        Ok(blob)
    }

    /// The bytes of a blob, verified.
    ///
    /// Errors: [`StoreError::Missing`]; [`StoreError::Damaged`], after which the blob is in quarantine and every
    /// record that names it is a miss.
    pub fn bytes(&self, blob: &Blob) -> Result<Vec<u8>, StoreError> {
        let digest = blob.digest;
        if !self.read_only {
            self.begin_use(&|| false)?;
        }
        let again = |error: StoreError| if error.is_broken_medium() { self.backend.read(blob) } else { Err(error) };
        match self.backend.read(blob).or_else(again) {
            Ok(Some(bytes)) if Digest::of(&bytes) == digest => return Ok(bytes),
            Ok(Some(_)) => {}
            Ok(None) => return Err(StoreError::Missing { digest }),
            // Whoever only looks is told; a run computes it anew.
            Err(error) if error.is_broken_medium() && !self.read_only => {}
            Err(error) => return Err(error),
        }
        if !self.read_only {
            self.backend.quarantine(blob)?;
        }
        Err(StoreError::Damaged { digest })
    }

    /// Reads an artifact. Errors as [`Store::bytes`].
    pub fn get(&self, blob: &Blob) -> Result<Artifact, StoreError> {
        if blob.kind == ArtifactKind::Images && blob.bytes >= large::LARGE {
            return self.open_images(blob)?.part(&|_, _| true).map(Artifact::Images);
        }
        decode(blob.kind, &self.bytes(blob)?)
    }

    /// An image stack of which parts are wanted: of a large one no more than these are ever in memory. Errors as [`Store::bytes`].
    pub fn open_images(&self, blob: &Blob) -> Result<OpenedImages, StoreError> {
        if blob.kind == ArtifactKind::Images && blob.bytes >= large::LARGE {
            return self.large(blob, large::open);
        }
        match self.get(blob)? {
            Artifact::Images(stack) => Ok(OpenedImages::of(stack)),
            _ => Err(StoreError::unfit("not an image stack")),
        }
    }

    /// What `read` makes of a large blob; a damaged one goes to quarantine.
    fn large<T>(&self, blob: &Blob, read: impl Fn(&Folder, &Blob) -> Result<T, StoreError>) -> Result<T, StoreError> {
        if !self.read_only {
            self.begin_use(&|| false)?;
        }
        self.backend.bring(blob)?;
        match read(&self.folder, blob) {
            Err(StoreError::Damaged { digest }) => {
                if !self.read_only {
                    self.backend.quarantine(blob)?;
                }
                Err(StoreError::Damaged { digest })
            }
            other => other,
        }
    }

    /// How large the artifact of a blob is, by the head of its file; `None` where that cannot be read. Cheap: nothing is decoded.
    pub fn extent(&self, blob: &Blob) -> Option<Extent> {
        match blob.kind {
            ArtifactKind::Images => match self.file_of(blob) {
                Some(path) => exr::extent(BufReader::new(disk::open_regular(&path).ok()?)),
                // Small: by its bytes, as one layer.
                None => Some(Extent::Images { pixels: blob.bytes / 4, layers: 1 }),
            },
            // Tables are stored in fewer bytes than they have in memory.
            ArtifactKind::Table | ArtifactKind::Record => Some(Extent::Record { bytes: blob.bytes.saturating_mul(4) }),
        }
    }

    /// Publishes a record, after its blobs; it replaces an older one of the same key.
    ///
    /// Errors: a number in it that is not finite; a full disk.
    pub fn publish(&self, record: &InstanceRecord, recipe: &Recipe) -> Result<(), StoreError> {
        let bytes = record.encode(recipe)?;
        self.begin_use(&|| false)?;
        self.backend.publish(&record.key, &bytes)?;
        self.vouch(&record.key);
        Ok(())
    }

    /// The same store, of which its user says that no other machine is at work on it: what needs it alone is done on a network
    /// file system too.
    #[must_use]
    pub fn without_other_machines(mut self) -> Self {
        self.no_other_machine = true;
        self
    }

    /// Waits until no other run works on `key`, then takes in what other runs have published meanwhile: look the
    /// record up once more. Where the file system has no locks, two runs may do the same work; no harm.
    ///
    /// Error: [`StoreError::Cancelled`].
    pub fn lock(&self, key: &Digest, cancelled: &dyn Fn() -> bool) -> Result<KeyLock, StoreError> {
        self.begin_use(cancelled)?;
        let lock = self.locks.take(key, cancelled)?;
        self.refresh()?;
        Ok(lock)
    }

    /// The same without waiting: none where another run works on `key`. It waits for a `gc` alone, and takes nothing in.
    pub fn try_lock(&self, key: &Digest, cancelled: &dyn Fn() -> bool) -> Result<Option<KeyLock>, StoreError> {
        self.begin_use(cancelled)?;
        Ok(self.locks.try_take(key))
    }

    /// Whether another process is at work on `key`, as far as the system tells; creates nothing.
    pub fn is_at_work(&self, key: &Digest) -> bool {
        self.lock_path().with_file_name("keys").is_file() && self.locks.try_take(key).is_none()
    }

    /// Takes in what other runs have published meanwhile.
    pub fn refresh(&self) -> Result<(), StoreError> {
        self.folder.packs.refresh()
    }

    /// The record of an instance with what went in; `None` where it is damaged or gone.
    pub fn record_and_recipe(&self, key: &Digest) -> Option<(InstanceRecord, Recipe)> {
        InstanceRecord::decode(key, &self.told(self.backend.record(key))??)
    }

    /// All undamaged records with what went in, the newest first, whether or not their blobs are still there.
    pub fn records(&self) -> impl Iterator<Item = (InstanceRecord, Recipe)> {
        self.folder.packs.records().into_iter().filter_map(|(key, _)| self.record_and_recipe(&key))
    }

    /// Brings a blob here from the store elsewhere, if there is one and it is not here. Error: it cannot be read, or this one not be written.
    pub fn bring(&self, blob: &Blob) -> Result<(), StoreError> {
        self.backend.bring(blob)
    }

    /// The file that holds exactly this blob; `None` for a blob in a pack (see [`Store::materialise`]).
    pub fn file_of(&self, blob: &Blob) -> Option<PathBuf> {
        if self.folder.packs.blob_length(&blob.digest).is_some() {
            return None;
        }
        Some(self.folder.loose_path(blob)).filter(|path| path.is_file())
    }

    /// Where the bytes of a blob are: a file, from which byte on and how many. Bytes in a pack stay where they are until packs are
    /// rewritten, which makes new files. `None`: it is not here.
    pub fn place_of(&self, blob: &Blob) -> Option<(PathBuf, u64, u64)> {
        let packed = self.folder.packs.place_of(&blob.digest);
        packed.or_else(|| self.file_of(blob).map(|path| (path, 0, blob.bytes)))
    }

    /// The files and folders that look-ups of records with these blobs depend on: while none of them is touched, they find the same.
    pub fn watched<'a>(&self, blobs: impl Iterator<Item = &'a Blob>) -> Vec<PathBuf> {
        let loose = blobs.filter_map(|blob| self.file_of(blob));
        let own = ["format", "index", "packs"].map(|name| self.root.join(name));
        own.into_iter().chain(self.folder.packs.paths()).chain(loose).collect()
    }

    /// Writes a copy of a blob to `path`, verified, atomically. Errors as [`Store::bytes`].
    pub fn materialise(&self, blob: &Blob, path: &Path) -> Result<(), StoreError> {
        let bytes = self.bytes(blob)?;
        // The path may be in another file system than the store.
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        disk::publish_through(folder, path, &bytes, false, true).map_err(StoreError::io("write a copy", path))
    }

    /// Digests of all blobs that records name and that are there, sorted.
    pub fn digests(&self) -> Vec<Digest> {
        let records = self.folder.packs.records().into_iter();
        let mut all: Vec<_> = records
            .filter_map(|(key, _)| InstanceRecord::decode_head(&key, &self.told(self.folder.record_head(&key))??))
            .flat_map(|record| record.blobs().copied().collect::<Vec<_>>())
            .filter(|blob| self.told(self.folder.holds(blob)).unwrap_or(false))
            .map(|blob| blob.digest)
            .collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// Brings everything to the disk in the middle of long work, of which nothing so far is asked for again; gives back the room of
    /// what was released, if it is much. To be called when no other thread works on the store.
    ///
    /// Error: what was published could not be brought to the disk.
    pub fn settle(&self) -> Result<(), StoreError> {
        self.folder.packs.finish_for_now()?;
        self.gather_if_wanted();
        guard(&self.vouched).clear();
        Ok(())
    }

    /// Brings everything to the disk, writes the index, and leaves behind what was found damaged. To be called when no
    /// other thread works on the store. Nothing is lost without it, but the next opening is slower.
    ///
    /// The caller runs again what was dropped, and finishes once more.
    ///
    /// Error: what was published could not be brought to the disk.
    pub fn finish(&self) -> Result<Finished, StoreError> {
        self.close()?;
        let elsewhere = self.remote.as_ref().is_some_and(|remote| remote.take_shrunk());
        if !self.folder.packs.take_shrunk() && !elsewhere {
            return Ok(Finished::default());
        }
        let mut vouched = guard(&self.vouched);
        let dropped: BTreeSet<Digest> =
            vouched.iter().filter(|key| self.whole_record(key).is_none()).copied().collect();
        vouched.retain(|key| !dropped.contains(key));
        Ok(Finished { dropped })
    }

    fn close(&self) -> Result<(), StoreError> {
        if self.read_only {
            return Ok(());
        }
        self.folder.packs.finish()?;
        self.gather_if_wanted();
        Ok(())
    }

    fn gather_if_wanted(&self) {
        if self.folder.packs.wants_gathering() {
            // In use, no locks, a full disk, an old pack that cannot be read: the old packs hold everything until the new ones do, and the next run tries again.
            let _ = self.gather_packs(&BTreeSet::new());
        }
    }

    /// Takes the shared lock that keeps `gc` out, once.
    fn begin_use(&self, cancelled: &dyn Fn() -> bool) -> Result<(), StoreError> {
        let mut in_use = guard(&self.in_use);
        if in_use.is_none() {
            *in_use = Some(lock::poll(cancelled, || match lock::try_shared(&self.lock_path()) {
                Try::Taken(file) => Some(Use::Locked(file)),
                Try::Unsupported => Some(Use::Unlocked),
                Try::Held => None,
            })?);
            // A `gc` may have come between the opening and now.
            self.folder.packs.refresh()?;
        }
        Ok(())
    }

    fn lock_path(&self) -> PathBuf {
        self.root.join("locks").join("gc")
    }
}

impl Drop for Store {
    fn drop(&mut self) {
        // Whoever wants to know calls `finish`; nothing is lost here.
        let _ = self.close();
    }
}

/// Removes what killed processes were writing. What a living one writes is locked.
fn remove_leftovers(tmp: &Path) {
    leftover::sweep(tmp, disk::WRITING);
    for entry in fs::read_dir(tmp).into_iter().flatten().flatten() {
        let (prefix, age) = UNLOCKED;
        let unlocked = entry.file_name().to_str().is_some_and(|name| name.starts_with(prefix));
        if unlocked && leftover::is_older(&entry.path(), age) {
            // A folder or another user's file: `verify` and `gc` see to it.
            let _ = fs::remove_file(entry.path());
        }
    }
}
