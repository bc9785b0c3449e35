//! Earlier results by label and by work.

use super::*;

fn of(i: u64, stage: &str, axes: &Axes, state: Option<u64>) -> InstanceRecord {
    let mut record = record(i, &[]);
    record.provenance.stage = stage.to_owned();
    record.provenance.axes = axes.clone();
    record.state_key = state.map(key);
    record
}

fn found(store: &Store, stage: &str, axes: &Axes) -> Option<Digest> {
    let label = Label { use_name: "scene", pipeline: "p", stage, axes };
    store.latest_of(&label).map(|(record, _)| record.key)
}

/// The latest of a label holds, by the value of its axes; what was forgotten or has gone over to another label is none of it.
#[test]
fn the_latest_result_of_a_label_is_found() {
    let outputs = folder();
    let store = Store::open(outputs.path()).unwrap();
    let axes = |value| Axes::from([("mu_a".to_owned(), value), ("kind".to_owned(), json!("skin"))]);
    let (one, two) = (axes(json!(1)), axes(json!(2.5)));
    for (i, stage, axes, state) in [
        (0, "tissue", &one, Some(50)),
        (1, "tissue", &one, Some(50)),
        (2, "tissue", &two, None),
        (3, "sky", &one, None),
    ] {
        store.publish(&of(i, stage, axes, state), &recipe(i)).unwrap();
    }
    let look = |store: &Store, when: &str| {
        assert_eq!(found(store, "tissue", &one), Some(key(1)), "{when}");
        assert_eq!(found(store, "tissue", &axes(json!(1.0))), Some(key(1)), "{when}");
        assert_eq!(found(store, "tissue", &two), Some(key(2)), "{when}");
        assert_eq!(found(store, "sky", &two), None, "{when}");
        assert_eq!(found(store, "tissue", &Axes::new()), None, "{when}");
        assert_eq!(
            store.latest_of_work(&key(50)).map(|(record, recipe)| (record.key, recipe)),
            Some((key(1), recipe(1)))
        );
        assert_eq!(store.latest_of_work(&key(51)), None, "{when}");
        assert!(store.knows("scene") && !store.knows("frames"), "{when}");
        let latest: Vec<Digest> = store.latest_records(3).map(|(record, _)| record.key).collect();
        assert_eq!(latest, [3, 2, 1].map(key), "{when}");
        assert_eq!(store.latest_records(usize::MAX).count(), 4, "{when}");
    };
    look(&store, "at once");
    drop(store);
    look(&Store::open_read_only(outputs.path()).unwrap(), "with the index");
    fs::remove_dir_all(outputs.path().join("store/index")).unwrap();
    let store = Store::open(outputs.path()).unwrap();
    look(&store, "without the index");
    store.gather_packs(&BTreeSet::new()).unwrap();
    look(&store, "after the packs were rewritten");
    drop(store);
    let store = Store::open(outputs.path()).unwrap();
    look(&store, "and in the next process");
    store.folder.packs.append(frame::Kind::ForgetRecord, &key(1), &[]).unwrap();
    assert_eq!(found(&store, "tissue", &one), None);
    store.publish(&of(2, "moon", &two, None), &recipe(2)).unwrap();
    assert_eq!((found(&store, "tissue", &two), found(&store, "moon", &two)), (None, Some(key(2))));
    store.gc(u64::MAX, &[]).unwrap();
    assert_eq!(found(&store, "tissue", &one), Some(key(0)), "gc looks at what is left");
}
