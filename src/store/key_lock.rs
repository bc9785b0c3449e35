//! Locks on keys: one holder for each key among all threads of all processes.

use std::collections::{HashMap, HashSet};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use crate::digest::Digest;
use crate::store::disk::{self, Identity};
use crate::store::error::StoreError;
use crate::store::kernel;
use crate::store::lock::{self, Try, guard};

/// Files of locks where a system has none for single bytes.
const STRIPES: u64 = 4096;

/// The locks on keys that this process holds.
///
/// Exact between its threads. Between processes a key is one byte of the file `locks/keys`, at the place that 62 bits of the key
/// name; where a system or a file system has no such locks, one of 4096 files, which several keys share. Nobody reads the file.
#[derive(Clone)]
pub(super) struct KeyLocks {
    folder: PathBuf,
    held: Arc<Mutex<Held>>,
}

#[derive(Default)]
struct Held {
    keys: HashSet<Digest>,
    /// How many keys of this process share a place, and what keeps other processes out of it.
    places: HashMap<Place, (usize, Guard)>,
    /// The file of bytes, as it was opened last.
    bytes: Option<(Arc<File>, Identity)>,
    /// Whether there are no locks of bytes.
    in_stripes: bool,
}

#[derive(Clone, Copy, PartialEq, Eq, Hash)]
enum Place {
    Byte(u64),
    Stripe(u64),
}

/// Keeps other processes out of a place.
enum Guard {
    Byte(Arc<File>),
    #[expect(dead_code, reason = "held, not read: closing the file gives the lock back")]
    Stripe(File),
    /// There are no locks: others may do the same work, no harm.
    None,
}

impl KeyLocks {
    pub fn new(root: &Path) -> Self {
        Self { folder: root.join("locks"), held: Arc::default() }
    }

    /// Waits until no other thread and no other process holds `key`.
    pub fn take(&self, key: &Digest, cancelled: &dyn Fn() -> bool) -> Result<KeyLock, StoreError> {
        lock::poll(cancelled, || self.try_take(key))
    }

    /// The lock, if nobody holds `key`.
    pub fn try_take(&self, key: &Digest) -> Option<KeyLock> {
        let mut held = guard(&self.held);
        if held.keys.contains(key) {
            return None;
        }
        let place = self.take_place(&mut held, key.first_u64())?;
        held.keys.insert(*key);
        Some(KeyLock { key: *key, place, held: self.held.clone() })
    }

    /// `None`: another process has the place.
    fn take_place(&self, held: &mut Held, number: u64) -> Option<Place> {
        if !held.in_stripes {
            let place = Place::Byte(number >> 2);
            match held.share(place) || self.lock_byte(held, number >> 2)? {
                true => return Some(place),
                false => held.in_stripes = true,
            }
        }
        let place = Place::Stripe(number % STRIPES);
        if !held.share(place) {
            let guard = match lock::try_exclusive(&self.folder.join(format!("{:03x}", number % STRIPES))) {
                Try::Taken(file) => Guard::Stripe(file),
                Try::Unsupported => Guard::None,
                Try::Held => return None,
            };
            held.places.insert(place, (1, guard));
        }
        Some(place)
    }

    /// Whether the byte was locked; `false`: there are no such locks. `None`: another process has it.
    fn lock_byte(&self, held: &mut Held, offset: u64) -> Option<bool> {
        #[cfg(test)]
        match lock::fake::get() {
            lock::fake::Locks::Real => {}
            lock::fake::Locks::NoBytes | lock::fake::Locks::None => return Some(false),
            lock::fake::Locks::Hollow => {
                held.places.insert(Place::Byte(offset), (1, Guard::None));
                return Some(true);
            }
        }
        let Some(file) = held.bytes(&self.folder.join("keys")) else { return Some(false) };
        match kernel::lock_byte(&file, offset) {
            Ok(true) => {
                held.places.insert(Place::Byte(offset), (1, Guard::Byte(file)));
                Some(true)
            }
            Ok(false) => None,
            Err(_) => Some(false),
        }
    }
}

impl Held {
    /// Whether another key of this process has the place already.
    fn share(&mut self, place: Place) -> bool {
        self.places.get_mut(&place).map(|(keys, _)| *keys += 1).is_some()
    }

    /// The file at `path`: opened once for all, and anew where it was removed or replaced, since others lock the new one.
    fn bytes(&mut self, path: &Path) -> Option<Arc<File>> {
        let there = disk::look(path).ok().flatten().map(|meta| disk::identity(&meta));
        if let Some((file, identity)) = &self.bytes
            && there.as_ref() == Some(identity)
        {
            return Some(file.clone());
        }
        let file = lock::open(path)?;
        let identity = disk::identity(&file.metadata().ok()?);
        Some(self.bytes.insert((Arc::new(file), identity)).0.clone())
    }
}

