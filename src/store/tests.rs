//! The store as runs use it: round trips, crashes, damage, full disks, two runs at once, gc.

use std::collections::BTreeMap;

use serde_json::json;
use tempfile::TempDir;
use turbid_contract::ndarray::Array2;
use turbid_contract::{Artifact, Axes, ImageStack, LayerInfo, Record};

use super::*;

fn folder() -> TempDir {
    tempfile::tempdir().expect("the test may write to the temporary folder")
}

fn key(i: u64) -> Digest {
    Digest::of(format!("key {i}").as_bytes())
}

/// A small artifact (goes into a pack).
fn small(i: u64) -> Artifact {
    Artifact::Record(Record { fields: BTreeMap::from([("value".to_owned(), json!(i))]) })
}

/// 128 x 128 pixels: 64 kB and a header, so a file of its own.
fn large(i: u64) -> Artifact {
    let mut stack = ImageStack::new(128, 128);
    let data = Array2::from_shape_fn((128, 128), |(row, column)| (i as f32) + (row * 128 + column) as f32);
    stack.push(LayerInfo::value("radiance", "W mm^-2 sr^-1"), data);
    Artifact::Images(stack)
}

fn record(i: u64, ports: &[(&str, Blob)]) -> InstanceRecord {
    let port = |(name, blob): &(&str, Blob)| (String::from(*name), PortRecord { payload: "any".into(), blob: *blob });
    InstanceRecord {
        key: key(i),
        use_name: "scene".into(),
        version: 1,
        ports: ports.iter().map(port).collect(),
        cost: Cost { wall_s: 0.1, cpu_s: 0.3, peak_bytes: 1 << 20, alone: true },
        params: json!({"f_x": [0.0, 0.1], "n": i}),
        inputs: vec![("scene".into(), vec![(Axes::from([("A_rho".into(), json!(1.0))]), key(i + 1))])],
        files: vec![("mesh.file".into(), "tube.stl".into(), key(i + 2))],
        seed: Some(u64::MAX),
        state_key: None,
        measures: vec![("paths".into(), 1e9, "1".into())],
        warnings: vec!["läuft".into()],
        provenance: Provenance { pipeline: "p".into(), stage: "tissue".into(), ..Provenance::default() },
    }
}

/// Puts `artifact` and publishes a record of `i` that names it.
fn publish(store: &Store, i: u64, artifact: &Artifact) -> Result<Blob, StoreError> {
    let blob = store.put(artifact)?;
    store.publish(&record(i, &[("out", blob)]))?;
    Ok(blob)
}

#[test]
fn what_is_published_is_found_again_by_the_next_store() {
    let outputs = folder();
    let store = Store::open(outputs.path()).unwrap();
    let blobs = [publish(&store, 0, &small(0)).unwrap(), publish(&store, 1, &large(1)).unwrap()];
    let check = |store: &Store| {
        for (i, (blob, artifact)) in blobs.iter().zip([small(0), large(1)]).enumerate() {
            assert_eq!(*store.record(&key(i as u64)).unwrap(), record(i as u64, &[("out", *blob)]));
            assert_eq!(store.get(blob).unwrap(), artifact);
        }
        assert!(store.record(&key(2)).is_none());
    };
    check(&store);
    drop(store);
    check(&Store::open(outputs.path()).unwrap());
    check(&Store::open_read_only(outputs.path()).unwrap());
}

/// A disk that runs full after any number of bytes: a clear error, nothing published before is lost, and the same
/// store goes on once there is room.
#[test]
fn a_full_disk_is_an_error_and_no_loss() {
    let outputs = folder();
    let store = Store::open(outputs.path()).unwrap();
    publish(&store, 0, &small(0)).unwrap();
    for artifact in [small(1), large(1)] {
        let step = if artifact == small(1) { 37 } else { 7001 };
        for room in (0..).step_by(step) {
            disk::quota::set(Some(room));
            let result = publish(&store, 1, &artifact);
            disk::quota::set(None);
            assert!(store.record(&key(0)).is_some(), "room for {room} bytes");
            match result {
                Ok(_) => break,
                Err(error) => assert!(error.is_full() && error.to_string().contains("full"), "{error}"),
            }
            assert!(store.record(&key(1)).is_none(), "room for {room} bytes");
        }
        assert!(store.record(&key(1)).is_some());
        store.folder.packs.append(frame::Kind::ForgetRecord, &key(1), &[]).unwrap();
    }
    publish(&store, 2, &small(2)).unwrap();
    drop(store);
    let again = Store::open(outputs.path()).unwrap();
    assert!(again.record(&key(0)).is_some() && again.record(&key(1)).is_none() && again.record(&key(2)).is_some());
    assert!(again.verify(false).unwrap().is_clean());
}
