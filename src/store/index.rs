//! The packed index: where in the packs each key has its newest frame. Only a cache of what the packs say.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::hash::{BuildHasherDefault, Hasher};
use std::io::{self, Write};

use crate::digest::Digest;
use crate::store::frame::{Frame, Kind};

/// Digests are uniformly random already; their first bytes are the hash.
#[derive(Default)]
pub(super) struct FirstBytes(u64);

impl Hasher for FirstBytes {
    fn finish(&self) -> u64 {
        self.0
    }
    fn write(&mut self, bytes: &[u8]) {
        if let Some(first) = bytes.first_chunk() {
            self.0 = u64::from_le_bytes(*first);
        }
    }
    fn write_usize(&mut self, _: usize) {}
}

pub(super) type Map<T> = HashMap<Digest, T, BuildHasherDefault<FirstBytes>>;

/// Where a key's newest frame is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Place {
    /// Id of the pack in this process ([`State`](super::state::State)), in the index file its number in the list;
    /// [`Place::FORGOTTEN`] where the newest frame says that older ones do not hold, [`Place::RELEASED`] where it says that
    /// they were given back.
    pub pack: u32,
    /// Of the frame's header. No pack has as many bytes as 32 bits count.
    pub offset: u32,
    /// Of the payload.
    pub length: u32,
    /// Unix time, s, when a record was last used or published.
    pub used: u32,
    pub stamp: u64,
}

impl Place {
    pub const FORGOTTEN: u32 = u32::MAX;
    pub const RELEASED: u32 = u32::MAX - 1;
    const BYTES: usize = 24;

    pub fn is_here(&self) -> bool {
        self.pack < Self::RELEASED
    }

    pub fn is_released(&self) -> bool {
        self.pack == Self::RELEASED
    }
}

/// The newest frame of every record and every packed blob.
#[derive(Default)]
pub(super) struct Index {
    pub records: Map<Place>,
    pub blobs: Map<Place>,
    /// Whether a blob may have been released.
    pub releases: bool,
}

impl Index {
    /// Takes in a frame (not [`Kind::Used`], not [`Kind::Release`]) that stands at `offset` of a pack; frames may come in any order.
    pub fn apply(&mut self, pack: u32, offset: u64, frame: &Frame) {
        let (map, here) = match frame.kind {
            Kind::Record => (&mut self.records, true),
            Kind::Blob => (&mut self.blobs, true),
            Kind::ForgetRecord => (&mut self.records, false),
            Kind::ForgetBlob => (&mut self.blobs, false),
            Kind::Used | Kind::Release => return,
        };
        let pack = if here { pack } else { Place::FORGOTTEN };
        if let (Ok(offset), Ok(length)) = (u32::try_from(offset), u32::try_from(frame.length)) {
            let used = seconds(frame.stamp / 1_000_000_000);
            newer(map, frame.key, Place { pack, offset, length, used, stamp: frame.stamp });
        }
    }

    /// Takes in that a frame with this stamp says that a blob was released.
    pub fn release(&mut self, digest: Digest, stamp: u64) {
        self.releases = true;
        newer(&mut self.blobs, digest, Place { pack: Place::RELEASED, offset: 0, length: 0, used: 0, stamp });
    }

    pub fn mark_used(&mut self, key: &Digest, time_s: u64) {
        if let Some(place) = self.records.get_mut(key) {
            place.used = place.used.max(seconds(time_s));
        }
    }
}

/// Unix time as it is kept: until 2106.
fn seconds(time_s: u64) -> u32 {
    u32::try_from(time_s).unwrap_or(u32::MAX)
}

/// The place with the higher stamp holds.
fn newer(map: &mut Map<Place>, key: Digest, new: Place) {
    match map.entry(key) {
        Entry::Vacant(slot) => {
            slot.insert(new);
        }
        Entry::Occupied(mut slot) if slot.get().stamp <= new.stamp => {
            slot.insert(Place { used: new.used.max(slot.get().used), ..new });
        }
        Entry::Occupied(_) => {}
    }
}

