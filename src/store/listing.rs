//! What is in the packs as a whole: for whoever looks after the store, not for runs, which look up what they need.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::digest::Digest;
use crate::store::packs::Packs;
use crate::store::place::{Entry, Named, Place};

/// Numbers of what is in the packs.
#[derive(Default)]
pub(super) struct Counts {
    pub records: u64,
    pub blobs: u64,
    /// Blobs whose bytes were given back.
    pub released: u64,
}

impl Packs {
    /// What `add` makes of all entries, one by one in the order of their digests. What of the packs cannot be read is left out, and is
    /// in [`Packs::unread`].
    fn fold<T: Default>(&self, add: impl Fn(&mut T, Entry)) -> T {
        self.state_mut().fold(&self.root, add)
    }

    fn collect<T>(&self, of: impl Fn(&Entry) -> Option<T>) -> Vec<T> {
        self.fold(|all: &mut Vec<T>, entry| all.extend(of(&entry)))
    }

    fn here(&self, named: Named) -> Vec<(Digest, Place)> {
        self.collect(|entry| (entry.named == named && entry.place.is_here()).then_some((entry.digest, entry.place)))
    }

    /// All records with their place, the newest first.
    pub fn records(&self) -> Vec<(Digest, Place)> {
        let mut all = self.here(Named::Record);
        all.sort_by_key(|(key, place)| (Reverse(place.stamp), *key));
        all
    }

    /// The keys of so many of the newest records, the newest first.
    pub fn newest(&self, most: usize) -> Vec<Digest> {
        let newest = self.fold(|newest: &mut BinaryHeap<(Reverse<u64>, Digest)>, entry| {
            if entry.named == Named::Record && entry.place.is_here() {
                newest.push((Reverse(entry.place.stamp), entry.digest));
                if newest.len() > most {
                    newest.pop();
                }
            }
        });
        newest.into_sorted_vec().into_iter().map(|(_, key)| key).collect()
    }

    /// The keys of all records but those.
    pub fn keys_but(&self, left_out: impl Fn(&Digest) -> bool) -> Vec<Digest> {
        self.collect(|Entry { digest, named, place }| {
            (*named == Named::Record && place.is_here() && !left_out(digest)).then_some(*digest)
        })
    }

    pub fn blobs(&self) -> Vec<(Digest, Place)> {
        self.here(Named::Blob)
    }

    /// The blobs that were released.
    pub fn released(&self) -> Vec<Digest> {
        self.collect(|entry| (entry.named == Named::Blob && entry.place.is_released()).then_some(entry.digest))
    }

    pub fn counts(&self) -> Counts {
        self.fold(|counts: &mut Counts, Entry { named, place, .. }| match named {
            Named::Record => counts.records += u64::from(place.is_here()),
            Named::Blob => {
                counts.blobs += u64::from(place.is_here());
                counts.released += u64::from(place.is_released());
            }
            _ => {}
        })
    }
}
