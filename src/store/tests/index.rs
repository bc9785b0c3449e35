//! The index: sorted files, what they say together, merging, damage.

use std::collections::BTreeMap;
use std::io;
use std::sync::atomic::Ordering;

use super::*;
use crate::digest::DigestMap;
use crate::store::place::{Entry, Named, Place};
use crate::store::saved::{Fresh, Saved};
use crate::store::sorted::{self, Covered, Foot, Sorted};

/// Numbers that are the same in each run.
struct Random(blake3::OutputReader);

impl Random {
    fn new(seed: u64) -> Self {
        Self(blake3::Hasher::new().update(&seed.to_le_bytes()).finalize_xof())
    }

    fn number(&mut self) -> u64 {
        let mut bytes = [0; 8];
        self.0.fill(&mut bytes);
        u64::from_le_bytes(bytes)
    }

    fn below(&mut self, n: u64) -> u64 {
        self.number() % n
    }

    fn digest(&mut self) -> Digest {
        let mut bytes = [0; 32];
        self.0.fill(&mut bytes);
        Digest(bytes)
    }

    fn place(&mut self) -> Place {
        let pack = [0, 1, 2, Place::FORGOTTEN, Place::RELEASED, Place::UNKNOWN][self.below(6) as usize];
        let mut word = || self.below(1 << 32) as u32;
        let (offset, length, used) = (word(), word(), word());
        Place { pack, offset, length, used, stamp: self.number() }
    }
}

/// Some digests at random, some that begin alike, some at the ends.
fn digests(random: &mut Random, n: u64) -> Vec<Digest> {
    let alike = random.digest();
    let mut digests: Vec<Digest> = (0..n)
        .map(|i| {
            let mut digest = random.digest();
            match i % 5 {
                0 => digest.0[..8].copy_from_slice(&alike.0[..8]),
                1 => digest.0[..31].copy_from_slice(&alike.0[..31]),
                _ => {}
            }
            digest
        })
        .collect();
    digests.extend([Digest([0; 32]), Digest([255; 32])].iter().take(n as usize));
    digests
}

fn pack(name: &str, from: u64, to: u64) -> Covered {
    Covered { name: name.to_owned(), from, to, first: [7; 16] }
}

const PACKS: [&str; 3] = ["a.pack", "b.pack", "c.pack"];

fn foot() -> Foot {
    Foot { id: 77, packs: PACKS.map(|name| pack(name, 0, 10)).to_vec(), dead: -5, ..Foot::default() }
}

fn entries_of(known: &BTreeMap<(Digest, Named), Place>) -> Vec<Entry> {
    known.iter().map(|((digest, named), place)| Entry { digest: *digest, named: *named, place: *place }).collect()
}

fn written(entries: &[Entry]) -> Vec<u8> {
    let mut bytes = Vec::new();
    sorted::write(&mut bytes, foot(), false, entries.iter().map(|entry| Ok(*entry)), Some).unwrap();
    bytes
}

fn known(random: &mut Random, n: u64) -> BTreeMap<(Digest, Named), Place> {
    let digests = digests(random, n);
    digests.iter().map(|digest| ((*digest, Named::ALL[random.below(5) as usize]), random.place())).collect()
}

/// Whatever is in a file is found as in a map, and nothing else.
#[test]
fn a_look_up_finds_what_a_map_finds() {
    let folder = folder();
    let path = folder.path().join("x.index");
    for n in [0, 1, 2, 71, 72, 73, 144, 1000, 20_000] {
        let mut random = Random::new(n);
        let known = known(&mut random, n);
        let entries = entries_of(&known);
        fs::write(&path, written(&entries)).unwrap();
        assert!(sorted::is_sound(&path).unwrap());
        let file = Sorted::open(&path).unwrap().expect("it is whole");
        assert_eq!((file.count(), file.foot.id, file.foot.dead), (entries.len() as u64, 77, -5));
        assert_eq!(file.foot.packs, foot().packs);
        assert_eq!(file.foot.releases, entries.iter().any(|entry| entry.place.is_released()));
        assert_eq!(file.entries().collect::<io::Result<Vec<_>>>().unwrap(), entries);
        for (digest, _) in known.keys() {
            for named in Named::ALL {
                assert_eq!(file.find(named, digest), known.get(&(*digest, named)).copied(), "{n}: {digest}");
            }
        }
        for digest in digests(&mut random, 1000) {
            assert_eq!(file.find(Named::Blob, &digest), known.get(&(digest, Named::Blob)).copied());
        }
        assert!(!file.is_hurt());
    }
}

