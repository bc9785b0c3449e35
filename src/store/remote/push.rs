//! Pushing: what the local store holds and the one elsewhere does not. Blobs, then packs, then the manifest that lists them.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Read;

use serde::Serialize;

use crate::digest::Digest;
use crate::store::Store;
use crate::store::backend::{Backend, PACKED_BELOW};
use crate::store::disk;
use crate::store::error::StoreError;
use crate::store::frame::{self, Kind};
use crate::store::lock::guard;
use crate::store::record::{Blob, InstanceRecord};
use crate::store::writer::now_ns;

use super::aside::side_by_side;
use super::known::MANIFESTS;
use super::manifest::{Contents, Listing, Manifest, Piece, Read as Reading, Spot, outputs_check};
use super::{BLOBS, PACKS, Remote};

/// A pack ends with the frame that makes it as long as this, and a piece of a large blob is no longer.
pub(super) const LONG: u64 = 32 << 20;
/// After so many bytes a manifest says what is there by now: a push that is killed loses no more than this.
const ROUND: u64 = 256 << 20;
/// No manifest that covers others becomes longer.
const LONGEST_COVER: u64 = 256 << 20;

/// What a push brought elsewhere.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Pushed {
    pub records: u64,
    /// Blobs in packs, and blobs that are objects of their own.
    pub small_blobs: u64,
    pub large_blobs: u64,
    pub packs: u64,
    pub manifests: u64,
    /// Bytes of blobs and packs.
    pub bytes: u64,
    /// Records that were left out: some of their blobs are damaged here, or neither here nor there (released, lost).
    pub left_out: u64,
}

/// A record that is to be pushed, with those of its blobs that are not there yet.
struct Parcel {
    record: InstanceRecord,
    blobs: Vec<Blob>,
}

/// Objects that lie elsewhere by their names, with their lengths; what is among them is not sent again.
type There = BTreeMap<Digest, u64>;

impl Store {
    /// Pushes the records of these keys (of all without) with their blobs. `looks`: lists all objects first, so that what was removed or cut short is sent again
    /// and what a killed push has sent is not. `told` is called with the bytes that went so far and those that are to go.
    ///
    /// Error: there is no store elsewhere, it cannot be written, or the local one not be read. What was pushed until then is there.
    pub fn push(
        &self,
        keys: Option<&[Digest]>,
        looks: bool,
        told: &(dyn Fn(u64, u64) + Sync),
    ) -> Result<Pushed, StoreError> {
        let Some(remote) = &self.remote else { return Ok(Pushed::default()) };
        self.folder.packs.refresh()?;
        let there = if looks { remote.look_at_objects()? } else { There::default() };
        let mut pushing = Pushing { store: self, remote, there, pushed: Pushed::default(), sending: BTreeSet::new() };
        // In the order in which they were made: what belongs together is read together.
        let records: Vec<Digest> = match keys {
            Some(keys) => {
                let stamps = keys.iter().filter_map(|key| Some((self.folder.packs.record_stamp(key)?, *key)));
                stamps.collect::<BTreeSet<_>>().into_iter().map(|(_, key)| key).collect()
            }
            None => self.folder.packs.records().into_iter().rev().map(|(key, _)| key).collect(),
        };
        let mut parcels = Vec::new();
        for key in records {
            parcels.extend(pushing.parcel(&key)?);
        }
        let size = |parcel: &Parcel| parcel.blobs.iter().map(|blob| blob.bytes).sum::<u64>() + (2 << 10);
        let all = parcels.iter().map(size).sum();
        let mut done = 0;
        let mut round = Vec::new();
        let mut left = parcels.into_iter().peekable();
        let mut bytes = 0;
        while let Some(parcel) = left.next() {
            bytes += size(&parcel);
            round.push(parcel);
            if bytes >= ROUND || left.peek().is_none() {
                told(done, all);
                pushing.round(std::mem::take(&mut round))?;
                done += std::mem::take(&mut bytes);
            }
        }
        told(all, all);
        Ok(pushing.pushed)
    }
}

impl Remote {
    /// Lists packs and objects of blobs. What manifests name and is gone or has another length counts as damaged from now on;
    /// a manifest that was cut short is written again.
    fn look_at_objects(&self) -> Result<There, StoreError> {
        let mut there = There::new();
        for folder in [PACKS, BLOBS] {
            let listed: There = self
                .objects
                .list(folder)?
                .into_iter()
                .filter_map(|object| Some((object.name.parse().ok()?, object.bytes)))
                .collect();
            let named = if folder == PACKS { self.known().packs() } else { self.known().pieces() };
            for (object, length) in named.iter().filter(|(object, length)| listed.get(*object) != Some(*length)) {
                let what = match listed.get(object) {
                    None => "is gone".to_owned(),
                    Some(found) => format!("has {found} bytes instead of {length}"),
                };
                self.note_damage(folder, object, &what);
            }
            there.extend(listed);
        }
        let torn = std::mem::take(&mut *guard(&self.torn));
        for manifest in self.known().live.iter().filter(|manifest| torn.contains(&manifest.name)) {
            self.objects.put(&format!("{MANIFESTS}/{}", manifest.name), manifest.bytes())?;
        }
        Ok(there)
    }
}