const MAGIC: &[u8; 16] = b"turbid index 3\n\0";

/// A pack as the index file names it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Covered {
    pub name: String,
    /// The index knows all frames up to here.
    pub length: u64,
    /// Tells the pack from another one of its name: the check of its first frame.
    pub first: [u8; 16],
}

/// The bytes of the index file: magic, packs, places, BLAKE3 of it all.
///
/// `number` gives the place in `packs` of a pack's id; what it does not know is left out.
/// Of a large store that is long: it goes to the file as it is made.
pub(super) fn write(
    packs: &[Covered],
    number: impl Fn(u32) -> Option<u32>,
    index: &Index,
    to: &mut dyn Write,
) -> io::Result<()> {
    let mut to = Hashing { hasher: blake3::Hasher::new(), to };
    to.write_all(MAGIC)?;
    to.write_all(&(packs.len() as u64).to_le_bytes())?;
    for pack in packs {
        to.write_all(&(pack.name.len() as u64).to_le_bytes())?;
        to.write_all(pack.name.as_bytes())?;
        to.write_all(&pack.length.to_le_bytes())?;
        to.write_all(&pack.first)?;
    }
    let number = |place: &Place| if place.is_here() { number(place.pack) } else { Some(place.pack) };
    for map in [&index.records, &index.blobs] {
        let count = map.values().filter(|place| number(place).is_some()).count() as u64;
        to.write_all(&count.to_le_bytes())?;
        for (key, place) in map {
            let Some(pack) = number(place) else { continue };
            let mut entry = [0; 32 + Place::BYTES];
            entry[..32].copy_from_slice(&key.0);
            for (at, number) in [pack, place.offset, place.length, place.used].into_iter().enumerate() {
                entry[32 + 4 * at..36 + 4 * at].copy_from_slice(&number.to_le_bytes());
            }
            entry[48..].copy_from_slice(&place.stamp.to_le_bytes());
            to.write_all(&entry)?;
        }
    }
    let digest = to.hasher.finalize();
    to.to.write_all(digest.as_bytes())
}

/// What passes goes into a digest too.
struct Hashing<'a> {
    hasher: blake3::Hasher,
    to: &'a mut dyn Write,
}

impl Write for Hashing<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.to.write(bytes)?;
        self.hasher.update(&bytes[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.to.flush()
    }
}

/// Whether these are the whole bytes of an index of another format: no damage, but of no use.
pub(super) fn is_of_another_format(bytes: &[u8]) -> bool {
    let body = bytes.len().checked_sub(32).and_then(|length| bytes.split_at_checked(length));
    body.is_some_and(|(body, digest)| {
        body.starts_with(b"turbid index ") && !body.starts_with(MAGIC) && Digest::of(body).0 == digest
    })
}

/// Reads an index file; `None` where it is damaged, torn or of another format.
pub(super) fn decode(bytes: &[u8]) -> Option<(Vec<Covered>, Index)> {
    let (body, digest) = bytes.split_at_checked(bytes.len().checked_sub(32)?)?;
    if !body.starts_with(MAGIC) || Digest::of(body).0 != digest {
        return None;
    }
    let mut rest = &body[MAGIC.len()..];
    let packs = (0..number(&mut rest)?)
        .map(|_| {
            let length = usize::try_from(number(&mut rest)?).ok()?;
            let name = std::str::from_utf8(take(&mut rest, length)?).ok()?.to_owned();
            Some(Covered { name, length: number(&mut rest)?, first: take(&mut rest, 16)?.try_into().ok()? })
        })
        .collect::<Option<Vec<_>>>()?;
    let mut index = Index::default();
    for map in [&mut index.records, &mut index.blobs] {
        let n = usize::try_from(number(&mut rest)?).ok()?;
        let places = take(&mut rest, n.checked_mul(32 + Place::BYTES)?)?;
        map.reserve(n);
        for entry in places.chunks_exact(32 + Place::BYTES) {
            let (key, mut numbers) = entry.split_at(32);
            let mut next = || Some(u32::from_le_bytes(take(&mut numbers, 4)?.try_into().ok()?));
            let (pack, offset, length, used) = (next()?, next()?, next()?, next()?);
            if pack < Place::RELEASED && pack as usize >= packs.len() {
                return None;
            }
            let place = Place { pack, offset, length, used, stamp: number(&mut numbers)? };
            index.releases |= place.is_released();
            map.insert(Digest(key.try_into().ok()?), place);
        }
    }
    Some((packs, index))
}

