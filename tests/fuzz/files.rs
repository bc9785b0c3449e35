//! Several files as one input: what a folder holds, in a text that names each with its length.

use std::fs;
use std::io;
use std::path::Path;

use crate::random::Random;

/// A name below the folder, and what is there.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    pub name: String,
    pub what: What,
}

#[derive(Clone, Debug, PartialEq)]
pub enum What {
    File(Vec<u8>),
    Folder,
    /// A symbolic link to nowhere.
    Dangling,
}

/// `file NAME LENGTH`, the bytes and a line break for each; `folder NAME`; `dangling NAME`.
pub fn join(entries: &[Entry]) -> Vec<u8> {
    let mut text = Vec::new();
    for Entry { name, what } in entries {
        match what {
            What::File(bytes) => {
                text.extend(format!("file {name} {}\n", bytes.len()).bytes());
                text.extend(bytes);
                text.push(b'\n');
            }
            What::Folder => text.extend(format!("folder {name}\n").bytes()),
            What::Dangling => text.extend(format!("dangling {name}\n").bytes()),
        }
    }
    text
}

/// What [`join`] wrote; all that can be read of anything else.
pub fn split(mut text: &[u8]) -> Vec<Entry> {
    let mut found = Vec::new();
    while let Some(end) = text.iter().position(|&b| b == b'\n') {
        let line = String::from_utf8_lossy(&text[..end]).into_owned();
        text = &text[end + 1..];
        let mut words = line.split(' ');
        let (kind, name, length) = (words.next(), words.next().unwrap_or_default().to_owned(), words.next());
        let what = match kind {
            Some("file") => {
                let length = length.and_then(|n| n.parse().ok()).unwrap_or(0).min(text.len());
                let bytes = text[..length].to_vec();
                text = &text[(length + 1).min(text.len())..];
                What::File(bytes)
            }
            Some("folder") => What::Folder,
            _ => What::Dangling,
        };
        found.push(Entry { name, what });
    }
    found
}

/// The files below `folder`, in the order of their names.
pub fn read(folder: &Path) -> Vec<Entry> {
    let mut found = Vec::new();
    let mut open = vec![folder.to_owned()];
    while let Some(at) = open.pop() {
        for entry in fs::read_dir(&at).expect("the folder is ours").flatten() {
            let path = entry.path();
            if path.is_dir() {
                open.push(path);
            } else {
                let name = path.strip_prefix(folder).expect("it is below").to_str().expect("ASCII").to_owned();
                found.push(Entry { name, what: What::File(fs::read(&path).expect("the file is ours")) });
            }
        }
    }
    found.sort_by(|a, b| a.name.cmp(&b.name));
    found
}

/// Puts `entries` below `folder`. Names that would lead out of it are left out.
pub fn write(folder: &Path, entries: &[Entry]) -> io::Result<()> {
    for Entry { name, what } in entries {
        let inside = Path::new(name).components().all(|c| matches!(c, std::path::Component::Normal(_)));
        let path = folder.join(name);
        let free = !path.exists() && !path.is_symlink();
        if name.is_empty() || !inside || !free || path.parent().is_some_and(Path::is_file) {
            continue;
        }
        fs::create_dir_all(path.parent().expect("it is below the folder"))?;
        match what {
            What::File(bytes) => fs::write(&path, bytes)?,
            What::Folder => fs::create_dir(&path)?,
            What::Dangling => dangle(&path)?,
        }
    }
    Ok(())
}

#[cfg(unix)]
fn dangle(path: &Path) -> io::Result<()> {
    std::os::unix::fs::symlink("nowhere", path)
}

#[cfg(not(unix))]
fn dangle(_: &Path) -> io::Result<()> {
    Ok(())
}

/// Changes one of the files by `content`, or what is there at all.
pub fn mutate(entries: &mut Vec<Entry>, random: &mut Random, content: impl Fn(&str, &mut Vec<u8>, &mut Random)) {
    if entries.is_empty() {
        return;
    }
    let (i, j) = (random.below(entries.len()), random.below(entries.len()));
    match random.below(16) {
        0 => drop(entries.remove(i)),
        1 => entries[i].what = What::Folder,
        2 => entries[i].what = What::Dangling,
        3 => {
            let what = entries[i].what.clone();
            entries[j].what = what;
        }
        4 => {
            let mut copy = entries[i].clone();
            let at = random.below(copy.name.len());
            copy.name.insert(at, *random.pick(&['0', 'a', '-', 'f']));
            entries.push(copy);
        }
        _ => {
            let Entry { name, what } = &mut entries[i];
            if let What::File(bytes) = what {
                content(name, bytes, random);
            }
        }
    }
}
