//! The few things that the store does to a disk: write, sync, publish atomically, read at an offset.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::Path;

/// Writes all of `bytes` to `file`. Every byte that the store writes passes here (tests let the disk run full).
pub(super) fn write(file: &mut File, bytes: &[u8]) -> io::Result<()> {
    #[cfg(test)]
    if let Some(left) = quota::take(bytes.len()) {
        file.write_all(&bytes[..left])?;
        return Err(io::ErrorKind::StorageFull.into());
    }
    file.write_all(bytes)
}

/// Publishes `bytes` as `path`: a temporary file in `tmp` (same file system), then a rename. Readers see the old
/// file, the new file or none, never a part.
///
/// `durable`: the bytes and the name are on the disk before this returns.
pub(super) fn publish(tmp: &Path, path: &Path, bytes: &[u8], durable: bool, read_only: bool) -> io::Result<()> {
    let folder = path.parent().expect("a file of the store lies in a folder");
    fs::create_dir_all(tmp)?;
    fs::create_dir_all(folder)?;
    let mut file = tempfile::Builder::new().prefix("new-").tempfile_in(tmp)?;
    write(file.as_file_mut(), bytes)?;
    persist(file, path, durable, read_only)
}

/// The second half of [`publish`]: of a temporary file that holds all bytes.
pub(super) fn persist(file: tempfile::NamedTempFile, path: &Path, durable: bool, read_only: bool) -> io::Result<()> {
    let folder = path.parent().expect("a file of the store lies in a folder");
    if durable {
        file.as_file().sync_all()?;
    }
    let mut permissions = file.as_file().metadata()?.permissions();
    set_mode(&mut permissions, read_only);
    file.as_file().set_permissions(permissions)?;
    file.persist(path).map_err(|e| e.error)?;
    if durable {
        sync_folder(folder);
    }
    Ok(())
}

#[cfg(unix)]
fn set_mode(permissions: &mut fs::Permissions, read_only: bool) {
    use std::os::unix::fs::PermissionsExt;
    permissions.set_mode(if read_only { 0o444 } else { 0o644 });
}

#[cfg(not(unix))]
fn set_mode(permissions: &mut fs::Permissions, read_only: bool) {
    permissions.set_readonly(read_only);
}

/// Brings the names in a folder to the disk; file systems that cannot are left alone.
pub(super) fn sync_folder(folder: &Path) {
    #[cfg(unix)]
    if let Ok(folder) = File::open(folder) {
        let _ = folder.sync_all();
    }
    #[cfg(not(unix))]
    let _ = folder;
}

/// Reads `length` bytes at `offset`.
pub(super) fn read_at(file: &File, offset: u64, length: usize) -> io::Result<Vec<u8>> {
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
