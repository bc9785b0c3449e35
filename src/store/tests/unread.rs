//! Reads that fail: what could not be read is neither damaged nor gone.

use super::*;

/// What may remove something.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Work {
    Gc,
    Gather,
    Repair,
    Verify,
}

/// Opens the store and works on it. Whether it says that all went well.
fn does(work: Work, outputs: &Path) -> bool {
    let Ok(store) = Store::open(outputs) else { return false };
    match work {
        Work::Gc => store.gc(u64::MAX, &[]).is_ok(),
        Work::Gather => {
            store.folder.packs.note_damage();
            store.finish().is_ok()
        }
        Work::Repair => store.verify(true).is_ok_and(|report| report.is_clean() || report.repaired),
        Work::Verify => store.verify(false).is_ok_and(|report| report.is_clean()),
    }
}

/// Two instances with a checkpoint, an unnamed blob and bytes that belong to no entry.
fn scarred() -> (TempDir, Vec<Digest>) {
    let (outputs, digests) = filled(2);
    let store = Store::open(outputs.path()).unwrap();
    store.checkpoint(&key(0), 1, b"state").unwrap();
    store.put(&small(100)).unwrap();
    drop(store);
    let pack = files(&outputs.path().join("store/packs")).remove(0);
    let bytes = [b"no entry".to_vec(), fs::read(&pack).unwrap()].concat();
    overwrite(&pack, &bytes);
    (outputs, digests)
}

/// Whichever read fails, once or from then on: nothing that was there is lost, and nothing is called sound that is not.
#[test]
fn a_read_that_fails_loses_nothing() {
    let (outputs, digests) = scarred();
    for work in [Work::Gc, Work::Gather, Work::Repair, Work::Verify] {
        // Steps, as each case copies a store; they meet every kind of reading.
        for (bad, step) in [(1, 2), (usize::MAX, 7)] {
            for good in (0..).step_by(step) {
                let case = format!("{work:?}: {bad} reads fail after {good}");
                let copied = folder();
                copy(outputs.path(), copied.path());
                disk::faults::set(good, bad);
                let well = does(work, copied.path());
                let struck = disk::faults::clear(bad);
                let store = Store::open(copied.path()).unwrap();
                assert_eq!(store.digests(), digests, "{case}");
                assert_eq!(run(&store, 2), 2, "{case}: all are hits");
                assert_eq!(store.resume(&key(0), 1), Some((1, b"state".to_vec())), "{case}");
                if work == Work::Repair && well {
                    let report = Store::open_read_only(copied.path()).unwrap().verify(false).unwrap();
                    assert!(report.is_clean(), "{case}: {:?}", report.findings);
                }
                assert!(!(work == Work::Verify && well), "{case}: it is not sound");
                if !struck {
                    assert!(well || work == Work::Verify, "{case}");
                    break;
                }
            }
        }
    }
}

/// Each read of `verify` that fails is told, and a repair removes nothing then.
#[test]
fn what_could_not_be_read_is_told() {
    let (outputs, _) = filled(2);
    // An index that could not be read is written anew.
    let but_index = || {
        let all = files(outputs.path()).into_iter();
        all.filter(|path| !path.starts_with(outputs.path().join("store/index"))).collect::<Vec<_>>()
    };
    let before = but_index();
    for (good, repair) in (0..).step_by(3).flat_map(|good| [(good, false), (good, true)]) {
        let store = Store::open(outputs.path()).unwrap();
        disk::faults::set(good, usize::MAX);
        let report = store.verify(repair);
        if !disk::faults::clear(usize::MAX) {
            assert!(report.unwrap().is_clean());
            break;
        }
        if let Ok(report) = report {
            assert!(report.unread().next().is_some() && !report.repaired, "after {good} reads: {:?}", report.findings);
            let told = report.findings.iter().map(ToString::to_string).collect::<String>();
            assert!(told.contains("could not be read") && !told.contains("missing"), "{told}");
        }
        drop(store);
        assert_eq!(but_index(), before, "after {good} reads");
    }
}

/// Whoever only looks is told why something is not found; a run computes what it cannot read.
#[test]
fn a_look_names_the_error() {
    let (outputs, _) = filled(2);
    let store = Store::open_read_only(outputs.path()).unwrap();
    let blob = store.record(&key(0)).unwrap().ports["out"].blob;
    assert_eq!(store.unread(), None);
    disk::faults::set(0, usize::MAX);
    let (found, bytes) = (store.record(&key(0)), store.bytes(&blob));
    disk::faults::clear(usize::MAX);
    assert!(found.is_none() && store.unread().is_some_and(|error| error.contains("cannot read a record")));
    let message = bytes.unwrap_err().to_string();
    assert!(message.contains("cannot read a blob") && message.contains("os error 5"), "{message}");
    assert_eq!(store.get(&blob).unwrap(), small(0), "it can be read again");

    let store = Store::open(outputs.path()).unwrap();
    assert!(store.get(&blob).is_ok());
    disk::faults::set(0, 1);
    assert!(store.get(&blob).is_ok(), "a second try");
    disk::faults::set(0, 2);
    assert!(matches!(store.get(&blob), Err(StoreError::Damaged { .. })), "a run computes it anew");
    disk::faults::clear(2);
    assert!(store.record(&key(0)).is_none());
}

/// Others may read what they might read of any file that is made: checkpoints are written piece by piece.
#[cfg(unix)]
#[test]
fn checkpoints_have_the_mode_of_other_files() {
    use std::os::unix::fs::PermissionsExt;
    let outputs = folder();
    Store::open(outputs.path()).unwrap().checkpoint(&key(0), 1, b"state").unwrap();
    let plain = outputs.path().join("plain");
    fs::write(&plain, "").unwrap();
    let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
    let state = files(&outputs.path().join("store/checkpoints")).remove(0);
    assert_eq!(mode(&state), mode(&plain));
}

/// Entries with right checks around wrong content, older and newer ones of one key, and stamps that nothing can beat.
#[test]
fn forged_entries_are_repaired() {
    use frame::Kind;
    for stamp in [1 << 62, u64::MAX] {
        let (outputs, _) = filled(2);
        let blob = Store::open_read_only(outputs.path()).unwrap().record(&key(0)).unwrap().ports["out"].blob.digest;
        for (name, content) in [("a", &b"wrong"[..]), ("b", b"wrong as well"), ("zz", b"and once more")] {
            let forged = [(Kind::Record, key(0)), (Kind::Record, key(9)), (Kind::Blob, blob), (Kind::Blob, key(8))];
            let frames = forged.iter().flat_map(|(kind, key)| {
                [stamp - 1, stamp].map(|stamp| frame::encode(*kind, key, stamp, content)).concat()
            });
            let path = outputs.path().join(format!("store/packs/{name}.pack"));
            fs::write(path, frames.collect::<Vec<u8>>()).unwrap();
        }
        let report = Store::open(outputs.path()).unwrap().verify(true).unwrap();
        assert!(report.repaired, "{:?}", report.findings);
        let report = Store::open(outputs.path()).unwrap().verify(false).unwrap();
        assert!(report.is_clean(), "{:?}", report.findings);
        run(&Store::open(outputs.path()).unwrap(), 2);
    }
}