/// A push at work.
struct Pushing<'a> {
    store: &'a Store,
    remote: &'a Remote,
    there: There,
    pushed: Pushed,
    /// Blobs that a parcel has already.
    sending: BTreeSet<Digest>,
}

impl Pushing<'_> {
    /// What of a record is to be pushed; `None` where all of it is there, or where it is not whole.
    fn parcel(&mut self, key: &Digest) -> Result<Option<Parcel>, StoreError> {
        let folder = &self.store.folder;
        let Some(record) = folder.record_head(key)?.and_then(|head| InstanceRecord::decode_head(key, &head)) else {
            return Ok(None);
        };
        let mut blobs = Vec::new();
        for blob in record.blobs().filter(|blob| !self.remote.holds(blob)) {
            if !folder.holds(blob)? {
                self.pushed.left_out += 1;
                return Ok(None);
            }
            blobs.push(*blob);
        }
        let (check, ports) = (outputs_check(&record), record.ports.len() as u32);
        let known = self.remote.listings(key);
        let is_there = known.iter().any(|listing| listing.check == check || listing.ports > ports);
        if is_there && blobs.is_empty() {
            return Ok(None);
        }
        blobs.retain(|blob| self.sending.insert(blob.digest));
        Ok(Some(Parcel { record, blobs }))
    }

    /// Blobs, packs, manifest: nothing is named before it is there.
    fn round(&mut self, parcels: Vec<Parcel>) -> Result<(), StoreError> {
        let mut contents = Contents::default();
        let is_small = |blob: &&Blob| blob.bytes < PACKED_BELOW;
        let large: Vec<Blob> = parcels.iter().flat_map(|p| p.blobs.iter().filter(|b| !is_small(b)).copied()).collect();
        // A piece is in memory while it is sent: not more than a few of them.
        for (blob, sent) in large.iter().zip(side_by_side(&large, |blob| self.send_large(blob))) {
            if let Some(pieces) = sent? {
                self.pushed.large_blobs += 1;
                self.pushed.bytes += blob.bytes;
                contents.loose.insert(blob.digest, pieces);
            }
        }
        let packs = self.packs(&parcels, &mut contents)?;
        let sent = side_by_side(&packs, |(digest, bytes)| self.send(PACKS, digest, bytes));
        sent.into_iter().collect::<Result<(), _>>()?;
        self.pushed.packs += packs.len() as u64;
        self.pushed.bytes += packs.iter().map(|(_, bytes)| bytes.len() as u64).sum::<u64>();
        drop(packs);
        if contents.is_empty() { Ok(()) } else { self.manifest(contents) }
    }

    fn send(&self, folder: &str, digest: &Digest, bytes: &[u8]) -> Result<(), StoreError> {
        if self.there.get(digest) == Some(&(bytes.len() as u64)) {
            return Ok(());
        }
        Ok(self.remote.objects.put(&format!("{folder}/{digest}"), bytes)?)
    }

    /// The pieces of a large blob, each an object now; `None` where it is damaged or gone here.
    fn send_large(&self, blob: &Blob) -> Result<Option<Vec<Piece>>, StoreError> {
        let path = self.store.folder.loose_path(blob);
        let mut file = match disk::open_regular(&path) {
            Ok(file) => file,
            Err(error) if disk::is_absent(&error) => return Ok(None),
            Err(error) => return Err(StoreError::io("read a blob", &path)(error)),
        };
        let (mut pieces, mut hasher) = (Vec::new(), blake3::Hasher::new());
        loop {
            let mut bytes = Vec::new();
            let read = file.by_ref().take(LONG).read_to_end(&mut bytes);
            if read.map_err(StoreError::io("read a blob", &path))? == 0 {
                break;
            }
            hasher.update(&bytes);
            let piece = Piece { digest: Digest::of(&bytes), bytes: bytes.len() as u64 };
            // Of a damaged blob that is one object nothing is sent.
            if blob.bytes > LONG || piece.digest == blob.digest {
                self.send(BLOBS, &piece.digest, &bytes)?;
            }
            pieces.push(piece);
        }
        Ok((hasher.finalize().as_bytes() == &blob.digest.0).then_some(pieces))
    }

    /// Packs of the records all of whose blobs are there or in the packs; what is in them goes into `contents`.
    fn packs(&mut self, parcels: &[Parcel], contents: &mut Contents) -> Result<Vec<(Digest, Vec<u8>)>, StoreError> {
        let mut packing = Packing { contents, packs: Vec::new(), open: Open::default() };
        for Parcel { record, blobs } in parcels {
            let mut whole = true;
            for blob in blobs {
                if blob.bytes >= PACKED_BELOW {
                    whole &= packing.contents.loose.contains_key(&blob.digest);
                    continue;
                }
                match self.store.folder.read(blob)?.filter(|bytes| Digest::of(bytes) == blob.digest) {
                    Some(bytes) => {
                        packing.add_blob(blob.digest, &bytes);
                        self.pushed.small_blobs += 1;
                    }
                    None => whole = false,
                }
            }
            // Blobs that several records name are in the parcel of the first of them.
            let known = |blob: &Blob| packing.has(&blob.digest) || self.remote.holds(blob);
            let stored = if whole && record.blobs().all(known) {
                self.store
                    .folder
                    .packs
                    .frame(Kind::Record, &record.key)
                    .map_err(StoreError::io("read a record", &self.store.root.join("packs")))?
            } else {
                None
            };
            let Some((stamp, bytes)) = stored else {
                self.pushed.left_out += 1;
                continue;
            };
            packing.add_record(record, stamp, &bytes);
            self.pushed.records += 1;
        }
        packing.close();
        Ok(packing.packs)
    }

    /// Writes the manifest, which covers older ones that are not much longer, so that there are never many: as many as the number of all has binary digits.
    fn manifest(&mut self, mut contents: Contents) -> Result<(), StoreError> {
        let bytes = {
            let known = self.remote.known();
            let mut length = contents.encode(0).len() as u64;
            let mut older: Vec<&Manifest> = known.live.iter().collect();
            older.sort_by_key(|manifest| (manifest.bytes().len(), std::cmp::Reverse(manifest.written)));
            for manifest in older {
                let more = manifest.bytes().len() as u64;
                if more > 2 * length || length + more > LONGEST_COVER {
                    break;
                }
                length += more;
                contents.cover(manifest, |object| self.remote.is_sound(object));
            }
            let last = known.live.iter().map(|manifest| manifest.written).max();
            contents.encode(now_ns().max(last.map_or(0, |last| last.saturating_add(1))))
        };
        let name = Digest::of(&bytes);
        self.remote.objects.put(&format!("{MANIFESTS}/{name}"), &bytes)?;
        self.pushed.manifests += 1;
        if let Reading::Whole(manifest) = Manifest::read(name, bytes) {
            self.remote.cache(&self.store.root).keep(&manifest);
            self.remote.add(manifest);
        }
        Ok(())
    }
}