/// A look-up reads few blocks, however many there are.
#[test]
fn a_look_up_reads_little() {
    let folder = folder();
    let path = folder.path().join("x.index");
    let mut random = Random::new(1);
    let known: BTreeMap<_, _> = (0..100_000).map(|_| ((random.digest(), Named::Blob), random.place())).collect();
    fs::write(&path, written(&entries_of(&known))).unwrap();
    for (digest, _) in known.keys().step_by(500) {
        let file = Sorted::open(&path).unwrap().expect("it is whole");
        // Of 1389 blocks.
        disk::faults::set(5, usize::MAX);
        let found = file.find(Named::Blob, digest);
        disk::faults::clear(usize::MAX);
        assert!(found.is_some(), "{digest}");
    }
}

/// Each flipped bit and each cut is noticed, or changes nothing that is found.
#[test]
fn no_damage_gives_another_place() {
    let folder = folder();
    let path = folder.path().join("x.index");
    let known = known(&mut Random::new(5), 80);
    let entries = entries_of(&known);
    let whole = written(&entries);
    let look = |bytes: &[u8], case: &str| {
        fs::write(&path, bytes).unwrap();
        assert!(!sorted::is_sound(&path).unwrap_or(false), "{case} is noticed");
        let Ok(Some(file)) = Sorted::open(&path) else { return };
        for ((digest, named), place) in &known {
            match file.find(*named, digest) {
                None => assert!(file.is_hurt(), "{case}"),
                found => assert_eq!(found, Some(*place), "{case}"),
            }
        }
        assert!(file.entries().any(|entry| entry.is_err()), "{case}: who reads it all notices");
    };
    for byte in 0..whole.len() {
        let mut flipped = whole.clone();
        flipped[byte] ^= 1 << (byte % 8);
        look(&flipped, &format!("a bit of byte {byte}"));
    }
    for cut in (0..whole.len()).step_by(7) {
        look(&whole[..cut], &format!("cut at {cut}"));
    }
    // Blocks of another file, and exchanged ones.
    let block = 72 * 56 + 32;
    let mut doubled = entries_of(&self::known(&mut Random::new(5), 300));
    doubled.retain(|entry| entry.digest.0[0] > 0);
    let mut bytes = written(&doubled);
    let (one, two) = bytes[..2 * block].split_at_mut(block);
    one.swap_with_slice(two);
    fs::write(&path, &bytes).unwrap();
    assert!(!sorted::is_sound(&path).unwrap());
}

fn saved(root: &Path, ids: &BTreeMap<&str, u32>) -> Saved {
    let mut saved = Saved::open(root);
    let known = |pack: &Covered| ids.get(pack.name.as_str()).copied();
    assert!(saved.keep_those(|file| file.foot.packs.iter().map(known).collect()).is_empty());
    saved
}

/// Of many small writings few files stay, all entries are found, the newest of each, and what is written in all is little.
#[test]
fn files_are_few_and_the_newest_entry_holds() {
    let folder = folder();
    let names: BTreeMap<u32, &str> = PACKS.iter().zip(0..).map(|(name, id)| (id, *name)).collect();
    let ids = names.iter().map(|(id, name)| (*name, *id)).collect();
    let mut random = Random::new(9);
    let pool: Vec<Digest> = (0..8000).map(|_| random.digest()).collect();
    let mut known: DigestMap<Place> = DigestMap::default();
    let (mut files, mut at, mut rewritten) = (saved(folder.path(), &ids), 0, 0);
    for round in 0..150 {
        let mut fresh: BTreeMap<Digest, Place> = BTreeMap::new();
        for _ in 0..100 {
            // Stamps go up and down: another machine's clock.
            let place = Place { pack: random.below(3) as u32, ..random.place() };
            fresh.insert(pool[random.below(8000) as usize], place);
        }
        for (digest, place) in &fresh {
            known.entry(*digest).and_modify(|old| *old = old.or_newer(*place)).or_insert(*place);
        }
        let entry = |(digest, place): (&Digest, &Place)| Entry { digest: *digest, named: Named::Blob, place: *place };
        let covered = PACKS.map(|name| pack(name, at, at + 10)).to_vec();
        let fresh = Fresh { entries: fresh.iter().map(entry).collect(), covered, dead: 1, id: round };
        files.write(folder.path(), &fresh, false, &names).unwrap();
        at += 10;
        rewritten += fs::metadata(self::files(folder.path()).iter().max().unwrap()).unwrap().len();
        assert!(self::files(&folder.path().join("index")).len() <= 5, "round {round}");
    }
    assert!(rewritten < 15_000 * 56 * 12, "{rewritten} bytes were written");
    for files in [files, saved(folder.path(), &ids)] {
        assert!(pool.iter().all(|digest| files.find(Named::Blob, digest) == known.get(digest).copied()));
        assert_eq!(files.reach(), [0, 1, 2].map(|id| (id, at)).into());
    }
}

