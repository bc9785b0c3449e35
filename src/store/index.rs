//! The packed index: where in the packs each key has its newest frame. Only a cache of what the packs say.
//!
//! Most of it is in files ([`Saved`]); in memory is what was taken in since.

use std::io;
use std::path::Path;

use crate::digest::{Digest, DigestMap};
use crate::store::frame::{self, Frame, HEADER, Kind};
use crate::store::labels;
use crate::store::place::{Entry, Named, Place, seconds};
use crate::store::saved::{Fresh, Merged, Saved, Source};

/// The newest frame of every record and every packed blob, and the latest record of every label.
#[derive(Default)]
pub(super) struct Index {
    pub saved: Saved,
    /// What the files lack, by what digests name.
    recent: [DigestMap<Place>; Named::ALL.len()],
    /// Bytes of the packs that newer frames replace, by what was taken in since.
    dead: i64,
    /// Whether a blob may have been released since.
    released: bool,
}

impl Index {
    pub fn open(root: &Path) -> Self {
        Self { saved: Saved::open(root), ..Self::default() }
    }

    /// Where the newest frame is. Where a file of the index cannot be read, it says nothing, and [`Saved::is_hurt`].
    pub fn find(&self, named: Named, digest: &Digest) -> Option<Place> {
        let recent = self.recent[named as usize].get(digest).copied();
        let saved = self.saved.find(named, digest);
        let found = match (saved, recent) {
            (Some(saved), Some(recent)) => Some(saved.or_newer(recent)),
            (saved, recent) => saved.or(recent),
        };
        found.filter(Place::is_known)
    }

    /// Whether anything may be known.
    pub fn has_entries(&self) -> bool {
        self.recent() > 0 || self.saved.has_files()
    }

    /// Takes in a frame that stands at `offset` of a pack; frames may come in any order, and again.
    pub fn apply(&mut self, pack: u32, offset: u64, frame: &Frame, payload: &[u8]) {
        let (named, here) = match frame.kind {
            Kind::Record => (Named::Record, true),
            Kind::Blob => (Named::Blob, true),
            Kind::ForgetRecord => (Named::Record, false),
            Kind::ForgetBlob => (Named::Blob, false),
            Kind::Used => {
                frame::used_pairs(payload).for_each(|(key, time_s)| self.mark_used(key, time_s));
                return self.bury(frame);
            }
            Kind::Release => {
                frame::released(payload).for_each(|digest| self.release(digest, frame.stamp));
                return self.bury(frame);
            }
        };
        let (Ok(offset), Ok(length)) = (u32::try_from(offset), u32::try_from(frame.length)) else { return };
        let used = seconds(frame.stamp / 1_000_000_000);
        let place = Place { pack, offset, length, used, stamp: frame.stamp };
        let fresh = self.add(named, frame.key, if here { place } else { Place { pack: Place::FORGOTTEN, ..place } });
        if !here {
            self.bury(frame);
        }
        if fresh && frame.kind == Kind::Record {
            for (named, digest) in labels::of_payload(payload) {
                self.recent[named as usize]
                    .entry(digest)
                    .and_modify(|older| *older = older.or_newer(place))
                    .or_insert(place);
            }
        }
    }

    /// Takes in a place. Whether it holds, and was not known.
    fn add(&mut self, named: Named, digest: Digest, new: Place) -> bool {
        let room = |place| Entry { digest, named, place }.room();
        match self.find(named, &digest) {
            Some(known) if known.is(&new) => return false,
            Some(known) if known.stamp > new.stamp => {
                self.dead = self.dead.saturating_add(room(new));
                return false;
            }
            Some(known) => self.dead = self.dead.saturating_add(room(known)),
            None => {}
        }
        let recent = self.recent[named as usize].entry(digest).or_insert(new);
        *recent = recent.or_newer(new);
        true
    }

    /// Counts a frame that nobody asks for once it was taken in.
    fn bury(&mut self, frame: &Frame) {
        self.dead = self.dead.saturating_add(HEADER as i64 + i64::try_from(frame.length).unwrap_or(0));
    }

    fn release(&mut self, digest: Digest, stamp: u64) {
        self.released = true;
        self.add(Named::Blob, digest, Place { pack: Place::RELEASED, offset: 0, length: 0, used: 0, stamp });
    }

