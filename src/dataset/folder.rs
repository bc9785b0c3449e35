//! The folder of a data set: one builder at a time, files that appear whole, nothing of somebody else's touched.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::Write;
use std::path::{Path, PathBuf};

use sha2::{Digest as _, Sha256};

use super::feature::Values;
use super::format::Format;
use super::manifest::{ColumnOf, FORMAT, FileOf, Manifest, ShardOf};
use super::{shard, webdataset};
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
    pub fn open(
        path: &Path,
        pipeline: &str,
        dataset: &str,
        format: Format,
    ) -> Result<(Self, Option<Manifest>), Refused> {
        let shown = path.display();
        let failed = |e: std::io::Error| Refused::Failed(format!("{shown}: {e}"));
        Self::fits(path, pipeline, dataset, format)?;
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

    /// Whether a build of the data set may go to that folder. Refused: it holds something else.
    pub fn fits(path: &Path, pipeline: &str, dataset: &str, format: Format) -> Result<(), Refused> {
        let shown = path.display();
        if path.exists() && !path.is_dir() {
            return Err(Refused::Input(format!("{shown} is no folder")));
        }
        let Some(found) = read(path).map_err(Refused::Input)? else {
            // What an earlier build began is ours.
            let mut entries = fs::read_dir(path).into_iter().flatten().flatten();
            if entries.any(|entry| !is_ours(&entry.file_name().to_string_lossy())) {
                let message = format!("{shown} is not empty and holds no data set; choose another folder");
                return Err(Refused::Input(message));
            }
            return Ok(());
        };
        found.holds(path, pipeline, dataset).map_err(|e| Refused::Input(format!("{e}; choose another folder")))?;
        if found.shard_format != format {
            let (has, asked) = (found.shard_format.name(), format.name());
            let message = format!(
                "{shown} holds `{dataset}` with shards of the format {has}, not {asked}; choose another folder, or `--format {has}`"
            );
            return Err(Refused::Input(message));
        }
        Ok(())
    }

    /// Writes a file whole; what had its name is replaced. A file that holds these bytes already is left as it is.
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<FileOf, String> {
        let at = self.path.join(name);
        let of = FileOf { bytes: bytes.len() as u64, sha256: sha256(bytes) };
        if fs::metadata(&at).is_ok_and(|meta| meta.len() == of.bytes) && fs::read(&at).is_ok_and(|there| there == bytes)
        {
            return Ok(of);
        }
        let told = |e: std::io::Error| unwritten(&at, &e);
        let folder = at.parent().unwrap_or(&self.path);
        let mut file = whole_file::begin(folder, WRITING).map_err(told)?;
        file.write_all(bytes).map_err(told)?;
        whole_file::place(file, &at, Synced::Bytes).map_err(told)?;
        Ok(of)
    }

    /// Gives a shard the name that it has now that there are more of them. What is not there, or was damaged, is no shard to keep.
    pub fn take_over(&self, shard: &ShardOf, to: &str) -> bool {
        let (from, to) = (self.path.join(&shard.file), self.path.join(to));
        let whole = |at: &Path| fs::read(at).is_ok_and(|bytes| sha256(&bytes) == shard.sha256);
        // A build that was killed may have given it the name and not told the manifest.
        whole(&to) || (from != to && whole(&from) && fs::rename(from, to).is_ok())
    }

    /// What a row of a shard holds of these features. Error: in words.
    pub fn values(
        &self,
        shard: &ShardOf,
        format: Format,
        features: &[ColumnOf],
        row: usize,
    ) -> Result<Vec<Values>, String> {
        let bytes = self.read(shard)?;
        let found = match format {
            Format::Parquet => shard::values(bytes, features, row),
            Format::WebDataset => webdataset::values(&bytes, features, row),
        };
        found.map_err(|e| format!("{}: {e}", shard.file))
    }

    /// The values of a feature that is a number in all rows of a shard; NaN where one is not known. Error: in words.
    pub fn numbers(&self, shard: &ShardOf, format: Format, feature: &ColumnOf) -> Result<Vec<f64>, String> {
        let bytes = self.read(shard)?;
        let found = match format {
            Format::Parquet => shard::numbers(bytes, feature),
            Format::WebDataset => webdataset::numbers(&bytes, feature),
        };
        found.map_err(|e| format!("{}: {e}", shard.file))
    }

    fn read(&self, shard: &ShardOf) -> Result<Vec<u8>, String> {
        let at = self.path.join(&shard.file);
        fs::read(&at).map_err(|e| format!("{}: {e}", at.display()))
    }

    /// Brings the names of all that was written to the disk.
    pub fn sync(&self) -> Result<(), String> {
        let synced =
            whole_file::sync_folder(&self.path.join("data")).and_then(|()| whole_file::sync_folder(&self.path));
        synced.map_err(|e| format!("{}: {e}", self.path.display()))
    }

    /// Removes shards that no longer belong to the data set.
    pub fn remove_others(&self, keep: &[String]) {
        for entry in fs::read_dir(self.path.join("data")).into_iter().flatten().flatten() {
            let name = format!("data/{}", entry.file_name().to_string_lossy());
            if Format::is_shard(&name) && !keep.contains(&name) {
                drop(fs::remove_file(entry.path()));
            }
        }
    }

    pub fn keep(&self, manifest: &Manifest) -> Result<(), String> {
        let text = serde_json::to_string_pretty(manifest).map_err(|e| e.to_string())?;
        self.write(MANIFEST, (text + "\n").as_bytes()).map(drop)
    }
}

/// Why a file could not be written, with the way out where it is room that lacks.
fn unwritten(at: &Path, error: &std::io::Error) -> String {
    use std::io::ErrorKind::{FileTooLarge, QuotaExceeded, StorageFull};
    match error.kind() {
        StorageFull | QuotaExceeded | FileTooLarge => format!(
            "cannot write {}: the disk is full; what was finished is kept: free some space (`turbid cache gc --max-size`), or move the \
             folder to another disk, and build again with the same command",
            at.display()
        ),
        _ => format!("{}: {error}", at.display()),
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
