//! Released blobs: digests stay, bytes go, and come again when somebody makes them.

use super::*;

/// Records of released blobs are hits, in this process and the next ones; what is made again is there.
#[test]
fn what_was_released_is_a_hit_without_bytes() {
    let outputs = folder();
    let store = Store::open(outputs.path()).unwrap();
    let blobs: Vec<Blob> = (0..6).map(|i| publish(&store, i, &artifact(i)).unwrap()).collect();
    assert!(!store.has_released());
    store.release(&blobs[..4]).unwrap();
    let look = |store: &Store, when: &str| {
        for (i, blob) in blobs.iter().enumerate() {
            let released = i < 4;
            assert!(store.record(&key(i as u64)).is_some(), "{when}: {i}");
            assert_eq!(store.is_released(blob), released, "{when}: {i}");
            assert_eq!(store.get(blob).is_err(), released, "{when}: {i}");
        }
        let report = store.verify(false).unwrap();
        assert!(report.is_clean() && report.released == 4, "{when}: {report:?}");
        assert_eq!((store.stat().unwrap().released_blobs, store.digests().len()), (4, 2), "{when}");
    };
    look(&store, "at once");
    drop(store);
    look(&Store::open_read_only(outputs.path()).unwrap(), "with the index");
    fs::remove_dir_all(outputs.path().join("store/index")).unwrap();
    let store = Store::open(outputs.path()).unwrap();
    look(&store, "without the index");
    store.gather_packs(&BTreeSet::new()).unwrap();
    look(&store, "after the packs were rewritten");
    let report = store.gc(u64::MAX, &[]).unwrap();
    assert_eq!(report.records_kept, 6);
    look(&store, "after gc");
    drop(store);
    let store = Store::open(outputs.path()).unwrap();
    look(&store, "and in the next process");
    for i in 0..4 {
        assert_eq!(publish(&store, i, &artifact(i)).unwrap(), blobs[i as usize]);
    }
    drop(store);
    let store = Store::open(outputs.path()).unwrap();
    assert!(blobs.iter().all(|blob| !store.is_released(blob) && store.get(blob).is_ok()));
    assert_eq!(store.verify(true).unwrap().released, 0);
}

/// Packs of which most is dead are rewritten by whoever ends a run.
#[test]
fn room_comes_back() {
    let outputs = folder();
    let store = Store::open(outputs.path()).unwrap();
    // 48 kB each: in packs, 24 MB in all.
    let stack = |i: usize| {
        let mut stack = ImageStack::new(96, 128);
        let data = Array2::from_shape_fn((96, 128), |(row, column)| (i * 96 * 128 + row * 128 + column) as f32);
        stack.push(LayerInfo::value("radiance", "W mm^-2 sr^-1"), data);
        Artifact::Images(stack)
    };
    let blobs: Vec<Blob> = (0..500).map(|i| publish(&store, i as u64, &stack(i)).unwrap()).collect();
    let before = store.stat().unwrap().pack_bytes;
    store.settle().unwrap();
    assert_eq!(store.stat().unwrap().pack_bytes, before, "all is in use");
    store.release(&blobs[..450]).unwrap();
    store.settle().unwrap();
    let after = store.stat().unwrap().pack_bytes;
    assert!(after < before / 8, "{after} of {before} bytes");
    assert!((0..500).all(|i| store.record(&key(i)).is_some()));
    assert!(blobs[450..].iter().all(|blob| store.get(blob).is_ok()));
}

/// Killed after any number of bytes of a release, nothing is lost: what is not released is there, and the next release goes on.
#[test]
fn a_full_disk_while_releasing_loses_nothing() {
    for room in [0, 1, 50, 87, 88, 100, 200, 10_000] {
        let outputs = folder();
        let store = Store::open(outputs.path()).unwrap();
        let blobs: Vec<Blob> = (0..6).map(|i| publish(&store, i, &artifact(i)).unwrap()).collect();
        disk::quota::set(Some(room));
        let done = store.release(&blobs);
        disk::quota::set(None);
        assert_eq!(done.is_ok(), room == 10_000 || room > 88 + 6 * 32, "room for {room} bytes");
        drop(store);
        let store = Store::open(outputs.path()).unwrap();
        for (i, blob) in blobs.iter().enumerate() {
            assert!(store.record(&key(i as u64)).is_some() && (store.is_released(blob) || store.get(blob).is_ok()));
        }
        store.release(&blobs).unwrap();
        assert!(blobs.iter().all(|blob| store.is_released(blob)) && store.verify(false).unwrap().is_clean());
    }
}

/// Blobs count as named by all records, those of other processes too, each once.
#[test]
fn names_are_counted_once() {
    let outputs = folder();
    let (store, other) = (Store::open(outputs.path()).unwrap(), Store::open(outputs.path()).unwrap());
    let shared = publish(&store, 0, &small(0)).unwrap();
    let mut names = Names::default();
    store.count_names(&mut names).unwrap();
    store.count_names(&mut names).unwrap();
    assert_eq!(names.of(&shared), 1);
    publish(&other, 1, &small(0)).unwrap();
    // Published again: the same record.
    publish(&store, 0, &small(0)).unwrap();
    store.count_names(&mut names).unwrap();
    assert_eq!(names.of(&shared), 2);
}
