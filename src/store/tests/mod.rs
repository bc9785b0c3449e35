//! The store as runs use it: round trips, crashes, damage, full disks, odd files, what vanishes or cannot be read,
//! two runs at once, the index, gc, stores elsewhere.

mod damage;
mod gc;
mod index;
mod labels;
mod odd;
mod released;
mod remote;
mod sharing;
mod unread;
mod vanishing;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

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
        seed: Some(u64::MAX),
        state_key: None,
        reached: None,
        measures: vec![("paths".into(), 1e9, "1".into())],
        warnings: vec!["läuft".into()],
        kernel: None,
        refused: Vec::new(),
        provenance: Provenance { pipeline: "p".into(), stage: "tissue".into(), ..Provenance::default() },
    }
}

fn recipe(i: u64) -> Recipe {
    Recipe {
        params: json!({"f_x": [0.0, 0.1], "n": i}),
        inputs: vec![("scene".into(), vec![(Axes::from([("A_rho".into(), json!(1.0))]), key(i + 1))])],
        files: vec![("mesh.file".into(), "tube.stl".into(), key(i + 2))],
    }
}

/// Puts `artifact` and publishes a record of `i` that names it.
fn publish(store: &Store, i: u64, artifact: &Artifact) -> Result<Blob, StoreError> {
    let blob = store.put(artifact)?;
    store.publish(&record(i, &[("out", blob)]), &recipe(i))?;
    Ok(blob)
}

/// Copies a folder; `cargo test` runs on file systems without snapshots.
fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap().flatten() {
        let target = to.join(entry.file_name());
        if entry.file_type().unwrap().is_dir() {
            copy(&entry.path(), &target)
        } else {
            fs::copy(entry.path(), target).unwrap();
        }
    }
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() { found.extend(files(&path)) } else { found.push(path) }
    }
    found.sort();
    found
}

/// Overwrites a file of the store, read-only or not.
fn overwrite(path: &Path, bytes: &[u8]) {
    fs::remove_file(path).unwrap();
    fs::write(path, bytes).unwrap();
}

fn artifact(i: u64) -> Artifact {
    if i.is_multiple_of(2) { small(i) } else { large(i) }
}

/// What a run does for instances 0..n: a hit is read, whatever is not there is computed. Returns the number of hits.
fn run(store: &Store, n: u64) -> u64 {
    let mut hits = 0;
    for i in 0..n {
        let _lock = store.lock(&key(i), &|| false).unwrap();
        let found = store.record(&key(i)).map(|record| (store.get(&record.ports["out"].blob), record));
        match found {
            Some((Ok(there), record)) => {
                assert_eq!(there, artifact(i), "a wrong hit");
                assert_eq!(*record, self::record(i, &[("out", record.ports["out"].blob)]), "a wrong record");
                hits += 1;
            }
            Some((Err(error), _)) if !error.is_lost_blob() => panic!("{error}"),
            _ => drop(publish(store, i, &artifact(i)).unwrap()),
        }
        assert!(store.record(&key(i)).is_some(), "instance {i} is there after it was computed");
    }
    store.finish().unwrap();
    hits
}

/// After whatever happened, one run brings back everything, and then nothing is wrong any more.
fn assert_heals(outputs: &Path, n: u64, digests: &[Digest], case: &str) {
    run(&Store::open(outputs).unwrap(), n);
    let store = Store::open(outputs).unwrap();
    assert_eq!(store.digests(), digests, "{case}");
    let report = store.verify(false).unwrap();
    assert!(report.is_clean(), "{case}: {:?}", report.findings);
    assert_eq!(run(&store, n), n, "{case}: all are hits");
}

/// A store after a run of `n` instances, with its digests.
fn filled(n: u64) -> (TempDir, Vec<Digest>) {
    let outputs = folder();
    let store = Store::open(outputs.path()).unwrap();
    assert_eq!(run(&store, n), 0);
    let digests = store.digests();
    assert_eq!(digests.len() as u64, n);
    (outputs, digests)
}

