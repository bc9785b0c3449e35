//! Checkpoints: states from which a killed or a longer run goes on.
//!
//! One file each: magic (16), progress (8), length (8), BLAKE3 of state key, progress and state (32), state.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::{self, BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use crate::digest::{Digest, PartHasher};
use crate::store::disk;
use crate::store::error::StoreError;
use crate::store::large;

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

    /// Writes a checkpoint, then removes those that [`kept`] does not name.
    ///
    /// Not synced: after a power cut a torn file is ignored, and older ones are still there.
    pub fn write(&self, state_key: &Digest, progress: u64, state: &[u8]) -> Result<(), StoreError> {
        let path = self.folder(state_key).join(format!("{state_key}-{progress:016x}.state"));
        let mut bytes = Vec::with_capacity(HEADER + state.len());
        bytes.extend_from_slice(MAGIC);
        bytes.extend_from_slice(&progress.to_le_bytes());
        bytes.extend_from_slice(&(state.len() as u64).to_le_bytes());
        bytes.extend_from_slice(&check(state_key, progress, state).0);
        bytes.extend_from_slice(state);
        disk::publish(&self.root, &path, &bytes, false, false).map_err(StoreError::io("write a checkpoint", &path))?;
        let all = self.of(state_key);
        let keep = kept(&all.iter().map(|c| c.progress).collect::<Vec<_>>());
        for old in all.iter().filter(|c| !keep.contains(&c.progress)) {
            // One too many is harmless: the next checkpoint tries again, and `gc` counts it.
            let _ = fs::remove_file(&old.path);
        }
        Ok(())
    }

    /// As [`write`](Self::write), of a state that `write` writes piece by piece: it is called twice, and no copy of the state is made.
    pub fn write_with(
        &self,
        state_key: &Digest,
        progress: u64,
        write: &dyn Fn(&mut dyn Write) -> io::Result<()>,
    ) -> Result<(), StoreError> {
        let path = self.folder(state_key).join(format!("{state_key}-{progress:016x}.state"));
        self.write_pieces(state_key, progress, write, &path).map_err(StoreError::io("write a checkpoint", &path))?;
        self.thin_out(state_key);
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
        let mut file = large::temporary(&self.root)?;
        let hasher = {
            let to = BufWriter::with_capacity(1 << 20, large::Passing(file.as_file_mut()));
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
        large::publish(file, path, false, false)
    }

    fn thin_out(&self, state_key: &Digest) {
        let all = self.of(state_key);
        let keep = kept(&all.iter().map(|c| c.progress).collect::<Vec<_>>());
        for old in all.iter().filter(|c| !keep.contains(&c.progress)) {
            let _ = fs::remove_file(&old.path);
        }
    }

    /// As [`resume`](Self::resume), of a state that `read` reads piece by piece. Whether there is one.
    pub fn resume_with(&self, state_key: &Digest, at_most: u64, read: &mut dyn FnMut(&mut dyn Read)) -> bool {
        let mut all = self.of(state_key);
        all.retain(|c| c.progress <= at_most);
        let Some(mut file) = all.iter().rev().find_map(Checkpoint::open) else { return false };
        read(&mut file);
        true
    }

    /// The furthest undamaged checkpoint with `progress <= at_most`.
    pub fn resume(&self, state_key: &Digest, at_most: u64) -> Option<(u64, Vec<u8>)> {
        let mut all = self.of(state_key);
        all.retain(|c| c.progress <= at_most);
        all.iter().rev().find_map(|c| Some((c.progress, c.read()?)))
    }

    pub fn has(&self, state_key: &Digest, progress: u64) -> bool {
        self.of(state_key).iter().any(|c| c.progress == progress)
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

    pub fn all(&self) -> Vec<Checkpoint> {
        let folders = fs::read_dir(self.root.join("checkpoints")).into_iter().flatten().flatten();
        let mut all: Vec<_> = folders.flat_map(|folder| list(&folder.path()).unwrap_or_default()).collect();
        all.sort_by(|a, b| a.path.cmp(&b.path));
        all
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
    fn open(&self) -> Option<impl Read> {
        let mut file = File::open(&self.path).ok().filter(|file| file.metadata().is_ok_and(|meta| meta.is_file()))?;
        let mut head = [0; HEADER];
        file.read_exact(&mut head).ok()?;
        let length = u64::from_le_bytes(head[24..32].try_into().expect("eight bytes"));
        let told = head[..16] == *MAGIC && head[16..24] == self.progress.to_le_bytes();
        if !told || file.metadata().ok()?.len() != (HEADER as u64).checked_add(length)? {
            return None;
        }
        let mut hashed = Hashed { hasher: begun(&self.state_key, self.progress, length), to: io::sink() };
        io::copy(&mut file, &mut hashed).ok()?;
        if hashed.hasher.finish().0 != head[32..] {
            return None;
        }
        file.seek(SeekFrom::Start(HEADER as u64)).ok()?;
        Some(BufReader::with_capacity(1 << 20, file.take(length)))
    }

    /// The state; `None` where the file is damaged or gone.
    pub fn read(&self) -> Option<Vec<u8>> {
        let mut bytes = disk::read_regular(&self.path).ok()?;
        let head = bytes.get(..HEADER)?;
        let state = &bytes[HEADER..];
        let whole = head[..16] == *MAGIC
            && head[16..24] == self.progress.to_le_bytes()
            && head[24..32] == (state.len() as u64).to_le_bytes()
            && head[32..] == check(&self.state_key, self.progress, state).0;
        whole.then(|| {
            bytes.drain(..HEADER);
            bytes
        })
    }
}

fn check(state_key: &Digest, progress: u64, state: &[u8]) -> Digest {
    let hasher = PartHasher::new("turbid checkpoint v1").part("key", &state_key.0);
    hasher.part("progress", &progress.to_le_bytes()).part("state", state).finish()
}

fn list(folder: &Path) -> io::Result<Vec<Checkpoint>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder)?.flatten() {
        let path = entry.path();
        let parsed = path.file_name().and_then(|n| n.to_str()).and_then(|n| n.strip_suffix(".state")).and_then(|n| {
            let (key, progress) = n.split_once('-')?;
            Some((key.parse().ok()?, u64::from_str_radix(progress, 16).ok()?))
        });
        if let (Some((state_key, progress)), Ok(meta)) = (parsed, fs::metadata(&path))
            && meta.is_file()
        {
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

    #[test]
    fn the_furthest_of_three_octaves_stay() {
        let folder = tempfile::tempdir().unwrap();
        let checkpoints = Checkpoints::new(folder.path());
        for progress in 0..=100 {
            checkpoints.write(&key(), progress, &[progress as u8; 10]).unwrap();
        }
        checkpoints.write(&Digest::of(b"another state"), 7, b"").unwrap();
        let found = |at_most| checkpoints.resume(&key(), at_most).map(|(p, state)| (p, state[0]));
        assert_eq!(
            [u64::MAX, 100, 99, 63, 62, 31, 30].map(found),
            [Some((100, 100)), Some((100, 100)), Some((63, 63)), Some((63, 63)), Some((31, 31)), Some((31, 31)), None]
        );
        assert_eq!(checkpoints.all().len(), 4);
    }

    /// A torn or flipped checkpoint is ignored, and the one before it serves.
    #[test]
    fn damage_is_ignored() {
        let folder = tempfile::tempdir().unwrap();
        let checkpoints = Checkpoints::new(folder.path());
        checkpoints.write(&key(), 1, b"one").unwrap();
        checkpoints.write(&key(), 2, b"two").unwrap();
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
            assert_eq!(checkpoints.resume(&key(), 9), Some((1, b"one".to_vec())));
        }
        fs::write(&path, whole).unwrap();
        assert_eq!(checkpoints.resume(&key(), 9), Some((2, b"two".to_vec())));
    }
}
