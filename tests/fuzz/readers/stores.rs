//! The folder of a store: packs, index, large blobs, checkpoints, format.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::json;
use turbid::digest::Digest;
use turbid::store::{Blob, Cost, InstanceRecord, PortRecord, Provenance, Recipe, Store};
use turbid_contract::ndarray::Array2;
use turbid_contract::{Artifact, ImageStack, LayerInfo, Record};

use super::{Reader, Seen, no_more, nothing};
use crate::files;
use crate::mutate::Form;

/// Records in the seed.
const RECORDS: u64 = 4;

pub fn readers() -> Vec<Reader> {
    vec![Reader {
        name: "store",
        form: Form::Store,
        share: 6,
        claims: nothing,
        seeds: || vec![seed()],
        read,
        law: no_more,
    }]
}

fn key(i: u64) -> Digest {
    Digest::of(format!("key {i}").as_bytes())
}

/// Small blobs in a pack, a large one in a file, two checkpoints.
fn seed() -> Vec<u8> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let store = Store::open(folder.path()).expect("the folder is ours");
    for i in 0..RECORDS {
        let blob = store.put(&artifact(i)).expect("every number is finite");
        store.publish(&record(i, blob), &Recipe::default()).expect("every number is finite");
    }
    for progress in [3, 9] {
        store.checkpoint(&key(0), progress, &[progress as u8; 40]).expect("the folder is ours");
    }
    store.finish().expect("the folder is ours");
    drop(store);
    let mut entries = files::read(&folder.path().join("store"));
    entries.retain(|e| !e.name.starts_with("locks") && !e.name.starts_with("tmp"));
    files::join(&entries)
}

fn artifact(i: u64) -> Artifact {
    if i > 0 {
        return Artifact::Record(Record { fields: BTreeMap::from([("value".to_owned(), json!(i))]) });
    }
    let mut stack = ImageStack::new(128, 128);
    stack.push(LayerInfo::value("radiance", "W mm^-2 sr^-1"), Array2::from_elem((128, 128), 0.5));
    Artifact::Images(stack)
}

fn record(i: u64, blob: Blob) -> InstanceRecord {
    InstanceRecord {
        key: key(i),
        use_name: "scene".into(),
        version: 1,
        ports: BTreeMap::from([("scene".to_owned(), PortRecord { payload: "any".into(), blob })]),
        cost: Cost::default(),
        seed: None,
        state_key: None,
        reached: None,
        measures: Vec::new(),
        warnings: Vec::new(),
        kernel: None,
        refused: Vec::new(),
        provenance: Provenance::default(),
    }
}

fn read(input: &[u8]) -> Result<Seen, String> {
    let folder = tempfile::tempdir().map_err(|e| e.to_string())?;
    let entries = files::split(input);
    files::write(&folder.path().join("store"), &entries).map_err(|e| format!("the input cannot be written: {e}"))?;
    let looked = match Store::open_read_only(folder.path()) {
        Ok(store) => look(&store)?,
        Err(_) => 0,
    };
    // The name of the folder differs from one reading to the next.
    mend(folder.path()).map_err(|e| e.replace(&*folder.path().to_string_lossy(), "."))?;
    // A store is read more than once: by a look, a repair and two checks.
    Ok(Seen { taken: looked > 0, decoded: 4 * input.len() })
}

/// Whatever a store holds, what it gives is what was asked for. The number of records.
fn look(store: &Store) -> Result<usize, String> {
    for i in 0..RECORDS {
        if store.record(&key(i)).is_some_and(|found| found.key != key(i)) {
            return Err(format!("the record of another key is given for that of {i}"));
        }
        // A checkpoint that is given is one that was written, whole.
        if let Some((progress, state)) = store.resume(&key(i), u64::MAX)
            && state != [progress as u8; 40]
        {
            return Err(format!("the checkpoint {progress} of {i} is not what was written"));
        }
    }
    let mut records = 0;
    for (record, _) in store.records() {
        records += 1;
        for blob in record.blobs() {
            match store.bytes(blob) {
                Ok(bytes) if Digest::of(&bytes) != blob.digest => {
                    return Err(format!("wrong bytes under the digest {}", blob.digest.short()));
                }
                _ => {}
            }
            let _ = store.get(blob);
        }
    }
    drop((store.digests(), store.stat()));
    Ok(records)
}

/// `verify --repair` mends whatever it finds: the next `verify` is clean.
fn mend(outputs: &Path) -> Result<(), String> {
    let Ok(store) = Store::open(outputs) else { return Ok(()) };
    store.verify(true).map_err(|e| format!("verify --repair: {e}"))?;
    drop(store);
    let store = Store::open(outputs).map_err(|e| format!("after verify --repair it cannot be opened: {e}"))?;
    look(&store)?;
    let report = store.verify(false).map_err(|e| format!("verify after --repair: {e}"))?;
    let found: Vec<String> = report.findings.iter().map(ToString::to_string).collect();
    if found.is_empty() { Ok(()) } else { Err(format!("not clean after verify --repair: {}", found.join("; "))) }
}