fn take<'a>(rest: &mut &'a [u8], n: usize) -> Option<&'a [u8]> {
    let (taken, left) = rest.split_at_checked(n)?;
    *rest = left;
    Some(taken)
}

fn number(rest: &mut &[u8]) -> Option<u64> {
    Some(u64::from_le_bytes(take(rest, 8)?.try_into().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn encode(packs: &[Covered], number: impl Fn(u32) -> Option<u32>, index: &Index) -> Vec<u8> {
        let mut bytes = Vec::new();
        write(packs, number, index, &mut bytes).expect("memory takes it");
        bytes
    }

    fn example() -> (Vec<Covered>, Index) {
        let mut index = Index::default();
        for i in 0..20u32 {
            let place = Place { pack: i % 2, offset: i, length: 2 * i, used: 4 * i, stamp: u64::from(3 * i) };
            index.records.insert(Digest::of(&[i as u8]), place);
            index.blobs.insert(Digest::of(&[i as u8, 0]), Place { pack: Place::FORGOTTEN, ..place });
        }
        let pack = |name: &str, length| Covered { name: name.to_owned(), length, first: [length as u8; 16] };
        (vec![pack("a.pack", 10), pack("b.pack", 0)], index)
    }

    #[test]
    fn an_index_survives_the_round_trip_and_no_flipped_bit() {
        let (packs, index) = example();
        let bytes = encode(&packs, Some, &index);
        let (packs_again, again) = decode(&bytes).expect("it is whole");
        assert_eq!((packs_again, &again.records, &again.blobs), (packs, &index.records, &index.blobs));
        for bit in 0..bytes.len() * 8 {
            let mut flipped = bytes.clone();
            flipped[bit / 8] ^= 1 << (bit % 8);
            assert!(decode(&flipped).is_none(), "bit {bit}");
        }
        for cut in 0..bytes.len() {
            assert!(decode(&bytes[..cut]).is_none(), "cut at {cut}");
        }
    }

    /// What lies in a pack that is gone is not written, and a number beyond the list is not read.
    #[test]
    fn no_place_names_a_pack_that_is_not_listed() {
        let (packs, index) = example();
        let (_, again) = decode(&encode(&packs, |id| (id == 1).then_some(0), &index)).expect("it is whole");
        assert_eq!((again.records.len(), again.blobs.len()), (10, 20));
        assert!(again.records.values().all(|place| place.pack == 0));
        assert!(decode(&encode(&packs, |id| Some(id + 1), &index)).is_none());
    }

    /// Whatever the order in which packs are read, the newest frame of a key holds.
    #[test]
    fn the_newest_frame_holds_in_any_order() {
        use crate::store::frame;
        let key = Digest::of(b"k");
        let frames: Vec<Frame> = [(Kind::Blob, 1), (Kind::ForgetBlob, 2), (Kind::Blob, 3)]
            .map(|(kind, stamp)| frame::decode(&frame::encode(kind, &key, stamp, b"")).expect("whole").0)
            .to_vec();
        for order in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
            let mut index = Index::default();
            order.iter().for_each(|&i| index.apply(7, 100 * i as u64, &frames[i]));
            assert_eq!((index.blobs[&key].offset, index.blobs[&key].pack), (200, 7), "{order:?}");
            let mut index = Index::default();
            order.iter().filter(|&&i| i < 2).for_each(|&i| index.apply(7, 0, &frames[i]));
            assert!(!index.blobs[&key].is_here(), "{order:?}");
        }
    }
}
