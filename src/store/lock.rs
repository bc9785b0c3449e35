//! Locks between processes (flock, bound to the open file: a killed process leaves none) and between threads.

use std::collections::{HashMap, HashSet};
use std::fs::{self, File, OpenOptions, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use crate::digest::Digest;
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

fn open(path: &Path) -> Option<File> {
    let open = || disk::open_regular_with(path, OpenOptions::new().create(true).truncate(false).read(true).write(true));
    open().or_else(|_| fs::create_dir_all(path.parent().unwrap_or(path)).and_then(|()| open())).ok()
}

fn attempt(path: &Path, lock: impl Fn(&File) -> Result<(), TryLockError>) -> Try {
    #[cfg(test)]
    match fake::get() {
        fake::Locks::Real => {}
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

/// The locks on keys that this process holds: exact between its threads, 256 stripes between processes.
#[derive(Clone)]
pub(super) struct KeyLocks {
    folder: PathBuf,
    held: Arc<Mutex<Held>>,
}

#[derive(Default)]
struct Held {
    keys: HashSet<Digest>,
    /// Stripe -> keys of this process in it, and the locked file (none where locks are not supported).
    stripes: HashMap<u8, (usize, Option<File>)>,
}

impl KeyLocks {
    pub fn new(root: &Path) -> Self {
        Self { folder: root.join("locks"), held: Arc::default() }
    }

    /// Waits until no other thread and no other process holds `key`.
    pub fn take(&self, key: &Digest, cancelled: &dyn Fn() -> bool) -> Result<KeyLock, StoreError> {
        poll(cancelled, || self.attempt(key).then(|| KeyLock { key: *key, held: self.held.clone() }))
    }

    fn attempt(&self, key: &Digest) -> bool {
        let mut held = guard(&self.held);
        if held.keys.contains(key) {
            return false;
        }
        let stripe = key.0[0];
        if let Some((keys, _)) = held.stripes.get_mut(&stripe) {
            *keys += 1;
        } else {
            match try_exclusive(&self.folder.join(format!("{stripe:02x}"))) {
                Try::Taken(file) => held.stripes.insert(stripe, (1, Some(file))),
                Try::Unsupported => held.stripes.insert(stripe, (1, None)),
                Try::Held => return false,
            };
        }
        held.keys.insert(*key)
    }
}

/// Keeps a key to its holder until it is dropped.
pub struct KeyLock {
    key: Digest,
    held: Arc<Mutex<Held>>,
}

impl Drop for KeyLock {
    fn drop(&mut self) {
        let mut held = guard(&self.held);
        held.keys.remove(&self.key);
        let stripe = self.key.0[0];
        if let Some((keys, _)) = held.stripes.get_mut(&stripe) {
            *keys -= 1;
            if *keys == 0 {
                held.stripes.remove(&stripe);
            }
        }
    }
}

/// File systems whose locks are none, for the calling test.
#[cfg(test)]
pub(super) mod fake {
    use std::cell::Cell;

    #[derive(Clone, Copy, PartialEq, Eq)]
    pub enum Locks {
        Real,
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
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    fn key(first: u8, last: u8) -> Digest {
        let mut key = Digest([0; 32]);
        (key.0[0], key.0[31]) = (first, last);
        key
    }

    /// Two handles stand for two processes: flock belongs to the open file, not to the process.
    #[test]
    fn one_holder_per_key_and_cancel_ends_the_wait() {
        let folder = tempfile::tempdir().unwrap();
        let (here, there) = (KeyLocks::new(folder.path()), KeyLocks::new(folder.path()));
        let first = here.take(&key(1, 1), &|| false).unwrap();
        let neighbour =
            here.take(&key(1, 2), &|| false).expect("another key of the stripe does not wait in its process");
        let tries = AtomicUsize::new(0);
        let give_up = || tries.fetch_add(1, Ordering::Relaxed) > 2;
        assert!(matches!(here.take(&key(1, 1), &give_up), Err(StoreError::Cancelled)));
        assert!(matches!(there.take(&key(1, 1), &|| true), Err(StoreError::Cancelled)));
        drop(first);
        assert!(matches!(there.take(&key(1, 1), &|| true), Err(StoreError::Cancelled)), "the stripe is still held");
        drop(neighbour);
        let second = there.take(&key(1, 1), &|| true).expect("it is free now");
        there.take(&key(2, 1), &|| true).expect("another stripe is free");
        drop(second);
    }

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

    #[test]
    fn threads_exclude_each_other() {
        let folder = tempfile::tempdir().unwrap();
        let handles = [KeyLocks::new(folder.path()), KeyLocks::new(folder.path())];
        let inside = AtomicUsize::new(0);
        std::thread::scope(|scope| {
            for i in 0..4 {
                let (locks, inside) = (&handles[i % 2], &inside);
                scope.spawn(move || {
                    for _ in 0..10 {
                        let _lock = locks.take(&key(9, 9), &|| false).unwrap();
                        assert_eq!(inside.fetch_add(1, Ordering::SeqCst), 0);
                        inside.fetch_sub(1, Ordering::SeqCst);
                    }
                });
            }
        });
    }
}
