//! Looking at what stands in the store: what it is, and what lies in a folder.

use std::fs::{self, Metadata};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use crate::regular;

/// Whether an error says that nothing stands at a path (a link to nothing, or to itself, leads to nothing). Any other error
/// says nothing about what is there.
pub(super) fn is_absent(error: &io::Error) -> bool {
    #[cfg(unix)]
    if error.raw_os_error() == Some(libc::ELOOP) {
        return true;
    }
    matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory)
}

/// What stands at a path, through links; none where nothing does.
pub(super) fn look(path: &Path) -> io::Result<Option<Metadata>> {
    reading()?;
    present(fs::metadata(path))
}

/// The same of a link itself.
pub(super) fn look_at_link(path: &Path) -> io::Result<Option<Metadata>> {
    reading()?;
    present(fs::symlink_metadata(path))
}

fn present(found: io::Result<Metadata>) -> io::Result<Option<Metadata>> {
    found.map(Some).or_else(|e| if is_absent(&e) { Ok(None) } else { Err(e) })
}

/// Whether a regular file begins with these bytes, as far as one can tell.
pub(super) fn begins(path: &Path, bytes: &[u8]) -> bool {
    let mut first = vec![0; bytes.len()];
    let file = regular::open(path, fs::OpenOptions::new().read(true));
    file.is_ok_and(|mut file| file.read_exact(&mut first).is_ok() && first == bytes)
}

/// Everything in a folder, sorted; nothing where there is no such folder.
pub(super) fn list(folder: &Path) -> io::Result<Vec<PathBuf>> {
    reading()?;
    let entries = match fs::read_dir(folder) {
        Err(e) if is_absent(&e) => return Ok(Vec::new()),
        entries => entries?,
    };
    let mut paths = entries.map(|entry| Ok(entry?.path())).collect::<io::Result<Vec<_>>>()?;
    paths.sort();
    Ok(paths)
}

/// Every reading of the store passes here (tests let reads fail).
pub(super) fn reading() -> io::Result<()> {
    #[cfg(test)]
    if faults::strikes() {
        // EIO.
        return Err(io::Error::from_raw_os_error(5));
    }
    Ok(())
}

/// Lets reads of the calling test fail.
#[cfg(test)]
pub(super) mod faults {
    use std::cell::Cell;

    thread_local!(static AT: Cell<Option<(usize, usize)>> = const { Cell::new(None) });

    /// After `good` more reads of this thread the next `bad` ones fail.
    pub fn set(good: usize, bad: usize) {
        AT.set(Some((good, bad)));
    }

    /// All reads work again. Returns whether any has failed.
    pub fn clear(bad: usize) -> bool {
        AT.take().is_some_and(|(_, left)| left < bad)
    }

    pub fn strikes() -> bool {
        match AT.get() {
            Some((0, bad)) if bad > 0 => AT.set(Some((0, bad - 1))),
            Some((good, bad)) if good > 0 => {
                AT.set(Some((good - 1, bad)));
                return false;
            }
            _ => return false,
        }
        true
    }
}
