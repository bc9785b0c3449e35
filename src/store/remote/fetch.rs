//! Bringing records and blobs from a store elsewhere into the local one; each is compared with what it must be.

use std::collections::BTreeSet;
use std::io::Write;

use crate::digest::Digest;
use crate::store::backend::{Backend, Folder, PACKED_BELOW};
use crate::store::disk;
use crate::store::error::StoreError;
use crate::store::frame::{self, HEADER, Kind};
use crate::store::record::{Blob, InstanceRecord};

use super::aside::side_by_side;
use super::manifest::{Piece, outputs_check};
use super::span::{Span, spans};
use super::{BLOBS, PACKS, Remote};

/// What a frame must hold.
type Item = (Kind, Digest);

/// What came in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Came {
    pub records: u64,
    pub blobs: u64,
}

impl Remote {
    /// Brings in records and small blobs, as far as they are there and whole; others that came with them too.
    ///
    /// Error: the store elsewhere cannot be read, or the local one not be written.
    pub(super) fn fetch(
        &self,
        folder: &Folder,
        mut records: BTreeSet<Digest>,
        mut blobs: BTreeSet<Digest>,
    ) -> Result<Came, StoreError> {
        let mut came = Came::default();
        // Each round that leaves something behind has found a damaged pack: the next one asks others.
        loop {
            let of_records = records.iter().filter_map(|key| {
                let listing = self.listings(key).into_iter().next()?;
                Some((listing.spot, (Kind::Record, *key)))
            });
            let of_blobs = blobs.iter().filter_map(|digest| Some((self.spot(digest)?, (Kind::Blob, *digest))));
            // The small blobs of a record stand before it.
            let lead = if records.is_empty() { 0 } else { PACKED_BELOW };
            let spans = spans(of_records.chain(of_blobs).collect(), lead);
            if spans.is_empty() {
                return Ok(came);
            }
            for arrived in side_by_side(&spans, |span| self.fetch_span(folder, span)) {
                let (arrived, more) = arrived?;
                came.records += more.records;
                came.blobs += more.blobs;
                for (kind, key) in arrived {
                    let left = if kind == Kind::Record { &mut records } else { &mut blobs };
                    left.remove(&key);
                }
            }
        }
    }

    /// Which of the wanted frames arrived, and how much is new here.
    fn fetch_span(&self, folder: &Folder, span: &Span<Item>) -> Result<(Vec<Item>, Came), StoreError> {
        let object = format!("{PACKS}/{}", span.pack);
        let Some(bytes) = self.objects.get(&object, span.start..span.end)? else {
            self.note_damage(PACKS, &span.pack, "is gone");
            return Ok((Vec::new(), Came::default()));
        };
        let (mut whole, mut came) = (BTreeSet::new(), Came::default());
        for (at, frame) in frame::scan(&bytes).frames {
            let start = at as usize + HEADER;
            let payload = &bytes[start..start + frame.length as usize];
            let new = match frame.kind {
                Kind::Record => self.take_record(folder, &frame.key, payload)?,
                Kind::Blob => take_blob(folder, &frame.key, payload)?,
                _ => None,
            };
            if let Some(new) = new {
                whole.insert((frame.kind, frame.key));
                *(if frame.kind == Kind::Record { &mut came.records } else { &mut came.blobs }) += u64::from(new);
            }
        }
        let (arrived, lost): (Vec<Item>, Vec<Item>) =
            span.wanted.iter().map(|(_, item)| *item).partition(|item| whole.contains(item));
        if !lost.is_empty() {
            self.note_damage(PACKS, &span.pack, "is cut short, or another stands in its place");
        }
        Ok((arrived, came))
    }

    /// Takes in a record that a manifest lists; whether it is new here. `None` where it is none of those.
    fn take_record(&self, folder: &Folder, key: &Digest, payload: &[u8]) -> Result<Option<bool>, StoreError> {
        let listed = InstanceRecord::decode_head(key, payload).filter(|record| self.lists(record));
        let Some(record) = listed else { return Ok(None) };
        let held = folder.record_head(key)?.and_then(|head| InstanceRecord::decode_head(key, &head));
        if held.is_some_and(|held| !adds_to(&record, &held)) {
            return Ok(Some(false));
        }
        folder.publish(key, payload)?;
        Ok(Some(true))
    }

    /// Brings in a large blob; whether it is there now.
    ///
    /// Error: as [`Remote::fetch`].
    pub(super) fn fetch_large(&self, folder: &Folder, blob: &Blob) -> Result<bool, StoreError> {
        while let Some(pieces) = self.pieces(&blob.digest) {
            if pieces.iter().map(|piece| piece.bytes).sum::<u64>() != blob.bytes {
                return Ok(false);
            }
            if self.fetch_pieces(folder, blob, &pieces)? {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Whether all pieces were what they must be; if not, one is noted as damaged.
    fn fetch_pieces(&self, folder: &Folder, blob: &Blob, pieces: &[Piece]) -> Result<bool, StoreError> {
        let (root, path) = (folder.root(), folder.loose_path(blob));
        let failed = |error| StoreError::io("write a blob", &path)(error);
        let mut file = disk::temporary(root).map_err(failed)?;
        let mut hasher = blake3::Hasher::new();
        for piece in pieces {
            let found = self.objects.get(&format!("{BLOBS}/{}", piece.digest), 0..piece.bytes)?;
            let Some(bytes) = found.filter(|bytes| Digest::of(bytes) == piece.digest) else {
                self.note_damage(BLOBS, &piece.digest, "is gone, cut short, or another stands in its place");
                return Ok(false);
            };
            hasher.update(&bytes);
            disk::Passing(file.as_file_mut()).write_all(&bytes).map_err(failed)?;
        }
        if hasher.finalize().as_bytes() != &blob.digest.0 {
            // The list of pieces is wrong, not a piece: without the first of them it is not asked again.
            pieces.iter().take(1).for_each(|piece| self.note_damage(BLOBS, &piece.digest, "is not a part of its blob"));
            return Ok(false);
        }
        folder.take_file(blob, file)?;
        Ok(true)
    }
}

/// Whether a record holds all that another of its key holds, with the same digests, and more.
fn adds_to(record: &InstanceRecord, held: &InstanceRecord) -> bool {
    let same = |(name, port): (&String, &crate::store::record::PortRecord)| {
        record.ports.get(name).is_some_and(|other| other.blob.digest == port.blob.digest)
    };
    held.ports.iter().all(same) && outputs_check(record) != outputs_check(held)
}

/// Takes in a small blob; whether it is new here. `None` where its bytes have another digest.
fn take_blob(folder: &Folder, digest: &Digest, payload: &[u8]) -> Result<Option<bool>, StoreError> {
    if Digest::of(payload) != *digest {
        return Ok(None);
    }
    if folder.packs.blob_length(digest).is_some() {
        return Ok(Some(false));
    }
    folder.packs.append(Kind::Blob, digest, payload)?;
    Ok(Some(true))
}
