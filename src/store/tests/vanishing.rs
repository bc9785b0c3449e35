//! Packs, locks and whole folders that vanish or change under a process: nothing fails, and nothing is called stored that is not.

use super::*;

fn packs(outputs: &TempDir) -> PathBuf {
    outputs.path().join("store/packs")
}

/// Takes something away from a store in use.
type Loss = fn(&Path);

const LOSSES: [(&str, Loss); 7] = [
    ("the packs", |store| files(&store.join("packs")).iter().for_each(|pack| fs::remove_file(pack).unwrap())),
    ("the folder of packs", |store| fs::remove_dir_all(store.join("packs")).unwrap()),
    ("the locks", |store| fs::remove_dir_all(store.join("locks")).unwrap()),
    ("the index", |store| drop(fs::remove_dir_all(store.join("index")))),
    ("everything", |store| fs::remove_dir_all(store).unwrap()),
    ("the packs, for empty ones", |store| {
        for pack in files(&store.join("packs")) {
            fs::rename(&pack, store.join("taken away")).unwrap();
            fs::write(&pack, "").unwrap();
        }
    }),
    ("the packs, for folders", |store| {
        for pack in files(&store.join("packs")) {
            fs::remove_file(&pack).unwrap();
            fs::create_dir(&pack).unwrap();
        }
    }),
];

/// What a process has written is there at its end, whatever vanished under it, and a process that comes later finds it.
#[test]
fn what_vanishes_under_its_writer_is_written_again() {
    for (case, lose) in LOSSES {
        for at in [1, 3] {
            let outputs = folder();
            let store = Store::open(outputs.path()).unwrap();
            for i in 0..4 {
                let i = 2 * i;
                let _lock = store.lock(&key(i), &|| false).unwrap();
                publish(&store, i, &small(i)).unwrap();
                if i == 2 * at {
                    lose(&outputs.path().join("store"));
                }
            }
            assert!(store.finish().unwrap().dropped.is_empty(), "{case} after {at}");
            drop(store);
            let again = Store::open(outputs.path()).unwrap();
            for i in [0, 2, 4, 6] {
                let record = again.record(&key(i)).unwrap_or_else(|| panic!("{case} after {at}: {i} is gone"));
                assert_eq!(again.get(&record.ports["out"].blob).unwrap(), small(i));
            }
        }
    }
}

/// A pack that is cut short cannot be brought back; `finish` says what was lost with it.
#[test]
fn what_is_cut_off_under_its_writer_is_reported() {
    let outputs = folder();
    let store = Store::open(outputs.path()).unwrap();
    publish(&store, 0, &small(0)).unwrap();
    let pack = files(&packs(&outputs)).remove(0);
    let length = fs::metadata(&pack).unwrap().len();
    publish(&store, 2, &small(2)).unwrap();
    fs::OpenOptions::new().write(true).open(&pack).unwrap().set_len(length + 10).unwrap();
    publish(&store, 4, &small(4)).unwrap();
    assert_eq!(store.finish().unwrap().dropped, BTreeSet::from([key(2)]));
    assert!(store.finish().unwrap().dropped.is_empty(), "each is named once");
    publish(&store, 2, &small(2)).unwrap();
    assert!(store.finish().unwrap().dropped.is_empty());
    drop(store);
    let again = Store::open(outputs.path()).unwrap();
    assert!([0, 2, 4].iter().all(|&i| again.record(&key(i)).is_some()));
}

/// Packs of others that vanish: what this process found in them it can still read, and `finish` says that it is gone.
#[test]
fn what_others_wrote_is_readable_to_the_end_and_reported_as_gone() {
    let (outputs, _) = filled(4);
    let store = Store::open(outputs.path()).unwrap();
    let found: Vec<Blob> = [0, 2].map(|i| store.record(&key(i)).unwrap().ports["out"].blob).to_vec();
    fs::remove_dir_all(packs(&outputs)).unwrap();
    let _lock = store.lock(&key(9), &|| false).unwrap();
    assert!(store.record(&key(0)).is_none(), "it is a miss");
    for (i, blob) in [0, 2].into_iter().zip(&found) {
        assert_eq!(store.get(blob).unwrap(), small(i), "and can be read all the same");
    }
    publish(&store, 9, &small(9)).unwrap();
    assert_eq!(store.finish().unwrap().dropped, BTreeSet::from([key(0), key(2)]));
    drop(store);
    assert_eq!(run(&Store::open(outputs.path()).unwrap(), 4), 0, "records were in the packs");
}

/// A hit whose packed blob is damaged (a look-up asks only its length) is thrown out with the damage, and `finish` says so.
#[test]
fn hits_that_are_thrown_out_are_reported() {
    let (outputs, _) = filled(4);
    let pack = files(&packs(&outputs)).remove(0);
    let mut bytes = fs::read(&pack).unwrap();
    let (at, frame) = *frame::scan(&bytes).frames.iter().find(|(_, f)| f.kind == frame::Kind::Blob).unwrap();
    bytes[at as usize + frame::HEADER + frame.length as usize / 2] ^= 1;
    overwrite(&pack, &bytes);
    let store = Store::open(outputs.path()).unwrap();
    assert!((0..4).all(|i| store.record(&key(i)).is_some()));
    store.folder.packs.note_damage();
    assert_eq!(store.finish().unwrap().dropped, BTreeSet::from([key(0)]));
    publish(&store, 0, &small(0)).unwrap();
    assert!(store.finish().unwrap().dropped.is_empty());
    assert!(store.verify(false).unwrap().is_clean());
}

