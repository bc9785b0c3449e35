//! Manifests: what lies in the packs and blobs of a store elsewhere. Each push writes one, after all that it lists.
//!
//! An object named by the BLAKE3 of its bytes, so that half of one, or another one in its place, is none. Little-endian, tables sorted by key so that
//! they are searched as they lie: [`MAGIC`] (16), Unix time in ns (8), the number of entries of each table (6 x 8), and the tables:
//!
//! | table | entry |
//! |---|---|
//! | covers | name of a manifest all of which is in this one (32) |
//! | packs | digest (32), length (8) |
//! | records | key (32), check over its outputs (16), stamp (8), pack (4), offset (4), payload bytes (4), ports (4) |
//! | blobs in packs | digest (32), pack (4), offset (4), payload bytes (4) |
//! | blobs of their own | digest (32), length (8), first piece (4), pieces (4); none of a blob that is one object |
//! | pieces | digest (32), length (4) |

use std::collections::BTreeMap;

use crate::digest::{Digest, PartHasher};
use crate::store::frame::HEADER;
use crate::store::record::InstanceRecord;

/// The name of the format, and its number.
const MAGIC: &[u8; 16] = b"turbid remote 1\n";
/// What manifests of later formats begin with too.
const ANY_FORMAT: &[u8] = b"turbid remote ";
const TABLES: usize = 6;
/// Bytes of an entry of each table.
const SIZES: [usize; TABLES] = [32, 40, 72, 44, 48, 36];
const COVERS: usize = 0;
const PACKS: usize = 1;
const RECORDS: usize = 2;
const BLOBS: usize = 3;
const LOOSE: usize = 4;
const PIECES: usize = 5;
const HEAD: usize = 16 + 8 + 8 * TABLES;

/// The outputs of a record as one check: which ports it holds, with which bytes.
pub(super) fn outputs_check(record: &InstanceRecord) -> [u8; 16] {
    let mut parts = PartHasher::new("turbid outputs of a record v1");
    record.ports.iter().for_each(|(name, port)| parts.add(name, &port.blob.digest.0));
    parts.finish().0[..16].try_into().expect("a digest has 32 bytes")
}

/// Where a frame lies in a pack.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Spot {
    pub pack: Digest,
    /// Of the frame's header.
    pub offset: u64,
    /// Of header and payload.
    pub length: u64,
}

impl Spot {
    pub fn end(&self) -> u64 {
        self.offset + self.length
    }
}

/// A record in a pack. Of two for one key the greater serves: more ports, or written later.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Listing {
    pub ports: u32,
    pub stamp: u64,
    pub check: [u8; 16],
    pub spot: Spot,
}

/// A part of a blob, an object of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Piece {
    pub digest: Digest,
    pub bytes: u64,
}

/// What a manifest is to say.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Contents {
    pub covers: Vec<Digest>,
    /// With their lengths.
    pub packs: BTreeMap<Digest, u64>,
    pub records: BTreeMap<Digest, Listing>,
    pub blobs: BTreeMap<Digest, Spot>,
    pub loose: BTreeMap<Digest, Vec<Piece>>,
}

impl Contents {
    pub fn is_empty(&self) -> bool {
        self.records.is_empty() && self.blobs.is_empty() && self.loose.is_empty()
    }

    /// Takes in an older manifest, but for what lies in objects that are not `sound`; what is known of a key already stays if it is as good.
    pub fn cover(&mut self, older: &Manifest, sound: impl Fn(&Digest) -> bool) {
        // What it covers too, or who knows this one alone would fetch them.
        self.covers.push(older.name);
        self.covers.extend(older.covers());
        for (key, listing) in older.records().filter(|(_, listing)| sound(&listing.spot.pack)) {
            let held = self.records.entry(key).or_insert(listing);
            *held = (*held).max(listing);
        }
        for (digest, spot) in older.blobs().filter(|(_, spot)| sound(&spot.pack)) {
            self.blobs.entry(digest).or_insert(spot);
        }
        for (digest, pieces) in older.loose().filter(|(_, pieces)| pieces.iter().all(|piece| sound(&piece.digest))) {
            self.loose.entry(digest).or_insert(pieces);
        }
        let used = self.records.values().map(|listing| listing.spot.pack).chain(self.blobs.values().map(|s| s.pack));
        let used: std::collections::BTreeSet<Digest> = used.collect();
        self.packs.extend(older.packs());
        self.packs.retain(|pack, _| used.contains(pack));
    }

