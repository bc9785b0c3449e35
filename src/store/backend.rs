//! Where the bytes of records and blobs are kept: a folder, alone or with a store elsewhere behind it (`remote/through.rs`).

use std::fs::Metadata;
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;
use turbid_contract::ArtifactKind;

use crate::digest::Digest;
use crate::store::compared::Compared;
use crate::store::disk;
use crate::store::error::StoreError;
use crate::store::frame::Kind;
use crate::store::odd;
use crate::store::packs::Packs;
use crate::store::record::Blob;

/// Blobs shorter than this go into packs.
pub(super) const PACKED_BELOW: u64 = 64 << 10;

/// Keeps bytes by digest (blobs) and by key (records). Knows no codec; calls may come from any thread.
pub(super) trait Backend: Send + Sync {
    /// The bytes of a record; `None` where there is none, or a damaged one. Error (here and below): it cannot be read.
    fn record(&self, key: &Digest) -> Result<Option<Vec<u8>>, StoreError>;
    /// At least the head of a record, not checked beyond its name; fast.
    fn record_head(&self, key: &Digest) -> Result<Option<Vec<u8>>, StoreError>;
    /// Replaces the record. The blobs that it names have been written before.
    fn publish(&self, key: &Digest, bytes: &[u8]) -> Result<(), StoreError>;
    /// Whether the blob is there in full length; cheap, its bytes are not read.
    fn holds(&self, blob: &Blob) -> Result<bool, StoreError>;
    /// The bytes, as they are: the caller checks the digest. `None` where there are none.
    fn read(&self, blob: &Blob) -> Result<Option<Vec<u8>>, StoreError>;
    /// Makes a blob one of this machine, as a file if it is large, where it is to be had elsewhere.
    fn bring(&self, blob: &Blob) -> Result<(), StoreError>;
    /// Writes a blob; nothing happens where the same bytes are there already.
    fn write(&self, blob: &Blob, bytes: &[u8]) -> Result<(), StoreError>;
    /// Sets a damaged blob aside, so that the backend does not hold it any more.
    fn quarantine(&self, blob: &Blob) -> Result<(), StoreError>;
}

/// A folder of the local file system: small pieces in packs, large blobs as files of their own.
pub(super) struct Folder {
    root: PathBuf,
    pub packs: Packs,
    /// What need not be compared with its digest again.
    pub compared: Compared,
}

pub fn extension(kind: ArtifactKind) -> &'static str {
    match kind {
        ArtifactKind::Images => "exr",
        ArtifactKind::Table | ArtifactKind::Record => "parquet",
    }
}

impl Folder {
    /// `among_many`: as [`Packs::open`] says.
    pub fn open(root: &Path, among_many: bool) -> Result<Self, StoreError> {
        Ok(Self { root: root.to_owned(), packs: Packs::open(root, among_many)?, compared: Compared::default() })
    }

    /// The folder of the store.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Publishes a temporary file that holds all bytes of a large blob.
    pub fn take_file(&self, blob: &Blob, file: NamedTempFile) -> Result<(), StoreError> {
        let path = self.loose_path(blob);
        disk::publish_file(&self.root, file, &path, true, true).map_err(StoreError::io("write a blob", &path))
    }

    /// Where a loose blob lies: `blobs/ab/abcd....exr`.
    pub fn loose_path(&self, blob: &Blob) -> PathBuf {
        let name = blob.digest.to_string();
        let mut path = self.root.join("blobs");
        path.push(&name[..2]);
        path.push(format!("{name}.{}", extension(blob.kind)));
        path
    }

    /// All loose blobs: digest, path, length. Other files in the folder are not blobs. Error: one cannot be looked at.
    pub fn loose(&self) -> Result<Vec<(Digest, PathBuf, u64)>, StoreError> {
        let list = |folder: &Path| disk::list(folder).map_err(StoreError::io("read the store", folder));
        let mut found = Vec::new();
        for folder in list(&self.root.join("blobs"))? {
            for path in list(&folder)? {
                let digest = path.file_stem().and_then(|stem| stem.to_str()).and_then(|stem| stem.parse().ok());
                let Some(digest) = digest else { continue };
                let meta = disk::look(&path).map_err(StoreError::io("read the store", &path))?;
                if let Some(meta) = meta.filter(Metadata::is_file) {
                    found.push((digest, path, meta.len()));
                }
            }
        }
        found.sort();
        Ok(found)
    }

