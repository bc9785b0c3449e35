//! The few things that the store does to a disk: open, read at an offset, write, sync, publish atomically.

use std::fs::{self, File, Metadata, OpenOptions};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::Path;

use crate::regular::{self, NotOpened};
#[cfg(test)]
pub(super) use crate::store::look::faults;
use crate::store::look::reading;
pub(super) use crate::store::look::{is_absent, list, look, look_at_link};
use crate::store::odd;
use crate::whole_file::{self, Synced};

pub(super) use crate::whole_file::sync_folder;

/// Temporary files of the store; their writer holds a lock on them (`leftover`).
pub(super) const WRITING: &str = "writing-";
/// How often a file is written anew that somebody removed while it was written, or whose way had to be cleared.
const ATTEMPTS: usize = 20;

/// Opens a file to read. Folders, pipes, sockets and devices are errors, and nothing is waited for.
pub(super) fn open_regular(path: &Path) -> io::Result<File> {
    reading()?;
    open_regular_with(path, OpenOptions::new().read(true))
}

/// As [`open_regular`], in the way that `options` say.
pub(super) fn open_regular_with(path: &Path, options: &mut OpenOptions) -> io::Result<File> {
    regular::open(path, options).map_err(|error| match error {
        NotOpened::Io(error) => error,
        NotOpened::Odd(what) => {
            io::Error::new(io::ErrorKind::InvalidInput, format!("this is {what}, not a regular file"))
        }
    })
}

/// All bytes of a regular file.
pub(super) fn read_regular(path: &Path) -> io::Result<Vec<u8>> {
    let file = open_regular(path)?;
    let length = usize::try_from(file.metadata()?.len()).map_err(|_| io::ErrorKind::OutOfMemory)?;
    read_at(&file, 0, length)
}

/// What tells a file from another one that takes over its name (device and inode; nothing where there is no such thing).
pub(super) type Identity = Option<(u64, u64)>;

pub(super) fn identity(meta: &Metadata) -> Identity {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        Some((meta.dev(), meta.ino()))
    }
    #[cfg(not(unix))]
    {
        let _ = meta;
        None
    }
}

/// Writes all of `bytes` to `file`. Every byte that the store writes passes here (tests let the disk run full).
pub(super) fn write(file: &mut File, bytes: &[u8]) -> io::Result<()> {
    #[cfg(test)]
    if let Some(left) = quota::take(bytes.len()) {
        file.write_all(&bytes[..left])?;
        return Err(io::ErrorKind::StorageFull.into());
    }
    file.write_all(bytes)
}

/// Lets every byte pass [`write()`].
pub(super) struct Passing<'a>(pub &'a mut File);

impl Write for Passing<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        write(self.0, bytes)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

impl Seek for Passing<'_> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.0.seek(to)
    }
}

/// Publishes `bytes` as `path` in the store at `root`: a temporary file, then a rename. Readers see the old file, the
/// new file or none, never a part.
///
/// What stands in the way (a file for a folder, a folder for a file) goes to quarantine; what somebody removes
/// meanwhile is made again. `durable`: the bytes and the name are on the disk before this returns.
pub(super) fn publish(root: &Path, path: &Path, bytes: &[u8], durable: bool, read_only: bool) -> io::Result<()> {
    publish_so(root, path, &|| publish_through(&root.join("tmp"), path, bytes, durable, read_only))
}

/// The same of a file that is only a cache, and that `write` writes piece by piece, the same bytes each time it is called.
pub(super) fn publish_with(
    root: &Path,
    path: &Path,
    write: &dyn Fn(&mut dyn Write) -> io::Result<()>,
) -> io::Result<()> {
    publish_so(root, path, &|| {
        let mut file = temporary(root)?;
        let mut to = BufWriter::with_capacity(1 << 16, Passing(file.as_file_mut()));
        write(&mut to)?;
        to.flush()?;
        drop(to);
        publish_file(root, file, path, false, false)
    })
}

fn publish_so(root: &Path, path: &Path, publish: &dyn Fn() -> io::Result<()>) -> io::Result<()> {
    let mut attempt = 1;
    loop {
        match publish() {
            Err(error) if attempt < ATTEMPTS => {
                let cleared = odd::clear_way(root, path).unwrap_or(false);
                if !cleared && error.kind() != io::ErrorKind::NotFound {
                    return Err(error);
                }
                attempt += 1;
            }
            done => return done,
        }
    }
}

/// The same of a temporary file that [`temporary`] made and that holds all bytes.
pub(super) fn publish_file(
    root: &Path,
    file: tempfile::NamedTempFile,
    path: &Path,
    durable: bool,
    read_only: bool,
) -> io::Result<()> {
    let folder = path.parent().expect("a file of the store lies in a folder");
    odd::make_folder(root, folder)?;
    odd::clear_way(root, path)?;
    persist(file, path, durable, read_only)
}

/// An empty temporary file of the store at `root`, removed unless it is published.
pub(super) fn temporary(root: &Path) -> io::Result<tempfile::NamedTempFile> {
    let tmp = root.join("tmp");
    odd::make_folder(root, &tmp)?;
    whole_file::begin(&tmp, WRITING)
}

/// Publishes `bytes` as `path` through a temporary file in `tmp`, which must be in the same file system.
pub(super) fn publish_through(tmp: &Path, path: &Path, bytes: &[u8], durable: bool, read_only: bool) -> io::Result<()> {
    let folder = path.parent().unwrap_or(Path::new("."));
    fs::create_dir_all(tmp)?;
    fs::create_dir_all(folder)?;
    let mut file = whole_file::begin(tmp, WRITING)?;
    write(file.as_file_mut(), bytes)?;
    persist(file, path, durable, read_only)
}

/// The second half of [`publish`]: of a temporary file that holds all bytes.
pub(super) fn persist(file: tempfile::NamedTempFile, path: &Path, durable: bool, read_only: bool) -> io::Result<()> {
    if read_only {
        whole_file::protect(file.as_file())?;
    }
    whole_file::place(file, path, if durable { Synced::BytesAndName } else { Synced::No })
}

/// Reads `length` bytes at `offset`.
pub(super) fn read_at(file: &File, offset: u64, length: usize) -> io::Result<Vec<u8>> {
    reading()?;
    // The length of a file is no reason to die of: more than there can be is an error.
    Vec::<u8>::new().try_reserve_exact(length).map_err(|_| io::ErrorKind::OutOfMemory)?;
    let mut bytes = vec![0; length];
    #[cfg(unix)]
    std::os::unix::fs::FileExt::read_exact_at(file, &mut bytes, offset)?;
    #[cfg(windows)]
    {
        let mut done = 0;
        while done < length {
            let n = std::os::windows::fs::FileExt::seek_read(file, &mut bytes[done..], offset + done as u64)?;
            if n == 0 {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
            done += n;
        }
    }
    Ok(bytes)
}

/// Lets the disk of the calling test run full.
#[cfg(test)]
pub(super) mod quota {
    use std::cell::Cell;

    thread_local!(static LEFT: Cell<Option<usize>> = const { Cell::new(None) });

    /// From now on this thread may write `bytes` more; `None`: as many as it likes.
    pub fn set(bytes: Option<usize>) {
        LEFT.set(bytes);
    }

    /// How many of `wanted` bytes still fit, if not all do.
    pub fn take(wanted: usize) -> Option<usize> {
        let left = LEFT.get()?;
        LEFT.set(Some(left.saturating_sub(wanted)));
        (wanted > left).then_some(left)
    }
}
