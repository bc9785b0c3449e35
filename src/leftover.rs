//! Temporary files that a killed process left behind: told from living ones by the lock that their writer holds.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::path::Path;
use std::time::{Duration, SystemTime};

/// Where locks tell nothing, a temporary file that was not written to for so long belongs to nobody.
const SURELY_DEAD: Duration = Duration::from_secs(86_400);

/// Marks a temporary file as being written, until it is closed or its process dies. Without locks its age has to tell.
pub(crate) fn hold(file: &File) {
    // Should [`sweep`] hold it at this moment, the file is about to go, and whoever renames it finds that out.
    drop(file.try_lock());
}

/// Removes the files in `folder` whose names begin with `prefix` and that no living process writes.
pub(crate) fn sweep(folder: &Path, prefix: &str) {
    sweep_those(folder, &|name| name.starts_with(prefix));
}

/// The same of files that are told by their `names`.
///
/// Best effort: what cannot be removed (another user's) is left.
pub(crate) fn sweep_those(folder: &Path, names: &dyn Fn(&str) -> bool) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let ours = entry.file_name().to_str().is_some_and(names);
        if ours && entry.file_type().is_ok_and(|kind| kind.is_file()) && is_dead(&entry.path()) {
            drop(fs::remove_file(entry.path()));
        }
    }
}

fn is_dead(path: &Path) -> bool {
    // Locks of network file systems need a file that may be written to.
    let open = || OpenOptions::new().read(true).write(true).open(path);
    let Ok(file) = open() else { return is_older(path, SURELY_DEAD) };
    #[cfg(test)]
    let _steady = crate::child::none_starts();
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => false,
        // A lock that keeps nobody out says nothing about a writer either.
        Ok(()) if matches!(open().map(|second| second.try_lock()), Ok(Err(TryLockError::WouldBlock))) => true,
        _ => is_older(path, SURELY_DEAD),
    }
}

/// Whether a file was last written to longer than `age` ago.
pub(crate) fn is_older(path: &Path, age: Duration) -> bool {
    fs::metadata(path).is_ok_and(|meta| is_past(&meta, age))
}

/// The same of a file of which this is known.
pub(crate) fn is_past(meta: &fs::Metadata, age: Duration) -> bool {
    meta.modified().is_ok_and(|time| SystemTime::now().duration_since(time).is_ok_and(|since| since > age))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_the_dead_go_and_those_of_the_living_stay() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let living = File::create(path("writing-living")).unwrap();
        hold(&living);
        drop(File::create(path("writing-dead")).unwrap());
        drop(File::create(path("another")).unwrap());
        sweep(folder.path(), "writing-");
        assert_eq!(["writing-living", "writing-dead", "another"].map(|n| path(n).exists()), [true, false, true]);
        drop(living);
        sweep(folder.path(), "writing-");
        assert!(!path("writing-living").exists());
    }
}