    pub fn encode(&self, written: u64) -> Vec<u8> {
        let pieces = |pieces: &Vec<Piece>| if pieces.len() > 1 { pieces.len() } else { 0 };
        let counts = [
            self.covers.len(),
            self.packs.len(),
            self.records.len(),
            self.blobs.len(),
            self.loose.len(),
            self.loose.values().map(pieces).sum(),
        ];
        let mut bytes = Vec::with_capacity(HEAD + counts.iter().zip(SIZES).map(|(n, size)| n * size).sum::<usize>());
        bytes.extend_from_slice(MAGIC);
        bytes.extend_from_slice(&written.to_le_bytes());
        counts.iter().for_each(|n| bytes.extend_from_slice(&(*n as u64).to_le_bytes()));
        self.covers.iter().for_each(|name| bytes.extend_from_slice(&name.0));
        for (digest, length) in &self.packs {
            bytes.extend_from_slice(&digest.0);
            bytes.extend_from_slice(&length.to_le_bytes());
        }
        let number: BTreeMap<&Digest, u32> = self.packs.keys().zip(0..).collect();
        let place = |bytes: &mut Vec<u8>, spot: &Spot| {
            // Packs are far shorter than 4 GiB.
            for n in [u64::from(number[&spot.pack]), spot.offset, spot.length - HEADER as u64] {
                bytes.extend_from_slice(&(n as u32).to_le_bytes());
            }
        };
        for (key, listing) in &self.records {
            bytes.extend_from_slice(&key.0);
            bytes.extend_from_slice(&listing.check);
            bytes.extend_from_slice(&listing.stamp.to_le_bytes());
            place(&mut bytes, &listing.spot);
            bytes.extend_from_slice(&listing.ports.to_le_bytes());
        }
        for (digest, spot) in &self.blobs {
            bytes.extend_from_slice(&digest.0);
            place(&mut bytes, spot);
        }
        let mut first = 0;
        for (digest, of) in &self.loose {
            bytes.extend_from_slice(&digest.0);
            bytes.extend_from_slice(&of.iter().map(|piece| piece.bytes).sum::<u64>().to_le_bytes());
            bytes.extend_from_slice(&(first as u32).to_le_bytes());
            bytes.extend_from_slice(&(pieces(of) as u32).to_le_bytes());
            first += pieces(of);
        }
        for piece in self.loose.values().filter(|of| of.len() > 1).flatten() {
            bytes.extend_from_slice(&piece.digest.0);
            bytes.extend_from_slice(&(piece.bytes as u32).to_le_bytes());
        }
        bytes
    }
}

/// A whole manifest; its tables are searched as they came.
pub(super) struct Manifest {
    /// BLAKE3 of its bytes.
    pub name: Digest,
    /// Unix time, ns.
    pub written: u64,
    bytes: Vec<u8>,
    /// Where each table begins, and the number of its entries.
    tables: [(usize, usize); TABLES],
}

/// What bytes turned out to be.
pub(super) enum Read {
    Whole(Manifest),
    /// Of a later turbid.
    Newer,
    /// Cut short, replaced or none at all.
    Damaged,
}

impl Manifest {
    pub fn read(name: Digest, bytes: Vec<u8>) -> Read {
        if Digest::of(&bytes) != name {
            return Read::Damaged;
        }
        if bytes.starts_with(ANY_FORMAT) && !bytes.starts_with(MAGIC) {
            return Read::Newer;
        }
        Self::of(name, bytes).map_or(Read::Damaged, Read::Whole)
    }

    fn of(name: Digest, bytes: Vec<u8>) -> Option<Self> {
        if bytes.get(..MAGIC.len())? != MAGIC {
            return None;
        }
        let mut at = HEAD;
        let mut tables = [(0, 0); TABLES];
        for (table, size) in SIZES.into_iter().enumerate() {
            let count = usize::try_from(number(bytes.get(24 + 8 * table..)?)?).ok()?;
            tables[table] = (at, count);
            at = at.checked_add(count.checked_mul(size)?)?;
        }
        if at != bytes.len() {
            return None;
        }
        let manifest = Self { name, written: number(&bytes[16..])?, bytes, tables };
        manifest.is_consistent().then_some(manifest)
    }

    /// Sorted, and what entries refer to is there.
    fn is_consistent(&self) -> bool {
        let sorted = |table| self.entries(table).map(|e| &e[..32]).is_sorted_by(|a, b| a < b);
        let packs: Vec<u64> = self.packs().map(|(_, length)| length).collect();
        let inside = |pack: &[u8]| {
            let end = u64::from(word(&pack[4..])) + HEADER as u64 + u64::from(word(&pack[8..]));
            packs.get(word(pack) as usize).is_some_and(|length| end <= *length)
        };
        let has_pieces = |entry: &[u8]| {
            let end = word(&entry[40..]) as usize + word(&entry[44..]) as usize;
            end <= self.tables[PIECES].1
        };
        [RECORDS, BLOBS, LOOSE].into_iter().all(sorted)
            && self.entries(RECORDS).all(|entry| inside(&entry[56..]))
            && self.entries(BLOBS).all(|entry| inside(&entry[32..]))
            && self.entries(LOOSE).all(has_pieces)
    }

