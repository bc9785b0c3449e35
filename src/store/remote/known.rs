//! What is known of a store elsewhere: its manifests, read once and kept beside the local store.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use crate::digest::Digest;
use crate::store::disk;
use crate::store::record::Blob;

use super::aside::{AT_ONCE, side_by_side};
use super::manifest::{Listing, Manifest, Piece, Read, Spot};
use super::objects::{Listed, Objects, RemoteError};

/// Where manifests are.
pub(super) const MANIFESTS: &str = "manifests";
/// No manifest is longer; pushes make none of more than a quarter of it.
const LONGEST: u64 = 1 << 30;

/// The manifests that hold: of those that others cover none is asked.
#[derive(Default)]
pub(super) struct Known {
    /// Those written last come first.
    pub live: Vec<Manifest>,
}

impl Known {
    /// The records of a key, the best first.
    pub fn records(&self, key: &Digest) -> Vec<Listing> {
        let mut found: Vec<Listing> = self.live.iter().filter_map(|manifest| manifest.record(key)).collect();
        found.sort_by(|a, b| b.cmp(a));
        found.dedup();
        found
    }

    /// Where a small blob lies, the latest place first.
    pub fn blobs(&self, digest: &Digest) -> impl Iterator<Item = Spot> {
        self.live.iter().filter_map(|manifest| manifest.blob(digest))
    }

    /// The objects that a large blob is made of, as the latest manifest says.
    pub fn loose(&self, digest: &Digest) -> impl Iterator<Item = Vec<Piece>> {
        self.live.iter().filter_map(|manifest| manifest.pieces_of(digest))
    }

    /// Whether a blob is listed, in full length.
    pub fn lists(&self, blob: &Blob) -> bool {
        let whole = |pieces: Vec<Piece>| pieces.iter().map(|piece| piece.bytes).sum::<u64>() == blob.bytes;
        self.blobs(&blob.digest).next().is_some() || self.loose(&blob.digest).any(whole)
    }

    /// The keys of all records.
    pub fn keys(&self) -> BTreeSet<Digest> {
        self.live.iter().flat_map(|manifest| manifest.records().map(|(key, _)| key)).collect()
    }

    /// The packs and their lengths.
    pub fn packs(&self) -> BTreeMap<Digest, u64> {
        self.live.iter().flat_map(Manifest::packs).collect()
    }

    /// The objects that large blobs are made of, and their lengths.
    pub fn pieces(&self) -> BTreeMap<Digest, u64> {
        let pieces = self.live.iter().flat_map(Manifest::loose).flat_map(|(_, pieces)| pieces);
        pieces.map(|piece| (piece.digest, piece.bytes)).collect()
    }

    /// Takes in a manifest that was just written.
    pub fn add(&mut self, manifest: Manifest) {
        let covered: BTreeSet<Digest> = manifest.covers().collect();
        self.live.retain(|old| !covered.contains(&old.name));
        self.live.insert(0, manifest);
    }
}

/// What a look for manifests found.
pub(super) struct Found {
    pub known: Known,
    /// Manifests that are whole here and have another length elsewhere.
    pub torn: Vec<Digest>,
    /// What is not what its name says, in words.
    pub damaged: Vec<String>,
}

/// Where the manifests of one store elsewhere are kept: `store/remote/ADDRESS/`.
pub(super) struct Cache<'a> {
    /// Of the local store.
    pub root: &'a Path,
    pub folder: PathBuf,
}

impl Cache<'_> {
    fn path(&self, name: &Digest) -> PathBuf {
        self.folder.join(name.to_string())
    }

    /// Only a cache: what cannot be written is fetched again.
    pub fn keep(&self, manifest: &Manifest) {
        let _ = disk::publish(self.root, &self.path(&manifest.name), manifest.bytes(), false, false);
    }

    fn read(&self, name: &Digest) -> Option<Manifest> {
        match Manifest::read(*name, disk::read_regular(&self.path(name)).ok()?) {
            Read::Whole(manifest) => Some(manifest),
            Read::Newer | Read::Damaged => None,
        }
    }

    /// The manifests of all stores elsewhere that are kept beside the local one.
    pub fn of_all(root: &Path) -> Known {
        let folders = disk::list(&root.join("remote")).unwrap_or_default();
        let read = |folder: PathBuf| {
            let cache = Cache { root, folder };
            let names = disk::list(&cache.folder).unwrap_or_default();
            let names = names.iter().filter_map(|path| path.file_name()?.to_str()?.parse().ok());
            names.filter_map(|name| cache.read(&name)).collect::<Vec<_>>()
        };
        Known { live: folders.into_iter().flat_map(read).collect() }
    }

    /// Removes what no longer holds.
    fn sweep(&self, live: &[Manifest]) {
        for path in disk::list(&self.folder).unwrap_or_default() {
            let name = path.file_name().and_then(|name| name.to_str()).and_then(|name| name.parse::<Digest>().ok());
            if name.is_some_and(|name| live.iter().all(|manifest| manifest.name != name)) {
                let _ = fs::remove_file(path);
            }
        }
    }
}

