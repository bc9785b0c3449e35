//! What a disk may hold after a power cut: a model of a file system with a journal.
//!
//! What was synced is there: the bytes of a file after a sync of the file, a name after a sync of its folder, a folder after a sync of anything in
//! it. All else may be there or not. Names: in order (a journal, of which the end is lost), or each by itself. Bytes: page by page the new ones, the
//! old ones, zeros, or torn within the page; the length is the old one, the new one, or between. So it covers ext4 with `data=ordered` and
//! `data=writeback` (the name is there, the bytes are not), XFS (zeros), and what POSIX allows of names.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::calls::Op;
use super::random::Random;
use super::tracer::Logged;

const PAGE: usize = 4096;
const SECTOR: u64 = 512;

/// A file by its content, whatever its names.
#[derive(Clone, Debug, Default)]
struct Content {
    synced: Vec<u8>,
    now: Vec<u8>,
    /// Pages that differ.
    dirty: BTreeSet<usize>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum Thing {
    Folder,
    /// Index of its content, and whether its owner may write to it.
    File(usize, bool),
    Link(PathBuf),
}

/// A change of names.
#[derive(Clone, Debug)]
enum Change {
    Add(PathBuf, Thing),
    /// From, to, and what it is: its new name does not need the old one to have come to be.
    Rename(PathBuf, PathBuf, Thing),
    Remove(PathBuf),
}

type Names = BTreeMap<PathBuf, Thing>;

/// A folder, what was done to it, and what of that is safe.
pub struct Disk {
    root: PathBuf,
    contents: Vec<Content>,
    before: Names,
    now: Names,
    /// In order, each with whether it is synced.
    changes: Vec<(Change, bool)>,
}

impl Disk {
    /// The folder as it is, all of it synced.
    pub fn of(root: &Path) -> io::Result<Self> {
        let mut disk = Self {
            root: root.to_owned(),
            contents: Vec::new(),
            before: Names::new(),
            now: Names::new(),
            changes: Vec::new(),
        };
        let mut open = vec![root.to_owned()];
        while let Some(folder) = open.pop() {
            for entry in fs::read_dir(folder)? {
                let path = entry?.path();
                let about = fs::symlink_metadata(&path)?;
                let thing = if about.is_dir() {
                    open.push(path.clone());
                    Thing::Folder
                } else if about.is_symlink() {
                    Thing::Link(fs::read_link(&path)?)
                } else {
                    let bytes = fs::read(&path)?;
                    disk.contents.push(Content { synced: bytes.clone(), now: bytes, dirty: BTreeSet::new() });
                    Thing::File(disk.contents.len() - 1, !about.permissions().readonly())
                };
                disk.before.insert(disk.inside(&path), thing);
            }
        }
        disk.now = disk.before.clone();
        Ok(disk)
    }

    fn inside(&self, path: &Path) -> PathBuf {
        path.strip_prefix(&self.root).unwrap_or(path).to_owned()
    }

    fn change(&mut self, change: Change) {
        apply(&mut self.now, &change);
        self.changes.push((change, false));
    }

    /// Takes in a call that was made.
    pub fn make(&mut self, logged: &Logged) {
        let path = self.inside(&logged.call.path);
        let file = match self.now.get(&path) {
            Some(Thing::File(content, _)) => Some(*content),
            _ => None,
        };
        match (&logged.call.op, file) {
            (Op::Create, Some(content)) | (Op::Truncate { length: 0 }, Some(content)) => self.contents[content].cut(0),
            (Op::Create, None) => {
                self.contents.push(Content::default());
                self.change(Change::Add(path, Thing::File(self.contents.len() - 1, true)));
            }
            (Op::Write { offset, .. }, Some(content)) => self.contents[content].write(*offset as usize, &logged.data),
            (Op::Truncate { length }, Some(content)) => self.contents[content].cut(*length as usize),
            (Op::Sync, _) => self.sync(&path, file),
            (Op::Rename { from }, _) => {
                let from = self.inside(from);
                if let Some(thing) = self.now.get(&from).cloned() {
                    self.change(Change::Rename(from, path, thing));
                }
            }
            (Op::Link { from }, _) => {
                if let Some(thing) = self.now.get(&self.inside(from)).cloned() {
                    self.change(Change::Add(path, thing));
                }
            }
            (Op::Symlink { target }, _) => self.change(Change::Add(path, Thing::Link(target.clone()))),
            (Op::MakeFolder, _) => self.change(Change::Add(path, Thing::Folder)),
            (Op::Unlink | Op::RemoveFolder, _) => self.change(Change::Remove(path)),
            // A file that has no name any more; modes, which nothing depends on; reading.
            (
                Op::Write { .. } | Op::Truncate { .. } | Op::Mode | Op::Copy | Op::Read { .. } | Op::Open | Op::Ask,
                _,
            ) => {}
        }
    }

    fn sync(&mut self, path: &Path, file: Option<usize>) {
        if let Some(content) = file {
            self.contents[content].sync();
        }
        for (change, synced) in &mut self.changes {
            let in_it = |name: &Path| file.is_none() && name.parent() == Some(path);
            *synced |= match change {
                Change::Add(name, Thing::Folder) => path.starts_with(&*name) || in_it(name),
                Change::Add(name, _) | Change::Remove(name) => in_it(name),
                Change::Rename(from, to, _) => in_it(from) || in_it(to),
            };
        }
    }

