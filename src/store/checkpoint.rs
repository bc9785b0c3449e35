//! Checkpoints: states from which a killed or a longer run goes on.
//!
//! One file each: magic (16), progress (8), length (8), BLAKE3 of state key, progress and state (32), state.

use std::collections::BTreeSet;
use std::fs;
use std::io::{self, BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use crate::digest::{Digest, PartHasher};
use crate::store::disk;
use crate::store::error::StoreError;

const MAGIC: &[u8; 16] = b"turbid state 1\n\0";
const HEADER: usize = 64;

/// The checkpoints in a folder.
pub(super) struct Checkpoints {
    root: PathBuf,
}

/// A checkpoint file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Checkpoint {
    pub state_key: Digest,
    pub progress: u64,
    pub path: PathBuf,
    pub bytes: u64,
    /// Unix time, s.
    pub written: u64,
}

impl Checkpoints {
    pub fn new(root: &Path) -> Self {
        Self { root: root.to_owned() }
    }

    fn folder(&self, state_key: &Digest) -> PathBuf {
        self.root.join("checkpoints").join(&state_key.to_string()[..2])
    }

    /// Writes a checkpoint of a state that `write` writes piece by piece, then removes those that [`kept`] does not name. `write` is called twice,
    /// so that no copy of the state is made.
    ///
    /// Not synced: after a power cut a torn file is ignored, and older ones are still there.
    pub fn write(
        &self,
        state_key: &Digest,
        progress: u64,
        write: &dyn Fn(&mut dyn Write) -> io::Result<()>,
    ) -> Result<(), StoreError> {
        let path = self.folder(state_key).join(format!("{state_key}-{progress:016x}.state"));
        self.write_pieces(state_key, progress, write, &path).map_err(StoreError::io("write a checkpoint", &path))?;
        let all = self.of(state_key);
        let keep = kept(&all.iter().map(|c| c.progress).collect::<Vec<_>>());
        for old in all.iter().filter(|c| !keep.contains(&c.progress)) {
            // One too many is harmless: the next checkpoint tries again, and `gc` counts it.
            let _ = fs::remove_file(&old.path);
        }
        Ok(())
    }

    fn write_pieces(
        &self,
        state_key: &Digest,
        progress: u64,
        write: &dyn Fn(&mut dyn Write) -> io::Result<()>,
        path: &Path,
    ) -> io::Result<()> {
        let mut length = Counted(0);
        write(&mut length)?;
        let mut file = disk::temporary(&self.root)?;
        let hasher = {
            let to = BufWriter::with_capacity(1 << 20, disk::Passing(file.as_file_mut()));
            let mut hashed = Hashed { hasher: begun(state_key, progress, length.0), to };
            hashed.to.write_all(&[0; HEADER])?;
            write(&mut hashed)?;
            hashed.to.flush()?;
            hashed.hasher
        };
        let mut head = Vec::with_capacity(HEADER);
        head.extend_from_slice(MAGIC);
        head.extend_from_slice(&progress.to_le_bytes());
        head.extend_from_slice(&length.0.to_le_bytes());
        head.extend_from_slice(&hasher.finish().0);
        file.as_file_mut().seek(SeekFrom::Start(0))?;
        disk::write(file.as_file_mut(), &head)?;
        disk::publish_file(&self.root, file, path, false, false)
    }

    /// Lets `read` read the furthest undamaged checkpoint with `progress <= at_most`, piece by piece. Whether there is one.
    pub fn resume(&self, state_key: &Digest, at_most: u64, read: &mut dyn FnMut(u64, &mut dyn Read)) -> bool {
        let mut all = self.of(state_key);
        all.retain(|c| c.progress <= at_most);
        // One that cannot be read now is left for later.
        let opened = all.iter().rev().find_map(|c| Some((c.progress, c.open().ok()??)));
        let Some((progress, mut state)) = opened else { return false };
        read(progress, &mut state);
        true
    }

    /// Removes the checkpoints of a state but those of these progresses.
    pub fn forget(&self, state_key: &Digest, but: &BTreeSet<u64>) {
        for old in self.of(state_key).iter().filter(|c| !but.contains(&c.progress)) {
            // One that stays is checked like any other when it is read.
            let _ = fs::remove_file(&old.path);
        }
    }

    /// The checkpoints of a state, by progress.
    fn of(&self, state_key: &Digest) -> Vec<Checkpoint> {
        let mut all = list(&self.folder(state_key)).unwrap_or_default();
        all.retain(|c| c.state_key == *state_key);
        all.sort_by_key(|c| c.progress);
        all
    }

    /// All of them, by path. Error: one cannot be looked at.
    pub fn all(&self) -> Result<Vec<Checkpoint>, StoreError> {
        let mut all = Vec::new();
        let folder = self.root.join("checkpoints");
        for folder in disk::list(&folder).map_err(StoreError::io("read the store", &folder))? {
            all.extend(list(&folder).map_err(StoreError::io("read the store", &folder))?);
        }
        Ok(all)
    }
}

/// Counts what is written.
struct Counted(u64);

impl Write for Counted {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0 += bytes.len() as u64;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Hashes what is written on its way.
struct Hashed<W> {
    hasher: PartHasher,
    to: W,
}

impl<W: Write> Write for Hashed<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.hasher.more(bytes);
        self.to.write_all(bytes)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.to.flush()
    }
}

/// What the check of a state hashes before its bytes.
fn begun(state_key: &Digest, progress: u64, length: u64) -> PartHasher {
    let hasher = PartHasher::new("turbid checkpoint v1").part("key", &state_key.0);
    let mut hasher = hasher.part("progress", &progress.to_le_bytes());
    hasher.begin("state", length);
    hasher
}