    /// As long as it is.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    fn entries(&self, table: usize) -> impl Iterator<Item = &[u8]> {
        let (at, count) = self.tables[table];
        self.bytes[at..at + count * SIZES[table]].chunks_exact(SIZES[table])
    }

    fn entry(&self, table: usize, n: usize) -> Option<&[u8]> {
        let (at, count) = self.tables[table];
        let start = (n < count).then_some(at + n * SIZES[table])?;
        self.bytes.get(start..start + SIZES[table])
    }

    fn find(&self, table: usize, key: &Digest) -> Option<&[u8]> {
        let (mut low, mut high) = (0, self.tables[table].1);
        while low < high {
            let middle = low + (high - low) / 2;
            let entry = self.entry(table, middle)?;
            match entry[..32].cmp(&key.0) {
                std::cmp::Ordering::Less => low = middle + 1,
                std::cmp::Ordering::Equal => return Some(entry),
                std::cmp::Ordering::Greater => high = middle,
            }
        }
        None
    }

    /// Names of the manifests all of which is in this one.
    pub fn covers(&self) -> impl Iterator<Item = Digest> {
        self.entries(COVERS).map(digest)
    }

    pub fn packs(&self) -> impl Iterator<Item = (Digest, u64)> {
        self.entries(PACKS).map(|entry| (digest(entry), number(&entry[32..]).unwrap_or(0)))
    }

    pub fn records(&self) -> impl Iterator<Item = (Digest, Listing)> {
        self.entries(RECORDS).map(|entry| (digest(entry), self.listing(entry)))
    }

    pub fn blobs(&self) -> impl Iterator<Item = (Digest, Spot)> {
        self.entries(BLOBS).map(|entry| (digest(entry), self.spot(&entry[32..])))
    }

    /// Blobs that are objects of their own, with these objects.
    pub fn loose(&self) -> impl Iterator<Item = (Digest, Vec<Piece>)> {
        self.entries(LOOSE).map(|entry| (digest(entry), self.pieces(entry)))
    }

    pub fn record(&self, key: &Digest) -> Option<Listing> {
        self.find(RECORDS, key).map(|entry| self.listing(entry))
    }

    pub fn blob(&self, key: &Digest) -> Option<Spot> {
        self.find(BLOBS, key).map(|entry| self.spot(&entry[32..]))
    }

    pub fn pieces_of(&self, key: &Digest) -> Option<Vec<Piece>> {
        self.find(LOOSE, key).map(|entry| self.pieces(entry))
    }

    fn listing(&self, entry: &[u8]) -> Listing {
        Listing {
            check: entry[32..48].try_into().expect("16 bytes"),
            stamp: number(&entry[48..]).unwrap_or(0),
            spot: self.spot(&entry[56..]),
            ports: word(&entry[68..]),
        }
    }

    fn spot(&self, place: &[u8]) -> Spot {
        let pack = self.entry(PACKS, word(place) as usize).map(digest).expect("its number was compared with the table");
        let length = HEADER as u64 + u64::from(word(&place[8..]));
        Spot { pack, offset: u64::from(word(&place[4..])), length }
    }

    fn pieces(&self, entry: &[u8]) -> Vec<Piece> {
        let (first, count) = (word(&entry[40..]) as usize, word(&entry[44..]) as usize);
        if count == 0 {
            return vec![Piece { digest: digest(entry), bytes: number(&entry[32..]).unwrap_or(0) }];
        }
        let piece = |entry: &[u8]| Piece { digest: digest(entry), bytes: u64::from(word(&entry[32..])) };
        (first..first + count).filter_map(|n| self.entry(PIECES, n)).map(piece).collect()
    }
}

fn digest(bytes: &[u8]) -> Digest {
    Digest(bytes[..32].try_into().expect("entries begin with a digest"))
}

fn number(bytes: &[u8]) -> Option<u64> {
    Some(u64::from_le_bytes(*bytes.first_chunk()?))
}

