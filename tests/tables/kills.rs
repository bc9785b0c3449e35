//! Builds that are killed, and builds side by side.

use std::time::Duration;

use crate::space::{PIPELINE, Space};

/// Killed at moments spread over the build: the next one goes on, and ends with the same shards.
#[test]
fn killed_builds_go_on() {
    let whole = Space::with(PIPELINE);
    whole.build("set", &[]);
    let space = Space::with(PIPELINE);
    for round in 0..10_u64 {
        let mut child = space.start(&["dataset", "build", "p.yaml", "--to", "set"]);
        std::thread::sleep(Duration::from_millis(3 + 23 * round));
        // It may have ended already; then there is nothing to kill.
        let _ = child.kill();
        child.wait().expect("it was started");
    }
    space.build("set", &[]);
    assert_eq!(space.shards("set"), whole.shards("set"));
    space.verify("set").ok();
    let left = std::fs::read_dir(space.path("set")).expect("it is there").flatten();
    let left: Vec<_> =
        left.map(|e| e.file_name().to_string_lossy().into_owned()).filter(|n| n.contains("writing")).collect();
    assert_eq!(left, [""; 0], "nothing half-written is left");
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
    let mut others: Vec<_> =
        ["a", "b"].iter().map(|to| space.start(&["dataset", "build", "p.yaml", "--to", to])).collect();
    for other in &mut others {
        assert!(other.wait().expect("it was started").success());
    }
    assert_eq!(space.shards("a"), space.shards("b"));
    space.verify("a").ok();
    space.verify("b").ok();

    let lock = std::fs::File::open(space.path("a/.turbid-lock")).expect("builders lock their folder");
    lock.lock().expect("nobody builds any more");
    let said = space.turbid(&["dataset", "build", "p.yaml", "--to", "a"]).fails(2);
    assert!(said.contains("is being built by another turbid"), "{said}");
    drop(lock);
    space.build("a", &[]);
}