impl Checkpoint {
    /// The undamaged state, to be read from its beginning; it has been read once, to compare it with its check.
    /// Error: it cannot be read, which says nothing about what is in it.
    fn open(&self) -> io::Result<Option<impl Read>> {
        let mut file = match disk::open_regular(&self.path) {
            Err(error) if disk::is_absent(&error) => return Ok(None),
            opened => opened?,
        };
        let all = file.metadata()?.len();
        if all < HEADER as u64 {
            return Ok(None);
        }
        let head = disk::read_at(&file, 0, HEADER)?;
        let length = u64::from_le_bytes(head[24..32].try_into().expect("eight bytes"));
        let told = head[..16] == *MAGIC && head[16..24] == self.progress.to_le_bytes();
        if !told || Some(all) != (HEADER as u64).checked_add(length) {
            return Ok(None);
        }
        let mut hashed = Hashed { hasher: begun(&self.state_key, self.progress, length), to: io::sink() };
        file.seek(SeekFrom::Start(HEADER as u64))?;
        io::copy(&mut file, &mut hashed)?;
        if hashed.hasher.finish().0 != head[32..] {
            return Ok(None);
        }
        file.seek(SeekFrom::Start(HEADER as u64))?;
        Ok(Some(BufReader::with_capacity(1 << 20, file.take(length))))
    }

    /// Whether the file is there and undamaged. Error: it cannot be read.
    pub fn is_whole(&self) -> io::Result<bool> {
        Ok(self.open()?.is_some())
    }
}

fn list(folder: &Path) -> io::Result<Vec<Checkpoint>> {
    let mut found = Vec::new();
    for path in disk::list(folder)? {
        let parsed = path.file_name().and_then(|n| n.to_str()).and_then(|n| n.strip_suffix(".state")).and_then(|n| {
            let (key, progress) = n.split_once('-')?;
            Some((key.parse().ok()?, u64::from_str_radix(progress, 16).ok()?))
        });
        let Some((state_key, progress)) = parsed else { continue };
        if let Some(meta) = disk::look(&path)?.filter(fs::Metadata::is_file) {
            let written = meta.modified().ok().and_then(|t| t.duration_since(std::time::UNIX_EPOCH).ok());
            let written = written.map_or(0, |t| t.as_secs());
            found.push(Checkpoint { state_key, progress, path, bytes: meta.len(), written });
        }
    }
    Ok(found)
}

/// Which of the ascending `progress` values are kept, at most three: the furthest of each of the three highest octaves
/// (2^k .. 2^(k+1) - 1) that occur. So a run shorter than the longest repeats at most about half of its work.
fn kept(progress: &[u64]) -> Vec<u64> {
    let mut keep: Vec<u64> = Vec::new();
    for &p in progress.iter().rev() {
        if keep.last().is_none_or(|last| last.leading_zeros() != p.leading_zeros()) {
            keep.push(p);
        }
    }
    keep.truncate(3);
    keep
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key() -> Digest {
        Digest::of(b"state")
    }

    fn write(checkpoints: &Checkpoints, key: &Digest, progress: u64, state: &[u8]) {
        checkpoints.write(key, progress, &|to| to.write_all(state)).unwrap();
    }

    fn resumed(checkpoints: &Checkpoints, at_most: u64) -> Option<(u64, Vec<u8>)> {
        let mut found = None;
        checkpoints.resume(&key(), at_most, &mut |progress, from| {
            let mut state = Vec::new();
            from.read_to_end(&mut state).unwrap();
            found = Some((progress, state));
        });
        found
    }

    #[test]
    fn the_furthest_of_three_octaves_stay() {
        let folder = tempfile::tempdir().unwrap();
        let checkpoints = Checkpoints::new(folder.path());
        for progress in 0..=100 {
            write(&checkpoints, &key(), progress, &[progress as u8; 10]);
        }
        write(&checkpoints, &Digest::of(b"another state"), 7, b"");
        let found = |at_most| resumed(&checkpoints, at_most).map(|(p, state)| (p, state[0]));
        assert_eq!(
            [u64::MAX, 100, 99, 63, 62, 31, 30].map(found),
            [Some((100, 100)), Some((100, 100)), Some((63, 63)), Some((63, 63)), Some((31, 31)), Some((31, 31)), None]
        );
        assert_eq!(checkpoints.all().unwrap().len(), 4);
    }

    /// A torn or flipped checkpoint is ignored, and the one before it serves.
    #[test]
    fn damage_is_ignored() {
        let folder = tempfile::tempdir().unwrap();
        let checkpoints = Checkpoints::new(folder.path());
        write(&checkpoints, &key(), 1, b"one");
        write(&checkpoints, &key(), 2, b"two");
        let path = checkpoints.of(&key())[1].path.clone();
        let whole = fs::read(&path).unwrap();
        let cuts = (0..whole.len()).map(|n| whole[..n].to_vec());
        let flips = (0..whole.len() * 8).map(|bit| {
            let mut flipped = whole.clone();
            flipped[bit / 8] ^= 1 << (bit % 8);
            flipped
        });
        for wrong in cuts.chain(flips) {
            fs::write(&path, wrong).unwrap();
            assert_eq!(resumed(&checkpoints, 9), Some((1, b"one".to_vec())));
        }
        fs::write(&path, whole).unwrap();
        assert_eq!(resumed(&checkpoints, 9), Some((2, b"two".to_vec())));
    }
}
