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
    /// CPU seconds of the instance's own work.
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

/// One record per key. Numbers must be finite; [`Store::publish`](crate::store::Store::publish) sees to it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InstanceRecord {
    pub key: Digest,
    pub use_name: String,
    pub version: u32,
    /// The ports that are in the store.
    pub ports: BTreeMap<String, PortRecord>,
    pub cost: Cost,
    /// Canonical params.
    pub params: Value,
    /// Content digests of the inputs; ports sorted by name.
    pub inputs: Vec<(String, Vec<(Axes, Digest)>)>,
    /// Field path, file name, content digest.
    pub files: Vec<(String, String, Digest)>,
    pub seed: Option<u64>,
    /// The key without the stopping params, under which checkpoints are kept.
    pub state_key: Option<Digest>,
    /// Name, value, unit.
    pub measures: Vec<(String, f64, String)>,
    pub warnings: Vec<String>,
    pub provenance: Provenance,
}

impl InstanceRecord {
    pub(super) fn encode(&self) -> Result<Vec<u8>, StoreError> {
        let wrong =
            |what: &str| StoreError::unfit(format!("the record of `{}` cannot be stored: {what}", self.use_name));
        // JSON would write NaN as null, and the record would be a miss for ever.
        if !(self.cost.wall_s.is_finite() && self.cost.cpu_s.is_finite()) {
            return Err(wrong("its cost is not finite"));
        }
        if let Some((name, value, _)) = self.measures.iter().find(|m| !m.1.is_finite()) {
            return Err(wrong(&format!("measure `{name}` = {value} is not finite")));
        }
        serde_json::to_vec(self).map_err(|e| wrong(&e.to_string()))
    }

    /// `None` where the bytes are not a record of `key`.
    pub(super) fn decode(key: &Digest, bytes: &[u8]) -> Option<Self> {
        serde_json::from_slice::<Self>(bytes).ok().filter(|record| record.key == *key)
    }

    /// The blobs of all ports.
    pub fn blobs(&self) -> impl Iterator<Item = &Blob> {
        self.ports.values().map(|port| &port.blob)
    }
}
