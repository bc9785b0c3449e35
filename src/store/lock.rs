//! Locks between processes (flock, bound to the process: a killed one leaves none) and between threads.

use std::collections::{HashMap, HashSet};
use std::fs::{self, File, OpenOptions, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use crate::digest::Digest;
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

fn open(path: &Path) -> Option<File> {
    let open = || OpenOptions::new().create(true).truncate(false).read(true).write(true).open(path);
    open().or_else(|_| fs::create_dir_all(path.parent().unwrap_or(path)).and_then(|()| open())).ok()
}

fn attempt(path: &Path, lock: impl Fn(&File) -> Result<(), TryLockError>) -> Try {
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
        let mut held = self.held.lock().expect("no holder panics");
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
        let mut held = self.held.lock().expect("no holder panics");
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
