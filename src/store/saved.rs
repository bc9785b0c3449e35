//! The files of the index in `store/index`: which there are, what they say together, and which are merged into one.
//!
//! Each says for itself which parts of which packs it covers, so that they need no list and no order: a run adds one of what is new,
//! and takes in those that are not much longer. So each is at least twice as long as the next shorter one, there are as many as
//! the logarithm of their entries, and an entry is written again about as often. Two runs that end at once may both take in the
//! same: entries that stand in two files are one.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::iter::Peekable;
use std::path::{Path, PathBuf};

use crate::digest::Digest;
use crate::store::disk;
use crate::store::odd;
use crate::store::place::{Entry, Named, Place};
use crate::store::sorted::{self, Covered, Foot, Sorted};

/// Fewer entries are written again by any run.
const FEW: u64 = 1024;
/// So often the folder is listed again while others merge what it lists.
const ATTEMPTS: usize = 5;

/// The files of an index.
#[derive(Default)]
pub(super) struct Saved {
    /// Shorter ones first.
    files: Vec<Sorted>,
    /// Damaged ones, those of other formats, and those that name packs which are gone: to be removed when another one is written.
    useless: Vec<PathBuf>,
}

/// The entries of several sources in one order; what stands in more than one of them once.
pub(super) struct Merged<'a> {
    sources: Vec<Peekable<Source<'a>>>,
}

/// What is written together.
pub(super) struct Fresh {
    /// In their order.
    pub entries: Vec<Entry>,
    pub covered: Vec<Covered>,
    pub dead: i64,
    /// Of another time than that of any other file.
    pub id: u64,
}

fn folder(root: &Path) -> PathBuf {
    root.join("index")
}

/// All that may be files of the index. Error: they cannot be listed.
pub(super) fn paths(root: &Path) -> io::Result<Vec<PathBuf>> {
    let mut paths = disk::list(&folder(root))?;
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "index"));
    Ok(paths)
}

/// Bytes of all files.
pub(super) fn bytes(root: &Path) -> u64 {
    paths(root).unwrap_or_default().iter().filter_map(|path| fs::metadata(path).ok()).map(|meta| meta.len()).sum()
}

impl Saved {
    pub fn has_files(&self) -> bool {
        !self.files.is_empty()
    }

    /// Opens all files that are there. What cannot be read is none: the index is only a cache.
    pub fn open(root: &Path) -> Self {
        let mut saved = Self::default();
        for _ in 0..ATTEMPTS {
            saved = Self::default();
            let mut merged = false;
            for path in paths(root).unwrap_or_default() {
                match Sorted::open(&path) {
                    Ok(Some(file)) => saved.files.push(file),
                    Ok(None) => saved.useless.push(path),
                    // Another run has merged it since the folder was listed.
                    Err(error) if error.kind() == io::ErrorKind::NotFound => merged = true,
                    Err(_) => saved.useless.push(path),
                }
            }
            if !merged {
                break;
            }
        }
        saved.sort();
        saved
    }

    fn sort(&mut self) {
        self.files.sort_by(|a, b| (a.count(), &a.path).cmp(&(b.count(), &b.path)));
    }

    /// Keeps the files that `ids` knows all packs of; the others.
    pub fn keep_those(&mut self, mut ids: impl FnMut(&Sorted) -> Option<Vec<u32>>) -> Vec<Sorted> {
        let mut others = Vec::new();
        for mut file in std::mem::take(&mut self.files) {
            match ids(&file) {
                Some(ids) => {
                    file.set_ids(ids);
                    self.files.push(file);
                }
                None => {
                    self.useless.push(file.path.clone());
                    others.push(file);
                }
            }
        }
        others
    }

    /// Leaves out files of which a longer one covers all: whoever merged them was killed before they were removed.
    pub fn drop_covered(&mut self) {
        let within =
            |a: &Covered, b: &Covered| (&a.name, a.first) == (&b.name, b.first) && b.from <= a.from && a.to <= b.to;
        let covers = |longer: &Sorted, file: &Sorted| {
            file.foot.packs.iter().all(|part| longer.foot.packs.iter().any(|other| within(part, other)))
        };
        for at in (0..self.files.len()).rev() {
            let (file, longer) = (&self.files[at], &self.files[at + 1..]);
            if longer.iter().any(|longer| covers(longer, file)) {
                self.useless.push(self.files.remove(at).path);
            }
        }
    }

    /// Leaves out what was found damaged.
    pub fn drop_hurt(&mut self) {
        self.keep_those(|file| (!file.is_hurt()).then(|| file.ids().to_vec()));
    }

    pub fn is_hurt(&self) -> bool {
        self.files.iter().any(Sorted::is_hurt)
    }

    /// Whether files are there that the next writing removes.
    pub fn has_useless(&self) -> bool {
        !self.useless.is_empty()
    }

    pub fn releases(&self) -> bool {
        self.files.iter().any(|file| file.foot.releases)
    }

    /// Bytes of the packs that are dead by what the files say; a guess where runs that ended at once have counted the same.
    pub fn dead(&self) -> i64 {
        self.files.iter().fold(0, |dead, file| dead.saturating_add(file.foot.dead))
    }

    pub fn find(&self, named: Named, digest: &Digest) -> Option<Place> {
        self.files.iter().filter_map(|file| file.find(named, digest)).reduce(Place::or_newer)
    }

