//! Threads and runs that share a store.

use super::*;

/// Two stores in different threads work on the same instances, as two runs would.
#[test]
fn two_runs_at_once_share_the_work() {
    let (_one, digests) = filled(24);
    let outputs = folder();
    std::thread::scope(|scope| {
        for reverse in [false, true] {
            let path = outputs.path();
            scope.spawn(move || {
                let store = Store::open(path).unwrap();
                for step in 0..24 {
                    let i = if reverse { 23 - step } else { step };
                    let _lock = store.lock(&key(i), &|| false).unwrap();
                    match store.record(&key(i)) {
                        Some(record) => assert_eq!(store.get(&record.ports["out"].blob).unwrap(), artifact(i)),
                        None => drop(publish(&store, i, &artifact(i)).unwrap()),
                    }
                }
            });
        }
    });
    assert_heals(outputs.path(), 24, &digests, "two runs");
    let stat = Store::open(outputs.path()).unwrap().stat().unwrap();
    assert_eq!((stat.records, stat.packed_blobs, stat.loose_blobs), (24, 12, 12));
    assert!(stat.packs <= 2, "{stat:?}");
}

/// Runs that follow each other append to the same pack.
#[test]
fn packs_do_not_multiply() {
    let outputs = folder();
    for i in 0..10 {
        publish(&Store::open(outputs.path()).unwrap(), i, &small(i)).unwrap();
    }
    let store = Store::open(outputs.path()).unwrap();
    assert_eq!((store.stat().unwrap().packs, store.stat().unwrap().records), (1, 10));
}

/// Many short packs (of machines, of boots) become few when a run ends.
#[test]
fn short_packs_are_gathered() {
    let outputs = folder();
    for i in 0..70 {
        old_pack(outputs.path(), i, i..i + 1);
    }
    let store = Store::open(outputs.path()).unwrap();
    assert_eq!(store.stat().unwrap().packs, 70);
    store.finish().unwrap();
    assert_eq!(store.stat().unwrap().packs, 1);
    assert_eq!((0..70).filter(|&i| store.record(&key(i)).is_some()).count(), 70);
    drop(store);
    assert_eq!(Store::open_read_only(outputs.path()).unwrap().records().count(), 70);
}

/// All threads of a run use one store.
#[test]
fn threads_share_a_store() {
    let outputs = folder();
    let store = Store::open(outputs.path()).unwrap();
    std::thread::scope(|scope| {
        for thread in 0..4 {
            let store = &store;
            scope.spawn(move || {
                for i in 0..25 {
                    let i = 100 * thread + i;
                    let _lock = store.lock(&key(i), &|| false).unwrap();
                    let blob = publish(store, i, &small(i)).unwrap();
                    assert_eq!(store.get(&blob).unwrap(), small(i));
                    assert!(store.record(&key(i)).is_some());
                }
            });
        }
    });
    assert_eq!(store.records().count(), 100);
}
