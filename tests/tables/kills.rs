//! Builds that are killed, and builds side by side.
//!
//! `TURBID_KILLS=1000 cargo test -p turbid-tables-tests -- --nocapture killed_builds` kills as often and says what it cost.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::time::{Duration, Instant, SystemTime};

use serde_json::Value;

use crate::space::{PIPELINE, Space};

const BUILD: [&str; 9] = ["dataset", "build", "p.yaml", "--to", "set", "--set", "vars.n=64", "--json", "-j2"];

/// Instances that a build said to have finished.
fn finished(space: &Space) -> Vec<String> {
    let text = fs::read_to_string(space.path("log")).expect("the build wrote it");
    let events = text.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
    let ran = events.filter(|event| event["event"] == "ran");
    ran.map(|event| event["instance"].as_str().expect("it has a name").to_owned()).collect()
}

/// A sample by the name of one of its instances, `frames[draw=12]`.
fn sample(instance: &str) -> &str {
    instance.split_once('[').map_or(instance, |(_, axes)| axes)
}

/// Killed at random moments again and again: each build goes on where the last one was, all end with the same shards, and of what was finished
/// nothing is computed twice but the samples that were in work.
#[test]
fn killed_builds_go_on() {
    let kills: usize = std::env::var("TURBID_KILLS").map_or(8, |text| text.parse().expect("a number of kills"));
    let whole = Space::with(PIPELINE);
    let began = Instant::now();
    let built: Value = serde_json::from_str(whole.turbid(&BUILD).ok().lines().last().expect("it ended")).expect("JSON");
    let length = began.elapsed();
    let instances = built["ran"].as_u64().expect("a number");
    let mut random: u64 = 1;
    let (mut killed, mut builds, mut lost, mut most_lost) = (0, 0, 0, 0);
    while killed < kills {
        let space = Space::with(PIPELINE);
        let mut known: BTreeSet<String> = BTreeSet::new();
        loop {
            let mut child = space.start_to(&BUILD, "log");
            if killed < kills {
                // Knuth's MMIX generator.
                random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                std::thread::sleep(length.mul_f64(0.6 * (random >> 11) as f64 / (1_u64 << 53) as f64));
                // It may have ended already; then there is nothing to kill.
                let _ = child.kill();
            }
            let ended = child.wait().expect("it was started");
            let ran = finished(&space);
            let again: BTreeSet<&str> =
                ran.iter().filter(|name| known.contains(*name)).map(|name| sample(name)).collect();
            lost += again.len();
            most_lost = most_lost.max(again.len());
            known.extend(ran);
            if ended.success() {
                break;
            }
            killed += 1;
        }
        builds += 1;
        assert_eq!(space.shards("set"), whole.shards("set"));
        space.verify("set").ok();
        let left = fs::read_dir(space.path("set")).expect("it is there").flatten();
        let left: Vec<_> =
            left.map(|e| e.file_name().to_string_lossy().into_owned()).filter(|n| n.contains("writing")).collect();
        assert_eq!(left, [""; 0], "nothing half-written is left");
    }
    println!(
        "{killed} kills of {builds} builds of {instances} instances in {:.2} s; {lost} samples computed again, at most {most_lost} after a kill",
        length.as_secs_f64()
    );
    // Two threads, each with a sample.
    assert!(most_lost <= 2, "{most_lost} samples were finished and computed again after one kill");
}

/// Killed while a set grows: shards that were full are kept as they are, under the names that they have among more.
#[test]
fn killed_growth_keeps_full_shards() {
    let written = |space: &Space| -> BTreeMap<String, SystemTime> {
        let at = |file: &str| fs::metadata(space.path("set").join(file)).and_then(|m| m.modified()).expect("a time");
        space
            .shards("set")
            .into_iter()
            .filter(|(_, _, rows)| *rows == 4)
            .map(|(f, sha256, _)| (sha256, at(&f)))
            .collect()
    };
    for store in ["keep", "shards_only"] {
        let space = Space::with(&PIPELINE.replace("    far:", &format!("    store: {store}\n    far:")));
        space.build("set", &[]);
        let before = written(&space);
        assert!(before.len() >= 2);
        for round in 0..8_u64 {
            let mut child = space.start(&["dataset", "build", "p.yaml", "--to", "set", "--set", "vars.n=48"]);
            std::thread::sleep(Duration::from_millis(5 + 17 * round));
            let _ = child.kill();
            child.wait().expect("it was started");
        }
        space.build("set", &["--set", "vars.n=48"]);
        let after = written(&space);
        for (sha256, time) in &before {
            assert_eq!(after.get(sha256), Some(time), "{store}: written again");
        }
        let whole = Space::with(PIPELINE);
        whole.build("set", &["--set", "vars.n=48"]);
        assert_eq!(space.shards("set"), whole.shards("set"));
        space.verify("set").ok();
    }
}

/// A killed build says that it has not ended.
#[test]
fn a_build_that_has_not_ended_is_told() {
    let space = Space::with(PIPELINE);
    // Four samples of sixteen.
    space.build("set", &[]);
    let mut manifest = space.manifest("set");
    manifest["files"] = serde_json::json!({});
    space.write("set/dataset.json", manifest.to_string());
    let said = space.verify("set").fails(1);
    assert!(said.contains("has not ended") && said.contains("turbid dataset build"), "{said}");
    let said = space.turbid(&["dataset", "stats", "p.yaml", "--to", "set"]).fails(2);
    assert!(said.contains("has not ended"), "{said}");
}

/// Two builders on one store make the same shards; of two in one folder one is told to wait.
#[test]
fn two_builders_at_once() {
    let space = Space::with(PIPELINE);
    let others: Vec<_> = ["a", "b"].map(|to| space.begin(&["dataset", "build", "p.yaml", "--to", to, "--json"])).into();
    let ended: Vec<Value> = others.into_iter().map(|other| other.finished()).collect();
    assert_eq!(space.shards("a"), space.shards("b"));
    let ran: u64 = ended.iter().map(|ended| ended["ran"].as_u64().expect("a number")).sum();
    assert_eq!(Some(ran), ended[0]["samples"].as_u64().map(|n| 3 * n), "each sample once, by either: {ended:?}");
    space.verify("a").ok();
    space.verify("b").ok();

    let lock = fs::File::open(space.path("a/.turbid-lock")).expect("builders lock their folder");
    lock.lock().expect("nobody builds any more");
    let said = space.turbid(&["dataset", "build", "p.yaml", "--to", "a"]).fails(2);
    assert!(said.contains("is being built by another turbid"), "{said}");
    drop(lock);
    space.build("a", &[]);
}