/// The pack that takes the next frame, and what is in it.
#[derive(Default)]
struct Open {
    bytes: Vec<u8>,
    /// Offset and length of their frames.
    blobs: BTreeMap<Digest, (u64, u64)>,
    records: Vec<Packed>,
}

/// A record in the open pack.
struct Packed {
    key: Digest,
    ports: u32,
    stamp: u64,
    check: [u8; 16],
    offset: u64,
    length: u64,
}

struct Packing<'a> {
    contents: &'a mut Contents,
    packs: Vec<(Digest, Vec<u8>)>,
    open: Open,
}

impl Packing<'_> {
    fn has(&self, blob: &Digest) -> bool {
        self.contents.loose.contains_key(blob)
            || self.contents.blobs.contains_key(blob)
            || self.open.blobs.contains_key(blob)
    }

    fn add_blob(&mut self, digest: Digest, payload: &[u8]) {
        // Without a time: the same blobs and records make the same pack.
        let frame = frame::encode(Kind::Blob, &digest, 0, payload);
        self.open.blobs.insert(digest, (self.open.bytes.len() as u64, frame.len() as u64));
        self.open.bytes.extend_from_slice(&frame);
    }

    fn add_record(&mut self, record: &InstanceRecord, stamp: u64, frame: &[u8]) {
        let (offset, length) = (self.open.bytes.len() as u64, frame.len() as u64);
        let (ports, check) = (record.ports.len() as u32, outputs_check(record));
        self.open.records.push(Packed { key: record.key, ports, stamp, check, offset, length });
        self.open.bytes.extend_from_slice(frame);
        if self.open.bytes.len() as u64 >= LONG {
            self.close();
        }
    }

    /// The pack has its name now, and its frames have their places.
    fn close(&mut self) {
        let Open { bytes, blobs, records } = std::mem::take(&mut self.open);
        if bytes.is_empty() {
            return;
        }
        let pack = Digest::of(&bytes);
        self.contents.packs.insert(pack, bytes.len() as u64);
        let spot = |offset, length| Spot { pack, offset, length };
        self.contents.blobs.extend(blobs.into_iter().map(|(key, (offset, length))| (key, spot(offset, length))));
        for Packed { key, ports, stamp, check, offset, length } in records {
            self.contents.records.insert(key, Listing { ports, stamp, check, spot: spot(offset, length) });
        }
        self.packs.push((pack, bytes));
    }
}