    /// Up to where each pack is covered without a gap.
    pub fn reach(&self) -> BTreeMap<u32, u64> {
        let mut parts: Vec<(u64, u64, u32)> = self
            .files
            .iter()
            .flat_map(|file| file.foot.packs.iter().zip(file.ids()).map(|(pack, id)| (pack.from, pack.to, *id)))
            .collect();
        parts.sort_unstable();
        let mut reach: BTreeMap<u32, u64> = BTreeMap::new();
        for (from, to, id) in parts {
            let reached = reach.entry(id).or_default();
            if from <= *reached {
                *reached = to.max(*reached);
            }
        }
        reach
    }

    /// The entries of each file.
    pub fn sources(&self) -> impl Iterator<Item = Source<'_>> {
        self.files.iter().map(|file| Box::new(file.entries()) as Source<'_>)
    }

    /// How many of the files, from the shortest on, are merged with so many fresh entries.
    fn merged_with(&self, fresh: u64) -> usize {
        let mut count = fresh;
        let grows = |file: &&Sorted| {
            let merged = file.count() <= FEW.max(count.saturating_mul(2));
            count += file.count();
            merged
        };
        self.files.iter().take_while(grows).count()
    }

    /// Writes what is fresh, with the shorter files or (`whole`) with all of them; then these and all useless ones are removed.
    ///
    /// `names` are those of the packs by their ids. Error: it could not be written, and all is as it was.
    pub fn write(&mut self, root: &Path, fresh: &Fresh, whole: bool, names: &BTreeMap<u32, &str>) -> io::Result<()> {
        let merged = if whole { self.files.len() } else { self.merged_with(fresh.entries.len() as u64) };
        let old = &self.files[..merged];
        let parts = old.iter().flat_map(|file| &file.foot.packs).chain(&fresh.covered).cloned().collect();
        let dead = old.iter().fold(fresh.dead, |dead, file| dead.saturating_add(file.foot.dead));
        let foot = Foot { id: fresh.id, packs: joined(parts), dead, ..Foot::default() };
        if odd::is_old_index(root) {
            fs::remove_file(folder(root))?;
        }
        if !foot.packs.is_empty() {
            let by_name: BTreeMap<&str, u32> = names.iter().map(|(id, name)| (*name, *id)).collect();
            let ids: Option<Vec<u32>> =
                foot.packs.iter().map(|pack| by_name.get(pack.name.as_str()).copied()).collect();
            let ids = ids.ok_or(io::ErrorKind::NotFound)?;
            let numbers: BTreeMap<u32, u32> = ids.iter().copied().zip(0..).collect();
            let path = folder(root).join(format!("{:016x}-{:08x}.index", fresh.id, std::process::id()));
            disk::publish_with(root, &path, &|to| {
                let own: Source<'_> = Box::new(fresh.entries.iter().map(|entry| Ok(*entry)));
                let sources = old.iter().map(|file| Box::new(file.entries()) as Source<'_>).chain([own]);
                let all = merged == self.files.len();
                sorted::write(to, foot.clone(), all, Merged::of(sources), |id| numbers.get(&id).copied())
            })?;
            let mut file = Sorted::open(&path)?.ok_or(io::ErrorKind::InvalidData)?;
            file.set_ids(ids);
            self.files.push(file);
        }
        // Best effort: what stays is merged again, or removed by a later writing.
        let gone = self.files.drain(..merged).map(|file| file.path).chain(self.useless.drain(..));
        gone.for_each(|path| drop(fs::remove_file(path)));
        self.sort();
        Ok(())
    }
}

/// Parts of one pack that touch or overlap are one.
fn joined(mut parts: Vec<Covered>) -> Vec<Covered> {
    parts.sort_by(|a, b| (&a.name, a.from, a.to).cmp(&(&b.name, b.from, b.to)));
    parts.dedup_by(|next, part| {
        let touch = next.name == part.name && next.from <= part.to;
        if touch {
            part.to = part.to.max(next.to);
        }
        touch
    });
    parts
}

pub(super) type Source<'a> = Box<dyn Iterator<Item = io::Result<Entry>> + 'a>;

impl<'a> Merged<'a> {
    /// Each source is in order by itself.
    pub fn of(sources: impl Iterator<Item = Source<'a>>) -> Self {
        Self { sources: sources.map(Iterator::peekable).collect() }
    }
}

impl Iterator for Merged<'_> {
    type Item = io::Result<Entry>;

    fn next(&mut self) -> Option<Self::Item> {
        let mut least: Option<Entry> = None;
        for source in &mut self.sources {
            match source.peek() {
                Some(Ok(entry)) if least.is_none_or(|least| entry.order(&least).is_lt()) => least = Some(*entry),
                Some(Ok(_)) | None => {}
                Some(Err(_)) => return source.next(),
            }
        }
        let mut least = least?;
        let mut place: Option<Place> = None;
        for source in &mut self.sources {
            let same = |next: &io::Result<Entry>| next.as_ref().is_ok_and(|entry| entry.order(&least).is_eq());
            if let Some(Ok(entry)) = source.next_if(same) {
                place = Some(place.map_or(entry.place, |place| place.or_newer(entry.place)));
            }
        }
        least.place = place?;
        Some(Ok(least))
    }
}
