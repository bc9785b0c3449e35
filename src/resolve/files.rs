//! Input files of a run: the digest of each, and the content of those that are small.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, Weak};

use turbid_contract::Files;

use crate::digest::Digest;
use crate::input_file::{self, Refused};
use crate::missing::neighbours;

use super::InputFile;

/// Bytes of all files together that are kept in memory for the whole run; others are read again when a stage asks for them.
const KEPT: u64 = 128 << 20;

/// What is wrong with a file, and the way out.
pub type Wrong = (String, Option<String>);

/// Every file is hashed once.
#[derive(Default)]
pub struct InputFiles {
    known: Mutex<HashMap<PathBuf, Arc<Mutex<Known>>>>,
    /// Bytes of the contents that are kept.
    kept: AtomicU64,
}

#[derive(Default)]
struct Known {
    seen: Option<Seen>,
    kept: Option<Arc<[u8]>>,
    /// Content that a stage holds just now.
    lent: Option<Weak<[u8]>>,
}

enum Seen {
    Whole {
        digest: Digest,
        bytes: u64,
    },
    /// Not read: stages before allowed less.
    Larger {
        bytes: u64,
    },
    Wrong(Wrong),
}

/// Files that a stage may ask for.
#[derive(Default)]
pub struct Lent {
    pub files: Files,
    failed: Arc<Mutex<Option<String>>>,
}

impl Lent {
    /// Why a file that the stage asked for could not be read any more.
    pub fn failed(&self) -> Option<String> {
        self.failed.lock().expect("no holder panics").clone()
    }
}

impl InputFiles {
    fn entry(&self, path: &Path) -> Arc<Mutex<Known>> {
        self.known.lock().expect("no holder panics").entry(path.to_path_buf()).or_default().clone()
    }

    /// The digest of a file of at most `most` bytes.
    pub fn digest(&self, path: &Path, most: u64) -> Result<Digest, Wrong> {
        let entry = self.entry(path);
        let mut known = held(&entry);
        if matches!(known.seen, Some(Seen::Larger { bytes }) if bytes <= most) {
            known.seen = None;
        }
        let known = &mut *known;
        match known.seen.get_or_insert_with(|| self.see(path, most, &mut known.kept)) {
            Seen::Whole { digest, bytes } if *bytes <= most => Ok(*digest),
            Seen::Whole { bytes, .. } | Seen::Larger { bytes } => Err(too_large(path, *bytes, most)),
            Seen::Wrong(wrong) => Err(wrong.clone()),
        }
    }

    fn see(&self, path: &Path, most: u64, kept: &mut Option<Arc<[u8]>>) -> Seen {
        let small = KEPT.saturating_sub(self.kept.load(Ordering::Relaxed)).min(most);
        let seen = match input_file::read(path, small) {
            Ok(bytes) => {
                let (digest, size) = (Digest::of(&bytes), bytes.len() as u64);
                self.kept.fetch_add(size, Ordering::Relaxed);
                *kept = Some(bytes);
                Ok((digest, size))
            }
            Err(Refused::Larger { .. }) => input_file::digest(path, most),
            Err(refused) => Err(refused),
        };
        match seen {
            Ok((digest, bytes)) => Seen::Whole { digest, bytes },
            Err(Refused::Larger { bytes, .. }) => Seen::Larger { bytes },
            Err(Refused::Odd(what)) => {
                let way_out = "name a regular file; a link to one will do".to_owned();
                Seen::Wrong((format!("{}: this is {what}, not a regular file", path.display()), Some(way_out)))
            }
            Err(refused) => {
                let missing = matches!(refused, Refused::Io(_));
                Seen::Wrong((format!("{}: {refused}", path.display()), missing.then(|| neighbours(path)).flatten()))
            }
        }
    }

    /// Those that were read, with what they held.
    pub fn read(&self) -> Vec<(PathBuf, Digest)> {
        let known = self.known.lock().expect("no holder panics");
        let digest = |known: &Known| match known.seen {
            Some(Seen::Whole { digest, .. }) => Some(digest),
            _ => None,
        };
        let mut read: Vec<(PathBuf, Digest)> =
            known.iter().filter_map(|(path, known)| Some((path.clone(), digest(&held(known))?))).collect();
        read.sort();
        read
    }

    /// The files of an instance, as they were when they were hashed. With `again` what is kept is compared with the files at once:
    /// a run is told of those that vanished or changed since.
    pub fn lend(self: &Arc<Self>, files: &BTreeMap<String, InputFile>, again: bool) -> Result<Lent, String> {
        let mut lent = Lent::default();
        for (at, file) in files {
            let kept = held(&self.entry(&file.path)).kept.clone();
            if again && kept.is_some() {
                let (digest, _) = input_file::digest(&file.path, file.most).map_err(|refused| lost(file, &refused))?;
                unchanged(file, digest)?;
            }
            match kept {
                Some(bytes) => lent.files.insert(at.clone(), bytes),
                None => {
                    let (all, file, failed) = (self.clone(), file.clone(), lent.failed.clone());
                    let read = move || match all.content(&file) {
                        Ok(bytes) => Some(bytes),
                        Err(message) => {
                            *failed.lock().expect("no holder panics") = Some(message);
                            None
                        }
                    };
                    lent.files.insert_read(at.clone(), Arc::new(read));
                }
            }
        }
        Ok(lent)
    }

    /// Content of a file that is too large to keep. Stages that run at a time share it.
    fn content(&self, file: &InputFile) -> Result<Arc<[u8]>, String> {
        let entry = self.entry(&file.path);
        let mut known = held(&entry);
        if let Some(bytes) = known.lent.as_ref().and_then(Weak::upgrade) {
            return Ok(bytes);
        }
        let bytes = input_file::read(&file.path, file.most).map_err(|refused| lost(file, &refused))?;
        unchanged(file, Digest::of(&bytes))?;
        known.lent = Some(Arc::downgrade(&bytes));
        Ok(bytes)
    }
}

fn held(entry: &Mutex<Known>) -> MutexGuard<'_, Known> {
    entry.lock().expect("no holder panics")
}

/// Whether what was read now is what was hashed before.
fn unchanged(file: &InputFile, digest: Digest) -> Result<(), String> {
    if digest == file.digest {
        return Ok(());
    }
    Err(format!("{} changed during the run; run again", file.path.display()))
}

fn lost(file: &InputFile, refused: &Refused) -> String {
    match refused {
        Refused::Io(_) => format!("{} vanished during the run: {refused}", file.path.display()),
        _ => format!("{} changed during the run: {refused}; run again", file.path.display()),
    }
}

fn too_large(path: &Path, bytes: u64, most: u64) -> Wrong {
    let refused = Refused::Larger { bytes, most };
    let enough = bytes.div_ceil(1_000_000);
    let way_out = format!("where it is meant to be so large, `max_file_mb: {enough}` among the params lets it in");
    (format!("{}: {refused}", path.display()), Some(way_out))
}
