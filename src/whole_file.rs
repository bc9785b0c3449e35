//! Files that appear whole or not at all: written beside their place, brought to the disk where that is wanted, renamed.
//!
//! All that turbid writes for others or keeps for itself passes here, but for what is appended to (packs, logs).

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::Path;

use tempfile::NamedTempFile;

use crate::leftover;

/// What a power cut leaves of a file whose name is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Synced {
    /// Nothing is promised.
    No,
    /// Its bytes.
    Bytes,
    /// Its bytes, and the name is there once this returns.
    BytesAndName,
}

/// An empty file in `folder`, whose name begins with `prefix`; gone unless it is [`place`]d. It has the rights that the user gives to new
/// files (0666 less the umask), not those of secrets: others may be meant to read it.
///
/// While it is open its lock says that somebody writes it ([`leftover::sweep`]).
pub(crate) fn begin(folder: &Path, prefix: &str) -> io::Result<NamedTempFile> {
    let file = builder(prefix).tempfile_in(folder).map_err(cause)?;
    leftover::hold(file.as_file());
    Ok(file)
}

/// How temporary files are called and what others may do with them.
pub(crate) fn builder(prefix: &str) -> tempfile::Builder<'_, 'static> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(prefix);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // Less what the umask takes away.
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    builder
}

/// Takes from everybody the right to write: against slips of people, where a file is a copy of what the store holds.
pub(crate) fn protect(file: &File) -> io::Result<()> {
    let mut permissions = file.metadata()?.permissions();
    permissions.set_readonly(true);
    file.set_permissions(permissions)
}

/// Gives a file that holds all its bytes its name, in the folder that it was begun in or another one of the same file system.
/// What had that name is replaced.
pub(crate) fn place(file: NamedTempFile, at: &Path, synced: Synced) -> io::Result<()> {
    match synced {
        Synced::No => {}
        Synced::Bytes => file.as_file().sync_data()?,
        Synced::BytesAndName => file.as_file().sync_all()?,
    }
    file.persist(at).map_err(|e| e.error)?;
    match (synced, at.parent()) {
        (Synced::BytesAndName, Some(folder)) => sync_folder(folder),
        _ => Ok(()),
    }
}

/// A file of these bytes at `at`, whose folder is there.
pub(crate) fn write(at: &Path, prefix: &str, bytes: &[u8], synced: Synced) -> io::Result<()> {
    let mut file = begin(folder_of(at), prefix)?;
    file.write_all(bytes)?;
    place(file, at, synced)
}

/// The folder of a file; `.` of a name alone.
pub(crate) fn folder_of(at: &Path) -> &Path {
    at.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Brings the names in a folder to the disk; file systems that know no such thing are left alone.
pub(crate) fn sync_folder(folder: &Path) -> io::Result<()> {
    #[cfg(unix)]
    {
        use io::ErrorKind::{InvalidInput, PermissionDenied, Unsupported};
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        let synced = File::open(folder).and_then(|folder| folder.sync_all());
        synced.or_else(
            |e| if matches!(e.kind(), InvalidInput | PermissionDenied | Unsupported) { Ok(()) } else { Err(e) },
        )
    }
    #[cfg(not(unix))]
    {
        let _ = folder;
        Ok(())
    }
}

/// The error of the system, without the temporary name, which says nothing to anybody.
pub(crate) fn cause(error: io::Error) -> io::Error {
    let inner = error.get_ref().and_then(|e| e.source()).and_then(|e| e.downcast_ref::<io::Error>());
    inner.and_then(io::Error::raw_os_error).map(io::Error::from_raw_os_error).unwrap_or(error)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The bytes are there under the name alone, what was there is replaced, and an error leaves it and nothing else.
    #[test]
    fn files_appear_whole_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path().join("a");
        for (text, synced) in [("one", Synced::No), ("two", Synced::Bytes), ("three", Synced::BytesAndName)] {
            write(&at, ".new-", text.as_bytes(), synced).unwrap();
            assert_eq!(fs::read_to_string(&at).unwrap(), text);
        }
        fs::create_dir(folder.path().join("b")).unwrap();
        assert!(write(&folder.path().join("b"), ".new-", b"x", Synced::No).is_err(), "a folder is not replaced");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    /// Errors are the system's, in its words.
    #[test]
    fn errors_name_no_temporary_file() {
        let error = write(Path::new("/nowhere/at/all"), ".new-", b"", Synced::No).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::NotFound);
        assert!(!error.to_string().contains(".new-"), "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn protected_files_are_written_by_nobody() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let file = begin(folder.path(), ".new-").unwrap();
        protect(file.as_file()).unwrap();
        let at = folder.path().join("a");
        place(file, &at, Synced::No).unwrap();
        assert_eq!(fs::metadata(&at).unwrap().permissions().mode() & 0o222, 0);
    }
}
