//! What tells, without reading it, that a file was not touched since.

use std::fs::Metadata;
use std::time::{SystemTime, UNIX_EPOCH};

/// Length, times and number of a file: every write changes one of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stamp {
    pub length: u64,
    pub modified_ns: i128,
    /// When the file or what the file system notes of it changed, and its number; 0 where the system does not tell.
    pub changed_ns: i128,
    pub inode: u64,
}

impl Stamp {
    pub fn of(meta: &Metadata) -> Self {
        let modified_ns = meta.modified().map_or(0, unix_ns);
        #[cfg(unix)]
        let (changed_ns, inode) = {
            use std::os::unix::fs::MetadataExt;
            (i128::from(meta.ctime()) * 1_000_000_000 + i128::from(meta.ctime_nsec()), meta.ino())
        };
        #[cfg(not(unix))]
        let (changed_ns, inode) = (0, 0);
        Self { length: meta.len(), modified_ns, changed_ns, inode }
    }
}

/// Nanoseconds since 1970.
pub fn unix_ns(time: SystemTime) -> i128 {
    match time.duration_since(UNIX_EPOCH) {
        Ok(since) => since.as_nanos() as i128,
        Err(before) => -(before.duration().as_nanos() as i128),
    }
}
