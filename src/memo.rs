//! The short way of a run that has nothing to do: which records an unchanged pipeline led to last time.
//!
//! Only a cache of keys, never of results: the records are looked up and their blobs checked as always. Whatever keys
//! depend on (text, axes, overrides, stages and their VERSIONs, input files, this very program) is compared, and so are
//! the digests of all outputs, because the keys further down were made from them.
//!
//! A file: [`FORMAT`], [`identity`] of the plan (32), number of input files (8), each with the length of its path (8), path and digest (32), for each
//! instance its key (32) and the digest over its outputs (32), BLAKE3 of all before (32). Its name is only where it is looked for: under another's
//! name, or of another format, it is none.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::UNIX_EPOCH;

use rayon::prelude::*;

use crate::brief::{Brief, Outputs};
use crate::digest::{Digest, PartHasher};
use crate::input_file;
use crate::leftover;
use crate::plan::{InstanceId, Plan};
use crate::store::Store;
use crate::threads;
use crate::whole_file::{self, Synced};
use turbid_contract::file::MOST_BYTES;

const FORMAT: &str = "turbid memo 3";
/// Kept for so many pipelines (or overrides of them); the oldest go.
const KEPT: usize = 64;
/// From so many records on they are looked up side by side.
const MANY: usize = 256;
/// Names of memos that are being written begin so.
const WRITING: &str = "writing-";
/// Bytes; a million instances take 64 MB.
const LONGEST: u64 = 1 << 28;

/// Identifies a plan by everything that its keys depend on but the content of input files.
pub fn identity(plan: &Plan) -> Digest {
    let mut parts = PartHasher::new(FORMAT);
    parts.add("program", program().as_bytes());
    for source in &plan.spec.sources {
        parts.add(&source.name, source.text.as_bytes());
    }
    for given in &plan.spec.overrides {
        parts.add("set", given.as_bytes());
    }
    for &stage in &plan.needed {
        let row = plan.row(stage);
        // Two stages of one kind are not the same target.
        parts.add("stage", plan.spec.stages[stage].name.as_bytes());
        parts.add(row.name, &row.version.to_le_bytes());
        for port in plan.wanted(stage) {
            parts.add("wanted", port.as_bytes());
        }
    }
    for id in plan.needed_instances() {
        parts.add("axes", plan.axes_text(id).as_bytes());
    }
    parts.finish()
}

/// This program: one that was built anew may make other keys although no VERSION was raised.
pub(crate) fn program() -> String {
    let described = std::env::current_exe().and_then(fs::metadata);
    let written = |m: &fs::Metadata| {
        m.modified().ok().and_then(|t| t.duration_since(UNIX_EPOCH).ok()).map_or(0, |d| d.as_nanos())
    };
    let described = described.map(|m| format!("{} {}", m.len(), written(&m))).unwrap_or_default();
    format!("{} {described}", env!("CARGO_PKG_VERSION"))
}

/// What a plan led to.
pub struct Recalled {
    /// Of all needed instances.
    pub briefs: Vec<Arc<Brief>>,
    /// The input files, with what they hold.
    pub files: Vec<(PathBuf, Digest)>,
}

/// What a plan led to, if everything is as it was; `None` sends the caller the long way.
pub fn recall(plan: &Plan, store: &Store, folder: &Path) -> Option<Recalled> {
    let identity = identity(plan);
    let path = folder.join(identity.to_string());
    let bytes = input_file::read(&path, LONGEST).ok()?;
    let (body, checksum) = bytes.split_at_checked(bytes.len().checked_sub(32)?)?;
    if Digest::of(body).0 != checksum {
        return None;
    }
    let mut rest = body.strip_prefix(FORMAT.as_bytes())?.strip_prefix(&identity.0)?;
    let mut take = |n: usize| -> Option<&[u8]> {
        let (head, tail) = rest.split_at_checked(n)?;
        rest = tail;
        Some(head)
    };
    let number = |bytes: &[u8]| bytes.try_into().map(u64::from_le_bytes).ok().and_then(|n| usize::try_from(n).ok());
    let mut files = Vec::new();
    for _ in 0..number(take(8)?)? {
        let length = number(take(8)?)?;
        let path = PathBuf::from(String::from_utf8(take(length)?.to_vec()).ok()?);
        let digest = take(32)?;
        // Larger ones than stages take unasked go the long way, which knows their limits.
        let (now, _) = input_file::digest(&path, MOST_BYTES).ok()?;
        if now.0 != digest {
            return None;
        }
        files.push((path, now));
    }
    let ids: Vec<_> = plan.needed_instances().collect();
    if rest.len() != 64 * ids.len() {
        return None;
    }
    let found = |(&id, entry): (&InstanceId, &[u8])| {
        let record = store.record(&Digest(entry[..32].try_into().ok()?))?;
        let stage = plan.stage_of(id);
        let brief = Brief::of(&record, plan.outputs(stage));
        let whole = outputs_digest(&brief.outputs).0 == entry[32..]
            && plan.wanted(stage).iter().all(|port| brief.outputs.has(port));
        whole.then(|| Arc::new(brief))
    };
    let briefs: Option<_> = if ids.len() >= MANY && threads::shared() {
        ids.par_iter().zip(rest.par_chunks_exact(64)).map(found).collect()
    } else {
        ids.iter().zip(rest.chunks_exact(64)).map(found).collect()
    };
    Some(Recalled { briefs: briefs?, files })
}

/// Notes the results of a plan that is up to date. Best effort: without it the next run is only slower.
pub fn keep(plan: &Plan, briefs: &[&Arc<Brief>], files: &[(PathBuf, Digest)], folder: &Path) {
    let identity = identity(plan);
    let mut body = Vec::with_capacity(64 * briefs.len() + 256);
    body.extend(FORMAT.as_bytes());
    body.extend(identity.0);
    body.extend((files.len() as u64).to_le_bytes());
    for (path, digest) in files {
        let Some(path) = path.to_str() else { return };
        body.extend((path.len() as u64).to_le_bytes());
        body.extend(path.as_bytes());
        body.extend(digest.0);
    }
    for brief in briefs {
        body.extend(brief.key.0);
        body.extend(outputs_digest(&brief.outputs).0);
    }
    body.extend(Digest::of(&body).0);
    if body.len() as u64 <= LONGEST {
        let _ = write(folder, &identity.to_string(), &body);
    }
}

/// Writes a note; the oldest of a folder of many go.
pub(crate) fn write(folder: &Path, name: &str, body: &[u8]) -> std::io::Result<()> {
    fs::create_dir_all(folder)?;
    leftover::sweep(folder, WRITING);
    whole_file::write(&folder.join(name), WRITING, body, Synced::No)?;
    let mut kept: Vec<_> =
        fs::read_dir(folder)?.flatten().map(|e| (e.metadata().and_then(|m| m.modified()).ok(), e.path())).collect();
    kept.sort();
    for (_, path) in kept.iter().rev().skip(KEPT) {
        // What is no file is not ours.
        let _ = fs::remove_file(path);
    }
    Ok(())
}

fn outputs_digest(outputs: &Outputs) -> Digest {
    let mut parts = PartHasher::new(FORMAT);
    for (name, blob) in outputs.iter() {
        parts.add(name, &blob.digest.0);
    }
    parts.finish()
}
