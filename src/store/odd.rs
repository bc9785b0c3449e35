//! What stands where the store has files and folders of its own, and is not of that kind: folders for files, links to
//! nothing, pipes, sockets. It is never opened, and goes to quarantine.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use crate::store::look;

/// The folders of a store.
const FOLDERS: [&str; 9] = ["packs", INDEX, "blobs", "checkpoints", "locks", "tmp", "quarantine", "memos", "unchanged"];
const INDEX: &str = "index";
/// So many files of one name find a place in quarantine; the last one is replaced.
const SAME_NAMES: u32 = 1000;

#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Folder,
    File,
}

/// Whether something is there (a link counts), and is not of that kind. Error: it cannot be looked at.
fn is_not(path: &Path, kind: Kind) -> io::Result<bool> {
    let is_there = look::look_at_link(path)?.is_some();
    let is_of_kind = |meta: fs::Metadata| if kind == Kind::Folder { meta.is_dir() } else { meta.is_file() };
    Ok(is_there && !look::look(path)?.is_some_and(is_of_kind))
}

/// Whether something else stands in the place of a file, as far as one can tell.
pub(super) fn is_no_file(path: &Path) -> bool {
    is_not(path, Kind::File).unwrap_or(false)
}

/// What a look through the store found.
#[derive(Default)]
pub(super) struct Found {
    /// Everything that is in the way of its files and folders.
    pub odd: Vec<PathBuf>,
    /// What could not be looked at or listed: nothing is known of it.
    pub unread: Vec<(PathBuf, io::Error)>,
}

impl Found {
    fn check(&mut self, path: PathBuf, kind: Kind) {
        match is_not(&path, kind) {
            Ok(true) => self.odd.push(path),
            Ok(false) => {}
            Err(error) => self.unread.push((path, error)),
        }
    }

    fn children(&mut self, folder: &Path) -> Vec<PathBuf> {
        look::list(folder).unwrap_or_else(|error| {
            self.unread.push((folder.to_owned(), error));
            Vec::new()
        })
    }
}

/// Looks at all names in the store at `root`.
pub(super) fn all(root: &Path) -> Found {
    let mut found = Found::default();
    found.check(root.join("format"), Kind::File);
    FOLDERS
        .iter()
        .filter(|name| **name != INDEX || !is_old_index(root))
        .for_each(|name| found.check(root.join(name), Kind::Folder));
    for name in ["packs", INDEX, "locks", "tmp", "memos", "unchanged"] {
        found.children(&root.join(name)).into_iter().for_each(|path| found.check(path, Kind::File));
    }
    for name in ["blobs", "checkpoints"] {
        for folder in found.children(&root.join(name)) {
            let is_prefix = folder.file_name().and_then(|n| n.to_str()).is_some_and(is_byte);
            if is_prefix {
                found.check(folder.clone(), Kind::Folder);
            }
            found.children(&folder).into_iter().for_each(|path| found.check(path, Kind::File));
        }
    }
    found.odd.sort();
    found
}

/// Whether the index is the one file that turbid up to 0.1 kept.
pub(super) fn is_old_index(root: &Path) -> bool {
    look::begins(&root.join(INDEX), b"turbid index ")
}

/// Two hexadecimal digits.
fn is_byte(name: &str) -> bool {
    name.len() == 2 && name.bytes().all(|b| b.is_ascii_hexdigit())
}

/// Moves what keeps `path` from being written to quarantine. Returns whether there was something.
pub(super) fn clear_way(root: &Path, path: &Path) -> io::Result<bool> {
    let folders = path.ancestors().skip(1).take_while(|folder| *folder != root && folder.starts_with(root));
    let mut cleared = false;
    for folder in folders.chain([root.join("tmp").as_path()]) {
        if is_not(folder, Kind::Folder)? {
            set_aside(root, folder)?;
            cleared = true;
        }
    }
    // A rename replaces anything but a folder.
    if path.is_dir() {
        set_aside(root, path)?;
        cleared = true;
    }
    Ok(cleared)
}

/// Makes a folder of the store; what stands in its place goes to quarantine.
pub(super) fn make_folder(root: &Path, folder: &Path) -> io::Result<()> {
    fs::create_dir_all(folder)
        .or_else(|error| if clear_way(root, &folder.join("any"))? { fs::create_dir_all(folder) } else { Err(error) })
}

/// Moves something to quarantine under its own name or the next free one; what is gone already needs no move.
pub(super) fn set_aside(root: &Path, path: &Path) -> io::Result<()> {
    let quarantine = root.join("quarantine");
    if is_not(&quarantine, Kind::Folder)? {
        // It stands in its own way.
        let beside = (0..SAME_NAMES).map(|n| root.join(format!("quarantine-{n}"))).find(|p| !is_there(p));
        let beside = beside.unwrap_or_else(|| root.join("quarantine-last"));
        fs::rename(&quarantine, &beside)?;
        fs::create_dir_all(&quarantine)?;
        fs::rename(&beside, quarantine.join("quarantine"))?;
        if path == quarantine {
            return Ok(());
        }
    }
    fs::create_dir_all(&quarantine)?;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let mut target = quarantine.join(&*name);
    // The same damaged file again replaces the earlier copy.
    let replaces = |target: &Path| fs::symlink_metadata(target).is_ok_and(|m| m.is_file());
    if !(replaces(&target) && path.is_file()) {
        let mut numbered = (1..SAME_NAMES).map(|n| quarantine.join(format!("{name}-{n}")));
        while is_there(&target)
            && let Some(next) = numbered.next()
        {
            target = next;
        }
    }
    match fs::rename(path, &target) {
        // A file in the place of its folder has taken it away.
        Err(e) if matches!(e.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory) && !is_there(path) => {
            Ok(())
        }
        done => done,
    }
}

fn is_there(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok()
}