    /// Moves a loose file, or what stands in its place, to quarantine.
    pub fn set_aside(&self, path: &Path) -> Result<(), StoreError> {
        odd::set_aside(&self.root, path).map_err(StoreError::io("move a damaged blob to quarantine", path))
    }

    /// Makes the store forget a packed blob; its bytes, as they are, go into quarantine.
    fn set_packed_aside(&self, blob: &Blob, bytes: &[u8]) -> Result<(), StoreError> {
        self.packs.note_damage();
        let path = self.root.join("quarantine").join(format!("{}.{}", blob.digest, extension(blob.kind)));
        // Forgetting matters; a copy of the damaged bytes is only for people.
        let _ = disk::publish(&self.root, &path, bytes, false, false);
        self.packs.append(Kind::ForgetBlob, &blob.digest, &[])
    }
}

impl Backend for Folder {
    fn record(&self, key: &Digest) -> Result<Option<Vec<u8>>, StoreError> {
        self.packs.record(key).map_err(StoreError::io("read a record", &self.root.join("packs")))
    }

    fn record_head(&self, key: &Digest) -> Result<Option<Vec<u8>>, StoreError> {
        self.packs.record_head(key).map_err(StoreError::io("read a record", &self.root.join("packs")))
    }

    fn publish(&self, key: &Digest, bytes: &[u8]) -> Result<(), StoreError> {
        self.packs.append(Kind::Record, key, bytes)
    }

    fn holds(&self, blob: &Blob) -> Result<bool, StoreError> {
        match self.packs.blob_length(&blob.digest) {
            Some(length) => Ok(length == blob.bytes),
            None if blob.bytes < PACKED_BELOW => Ok(false),
            None => {
                let path = self.loose_path(blob);
                let meta = disk::look(&path).map_err(StoreError::io("look for a blob", &path))?;
                Ok(meta.is_some_and(|m| m.is_file() && m.len() == blob.bytes))
            }
        }
    }

    fn read(&self, blob: &Blob) -> Result<Option<Vec<u8>>, StoreError> {
        let packed = self.packs.blob(&blob.digest);
        if let Some(bytes) = packed.map_err(StoreError::io("read a blob", &self.root.join("packs")))? {
            return Ok(Some(bytes));
        }
        let path = self.loose_path(blob);
        // No longer than the record says: a damaged file must not decide how much memory is taken.
        let read = disk::open_regular(&path).and_then(|file| {
            let length = file.metadata()?.len().min(blob.bytes + 1);
            disk::read_at(&file, 0, length as usize)
        });
        match read {
            Ok(bytes) => Ok(Some(bytes)),
            Err(e) if disk::is_absent(&e) => Ok(None),
            Err(e) => Err(StoreError::io("read a blob", &path)(e)),
        }
    }

    fn bring(&self, _: &Blob) -> Result<(), StoreError> {
        Ok(())
    }

    fn write(&self, blob: &Blob, bytes: &[u8]) -> Result<(), StoreError> {
        let there = self.read(blob);
        if matches!(self.holds(blob), Ok(true)) && matches!(&there, Ok(Some(there)) if there == bytes) {
            return Ok(());
        }
        if blob.bytes < PACKED_BELOW {
            return self.packs.append(Kind::Blob, &blob.digest, bytes);
        }
        let path = self.loose_path(blob);
        // Only what was read and is wrong: another instance may be publishing the same bytes right now, and if the disk
        // is full there must be no moment without them. What cannot be read is replaced.
        if matches!(there, Ok(Some(_))) {
            self.set_aside(&path)?;
        }
        disk::publish(&self.root, &path, bytes, true, true).map_err(StoreError::io("write a blob", &path))
    }

    fn quarantine(&self, blob: &Blob) -> Result<(), StoreError> {
        match self.packs.blob(&blob.digest) {
            Ok(Some(bytes)) => self.set_packed_aside(blob, &bytes),
            Ok(None) if self.packs.blob_length(&blob.digest).is_none() => self.set_aside(&self.loose_path(blob)),
            // No bytes for people to look at.
            _ => self.packs.append(Kind::ForgetBlob, &blob.digest, &[]),
        }
    }
}
