//! What can go wrong with the store, in words for users.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use crate::digest::Digest;
use crate::store::remote::objects::RemoteError;

/// An error of the store; `Display` says what happened, where, and the way out.
#[derive(Debug)]
pub enum StoreError {
    /// The store was written by a later turbid.
    NewerFormat { path: PathBuf, found: u64, known: u64 },
    /// The operating system refused.
    Io { doing: String, path: PathBuf, source: io::Error },
    /// A blob's bytes no longer have its digest; they are in quarantine now, and it counts as missing.
    Damaged { digest: Digest },
    /// No such blob.
    Missing { digest: Digest },
    /// An artifact that cannot be stored (a pixel that is not finite, no layers, ...).
    Unfit { what: String },
    /// The run was cancelled while it waited for a lock.
    Cancelled,
    /// Runs use the store, and what was asked needs it alone.
    Busy { path: PathBuf },
    /// The file system does not keep other processes out, and what was asked needs the store alone.
    NoLocks { path: PathBuf },
    /// A file system that other machines may use too, and what was asked needs the store alone.
    OtherMachines { path: PathBuf, kind: &'static str },
    /// A store elsewhere could not be read or written.
    Remote(RemoteError),
    /// A second look after a repair found this.
    NotRepaired { path: PathBuf, left: Vec<String> },
}

impl StoreError {
    /// Whether computing the instance again puts things right: what was to be read is damaged or gone.
    pub fn is_lost_blob(&self) -> bool {
        matches!(self, Self::Damaged { .. } | Self::Missing { .. })
    }

    /// Whether the disk (or a quota) is full.
    pub fn is_full(&self) -> bool {
        use io::ErrorKind::{FileTooLarge, QuotaExceeded, StorageFull};
        matches!(self, Self::Io { source, .. } if matches!(source.kind(), StorageFull | QuotaExceeded | FileTooLarge))
    }

    /// Whether the disk cannot give these bytes back (EIO), unlike a file that may not or cannot be opened now.
    pub(super) fn is_broken_medium(&self) -> bool {
        matches!(self, Self::Io { source, .. } if cfg!(unix) && source.raw_os_error() == Some(5))
    }

    pub(super) fn io(doing: impl Into<String>, path: &Path) -> impl FnOnce(io::Error) -> Self {
        let (doing, path) = (doing.into(), path.to_owned());
        move |source| Self::Io { doing, path, source }
    }

    pub(super) fn unfit(what: impl Into<String>) -> Self {
        Self::Unfit { what: what.into() }
    }
}

impl fmt::Display for StoreError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NewerFormat { path, found, known } => write!(
                f,
                "the store at {} has format {found}, and this turbid knows formats up to {known}; update turbid, or choose \
                 another folder with --outputs",
                path.display()
            ),
            Self::Io { doing, path, .. } if self.is_full() => write!(
                f,
                "cannot {doing}: the disk that holds {} is full; free some space (`turbid cache gc --max-size`), or choose \
                 another folder with --outputs",
                path.display()
            ),
            Self::Io { doing, path, source } => write!(f, "cannot {doing} ({}): {source}", path.display()),
            Self::Damaged { digest } => {
                write!(f, "blob {} is damaged: its bytes have another digest; it was set aside", digest.short())
            }
            Self::Missing { digest } => write!(f, "blob {} is not in the store", digest.short()),
            Self::Unfit { what } => f.write_str(what),
            Self::Cancelled => f.write_str("interrupted"),
            Self::Busy { path } => {
                write!(f, "the store at {} is in use by a run; try again when it has ended", path.display())
            }
            Self::NoLocks { path } => write!(
                f,
                "the file system of {} does not keep other processes out (its locks are missing or do not exclude, or something \
                 else stands in the place of locks/gc), so a run might be at work unseen, and nothing was removed; to make room \
                 delete the whole folder when no run is at work, or move it to a local disk and run `turbid cache gc` there",
                path.display()
            ),
            Self::OtherMachines { path, kind } => write!(
                f,
                "{} lies on a network file system ({kind}), on which another machine might be at work unseen, and nothing was \
                 removed; when no other machine uses the store, say so with --exclusive",
                path.display()
            ),
            Self::Remote(error) => fmt::Display::fmt(error, f),
            Self::NotRepaired { path, left } => write!(
                f,
                "the store at {} could not be repaired; a second look still finds: {}; if it stays so, delete the folder when no \
                 run is at work, and results are computed anew",
                path.display(),
                left.join("; ")
            ),
        }
    }
}

impl From<RemoteError> for StoreError {
    fn from(error: RemoteError) -> Self {
        Self::Remote(error)
    }
}

impl std::error::Error for StoreError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Io { source, .. } => Some(source),
            _ => None,
        }
    }
}