/// An index that was saved for another pack of the same name is of no use, and is not used.
#[test]
fn an_index_of_another_pack_is_not_believed() {
    let (outputs, _) = filled(2);
    let (other, _) = filled(6);
    let pack = files(&packs(&outputs)).remove(0);
    fs::copy(files(&packs(&other)).remove(0), &pack).unwrap();
    let store = Store::open(outputs.path()).unwrap();
    assert!([0, 2, 4].iter().all(|&i| store.record(&key(i)).is_some()), "all that the pack holds is found");
}

/// Where locks exclude nobody, runs work, gathering is left out and gc refuses.
#[test]
fn without_locks_nothing_is_removed() {
    use lock::fake::{Locks, set};
    for locks in [Locks::None, Locks::Hollow] {
        let (outputs, digests) = filled(6);
        set(locks);
        let store = Store::open(outputs.path()).unwrap();
        assert_eq!(run(&store, 8), 6);
        let other = Store::open(outputs.path()).unwrap();
        publish(&other, 20, &small(20)).unwrap();
        publish(&store, 21, &small(21)).unwrap();
        assert_eq!(files(&packs(&outputs)).len(), 3, "each writer has a pack of its own");
        let refused = store.gc(0, &[]).unwrap_err();
        assert!(matches!(&refused, StoreError::NoLocks { .. }), "{refused}");
        assert!(refused.to_string().contains("delete the whole folder when no run is at work"), "{refused}");
        drop(other);
        // Damage cannot be left behind, and a repair says so.
        let pack = files(&packs(&outputs)).remove(0);
        let mut bytes = fs::read(&pack).unwrap();
        bytes[10] ^= 1;
        overwrite(&pack, &bytes);
        fs::remove_dir_all(outputs.path().join("store/index")).unwrap();
        assert!(matches!(Store::open(outputs.path()).unwrap().verify(true), Err(StoreError::NoLocks { .. })));
        run(&Store::open(outputs.path()).unwrap(), 6);
        set(Locks::Real);
        drop(store);
        let store = Store::open(outputs.path()).unwrap();
        store.verify(true).unwrap();
        assert!(digests.iter().all(|digest| store.digests().contains(digest)));
        assert!(Store::open(outputs.path()).unwrap().verify(false).unwrap().is_clean());
    }
}

/// A thread that panics with a lock of the store stops no other.
#[test]
fn a_panic_stops_only_its_own_thread() {
    let outputs = folder();
    let store = Store::open(outputs.path()).unwrap();
    publish(&store, 0, &small(0)).unwrap();
    std::thread::scope(|scope| {
        let panics = scope.spawn(|| {
            let _key = store.lock(&key(1), &|| false).unwrap();
            let _guards = (guard(&store.folder.packs.writer), store.folder.packs.state_mut(), guard(&store.in_use));
            panic!("as an instance might");
        });
        assert!(panics.join().is_err());
    });
    let _lock = store.lock(&key(1), &|| false).unwrap();
    publish(&store, 1, &small(1)).unwrap();
    assert!(store.finish().unwrap().dropped.is_empty());
    assert!([0, 1].iter().all(|&i| store.record(&key(i)).is_some()));
}

/// Runs side by side while packs, index and locks vanish and gc is asked for: no error, and at the end all is there.
#[test]
fn runs_survive_whatever_is_removed_beside_them() {
    use std::sync::atomic::{AtomicBool, Ordering};
    const N: u64 = 30;
    let outputs = folder();
    let store = outputs.path().join("store");
    let done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            for round in 0.. {
                if done.load(Ordering::Relaxed) {
                    break;
                }
                std::thread::sleep(Duration::from_millis(3));
                match round % 4 {
                    0 => files(&store.join("packs")).iter().for_each(|pack| drop(fs::remove_file(pack))),
                    1 => drop(fs::remove_dir_all(store.join("index"))),
                    2 => drop(fs::remove_dir_all(store.join("locks"))),
                    _ => match Store::open(outputs.path()).and_then(|store| store.gc(1 << 20, &[])) {
                        Ok(_) | Err(StoreError::Busy { .. } | StoreError::NoLocks { .. }) => {}
                        Err(error) => panic!("gc: {error}"),
                    },
                }
            }
        });
        let runs: Vec<_> = (0..2u64)
            .map(|first| {
                let outputs = outputs.path();
                scope.spawn(move || {
                    let store = Store::open(outputs).unwrap();
                    for round in 0..3 {
                        for step in 0..N {
                            let i = 2 * ((step + first * N / 2) % N);
                            let _lock = store.lock(&key(i), &|| false).unwrap();
                            if let Some(record) = store.record(&key(i)) {
                                match store.get(&record.ports["out"].blob) {
                                    Ok(there) => assert_eq!(there, small(i), "a wrong hit"),
                                    Err(error) => assert!(error.is_lost_blob(), "round {round}: {error}"),
                                }
                            } else {
                                publish(&store, i, &small(i)).unwrap();
                            }
                        }
                    }
                    store.finish().unwrap();
                })
            })
            .collect();
        let ended: Vec<_> = runs.into_iter().map(|run| run.join()).collect();
        done.store(true, Ordering::Relaxed);
        assert!(ended.iter().all(Result::is_ok));
    });
    let count = |store: &Store| (0..N).filter(|&i| store.record(&key(2 * i)).is_some()).count() as u64;
    let store = Store::open(outputs.path()).unwrap();
    (0..N)
        .filter(|&i| store.record(&key(2 * i)).is_none())
        .for_each(|i| assert!(publish(&store, 2 * i, &small(2 * i)).is_ok()));
    assert_eq!(count(&store), N);
    drop(store);
    let store = Store::open(outputs.path()).unwrap();
    assert_eq!(count(&store), N);
    store.verify(true).unwrap();
    assert!(store.verify(false).unwrap().is_clean());
}