/// Keeps a key to its holder until it is dropped.
pub struct KeyLock {
    key: Digest,
    place: Place,
    held: Arc<Mutex<Held>>,
}

impl Drop for KeyLock {
    fn drop(&mut self) {
        let mut held = guard(&self.held);
        held.keys.remove(&self.key);
        let Some((keys, guard)) = held.places.get_mut(&self.place) else { return };
        *keys -= 1;
        if *keys > 0 {
            return;
        }
        if let (Place::Byte(offset), Guard::Byte(file)) = (self.place, guard) {
            kernel::free_byte(file, offset);
        }
        held.places.remove(&self.place);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;
    use crate::store::lock::fake::{Locks, set};

    /// A key of which this is the beginning, and this the end.
    fn key(first: u64, last: u8) -> Digest {
        let mut key = Digest([0; 32]);
        key.0[..8].copy_from_slice(&first.to_le_bytes());
        key.0[31] = last;
        key
    }

    fn number(i: u64) -> u64 {
        Digest::of(&i.to_le_bytes()).first_u64()
    }

    /// Two handles stand for two processes: locks belong to the opened file, not to the process.
    #[test]
    fn one_holder_per_key_and_cancel_ends_the_wait() {
        let folder = tempfile::tempdir().unwrap();
        for locks in [Locks::Real, Locks::NoBytes] {
            set(locks);
            let (here, there) = (KeyLocks::new(folder.path()), KeyLocks::new(folder.path()));
            let first = here.take(&key(1, 1), &|| false).unwrap();
            let twin = here.try_take(&key(1, 2)).expect("another key of the place does not wait in its process");
            let tries = AtomicUsize::new(0);
            let give_up = || tries.fetch_add(1, Ordering::Relaxed) > 2;
            assert!(matches!(here.take(&key(1, 1), &give_up), Err(StoreError::Cancelled)));
            assert!(there.try_take(&key(1, 1)).is_none());
            drop(first);
            assert!(there.try_take(&key(1, 1)).is_none(), "the place is still held");
            drop(twin);
            let second = there.try_take(&key(1, 1)).expect("it is free now");
            there.try_take(&key(1 << 20, 1)).expect("another place is free");
            assert!(here.try_take(&key(1, 1)).is_none());
            drop(second);
        }
        set(Locks::Real);
    }

    /// Whole keys, not a few stripes: as many workers as there are hold a key each, on one file.
    #[test]
    #[cfg(all(target_os = "linux", target_pointer_width = "64"))]
    fn many_workers_do_not_meet() {
        // Each has an open file: as many as any system allows. `cargo bench --bench sharing` has more, in several processes.
        const WORKERS: usize = 400;
        let folder = tempfile::tempdir().unwrap();
        let workers: Vec<KeyLocks> = (0..WORKERS).map(|_| KeyLocks::new(folder.path())).collect();
        let held: Vec<_> = (0..).zip(&workers).filter_map(|(i, w)| w.try_take(&key(number(i), 0))).collect();
        assert_eq!(held.len(), WORKERS);
        assert!((0..).zip(&workers[1..]).all(|(i, worker)| worker.try_take(&key(number(i), 0)).is_none()));
        let files = std::fs::read_dir(folder.path().join("locks")).unwrap();
        assert_eq!(files.count(), 1);
        drop(held);
        assert!((0..).zip(&workers[1..]).all(|(i, worker)| worker.try_take(&key(number(i), 0)).is_some()));
    }

    /// Without locks, or with such as keep nobody out, work goes on.
    #[test]
    fn nobody_waits_for_locks_that_are_none() {
        let folder = tempfile::tempdir().unwrap();
        for locks in [Locks::None, Locks::Hollow] {
            set(locks);
            let (here, there) = (KeyLocks::new(folder.path()), KeyLocks::new(folder.path()));
            let held = here.try_take(&key(1, 1)).expect("nothing keeps it out");
            assert!(here.try_take(&key(1, 1)).is_none(), "threads of a process exclude each other all the same");
            assert!(there.try_take(&key(1, 1)).is_some());
            drop(held);
            assert!(here.try_take(&key(1, 1)).is_some());
        }
        set(Locks::Real);
    }

    /// Where the file of locks is removed, what comes after is locked in the new one, as others do.
    #[test]
    fn the_file_of_locks_may_vanish() {
        let folder = tempfile::tempdir().unwrap();
        let (here, there) = (KeyLocks::new(folder.path()), KeyLocks::new(folder.path()));
        let before = here.try_take(&key(1, 1)).unwrap();
        std::fs::remove_dir_all(folder.path().join("locks")).unwrap();
        let _after = here.try_take(&key(2 << 20, 1)).unwrap();
        assert!(there.try_take(&key(2 << 20, 1)).is_none());
        drop(before);
        assert!(there.try_take(&key(1, 1)).is_some());
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
