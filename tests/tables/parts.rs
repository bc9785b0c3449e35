//! Data sets and studies in shards: the samples and points are made by many processes, and one command finds them.

use serde_json::Value;

use crate::space::{Ended, PIPELINE, Space};

fn last(ended: &Ended) -> Value {
    let text = ended.ok();
    let last: Value =
        serde_json::from_str(text.lines().last().expect("it says how it ended")).expect("events are JSON");
    assert_eq!(last["event"], "finished", "{text}");
    last
}

/// Shards of all samples side by side, then the build: it computes nothing, and the folder is that of one process.
#[test]
fn samples_are_made_in_shards() {
    let (whole, space) = (Space::with(PIPELINE), Space::with(PIPELINE));
    let built = whole.build("set", &[]);
    let shard = |k: usize| space.begin(&["run", "p.yaml", "spots", "--json", "-j1", "--shard", &format!("{k}/3")]);
    let shards: Vec<Value> = (1..=3).map(shard).collect::<Vec<_>>().into_iter().map(|shard| shard.finished()).collect();
    assert!(shards.iter().enumerate().all(|(at, shard)| shard["shard"]["shard"] == at + 1 && shard["left"] == 0));
    let sum = |name: &str| shards.iter().map(|shard| shard[name].as_u64().expect("a count")).sum::<u64>();
    assert_eq!((&built["ran"], &built["samples"]), (&sum("ran").into(), &sum("samples").into()));
    assert!(!space.path("set").exists() && !space.path("outputs/datasets").exists());
    let again = space.build("set", &[]);
    assert_eq!((&again["ran"], &again["samples"]), (&0.into(), &built["samples"]));
    assert_eq!(space.shards("set"), whole.shards("set"));
    let empty = last(&space.turbid(&["run", "p.yaml", "spots", "--json", "--shard", "1/1000"]));
    assert_eq!(empty["ran"], 0);
    space.turbid(&["run", "p.yaml", "spots", "--only", "frames"]).fails(2);
}

/// The points of a study in shards, then the study.
#[test]
fn points_are_made_in_shards() {
    let studies = "studies:\n  paths:\n    vary: {stages.frames.with.samples: [16, 24, 32, 48]}\n    estimate: maps.modulation.m_ac\n    error: masked_percent\n";
    let space = Space::with(&(PIPELINE.replace("n: 16}", "n: 2}") + studies));
    let made: Vec<Value> = (1..=2)
        .map(|k| last(&space.turbid(&["run", "p.yaml", "paths", "--json", "--shard", &format!("{k}/2")])))
        .collect();
    assert!(made.iter().all(|shard| shard["points"] == 2 && shard["ran"].as_u64() > Some(0)));
    assert!(!space.path("outputs/latest").exists());
    let study = last(&space.turbid(&["study", "p.yaml", "paths", "--json"]));
    assert_eq!((&study["points"], &study["failed"], &study["ran"]), (&4.into(), &0.into(), &0.into()));
}
