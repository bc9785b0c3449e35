//! What `gc` removes and keeps.

use super::*;

#[test]
fn gc_takes_the_least_recently_used_first_and_roots_last() {
    let outputs = folder();
    old_pack(outputs.path(), 30, 0..4);
    old_pack(outputs.path(), 20, 4..8);
    old_pack(outputs.path(), 10, 8..12);
    let here = |store: &Store| (0..12).filter(|&i| store.record(&key(i)).is_some()).collect::<Vec<u64>>();
    let room = |records: u64| {
        records * (record(11, &[]).encode(&recipe(11)).unwrap().len() as u64 + frame::HEADER as u64) + 200
    };
    let store = Store::open(outputs.path()).unwrap();
    // A look-up is a use, noted when the run ends.
    assert!(store.record(&key(1)).is_some());
    store.finish().unwrap();
    drop(store);
    let store = Store::open(outputs.path()).unwrap();
    let report = store.gc(room(8), &[key(0), key(99)]).unwrap();
    assert_eq!((report.records_kept, report.records_removed, report.roots_removed), (8, 4, 0));
    assert_eq!(here(&store), [0, 1, 6, 7, 8, 9, 10, 11], "root 0, used 1, then the youngest");
    assert!(report.bytes_after < report.bytes_before);
    drop(store);
    let store = Store::open(outputs.path()).unwrap();
    assert_eq!(here(&store).len(), 8);
    let report = store.gc(room(1), &[key(0), key(11)]).unwrap();
    assert_eq!((report.records_kept, report.roots_removed), (1, 1), "the limit forces it");
    assert_eq!(here(&store), [11]);
    assert_eq!(store.gc(0, &[key(11)]).unwrap().records_kept, 0);
    assert_eq!(store.stat().unwrap().records, 0);
}

#[test]
fn gc_removes_what_nobody_names_and_keeps_the_rest_whole() {
    let (outputs, digests) = filled(6);
    let store = Store::open(outputs.path()).unwrap();
    let orphans = [store.put(&small(100)).unwrap(), store.put(&large(101)).unwrap()];
    store.checkpoint(&key(0), 1, &[0; 1000]).unwrap();
    let report = store.gc(u64::MAX, &[]).unwrap();
    assert_eq!((report.records_kept, report.records_removed, report.checkpoints_removed), (6, 0, 0));
    for orphan in orphans {
        assert!(matches!(store.get(&orphan), Err(StoreError::Missing { .. })));
    }
    assert_eq!(store.digests(), digests);
    assert_eq!(store.resume(&key(0), 1).map(|(_, state)| state.len()), Some(1000));
    assert_eq!(run(&store, 6), 6);
    let limit = 2 * (64 << 10) + 30_000;
    let report = store.gc(limit, &[]).unwrap();
    assert!(
        report.records_removed > 0 && store.stat().unwrap().loose_bytes + store.stat().unwrap().pack_bytes <= limit,
        "{report:?}"
    );
    drop(store);
    assert_heals(outputs.path(), 6, &digests, "after gc");
}

#[test]
fn gc_waits_for_nobody_and_disturbs_nobody() {
    let (outputs, _) = filled(4);
    let (collector, bystander) = (Store::open(outputs.path()).unwrap(), Store::open(outputs.path()).unwrap());
    let user = Store::open(outputs.path()).unwrap();
    let blob = user.record(&key(0)).unwrap().ports["out"].blob;
    user.get(&blob).unwrap();
    assert!(matches!(collector.gc(0, &[]), Err(StoreError::Busy { .. })));
    drop(user);
    collector.gc(0, &[]).unwrap();
    // This one has opened before the gc, and comes to work after it.
    assert_eq!(run(&bystander, 4), 0);
    assert_eq!(run(&collector, 4), 4);
}

/// On a network file system short packs are not gathered and nothing is removed, unless somebody says that no other machine is at
/// work; a shard gathers nothing anywhere, and takes over no pack.
#[test]
fn where_others_may_be_at_work_nothing_is_removed() {
    let outputs = folder();
    for i in 0..70 {
        old_pack(outputs.path(), i, i..i + 1);
    }
    network::fake::set(Some("NFS"));
    let store = Store::open(outputs.path()).unwrap();
    store.finish().unwrap();
    assert_eq!(store.stat().unwrap().packs, 70);
    let refused = store.gc(u64::MAX, &[]).unwrap_err();
    assert!(matches!(refused, StoreError::OtherMachines { kind: "NFS", .. }), "{refused}");
    drop(store);
    let shard = Store::open_for_shard(outputs.path()).unwrap();
    publish(&shard, 70, &small(70)).unwrap();
    drop(shard);
    network::fake::set(None);
    let shard = Store::open_for_shard(outputs.path()).unwrap();
    publish(&shard, 71, &small(71)).unwrap();
    drop(shard);
    network::fake::set(Some("NFS"));
    let store = Store::open(outputs.path()).unwrap().without_other_machines();
    assert_eq!(store.stat().unwrap().packs, 72);
    store.gc(u64::MAX, &[]).unwrap();
    network::fake::set(None);
    assert_eq!(store.stat().unwrap().packs, 1);
    assert!((0..72).all(|i| store.record(&key(i)).is_some()));
}