    /// Writes a state that may be there after a power cut now into the empty folder `at`.
    pub fn cut(&self, random: &mut Random, at: &Path) -> io::Result<()> {
        let mut names = self.before.clone();
        let last_synced = self.changes.iter().rposition(|(_, synced)| *synced).map_or(0, |at| at + 1);
        // 0: nothing more than what was synced; 2: in order up to somewhere; 3: each by itself; else all names, as after some seconds.
        let how = random.below(6);
        let upto = last_synced + random.below((self.changes.len() - last_synced + 1) as u64) as usize;
        for (k, (change, synced)) in self.changes.iter().enumerate() {
            if *synced || how == 1 || how > 3 || (how == 2 && k < upto) || (how == 3 && random.coin()) {
                apply(&mut names, change);
            }
        }
        // Of all files alike, or each by itself: 0: what was synced; 1: zeros; 2: all; 3: page by page.
        let alike = if random.below(3) == 0 { Some(random.below(4)) } else { None };
        let mut after = |content: &Content| content.after(alike.unwrap_or_else(|| random.below(4)), random);
        let contents: Vec<Vec<u8>> = self.contents.iter().map(&mut after).collect();
        for (name, thing) in &names {
            let path = at.join(name);
            match thing {
                Thing::Folder => fs::create_dir_all(path)?,
                Thing::Link(target) => std::os::unix::fs::symlink(target, path)?,
                Thing::File(content, writable) => {
                    fs::write(&path, &contents[*content])?;
                    let mut rights = fs::metadata(&path)?.permissions();
                    rights.set_readonly(!writable);
                    fs::set_permissions(&path, rights)?;
                }
            }
        }
        Ok(())
    }
}

/// Does nothing where it cannot be: its folder, or what it changes, did not come to be.
fn apply(names: &mut Names, change: &Change) {
    let lies = |names: &Names, name: &Path| {
        let folder = name.parent().unwrap_or(Path::new(""));
        folder == Path::new("") || names.get(folder) == Some(&Thing::Folder)
    };
    match change {
        Change::Add(name, thing) => {
            if lies(names, name) && !names.contains_key(name) {
                names.insert(name.clone(), thing.clone());
            }
        }
        Change::Rename(from, to, thing) => {
            if lies(names, to) {
                names.remove(from);
                let below = |name: &&PathBuf| *thing == Thing::Folder && name.starts_with(from);
                for name in names.keys().filter(below).cloned().collect::<Vec<_>>() {
                    let thing = names.remove(&name).expect("it was listed");
                    names.insert(to.join(name.strip_prefix(from).expect("below it")), thing);
                }
                names.insert(to.clone(), thing.clone());
            }
        }
        Change::Remove(name) => {
            let filled = names.range(name.clone()..).nth(1).is_some_and(|(next, _)| next.starts_with(name));
            if !filled {
                names.remove(name);
            }
        }
    }
}

impl Content {
    fn touch(&mut self, from: usize, to: usize) {
        self.dirty.extend(from / PAGE..to.div_ceil(PAGE));
    }

    fn write(&mut self, offset: usize, bytes: &[u8]) {
        let end = offset + bytes.len();
        self.touch(offset.min(self.now.len()), end);
        if self.now.len() < end {
            self.now.resize(end, 0);
        }
        self.now[offset..end].copy_from_slice(bytes);
    }

    fn cut(&mut self, length: usize) {
        let (low, high) = (length.min(self.now.len()), length.max(self.now.len()));
        self.touch(low, high);
        self.now.resize(length, 0);
    }

    fn sync(&mut self) {
        self.synced.clone_from(&self.now);
        self.dirty.clear();
    }

    /// What may be there after a power cut: see [`Disk::cut`].
    fn after(&self, how: u64, random: &mut Random) -> Vec<u8> {
        if self.dirty.is_empty() || how == 0 {
            return self.synced.clone();
        }
        if how == 2 {
            return self.now.clone();
        }
        let (low, high) = (self.synced.len().min(self.now.len()), self.synced.len().max(self.now.len()));
        let length = match random.below(4) {
            _ if how == 1 => self.now.len(),
            0 => self.synced.len(),
            1 => (low / PAGE * PAGE + PAGE * random.below(((high - low) / PAGE + 1) as u64) as usize).clamp(low, high),
            _ => self.now.len(),
        };
        let mut bytes = self.synced.clone();
        bytes.resize(length, 0);
        for &page in &self.dirty {
            let (from, to) = (page * PAGE, ((page + 1) * PAGE).min(length));
            let new_to = to.min(self.now.len());
            if from >= new_to {
                continue;
            }
            match if how == 1 { 1 } else { random.below(4) } {
                0 => {}
                1 => {
                    // What was there before stays; what is new is zero.
                    let fresh = self.synced.len().clamp(from, to);
                    bytes[fresh..to].fill(0);
                }
                2 => {
                    let torn = (from + (SECTOR * random.below(PAGE as u64 / SECTOR)) as usize).min(new_to);
                    bytes[from..torn].copy_from_slice(&self.now[from..torn]);
                }
                _ => bytes[from..new_to].copy_from_slice(&self.now[from..new_to]),
            }
        }
        bytes
    }
}