    fn mark_used(&mut self, key: Digest, time_s: u64) {
        let used = seconds(time_s);
        let place = self.recent[Named::Record as usize].entry(key).or_insert(Place::unknown(used));
        place.used = place.used.max(used);
    }

    /// Whether a blob may have been released.
    pub fn releases(&self) -> bool {
        self.released || self.saved.releases()
    }

    /// Bytes of the packs that are dead, as far as it was counted.
    pub fn dead(&self) -> i64 {
        self.dead.saturating_add(self.saved.dead())
    }

    /// Says how many bytes are dead, after they were counted.
    pub fn set_dead(&mut self, bytes: i64) {
        self.dead = bytes.saturating_sub(self.saved.dead());
    }

    /// Entries in memory.
    pub fn recent(&self) -> usize {
        self.recent.iter().map(|map| map.len()).sum()
    }

    /// Forgets what is in memory.
    pub fn forget_recent(&mut self) {
        self.recent = Default::default();
        (self.dead, self.released) = (0, false);
    }

    /// What is in memory, in order.
    pub fn sorted(&self) -> Vec<Entry> {
        let entry = |named, (digest, place): (&Digest, &Place)| Entry { digest: *digest, named, place: *place };
        let all = Named::ALL.into_iter().zip(&self.recent);
        let mut entries: Vec<Entry> =
            all.flat_map(|(named, map)| map.iter().map(move |found| entry(named, found))).collect();
        entries.sort_unstable_by(Entry::order);
        entries
    }

    /// Every entry, in order; `recent` are those in memory ([`Index::sorted`]). Error: a file of the index cannot be read, and is hurt.
    pub fn entries<'a>(&'a self, recent: &'a [Entry]) -> impl Iterator<Item = io::Result<Entry>> + 'a {
        let own: Source<'a> = Box::new(recent.iter().map(|entry| Ok(*entry)));
        let known = |entry: &io::Result<Entry>| entry.as_ref().is_ok_and(|e| e.place.is_known()) || entry.is_err();
        Merged::of(self.saved.sources().chain([own])).filter(known)
    }

    /// What the next file of the index holds.
    pub fn fresh(&self, id: u64) -> Fresh {
        Fresh { entries: self.sorted(), covered: Vec::new(), dead: self.dead, id }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whatever the order in which packs are read, the newest frame of a key holds.
    #[test]
    fn the_newest_frame_holds_in_any_order() {
        let key = Digest::of(b"k");
        let frames: Vec<Frame> = [(Kind::Blob, 1), (Kind::ForgetBlob, 2), (Kind::Blob, 3)]
            .map(|(kind, stamp)| frame::decode(&frame::encode(kind, &key, stamp, b"")).expect("whole").0)
            .to_vec();
        for order in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
            let mut index = Index::default();
            order.iter().for_each(|&i| index.apply(7, 100 * i as u64, &frames[i], b""));
            let place = index.find(Named::Blob, &key).expect("it was taken in");
            assert_eq!((place.offset, place.pack), (200, 7), "{order:?}");
            assert_eq!(index.dead(), 2 * HEADER as i64, "{order:?}");
            let mut index = Index::default();
            order.iter().filter(|&&i| i < 2).for_each(|&i| index.apply(7, 0, &frames[i], b""));
            assert!(!index.find(Named::Blob, &key).expect("it was taken in").is_here(), "{order:?}");
        }
    }

    /// Frames that are read again change nothing, and what was used before its record was read was used.
    #[test]
    fn frames_may_come_again_and_uses_before_their_records() {
        let key = Digest::of(b"k");
        let used = [&key.0[..], &77u64.to_le_bytes()].concat();
        let frames = [(Kind::Used, &used[..]), (Kind::Record, b"no record, but whole")];
        let mut index = Index::default();
        for round in 0..2 {
            for (kind, payload) in frames {
                let bytes = frame::encode(kind, &key, 5, payload);
                let (frame, payload) = frame::decode(&bytes).expect("whole");
                index.apply(1, 10, &frame, payload);
                if kind == Kind::Used && round == 0 {
                    assert_eq!(index.find(Named::Record, &key), None, "nobody knows where it is");
                }
            }
            let place = index.find(Named::Record, &key).expect("it was taken in");
            assert_eq!((place.used, place.pack, index.recent()), (77, 1, 1));
        }
    }
}
