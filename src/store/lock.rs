//! Locks of files between processes (flock, which belongs to the opened file: a killed process leaves none).

use std::fs::{self, File, OpenOptions, TryLockError};
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use crate::store::disk;
use crate::store::error::StoreError;

const FIRST_WAIT: Duration = Duration::from_millis(1);
const LONGEST_WAIT: Duration = Duration::from_millis(50);

/// How an attempt to lock ended.
pub(super) enum Try {
    Taken(File),
    Held,
    /// The file system has no locks (or no room for the file): whoever goes on may do work twice, no harm.
    Unsupported,
}

/// What a mutex guards, whether or not a thread panicked with it: what the store guards is whole after every step.
pub(super) fn guard<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A file to lock; made, with its folder, where there is none.
pub(super) fn open(path: &Path) -> Option<File> {
    let open = || disk::open_regular_with(path, OpenOptions::new().create(true).truncate(false).read(true).write(true));
    open().or_else(|_| fs::create_dir_all(path.parent().unwrap_or(path)).and_then(|()| open())).ok()
}

fn attempt(path: &Path, lock: impl Fn(&File) -> Result<(), TryLockError>) -> Try {
    #[cfg(test)]
    match fake::get() {
        fake::Locks::Real | fake::Locks::NoBytes => {}
        fake::Locks::None => return Try::Unsupported,
        fake::Locks::Hollow => return open(path).map_or(Try::Unsupported, Try::Taken),
    }
    #[cfg(test)]
    let _steady = crate::child::none_starts();
    let Some(file) = open(path) else { return Try::Unsupported };
    match lock(&file) {
        Ok(()) => Try::Taken(file),
        Err(TryLockError::WouldBlock) => Try::Held,
        Err(TryLockError::Error(_)) => Try::Unsupported,
    }
}

pub(super) fn try_exclusive(path: &Path) -> Try {
    attempt(path, File::try_lock)
}

pub(super) fn try_shared(path: &Path) -> Try {
    attempt(path, File::try_lock_shared)
}

/// Whether a lock on the file at `path`, which the caller has just taken, keeps others out: a second opening of the same
/// file must be refused an exclusive lock.
///
/// flock belongs to the open file, not to the process, so what is refused to a second opening here is refused to every
/// process that shares this kernel's locks. Not proven, and false here: a lock call that is missing or that always
/// succeeds, locks that belong to processes (some network file systems), a lock file that was removed or replaced.
pub(super) fn is_exclusive(path: &Path) -> bool {
    matches!(try_exclusive(path), Try::Held)
}

/// Calls `attempt` until it yields something, less and less often. Error: cancelled.
pub(super) fn poll<T>(cancelled: &dyn Fn() -> bool, mut attempt: impl FnMut() -> Option<T>) -> Result<T, StoreError> {
    let mut wait = FIRST_WAIT;
    loop {
        if let Some(got) = attempt() {
            return Ok(got);
        }
        if cancelled() {
            return Err(StoreError::Cancelled);
        }
        std::thread::sleep(wait);
        wait = (2 * wait).min(LONGEST_WAIT);
    }
}

/// File systems whose locks are none, for the calling test.
#[cfg(test)]
pub(super) mod fake {
    use std::cell::Cell;

    #[derive(Clone, Copy, PartialEq, Eq)]
    pub enum Locks {
        Real,
        /// There is flock, but no locks of single bytes.
        NoBytes,
        /// Every call fails.
        None,
        /// Every call succeeds, and nobody is kept out.
        Hollow,
    }

    thread_local!(static LOCKS: Cell<Locks> = const { Cell::new(Locks::Real) });

    pub fn set(locks: Locks) {
        LOCKS.set(locks);
    }

    pub fn get() -> Locks {
        LOCKS.get()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lock_that_keeps_nobody_out_is_no_lock() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lock");
        assert!(!is_exclusive(&path), "nobody holds it");
        let Try::Taken(held) = try_exclusive(&path) else { panic!("it is free") };
        assert!(is_exclusive(&path));
        fs::remove_file(&path).unwrap();
        assert!(!is_exclusive(&path), "another file of this name says nothing about the held one");
        drop(held);
        for (locks, taken) in [(fake::Locks::None, false), (fake::Locks::Hollow, true)] {
            fake::set(locks);
            let attempt = try_exclusive(&path);
            assert_eq!((matches!(attempt, Try::Taken(_)), is_exclusive(&path)), (taken, false));
        }
        fake::set(fake::Locks::Real);
    }
}
