//! Objects as files in a folder that several machines see: `file:///FOLDER`. Needs no locks: files appear whole, and never change.

use std::fs;
use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

use super::objects::{Counter, Listed, Objects, RemoteError, Traffic};
use crate::store::disk;

pub(super) struct FolderObjects {
    root: PathBuf,
    counter: Counter,
}

impl FolderObjects {
    pub fn new(root: &Path) -> Self {
        Self { root: root.to_owned(), counter: Counter::default() }
    }

    fn failed(&self, doing: &str, name: &str) -> impl FnOnce(io::Error) -> RemoteError {
        let text = format!("cannot {doing} {}", self.root.join(name).display());
        move |error| RemoteError::new(format!("{text}: {error}; make the folder of the store one that you may use"))
    }
}

impl Objects for FolderObjects {
    fn put(&self, name: &str, bytes: &[u8]) -> Result<(), RemoteError> {
        self.counter.add(bytes.len(), 0);
        let written = disk::publish_through(&self.root.join("tmp"), &self.root.join(name), bytes, true, true);
        written.map_err(self.failed("write", name))
    }

    fn get(&self, name: &str, range: Range<u64>) -> Result<Option<Vec<u8>>, RemoteError> {
        let read = || {
            let mut file = disk::open_regular(&self.root.join(name))?;
            file.seek(SeekFrom::Start(range.start))?;
            let mut bytes = Vec::new();
            file.take(range.end.saturating_sub(range.start)).read_to_end(&mut bytes)?;
            Ok(bytes)
        };
        match read() {
            Ok(bytes) => {
                self.counter.add(0, bytes.len());
                Ok(Some(bytes))
            }
            Err(error) if disk::is_absent(&error) => Ok(None),
            Err(error) => Err(self.failed("read", name)(error)),
        }
    }

    fn list(&self, folder: &str) -> Result<Vec<Listed>, RemoteError> {
        self.counter.add(0, 0);
        let mut listed = Vec::new();
        for path in disk::list(&self.root.join(folder)).map_err(self.failed("list", folder))? {
            let Some(name) = path.file_name().and_then(|name| name.to_str()) else { continue };
            if let Some(meta) = disk::look(&path).map_err(self.failed("list", folder))?.filter(fs::Metadata::is_file) {
                let modified = meta.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok());
                let modified = format!("{:039}", modified.map_or(0, |since| since.as_nanos()));
                listed.push(Listed { name: name.to_owned(), bytes: meta.len(), modified });
            }
        }
        Ok(listed)
    }

    fn traffic(&self) -> Traffic {
        self.counter.traffic()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_objects() {
        let folder = tempfile::tempdir().unwrap();
        let objects = FolderObjects::new(&folder.path().join("store"));
        assert_eq!((objects.list("packs"), objects.get("packs/a", 0..9)), (Ok(Vec::new()), Ok(None)));
        objects.put("packs/a", b"0123456789").unwrap();
        objects.put("packs/a", b"0123456789").unwrap();
        objects.put("packs/b", b"").unwrap();
        assert_eq!(objects.get("packs/a", 2..5), Ok(Some(b"234".to_vec())));
        assert_eq!(objects.get("packs/a", 8..20), Ok(Some(b"89".to_vec())));
        assert_eq!(objects.get("packs/a", 20..30), Ok(Some(Vec::new())));
        let names: Vec<_> = objects.list("packs").unwrap().into_iter().map(|l| (l.name, l.bytes)).collect();
        assert_eq!(names, [("a".to_owned(), 10), ("b".to_owned(), 0)]);
        fs::write(folder.path().join("store/blobs"), b"a file where a folder should be").unwrap();
        assert!(objects.put("blobs/c", b"x").is_err_and(|e| e.to_string().contains("blobs/c")));
    }
}