/// Lists the manifests and fetches those that are not in the cache, the latest first: what they cover is not fetched.
///
/// Errors: the list or a manifest cannot be read; one is of a later format.
pub(super) fn look(objects: &dyn Objects, cache: &Cache<'_>) -> Result<Found, RemoteError> {
    let mut listed = objects.list(MANIFESTS)?;
    listed.sort_by(|a, b| (&b.modified, &b.name).cmp(&(&a.modified, &a.name)));
    let named = listed.iter().filter_map(|object| Some((object.name.parse::<Digest>().ok()?, object)));
    let mut open: Vec<(Digest, &Listed)> = named.collect();
    let mut found = Found { known: Known::default(), torn: Vec::new(), damaged: Vec::new() };
    let mut covered = BTreeSet::new();
    while !open.is_empty() {
        let block: Vec<_> = open.drain(..open.len().min(AT_ONCE)).collect();
        let read = side_by_side(&block, |(name, object)| fetch(objects, cache, name, object.bytes));
        for (read, (name, object)) in read.into_iter().zip(block) {
            match read? {
                Ok(manifest) => {
                    if manifest.bytes().len() as u64 != object.bytes {
                        found.torn.push(name);
                    }
                    covered.extend(manifest.covers());
                    found.known.live.push(manifest);
                }
                Err(damaged) => found.damaged.push(damaged),
            }
        }
        open.retain(|(name, _)| !covered.contains(name));
    }
    let live = &mut found.known.live;
    live.retain(|manifest| !covered.contains(&manifest.name));
    live.sort_by_key(|manifest| std::cmp::Reverse((manifest.written, manifest.name)));
    cache.sweep(live);
    Ok(found)
}

/// A manifest, or in words that there is none under its name.
fn fetch(
    objects: &dyn Objects,
    cache: &Cache<'_>,
    name: &Digest,
    bytes: u64,
) -> Result<Result<Manifest, String>, RemoteError> {
    if let Some(manifest) = cache.read(name) {
        return Ok(Ok(manifest));
    }
    let object = format!("{MANIFESTS}/{name}");
    let read = match objects.get(&object, 0..bytes.min(LONGEST))? {
        Some(bytes) => Manifest::read(*name, bytes),
        None => Read::Damaged,
    };
    match read {
        Read::Whole(manifest) => {
            cache.keep(&manifest);
            Ok(Ok(manifest))
        }
        Read::Newer => Err(RemoteError::new(format!(
            "{object} was written by a later turbid, and this one does not know its format; update turbid, or give another prefix"
        ))),
        Read::Damaged => Ok(Err(format!(
            "{object} is cut short, replaced or gone: what it lists counts as missing; remove the object if it stays so"
        ))),
    }
}

#[cfg(test)]
mod tests {
    use super::super::folder::FolderObjects;
    use super::super::manifest::tests::{digest_of, example};
    use super::*;

    fn put(objects: &dyn Objects, bytes: &[u8]) -> Digest {
        let name = Digest::of(bytes);
        objects.put(&format!("{MANIFESTS}/{name}"), bytes).unwrap();
        name
    }

    /// What is whole is known; halves and what is covered by others is not; what is known is not fetched again.
    #[test]
    fn manifests_are_fetched_once() {
        let folder = tempfile::tempdir().unwrap();
        let objects = FolderObjects::new(&folder.path().join("elsewhere"));
        let root = folder.path().join("store");
        let cache = || Cache { root: &root, folder: root.join("remote/x") };
        assert!(look(&objects, &cache()).unwrap().known.live.is_empty());
        let first = put(&objects, &example(0).encode(1));
        let second = put(&objects, &example(1000).encode(2));
        let half = example(2000).encode(3);
        let name = Digest::of(&half);
        objects.put(&format!("{MANIFESTS}/{name}"), &half[..half.len() / 2]).unwrap();
        objects.put(&format!("{MANIFESTS}/notes.txt"), b"not ours").unwrap();
        let found = look(&objects, &cache()).unwrap();
        assert_eq!(found.known.live.iter().map(|m| m.name).collect::<Vec<_>>(), [second, first]);
        assert!(found.damaged.len() == 1 && found.damaged[0].contains(&name.to_string()), "{:?}", found.damaged);
        assert_eq!(found.known.records(&digest_of(20)).len(), 1);
        assert_eq!(found.known.keys().len(), 60);
        let before = objects.traffic().requests;
        assert_eq!(look(&objects, &cache()).unwrap().known.live.len(), 2);
        assert_eq!(objects.traffic().requests - before, 2, "the list, and the half one again");

        let mut all = super::super::manifest::Contents::default();
        found.known.live.iter().for_each(|manifest| all.cover(manifest, |_| true));
        let third = put(&objects, &all.encode(4));
        let found = look(&objects, &cache()).unwrap();
        assert_eq!(found.known.live.iter().map(|m| m.name).collect::<Vec<_>>(), [third]);
        assert_eq!(fs::read_dir(root.join("remote/x")).unwrap().count(), 1, "the others are not kept");
        // A flipped bit in the cache is only a reason to fetch again.
        let path = root.join("remote/x").join(third.to_string());
        let mut bytes = fs::read(&path).unwrap();
        bytes[100] ^= 1;
        fs::remove_file(&path).unwrap();
        fs::write(&path, bytes).unwrap();
        assert_eq!(look(&objects, &cache()).unwrap().known.live.len(), 1);
    }
}
