//! What stands where the store has files and folders of its own, and is not of that kind: folders for files, links to
//! nothing, pipes, sockets. It is never opened, and goes to quarantine.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use crate::store::disk;

/// The folders of a store.
const FOLDERS: [&str; 7] = ["packs", "blobs", "checkpoints", "locks", "tmp", "quarantine", "memos"];
/// So many files of one name find a place in quarantine; the last one is replaced.
const SAME_NAMES: u32 = 1000;

#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Folder,
    File,
}

/// Whether something is there (a link counts), and is not of that kind, or cannot be looked at.
fn is_not(path: &Path, kind: Kind) -> bool {
    fs::symlink_metadata(path).is_ok()
        && fs::metadata(path).map_or(true, |meta| match kind {
            Kind::Folder => !meta.is_dir(),
            Kind::File => !meta.is_file(),
        })
}

/// Whether something else stands in the place of a file.
pub(super) fn is_no_file(path: &Path) -> bool {
    is_not(path, Kind::File)
}

/// Everything in the store at `root` that is in the way of its files and folders, sorted.
pub(super) fn all(root: &Path) -> Vec<PathBuf> {
    let mut found: Vec<PathBuf> = ["format", "index"]
        .iter()
        .map(|name| root.join(name))
        .filter(|path| is_not(path, Kind::File))
        .chain(FOLDERS.iter().map(|name| root.join(name)).filter(|path| is_not(path, Kind::Folder)))
        .collect();
    for name in ["packs", "locks", "tmp", "memos"] {
        found.extend(children(&root.join(name)).into_iter().filter(|path| is_not(path, Kind::File)));
    }
    let packs = children(&root.join("packs")).into_iter().filter(|path| path.extension().is_some_and(|e| e == "pack"));
    found.extend(packs.filter(|path| path.is_file() && disk::open_regular(path).is_err()));
    for name in ["blobs", "checkpoints"] {
        for folder in children(&root.join(name)) {
            let is_prefix = folder.file_name().and_then(|n| n.to_str()).is_some_and(is_byte);
            if is_prefix && is_not(&folder, Kind::Folder) {
                found.push(folder);
            } else {
                found.extend(children(&folder).into_iter().filter(|path| is_not(path, Kind::File)));
            }
        }
    }
    found.sort();
    found
}

/// Two hexadecimal digits.
fn is_byte(name: &str) -> bool {
    name.len() == 2 && name.bytes().all(|b| b.is_ascii_hexdigit())
}

fn children(folder: &Path) -> Vec<PathBuf> {
    fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()).collect()
}

/// Moves what keeps `path` from being written to quarantine. Returns whether there was something.
pub(super) fn clear_way(root: &Path, path: &Path) -> io::Result<bool> {
    let folders = path.ancestors().skip(1).take_while(|folder| *folder != root && folder.starts_with(root));
    let mut cleared = false;
    for folder in folders.chain([root.join("tmp").as_path()]) {
        if is_not(folder, Kind::Folder) {
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
    if is_not(&quarantine, Kind::Folder) {
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