/// A part that no file covers is a gap: what lies behind it counts as unknown.
#[test]
fn a_gap_is_not_covered() {
    let folder = folder();
    let names = BTreeMap::from([(4, "a.pack")]);
    let ids = BTreeMap::from([("a.pack", 4)]);
    for (id, from, to) in [(1, 0, 10), (2, 15, 20), (3, 5, 12)] {
        let entries: Vec<Entry> = entries_of(&known(&mut Random::new(id), 2000))
            .into_iter()
            .map(|entry| Entry { place: Place { pack: 4, ..entry.place }, ..entry })
            .take(2000 >> (2 * id))
            .collect();
        let fresh = Fresh { entries, covered: vec![pack("a.pack", from, to)], dead: 0, id };
        saved(&folder.path().join(id.to_string()), &ids).write(folder.path(), &fresh, false, &names).unwrap();
    }
    let mut files = saved(folder.path(), &ids);
    assert_eq!(files.reach(), [(4, 12)].into());
    files
        .write(folder.path(), &Fresh { entries: Vec::new(), covered: Vec::new(), dead: 0, id: 9 }, true, &names)
        .unwrap();
    assert_eq!(files.reach(), [(4, 12)].into(), "merging closes no gap");
    let fresh = Fresh { entries: Vec::new(), covered: vec![pack("a.pack", 12, 15)], dead: 0, id: 10 };
    files.write(folder.path(), &fresh, false, &names).unwrap();
    assert_eq!(files.reach(), [(4, 20)].into());
    assert_eq!(self::files(folder.path()).len(), 1);
}

fn index(outputs: &TempDir) -> PathBuf {
    outputs.path().join("store/index")
}

/// A store of many runs of one instance each, long enough that not all files of its index are one.
fn grown(n: u64) -> TempDir {
    let outputs = folder();
    let store = Store::open(outputs.path()).unwrap();
    for i in 0..n {
        publish(&store, 2 * i, &small(2 * i)).unwrap();
    }
    drop(store);
    publish(&Store::open(outputs.path()).unwrap(), 2 * n, &small(2 * n)).unwrap();
    assert_eq!(files(&index(&outputs)).len(), 2);
    outputs
}

fn has_all(store: &Store, n: u64) -> bool {
    (0..=n).all(|i| {
        // Decoding all takes long in the dev profile.
        let is_right = |blob: &Blob| i % 8 > 0 || store.get(blob).unwrap() == small(2 * i);
        store.record(&key(2 * i)).is_some_and(|record| is_right(&record.ports["out"].blob))
    })
}

/// A file of the index that is gone, or damaged anywhere, is made good from the packs while a store is looked at, and by the next run.
#[test]
fn damaged_files_of_the_index_are_read_again_from_the_packs() {
    let n = 600;
    let whole = grown(n);
    let paths = files(&index(&whole));
    let garble: [fn(&Path); 4] = [
        |path| fs::remove_file(path).unwrap(),
        |path| overwrite(path, b""),
        |path| overwrite(path, &fs::read(path).unwrap()[..5000.min(fs::metadata(path).unwrap().len() as usize - 1)]),
        |path| {
            // A bit of each block.
            let mut bytes = fs::read(path).unwrap();
            bytes.chunks_mut(4000).for_each(|piece| piece[0] ^= 1);
            overwrite(path, &bytes);
        },
    ];
    for (case, garble) in garble.iter().enumerate() {
        for path in &paths {
            let outputs = folder();
            copy(whole.path(), outputs.path());
            garble(&outputs.path().join(path.strip_prefix(whole.path()).unwrap()));
            let store = Store::open_read_only(outputs.path()).unwrap();
            assert_eq!(store.verify(false).unwrap().is_clean(), case == 0, "{case}");
            assert!(has_all(&store, n), "{case}");
            assert_eq!((store.digests().len(), store.records().count()), (601, 601), "{case}");
            drop(store);
            let store = Store::open(outputs.path()).unwrap();
            assert!(has_all(&store, n), "{case}");
            drop(store);
            let store = Store::open(outputs.path()).unwrap();
            assert!(has_all(&store, n) && store.folder.packs.is_complete().is_ok(), "{case}");
            store.verify(true).unwrap();
            assert!(store.verify(false).unwrap().is_clean(), "{case}");
        }
    }
}

