//! Data sets and studies handed over to an engine: scripts stand for Slurm.

use std::fs;
use std::os::unix::fs::PermissionsExt;

use serde_json::Value;

use crate::space::{PIPELINE, Space};

const SCRIPTS: [(&str, &str); 4] = [
    ("tasks.sh", include_str!("../all/submit/tasks.sh")),
    ("sbatch", include_str!("../all/submit/sbatch")),
    ("squeue", include_str!("../all/submit/squeue")),
    ("sacct", include_str!("../all/submit/sacct")),
];

/// Submits targets of `p.yaml` in three tasks, and follows them; its events.
fn submitted(space: &Space, target: &str) -> Vec<Value> {
    let bin = space.path("fake/bin");
    fs::create_dir_all(&bin).expect("the folder is ours");
    for (name, script) in SCRIPTS {
        fs::write(bin.join(name), script).expect("the folder is ours");
        fs::set_permissions(bin.join(name), fs::Permissions::from_mode(0o755)).expect("the file is ours");
    }
    let words =
        ["submit", "p.yaml", target, "--engine", "slurm", "--shards", "3", "--task-seconds", "0", "--follow", "--json"];
    let path = format!("{}:{}", bin.display(), std::env::var("PATH").expect("there is a PATH"));
    let output = space.command(&words).env("PATH", path).env("FAKE", space.path("fake")).output();
    let output = output.expect("the program starts");
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(output.status.code(), Some(0), "{said}\n{}", String::from_utf8_lossy(&output.stderr));
    said.lines().map(|line| serde_json::from_str(line).expect("an event")).collect()
}

/// All of a data set, and of a study, is made by tasks, each part in one of them; what is made of it here computes nothing.
#[test]
fn data_sets_and_studies_are_submitted() {
    let studies = "studies:\n  paths:\n    vary: {stages.frames.with.samples: [24, 32, 48]}\n    estimate: maps.modulation.m_ac\n    error: masked_percent\n";
    let space = Space::with(&(PIPELINE.to_owned() + studies));
    for target in ["spots", "paths"] {
        let events = submitted(&space, target);
        let tasks: Vec<&Value> = events.iter().filter(|event| event["event"] == "submitted").collect();
        assert_eq!(tasks.len(), 1, "{target}: {events:?}");
        assert_eq!(tasks[0]["shards"], Value::from(vec![1, 2, 3]), "{target}");
        let last = events.last().expect("there are events");
        assert_eq!((&last["event"], &last["ran"]), (&"finished".into(), &0.into()), "{target}: {last}");
    }
    assert!(space.path("outputs/datasets/drawn/spots/index.parquet").exists());
    assert!(space.path("outputs/latest/drawn/studies/paths/study.parquet").exists());
    let again = submitted(&space, "spots");
    assert!(again.iter().all(|event| event["event"] != "submitted"), "{again:?}");
}
