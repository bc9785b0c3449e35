//! The record of an instance: what went in, which blobs came out, what it cost, and where it came from.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use turbid_contract::{ArtifactKind, Axes};

use crate::digest::Digest;
use crate::store::error::StoreError;

/// The name of an encoded artifact: the BLAKE3 digest of its bytes, its kind (hence its file format), its length.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Blob {
    pub digest: Digest,
    pub kind: ArtifactKind,
    pub bytes: u64,
}

/// What a port holds.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PortRecord {
    pub payload: String,
    pub blob: Blob,
}

/// What an instance cost; lives in records only, never in a port.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Cost {
    pub wall_s: f64,
    /// CPU seconds of the instance's own work, with those of the runs whose checkpoint it continued.
    pub cpu_s: f64,
    /// Peak memory of the process while the instance ran.
    pub peak_bytes: u64,
    /// Whether no other instance ran beside it.
    pub alone: bool,
}

/// Where a record came from; not in the key.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    pub pipeline: String,
    /// Label of the stage in that pipeline.
    pub stage: String,
    pub axes: Axes,
    pub turbid_version: String,
    /// Unix time, s.
    pub started: u64,
}

/// What an instance made and what it cost: all that a hit needs. One per key, kept together with its [`Recipe`].
///
/// Numbers must be finite; [`Store::publish`](crate::store::Store::publish) sees to it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InstanceRecord {
    pub key: Digest,
    pub use_name: String,
    pub version: u32,
    /// The ports that are in the store.
    pub ports: BTreeMap<String, PortRecord>,
    pub cost: Cost,
    pub seed: Option<u64>,
    /// The key without the stopping params, under which checkpoints are kept.
    pub state_key: Option<Digest>,
    /// Where the stage might stop by a clock: the stopping params that ask for just what it made, all others of them left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reached: Option<BTreeMap<String, Value>>,
    /// Name, value, unit.
    pub measures: Vec<(String, f64, String)>,
    pub warnings: Vec<String>,
    /// The kernel that did the work, where a stage has several ...
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kernel: Option<String>,
    /// ... and what kept faster ones from doing it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub refused: Vec<String>,
    pub provenance: Provenance,
}

/// What went into an instance. Read only to explain: parsing it takes longer than all else of a look-up.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Recipe {
    /// Canonical params.
    pub params: Value,
    /// Content digests of the inputs; ports sorted by name.
    pub inputs: Vec<(String, Vec<(Axes, Digest)>)>,
    /// Field path, file name, content digest.
    pub files: Vec<(String, String, Digest)>,
}

/// Bytes before the head: its length (4, little-endian) and the first 16 bytes of its BLAKE3.
pub(super) const LEAD: usize = 20;

impl InstanceRecord {
    /// Lead, head (the record as JSON), recipe (as JSON). The head has a check of its own, so that a look-up reads no more.
    pub(super) fn encode(&self, recipe: &Recipe) -> Result<Vec<u8>, StoreError> {
        let wrong =
            |what: &str| StoreError::unfit(format!("the record of `{}` cannot be stored: {what}", self.use_name));
        // JSON would write NaN as null, and the record would be a miss for ever.
        if !(self.cost.wall_s.is_finite() && self.cost.cpu_s.is_finite()) {
            return Err(wrong("its cost is not finite"));
        }
        if let Some((name, value, _)) = self.measures.iter().find(|m| !m.1.is_finite()) {
            return Err(wrong(&format!("measure `{name}` = {value} is not finite")));
        }
        let head = serde_json::to_vec(self).map_err(|e| wrong(&e.to_string()))?;
        let length = u32::try_from(head.len()).map_err(|_| wrong("it is longer than 4 GiB"))?;
        let mut bytes = length.to_le_bytes().to_vec();
        bytes.extend_from_slice(&Digest::of(&head).0[..16]);
        bytes.extend_from_slice(&head);
        serde_json::to_writer(&mut bytes, recipe).map_err(|e| wrong(&e.to_string()))?;
        Ok(bytes)
    }

    /// The record of `key` at the start of `bytes`; `None` where it is damaged or not one of `key`.
    pub(super) fn decode_head(key: &Digest, bytes: &[u8]) -> Option<Self> {
        let head = bytes.get(LEAD..head_end(bytes)?)?;
        if Digest::of(head).0[..16] != bytes[4..LEAD] {
            return None;
        }
        serde_json::from_slice::<Self>(head).ok().filter(|record| record.key == *key)
    }

    /// Record and recipe.
    pub(super) fn decode(key: &Digest, bytes: &[u8]) -> Option<(Self, Recipe)> {
        let record = Self::decode_head(key, bytes)?;
        Some((record, serde_json::from_slice(&bytes[head_end(bytes)?..]).ok()?))
    }

    /// The blobs of all ports.
    pub fn blobs(&self) -> impl Iterator<Item = &Blob> {
        self.ports.values().map(|port| &port.blob)
    }
}

/// Where the head of a record ends.
pub(super) fn head_end(bytes: &[u8]) -> Option<usize> {
    let length = u32::from_le_bytes(*bytes.first_chunk()?);
    LEAD.checked_add(usize::try_from(length).ok()?)
}
