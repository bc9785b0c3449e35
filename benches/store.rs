//! What the store costs: look-ups, opening, and the encoding of images. `cargo bench --bench store`
//!
//! `cargo bench --bench store -- size [RECORDS..]` says what look-ups, appending and runs of one instance cost in stores of 1000
//! to a million records ([`store_size`]).
//!
//! CPU time of the calling thread (user and system), the best of several rounds, in a temporary folder; wall time where
//! it says so.

mod store_size;

use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant};

use cpu_time::ThreadTime;
use serde_json::json;
use turbid::digest::Digest;
use turbid::store::{Cost, InstanceRecord, PortRecord, Provenance, Recipe, Store};
use turbid_contract::ndarray::Array2;
use turbid_contract::{Artifact, ImageStack, LayerInfo, Record};

fn key(i: u64) -> Digest {
    Digest::of(&i.to_le_bytes())
}

/// About as long as the params of the paper's scenes.
fn scene(i: u64) -> serde_json::Value {
    json!({
        "media": {"healthy": {"A_rho": 25.0, "S_rho": 4236.0, "g": 0.8, "n": 1.0}, "scc": {"A_rho": i, "S_rho": 3721.0, "g": 0.8, "n": 1.0}},
        "objects": {
            "tissue": {"slab": {"thickness": 2000.0, "top": 0.0}, "medium": "healthy", "priority": 0},
            "polyp": {"spheroid": {"diameters": [40.0, 40.0, 80.0], "center": [0.0, 0.0, 0.0]}, "medium": "scc", "priority": 1}
        },
        "camera": {"position": [0.0, 0.0, 500.0], "look_at": [0.0, 0.0, 0.0], "field": [64.0, 64.0], "pixels": [64, 64]},
        "projector": {"position": [0.0, 35.0, 500.0], "look_at": [0.0, 0.0, 0.0], "field": [128.0, 128.0], "power": 5.0}
    })
}

/// The result of an instance, as small as the scene's.
fn publish(store: &Store, i: u64) {
    let params = scene(i);
    let artifact = Artifact::Record(Record { fields: BTreeMap::from([("scene".to_owned(), params.clone())]) });
    let blob = store.put(&artifact).expect("there is room");
    let record = InstanceRecord {
        key: key(i),
        use_name: "scene".into(),
        version: 1,
        ports: BTreeMap::from([("scene".into(), PortRecord { payload: "scene".into(), blob })]),
        cost: Cost::default(),
        seed: None,
        state_key: None,
        measures: Vec::new(),
        reached: None,
        warnings: Vec::new(),
        kernel: None,
        refused: Vec::new(),
        provenance: Provenance {
            pipeline: "sweep".into(),
            stage: "scene".into(),
            axes: BTreeMap::from([("A_rho".to_owned(), json!(i))]),
            ..Provenance::default()
        },
    };
    store.publish(&record, &Recipe { params, ..Recipe::default() }).expect("there is room");
}

fn fill(outputs: &Path, records: u64) -> Duration {
    let store = Store::open(outputs).expect("a fresh store opens");
    let begin = Instant::now();
    (0..records).for_each(|i| publish(&store, i));
    store.finish().expect("there is room");
    begin.elapsed()
}

fn best(rounds: usize, mut work: impl FnMut()) -> Duration {
    let time = |work: &mut dyn FnMut()| {
        let begin = ThreadTime::now();
        work();
        begin.elapsed()
    };
    (0..rounds).map(|_| time(&mut work)).min().unwrap_or_default()
}

fn main() {
    if store_size::work() {
        return;
    }
    let words: Vec<String> = std::env::args().skip(1).filter(|word| !word.starts_with("--")).collect();
    if words.first().is_some_and(|word| word == "size") {
        let numbers: Vec<u64> = words[1..].iter().filter_map(|word| word.parse().ok()).collect();
        return store_size::table(if numbers.is_empty() { &[1000, 10_000, 100_000, 1_000_000] } else { &numbers });
    }
    for records in [1000, 100_000] {
        let outputs = tempfile::tempdir().expect("a temporary folder");
        let wrote = fill(outputs.path(), records);
        let open = || Store::open(outputs.path()).expect("it opens");
        println!("{records} records: put and publish {:.1} us each (wall)", 1e6 * wrote.as_secs_f64() / records as f64);
        println!("  open: {:.3?}", best(9, || std::mem::forget(open())));
        let store = open();
        let look_up = || (0..1000).for_each(|i| assert!(store.record(&key(i * records / 1000)).is_some()));
        println!("  1000 look-ups: {:.3?}", best(9, look_up));
        // What a look-up is made of.
        let bytes = serde_json::to_vec(&*store.record(&key(0)).expect("it is there")).expect("it came from JSON");
        let parse = || (0..1000).for_each(|_| assert!(serde_json::from_slice::<InstanceRecord>(&bytes).is_ok()));
        println!("    of which parsing {} bytes: {:.3?}", bytes.len(), best(9, parse));
        let hash = || (0..1000).for_each(|_| assert!(Digest::of(std::hint::black_box(&bytes)) != key(0)));
        println!("    of which hashing: {:.3?}", best(9, hash));
        println!("  all digests: {:.3?}", best(3, || assert_eq!(store.digests().len() as u64, records)));
        std::fs::remove_dir_all(outputs.path().join("store/index")).expect("it was written");
        println!("  open without the index: {:.3?}", best(3, || std::mem::forget(open())));
    }

    let outputs = tempfile::tempdir().expect("a temporary folder");
    let store = Store::open(outputs.path()).expect("a fresh store opens");
    let stack = |seed: u64| {
        let mut stack = ImageStack::new(500, 500);
        for layer in 0..16 {
            let pixels = Array2::from_shape_fn((500, 500), |(r, c)| {
                (key(seed ^ (layer << 32 | ((r * 500 + c) as u64 / 4))).first_u64() >> 40) as f32
            });
            stack.push(LayerInfo::value("radiance", "W mm^-2 sr^-1").with_f_x(layer as f64), pixels);
        }
        Artifact::Images(stack)
    };
    let mb = 500.0 * 500.0 * 16.0 * 4.0 / 1e6;
    let stacks: Vec<Artifact> = (0..5).map(stack).collect();
    let rate = |time: Duration| mb / time.as_secs_f64();
    println!("500 x 500 x 16 layers, {mb} MB:");
    println!("  encode: {:.0} MB/s", rate(best(5, || drop(turbid::store::encode(&stacks[0])))));
    let mut next = stacks.iter();
    let begin = Instant::now();
    let put = best(5, || assert!(store.put(next.next().expect("five rounds")).is_ok()));
    println!("  put: {:.0} MB/s, wall with fsync {:.0} MB/s", rate(put), rate(begin.elapsed() / 5));
    let blob = store.put(&stacks[0]).expect("it is there");
    println!("  get: {:.0} MB/s", rate(best(5, || drop(store.get(&blob).expect("it is there")))));
}