/// A pack that a process wrote `days` ago: records of `range`, without blobs.
fn old_pack(outputs: &Path, days: u64, range: std::ops::Range<u64>) {
    let stamp = writer::now_ns() - days * 86_400 * 1_000_000_000;
    let frames = range.flat_map(|i| {
        frame::encode(frame::Kind::Record, &key(i), stamp + i, &record(i, &[]).encode(&recipe(i)).unwrap())
    });
    fs::create_dir_all(outputs.join("store/packs")).unwrap();
    fs::write(outputs.join(format!("store/packs/{days}-days.pack")), frames.collect::<Vec<u8>>()).unwrap();
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

#[test]
fn a_newer_record_replaces_an_older_one() {
    let outputs = folder();
    let store = Store::open(outputs.path()).unwrap();
    let (first, second) = (store.put(&small(1)).unwrap(), store.put(&large(2)).unwrap());
    store.publish(&record(0, &[("out", first)]), &recipe(0)).unwrap();
    store.publish(&record(0, &[("more", second), ("out", first)]), &recipe(0)).unwrap();
    drop(store);
    fs::remove_dir_all(outputs.path().join("store/index")).unwrap();
    let store = Store::open(outputs.path()).unwrap();
    assert_eq!(store.record(&key(0)).unwrap().ports.len(), 2);
    assert_eq!(store.records().map(|(_, recipe)| recipe).collect::<Vec<_>>(), [recipe(0)]);
    fs::remove_file(store.file_of(&second).expect("it is a file")).unwrap();
    assert!(store.record(&key(0)).is_none(), "one port is missing");
    assert_eq!(store.records().count(), 1, "`explain` still finds it");
}

#[test]
fn numbers_that_are_not_finite_do_not_become_records() {
    let outputs = folder();
    let store = Store::open(outputs.path()).unwrap();
    let mut wrong = record(0, &[]);
    wrong.measures[0].1 = f64::NAN;
    let message = store.publish(&wrong, &recipe(0)).unwrap_err().to_string();
    assert!(message.contains("measure `paths` = NaN is not finite"), "{message}");
}

#[test]
fn copies_are_whole_and_files_are_read_only() {
    let outputs = folder();
    let store = Store::open(outputs.path()).unwrap();
    for (i, in_pack) in [(0, true), (1, false)] {
        let blob = store.put(&artifact(i)).unwrap();
        assert_eq!(store.file_of(&blob).is_none(), in_pack);
        let path = outputs.path().join("latest/p/out");
        store.materialise(&blob, &path).unwrap();
        assert_eq!(Digest::of(&fs::read(&path).unwrap()), blob.digest);
        let file = store.file_of(&blob).unwrap_or(path);
        assert!(fs::metadata(file).unwrap().permissions().readonly());
    }
}

#[test]
fn a_newer_format_is_refused_and_a_damaged_one_healed() {
    let (outputs, digests) = filled(2);
    let path = outputs.path().join("store/format");
    for newer in ["2\n", "2", "18446744073709551615\nwhatever"] {
        fs::write(&path, newer).unwrap();
        let errors = [
            Store::open(outputs.path()).err(),
            Store::open_read_only(outputs.path()).err(),
            Store::check(outputs.path()).err(),
        ];
        for error in errors {
            let message = error.expect("it is refused").to_string();
            assert!(message.contains("knows formats up to 1; update turbid"), "{message}");
        }
        assert_eq!(fs::read_to_string(&path).unwrap(), newer, "nothing was changed");
    }
    for damaged in ["", "\u{1}", "0\n", "turbid"] {
        fs::write(&path, damaged).unwrap();
        assert_heals(outputs.path(), 2, &digests, damaged);
        assert!(fs::read_to_string(&path).unwrap().starts_with("1\n"));
    }
}

#[test]
fn what_is_no_folder_is_refused() {
    let outputs = folder();
    let file = outputs.path().join("file");
    fs::write(&file, "not a folder").unwrap();
    for path in [file.clone(), file.join("below")] {
        assert!(Store::open(&path).is_err());
        assert!(Store::check(&path).is_err());
    }
    assert_eq!(fs::read_to_string(&file).unwrap(), "not a folder");
}

#[test]
fn looking_creates_nothing() {
    let outputs = folder();
    let missing = outputs.path().join("not/yet");
    Store::check(&missing).unwrap();
    let store = Store::open_read_only(&missing).unwrap();
    assert!(store.record(&key(0)).is_none() && store.digests().is_empty());
    assert!(store.verify(false).unwrap().is_clean());
    drop(store);
    assert_eq!(fs::read_dir(outputs.path()).unwrap().count(), 0);

    let (outputs, _) = filled(2);
    fs::remove_dir_all(outputs.path().join("store/index")).unwrap();
    let before = files(outputs.path());
    let store = Store::open_read_only(outputs.path()).unwrap();
    assert!(store.records().all(|(r, _)| store.get(&r.ports["out"].blob).is_ok()));
    drop(store);
    assert_eq!(files(outputs.path()), before);
}