fn word(bytes: &[u8]) -> u32 {
    bytes.first_chunk().map_or(0, |bytes| u32::from_le_bytes(*bytes))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub fn digest_of(n: u64) -> Digest {
        Digest::of(&n.to_le_bytes())
    }

    /// Two packs with records and blobs, blobs of one object and of three.
    pub fn example(seed: u64) -> Contents {
        let packs = [digest_of(seed), digest_of(seed + 1)];
        let spot = |n: u64| Spot { pack: packs[n as usize % 2], offset: 1000 * n, length: HEADER as u64 + n };
        let listing = |n: u64| Listing { ports: 2, stamp: n, check: [n as u8; 16], spot: spot(n) };
        let piece = |n: u64| Piece { digest: digest_of(seed + n), bytes: n };
        Contents {
            covers: vec![digest_of(seed + 2)],
            packs: packs.iter().map(|pack| (*pack, 1 << 20)).collect(),
            records: (10..40).map(|n| (digest_of(seed + n), listing(n))).collect(),
            blobs: (50..70).map(|n| (digest_of(seed + n), spot(n))).collect(),
            loose: [
                (digest_of(seed + 80), vec![piece(80)]),
                (digest_of(seed + 90), vec![piece(91), piece(92), piece(93)]),
            ]
            .into(),
        }
    }

    pub fn manifest(contents: &Contents, written: u64) -> Manifest {
        let bytes = contents.encode(written);
        match Manifest::read(Digest::of(&bytes), bytes) {
            Read::Whole(manifest) => manifest,
            _ => panic!("it is whole"),
        }
    }

    fn contents(manifest: &Manifest) -> Contents {
        Contents {
            covers: manifest.covers().collect(),
            packs: manifest.packs().collect(),
            records: manifest.records().collect(),
            blobs: manifest.blobs().collect(),
            loose: manifest.loose().collect(),
        }
    }

    #[test]
    fn a_manifest_says_what_went_in() {
        let example = example(0);
        let manifest = manifest(&example, 7);
        assert_eq!((contents(&manifest), manifest.written), (example.clone(), 7));
        for (key, listing) in &example.records {
            assert_eq!((manifest.record(key), manifest.blob(key)), (Some(*listing), None));
        }
        for (key, spot) in &example.blobs {
            assert_eq!((manifest.blob(key), manifest.record(key)), (Some(*spot), None));
        }
        for (key, pieces) in &example.loose {
            assert_eq!(manifest.pieces_of(key).as_ref(), Some(pieces));
        }
        assert_eq!(contents(&tests::manifest(&Contents::default(), 0)), Contents::default());
    }

    /// Half of it, any bit of it, another one under its name: none of these is a manifest.
    #[test]
    fn what_is_not_whole_is_none() {
        let bytes = example(0).encode(1);
        let name = Digest::of(&bytes);
        let is_damaged = |bytes: &[u8]| matches!(Manifest::read(name, bytes.to_vec()), Read::Damaged);
        assert!((0..bytes.len()).all(|cut| is_damaged(&bytes[..cut])));
        assert!(is_damaged(&example(1).encode(1)) && is_damaged(&[&bytes[..], b"x"].concat()));
        for byte in 0..bytes.len() {
            let mut flipped = bytes.clone();
            flipped[byte] ^= 1;
            assert!(is_damaged(&flipped), "byte {byte}");
        }
    }

    /// Bytes with the right name that are no manifest of ours are refused without a panic.
    #[test]
    fn nonsense_of_the_right_name_is_refused() {
        let bytes = example(0).encode(1);
        for at in (16..bytes.len()).step_by(3) {
            for value in [0, 1, 0x7f, 0xff] {
                let mut wrong = bytes.clone();
                wrong[at] = value;
                if let Read::Whole(manifest) = Manifest::read(Digest::of(&wrong), wrong) {
                    // Whatever it says, it can be read to its end.
                    contents(&manifest);
                }
            }
        }
        let newer = b"turbid remote 2\nwhatever follows".to_vec();
        assert!(matches!(Manifest::read(Digest::of(&newer), newer), Read::Newer));
    }

    /// A manifest that covers others says all that they say, but for objects that are damaged.
    #[test]
    fn covering_keeps_everything_that_is_sound() {
        let (one, two) = (example(0), example(1000));
        let (old, new) = (manifest(&one, 1), manifest(&two, 2));
        let mut all = Contents::default();
        all.cover(&new, |_| true);
        all.cover(&old, |_| true);
        assert_eq!(all.covers, [new.name, two.covers[0], old.name, one.covers[0]]);
        for contents in [&one, &two] {
            assert!(contents.records.iter().all(|(key, listing)| all.records[key] == *listing));
            assert!(contents.blobs.iter().all(|(key, spot)| all.blobs[key] == *spot));
            assert!(contents.loose.iter().all(|(key, pieces)| all.loose[key] == *pieces));
        }
        assert_eq!(all.packs.len(), 4);
        manifest(&all, 3);
        let bad = digest_of(0);
        let mut some = Contents::default();
        some.cover(&old, |object| *object != bad);
        assert!(some.packs.len() == 1 && some.records.values().all(|listing| listing.spot.pack != bad));
        assert_eq!(some.records.len(), 15);
        manifest(&some, 3);
    }
}
