//! Files that are written beside their places: brought to the disk, then all renamed.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use tempfile::TempPath;

use crate::digest::Digest;
use crate::leftover::is_past;
use crate::stamp::Stamp;
use crate::whole_file::{self, Synced};

use super::links::{Entry, Links};

const PREFIX: &str = ".new-";
/// A file that is so old and not in its place is one of a run that was killed.
const ABANDONED: Duration = Duration::from_secs(3600);

/// New files of one folder of `latest`.
pub struct Staged {
    folder: PathBuf,
    files: Vec<New>,
}

struct New {
    path: String,
    content: String,
    bytes: Digest,
    is_link: bool,
    temporary: TempPath,
}

fn told(at: &Path) -> impl Fn(io::Error) -> String {
    move |error| format!("{}: {error}", at.display())
}

impl Staged {
    pub fn new(folder: &Path) -> Self {
        Self { folder: folder.to_owned(), files: Vec::new() }
    }

    pub fn is_empty(&self) -> bool {
        self.files.is_empty()
    }

    /// A file of these bytes, at `path` once they are all there.
    pub fn file(&mut self, path: &str, content: &str, bytes: &[u8], read_only: bool) -> Result<(), String> {
        let at = self.folder.join(path);
        let mut file = whole_file::begin(prepared(&at)?, PREFIX).map_err(told(&at))?;
        file.write_all(bytes).map_err(told(&at))?;
        // Elsewhere a file that is read-only is not replaced either.
        if read_only && cfg!(unix) {
            whole_file::protect(file.as_file()).map_err(told(&at))?;
        }
        self.add(path, content, Digest::of(bytes), false, file.into_temp_path());
        Ok(())
    }

    /// A link to `file`, or nothing where none that leads there can be made.
    #[cfg(unix)]
    pub fn link(&mut self, path: &str, content: &str, file: &Path) -> Result<bool, String> {
        let at = self.folder.join(path);
        let folder = prepared(&at)?;
        let physical = || {
            let name = at.file_name()?;
            Some(relative(&folder.canonicalize().ok()?.join(name), &file.canonicalize().ok()?))
        };
        // As it is spelt, so that the outputs folder can be moved; where a folder on the way is a link itself, as it is.
        for target in std::iter::once_with(|| Some(relative(&at, file))).chain(std::iter::once_with(physical)).flatten()
        {
            let Ok(made) =
                whole_file::builder(PREFIX).make_in(folder, |fresh| std::os::unix::fs::symlink(&target, fresh))
            else {
                break;
            };
            if same_file(made.path(), file) {
                self.add(path, content, Digest::of(target.as_os_str().as_encoded_bytes()), true, made.into_temp_path());
                return Ok(true);
            }
        }
        Ok(false)
    }

    #[cfg(not(unix))]
    pub fn link(&mut self, _: &str, _: &str, _: &Path) -> Result<bool, String> {
        Ok(false)
    }

    fn add(&mut self, path: &str, content: &str, bytes: Digest, is_link: bool, temporary: TempPath) {
        self.files.push(New { path: path.to_owned(), content: content.to_owned(), bytes, is_link, temporary });
    }

    /// Puts all in their places, after their bytes have reached the disk: a power cut leaves the old file or the new one. Notes them in `links`.
    pub fn commit(self, links: &mut Links) -> Result<(), String> {
        for new in self.files.iter().filter(|new| !new.is_link) {
            File::open(&new.temporary).and_then(|file| file.sync_data()).map_err(told(&self.folder.join(&new.path)))?;
        }
        for New { path, content, bytes, temporary, .. } in self.files {
            let at = self.folder.join(&path);
            temporary.persist(&at).map_err(|e| told(&at)(e.error))?;
            let stamp = Stamp::of(&fs::symlink_metadata(&at).map_err(told(&at))?);
            links.insert(path, Entry { content, bytes, stamp });
        }
        Ok(())
    }
}

/// Whole or not at all, and on the disk before it is there: a reader never sees half a file.
pub fn write(at: &Path, bytes: &[u8]) -> Result<(), String> {
    prepared(at)?;
    whole_file::write(at, PREFIX, bytes, Synced::Bytes).map_err(told(at))
}

/// The folder of a file, which is there now, and without files of runs that were killed.
fn prepared(at: &Path) -> Result<&Path, String> {
    let folder = at.parent().expect("files of latest lie in folders");
    fs::create_dir_all(folder).map_err(told(folder))?;
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let ours = entry.file_name().as_encoded_bytes().starts_with(PREFIX.as_bytes());
        // No lock tells here: so many files are not kept open.
        // Of a link its own: what it leads to may have been in the store for years.
        if ours && entry.metadata().is_ok_and(|own| is_past(&own, ABANDONED)) {
            let _ = fs::remove_file(entry.path());
        }
    }
    Ok(folder)
}

#[cfg(unix)]
fn same_file(a: &Path, b: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let id = |path: &Path| fs::metadata(path).ok().map(|meta| (meta.dev(), meta.ino()));
    id(a).is_some_and(|a| id(b) == Some(a))
}

/// `to` as seen from the folder of `at`; both begin at the same folder.
#[cfg(unix)]
fn relative(at: &Path, to: &Path) -> PathBuf {
    let (from, to): (Vec<_>, Vec<_>) = (at.components().collect(), to.components().collect());
    let shared = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
    let mut path: PathBuf = std::iter::repeat_n("..", from.len() - shared - 1).collect();
    path.extend(&to[shared..]);
    path
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn links_are_relative() {
        let path = relative(Path::new("/o/latest/p/s/frames.exr"), Path::new("/o/store/blobs/ab/cd.exr"));
        assert_eq!(path, Path::new("../../../store/blobs/ab/cd.exr"));
    }

    /// Files of a killed run go; those of one that is at work stay.
    #[test]
    fn abandoned_files_go() {
        let folder = tempfile::tempdir().unwrap();
        let [old, young] = [".new-old", ".new-young"].map(|name| folder.path().join(name));
        for path in [&old, &young] {
            fs::write(path, "half a picture").unwrap();
        }
        let long_ago = std::time::SystemTime::now() - 2 * ABANDONED;
        File::options().write(true).open(&old).unwrap().set_modified(long_ago).unwrap();
        write(&folder.path().join("whole"), b"a picture").unwrap();
        assert!(!old.exists() && young.exists());
    }

    /// Links to results of long ago are as good as others, whatever is staged beside them.
    #[test]
    fn links_to_old_files_stay() {
        let space = tempfile::tempdir().unwrap();
        let result = space.path().join("blob.exr");
        fs::write(&result, "of last year").unwrap();
        File::options()
            .write(true)
            .open(&result)
            .unwrap()
            .set_modified(std::time::SystemTime::now() - 2 * ABANDONED)
            .unwrap();
        let latest = space.path().join("latest");
        let mut staged = Staged::new(&latest);
        assert!(staged.link("s/frames.exr", "a", &result).unwrap());
        staged.file("s/frames.png", "b", b"a picture", false).unwrap();
        let mut links = Links::default();
        staged.commit(&mut links).unwrap();
        assert_eq!(fs::read(latest.join("s/frames.exr")).unwrap(), b"of last year");
        assert_eq!(links.len(), 2);
    }
}
