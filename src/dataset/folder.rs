//! The folder of a data set: one builder at a time, files that appear whole, nothing of somebody else's touched.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::Write;
use std::path::{Path, PathBuf};

use sha2::{Digest as _, Sha256};

use super::manifest::{FORMAT, FileOf, Manifest, ShardOf};
use crate::leftover;
use crate::whole_file::{self, Synced};

const MANIFEST: &str = "dataset.json";
const LOCK: &str = ".turbid-lock";
const WRITING: &str = ".writing-";

/// A folder that this process builds in.
pub struct Folder {
    path: PathBuf,
    _lock: File,
}

/// Why a folder cannot be built in.
#[derive(Debug)]
pub enum Refused {
    /// The user's mistake.
    Input(String),
    Failed(String),
}

impl Folder {
    /// Opens or creates a folder for the data set. Refused: it holds something else, or somebody builds in it.
    pub fn open(path: &Path, pipeline: &str, dataset: &str) -> Result<(Self, Option<Manifest>), Refused> {
        let shown = path.display();
        let failed = |e: std::io::Error| Refused::Failed(format!("{shown}: {e}"));
        if path.exists() && !path.is_dir() {
            return Err(Refused::Input(format!("{shown} is no folder")));
        }
        let manifest = read(path).map_err(Refused::Input)?;
        let empty = match fs::read_dir(path) {
            Err(_) => true,
            // What an earlier build began is ours.
            Ok(entries) => !entries.flatten().any(|entry| !is_ours(&entry.file_name().to_string_lossy())),
        };
        match &manifest {
            Some(found) if !found.is_of(pipeline, dataset) => {
                let message = format!(
                    "{shown} holds the data set `{}` of pipeline `{}`, not `{dataset}` of `{pipeline}`; choose another folder",
                    found.dataset, found.pipeline
                );
                return Err(Refused::Input(message));
            }
            None if !empty => {
                let message = format!("{shown} is not empty and holds no data set; choose another folder");
                return Err(Refused::Input(message));
            }
            _ => {}
        }
        fs::create_dir_all(path.join("data")).map_err(failed)?;
        let lock = OpenOptions::new().create(true).truncate(false).write(true).open(path.join(LOCK)).map_err(failed)?;
        if let Err(TryLockError::WouldBlock) = lock.try_lock() {
            return Err(Refused::Input(format!(
                "{shown} is being built by another turbid; wait for it, or choose another folder"
            )));
        }
        for folder in [path.to_owned(), path.join("data")] {
            leftover::sweep(&folder, WRITING);
        }
        // Another builder may have ended since.
        let manifest = read(path).map_err(Refused::Input)?;
        Ok((Self { path: path.to_owned(), _lock: lock }, manifest))
    }

    /// Writes a file whole; what had its name is replaced. A file that holds these bytes already is left as it is.
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<FileOf, String> {
        let at = self.path.join(name);
        let of = FileOf { bytes: bytes.len() as u64, sha256: sha256(bytes) };
        if fs::metadata(&at).is_ok_and(|meta| meta.len() == of.bytes) && fs::read(&at).is_ok_and(|there| there == bytes)
        {
            return Ok(of);
        }
        let told = |e: std::io::Error| format!("{}: {e}", at.display());
        let folder = at.parent().unwrap_or(&self.path);
        let mut file = whole_file::begin(folder, WRITING).map_err(told)?;
        file.write_all(bytes).map_err(told)?;
        whole_file::place(file, &at, Synced::Bytes).map_err(told)?;
        Ok(of)
    }

    /// Gives a shard the name that it has now that there are more of them. What is not there, or was damaged, is no shard to keep.
    pub fn take_over(&self, shard: &ShardOf, to: &str) -> bool {
        let (from, to) = (self.path.join(&shard.file), self.path.join(to));
        let whole = fs::read(&from).is_ok_and(|bytes| sha256(&bytes) == shard.sha256);
        whole && (from == to || fs::rename(from, to).is_ok())
    }

    /// Removes shards that no longer belong to the data set.
    pub fn remove_others(&self, keep: &[String]) {
        for entry in fs::read_dir(self.path.join("data")).into_iter().flatten().flatten() {
            let name = format!("data/{}", entry.file_name().to_string_lossy());
            if name.ends_with(".parquet") && !keep.contains(&name) {
                drop(fs::remove_file(entry.path()));
            }
        }
    }

    pub fn keep(&self, manifest: &Manifest) -> Result<(), String> {
        let text = serde_json::to_string_pretty(manifest).map_err(|e| e.to_string())?;
        self.write(MANIFEST, (text + "\n").as_bytes()).map(drop)
    }
}

/// What a build leaves in a folder before its manifest is there.
fn is_ours(name: &str) -> bool {
    name == LOCK || name == "data" || name.starts_with(WRITING)
}

/// The manifest of a folder, if there is one. Error: it cannot be read, in words.
pub fn read(path: &Path) -> Result<Option<Manifest>, String> {
    let at = path.join(MANIFEST);
    let text = match fs::read_to_string(&at) {
        Ok(text) => text,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(format!("{}: {e}", at.display())),
    };
    let manifest: Manifest =
        serde_json::from_str(&text).map_err(|e| format!("{} is no manifest of a data set: {e}", at.display()))?;
    if manifest.format != FORMAT {
        return Err(format!("{}: format {} is not known to this turbid", at.display(), manifest.format));
    }
    Ok(Some(manifest))
}

pub fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}
