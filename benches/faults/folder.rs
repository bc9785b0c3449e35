//! Folders: copied whole, read whole.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

/// Copies a folder with its links, rights and times; `to` is made.
pub fn copy(from: &Path, to: &Path) -> io::Result<()> {
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        let (source, target) = (entry.path(), to.join(entry.file_name()));
        let about = entry.metadata()?;
        if about.is_dir() {
            copy(&source, &target)?;
        } else if about.is_symlink() {
            std::os::unix::fs::symlink(fs::read_link(&source)?, &target)?;
        } else {
            fs::write(&target, fs::read(&source)?)?;
            File::options().write(true).open(&target)?.set_modified(about.modified()?)?;
            fs::set_permissions(&target, about.permissions())?;
        }
    }
    Ok(())
}

/// Paths of all files and links below a folder, relative to it and sorted; none where there is no folder.
pub fn files(root: &Path) -> Vec<PathBuf> {
    let (mut found, mut open) = (Vec::new(), vec![root.to_owned()]);
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
            if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
                open.push(entry.path());
            } else {
                found.push(entry.path().strip_prefix(root).expect("below it").to_owned());
            }
        }
    }
    found.sort();
    found
}

/// What people see of `outputs/latest`: each file by its path, links followed; `None` where a link leads nowhere. What begins with a dot is the
/// program's own.
pub fn latest(outputs: &Path) -> BTreeMap<PathBuf, Option<Vec<u8>>> {
    let root = outputs.join("latest");
    let shown = |path: &PathBuf| !path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"."));
    files(&root).into_iter().filter(shown).map(|path| (path.clone(), fs::read(root.join(path)).ok())).collect()
}

/// Files that a dead process was writing: names that only unfinished files have.
pub fn left_over(work: &Path) -> Vec<PathBuf> {
    let unfinished = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        path.starts_with("outputs/store/tmp")
            || name.starts_with(".tmp")
            || name.starts_with("new-")
            || name.ends_with(".new")
    };
    files(work).into_iter().filter(unfinished).collect()
}
