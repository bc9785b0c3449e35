//! Objects elsewhere: bytes under names, written once. All that a store elsewhere asks of a service.

use std::fmt;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

/// A service that keeps objects. Calls may come from any thread, and do what they can about faults that pass.
///
/// Names are `FOLDER/DIGEST` in ASCII. A name stands for one content, so that to write an object twice does no harm.
pub(in crate::store) trait Objects: Send + Sync {
    /// Writes an object; nobody sees a part of it.
    fn put(&self, name: &str, bytes: &[u8]) -> Result<(), RemoteError>;
    /// These bytes of an object, fewer where it is shorter; `None` where there is no such object.
    fn get(&self, name: &str, range: Range<u64>) -> Result<Option<Vec<u8>>, RemoteError>;
    /// All objects of a folder.
    fn list(&self, folder: &str) -> Result<Vec<Listed>, RemoteError>;
    /// What was asked for so far.
    fn traffic(&self) -> Traffic;
}

/// An object in a list.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::store) struct Listed {
    /// Within its folder.
    pub name: String,
    pub bytes: u64,
    /// When it was written: the later, the greater the text.
    pub modified: String,
}

/// What went over the network: requests, those that were repeated included, and bytes of objects.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Traffic {
    pub requests: u64,
    pub sent: u64,
    pub received: u64,
}

/// Counts traffic from all threads.
#[derive(Default)]
pub(super) struct Counter {
    requests: AtomicU64,
    sent: AtomicU64,
    received: AtomicU64,
}

impl Counter {
    pub fn add(&self, sent: usize, received: usize) {
        self.requests.fetch_add(1, Ordering::Relaxed);
        self.sent.fetch_add(sent as u64, Ordering::Relaxed);
        self.received.fetch_add(received as u64, Ordering::Relaxed);
    }

    pub fn traffic(&self) -> Traffic {
        let [requests, sent, received] =
            [&self.requests, &self.sent, &self.received].map(|counter| counter.load(Ordering::Relaxed));
        Traffic { requests, sent, received }
    }
}

/// Why a store elsewhere could not be read or written: what, where, why, and the way out. Holds no secret.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RemoteError(String);

impl RemoteError {
    pub(in crate::store) fn new(text: impl Into<String>) -> Self {
        Self(text.into())
    }
}

impl fmt::Display for RemoteError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for RemoteError {}