/// Killed between the writing of a merged file and the removal of what went into it: all is there twice, and found once.
#[test]
fn files_that_were_merged_and_stayed_do_no_harm() {
    let n = 600;
    let outputs = grown(n);
    let kept = folder();
    copy(&index(&outputs), kept.path());
    Store::open(outputs.path()).unwrap().folder.packs.save_index().unwrap();
    assert_eq!(files(&index(&outputs)).len(), 1);
    copy(kept.path(), &index(&outputs));
    assert_eq!(files(&index(&outputs)).len(), 3);
    let store = Store::open(outputs.path()).unwrap();
    assert!(has_all(&store, n) && store.verify(false).unwrap().is_clean());
    assert_eq!(store.stat().unwrap().records, 601);
    publish(&store, 2000, &small(2000)).unwrap();
    store.finish().unwrap();
    assert_eq!(files(&index(&outputs)).len(), 2, "what went into the merged one is gone");
    assert!(has_all(&Store::open(outputs.path()).unwrap(), n));
}

/// Two that end at once each write what they know; nothing is read again by the next one.
#[test]
fn two_that_end_at_once_both_write_the_index() {
    let outputs = folder();
    let stores = [0, 1].map(|_| Store::open(outputs.path()).unwrap());
    for (i, store) in stores.iter().enumerate() {
        publish(store, i as u64, &small(i as u64)).unwrap();
    }
    for store in &stores {
        store.folder.packs.save_index().unwrap();
    }
    assert_eq!(files(&index(&outputs)).len(), 2);
    drop(stores);
    let store = Store::open(outputs.path()).unwrap();
    assert_eq!(store.folder.packs.state().index.recent(), 0);
    assert!([0, 1].iter().all(|&i| store.record(&key(i)).is_some()));
}

/// A long run keeps little of the index in memory.
#[test]
fn what_is_written_leaves_memory() {
    let outputs = folder();
    let store = Store::open(outputs.path()).unwrap();
    let recent = || store.folder.packs.state().index.recent();
    for i in 0..60 {
        store.folder.packs.most_recent.store(50, Ordering::Relaxed);
        publish(&store, 2 * i, &small(2 * i)).unwrap();
        assert!(recent() <= 50, "{} entries after {i}", recent());
    }
    assert!(!files(&index(&outputs)).is_empty() && has_all(&store, 59));
    drop(store);
    assert!(has_all(&Store::open(outputs.path()).unwrap(), 59));
}

/// The one file that turbid kept up to 0.1 is no damage, and gives way to the folder.
#[test]
fn an_index_of_earlier_versions_gives_way() {
    let (outputs, digests) = filled(4);
    fs::remove_dir_all(index(&outputs)).unwrap();
    fs::write(index(&outputs), b"turbid index 3\n\0and places").unwrap();
    let store = Store::open_read_only(outputs.path()).unwrap();
    assert!(store.verify(false).unwrap().is_clean());
    drop(store);
    assert_heals(outputs.path(), 4, &digests, "an old index");
    assert_eq!(files(&index(&outputs)).len(), 1);
    assert!(!outputs.path().join("store/quarantine").exists());
}

/// A run that cannot write the index works as any other.
#[test]
fn an_index_that_cannot_be_written_is_no_error() {
    let (outputs, digests) = filled(4);
    fs::remove_dir_all(index(&outputs)).unwrap();
    disk::quota::set(Some(0));
    let store = Store::open(outputs.path()).unwrap();
    assert_eq!(run(&store, 4), 4);
    disk::quota::set(None);
    assert!(files(&index(&outputs)).is_empty());
    drop(store);
    assert_heals(outputs.path(), 4, &digests, "no index");
}
