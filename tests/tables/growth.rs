//! A build, the same again, and one of more points.

use std::collections::BTreeMap;
use std::fs;
use std::time::SystemTime;

use serde_json::Value;

use crate::space::{PIPELINE, Space};

fn written(space: &Space, to: &str) -> BTreeMap<String, SystemTime> {
    let mut times = BTreeMap::new();
    for folder in ["", "data"] {
        for entry in fs::read_dir(space.path(to).join(folder)).expect("it is there").flatten() {
            let meta = entry.metadata().expect("it is there");
            if meta.is_file() {
                times.insert(
                    format!("{folder}/{}", entry.file_name().to_string_lossy()),
                    meta.modified().expect("a time"),
                );
            }
        }
    }
    times
}

/// A second build finds everything; one of more points keeps full shards byte by byte, and samples of the first are not computed again.
#[test]
fn a_data_set_is_kept_and_grows() {
    let space = Space::with(PIPELINE);
    let planned = space.turbid(&["dataset", "plan", "p.yaml", "--json"]).ok();
    let planned: Value = serde_json::from_str(&planned).expect("it is JSON");
    let first = space.build("set", &[]);
    assert_eq!(planned["points"], first["samples"], "without `keep` every point is a sample: {planned}");
    let samples = first["samples"].as_u64().expect("a number");
    let left_out: u64 = first["rejects"].as_object().expect("a map").values().filter_map(|n| n.as_u64()).sum();
    assert_eq!(samples + left_out, 16, "every point is a sample or left out for a reason: {first}");
    let said = space.verify("set").ok();
    assert!(said.contains(&format!("{samples} samples as they should be")), "{said}");
    let names = ["README.md", "croissant.json", "dataset.json", "index.parquet", "costs.parquet", "statistics.parquet"];
    for name in names.into_iter().chain(["overview.png"]) {
        assert!(space.path("set").join(name).is_file(), "{name}");
    }
    let (before, shards) = (written(&space, "set"), space.shards("set"));
    described(&space, &shards);

    let second = space.build("set", &[]);
    assert_eq!((second["ran"].as_u64(), &second["samples"]), (Some(0), &first["samples"]), "{second}");
    assert_eq!(written(&space, "set"), before, "nothing is written twice");

    let more = space.build("set", &["--set", "vars.n=32"]);
    assert_eq!(more["ran"].as_u64(), Some(3 * (more["samples"].as_u64().expect("a number") - samples)), "{more}");
    let grown = space.shards("set");
    let place = |file: &str| file.rsplit_once("-of-").expect("NAME-00000-of-00001").0.to_owned();
    let grown: BTreeMap<String, &String> = grown.iter().map(|(file, sha256, _)| (place(file), sha256)).collect();
    let full: Vec<_> = shards.iter().filter(|(_, _, rows)| *rows == 4).collect();
    assert!(full.len() >= 2, "{shards:?}");
    for (file, sha256, _) in full {
        assert_eq!(grown[&place(file)], sha256, "{file}");
    }
    space.verify("set").ok();
}

/// `croissant.json` has every shard with its digest, and sets of files that are looked for beside it.
fn described(space: &Space, shards: &[(String, String, u64)]) {
    let text = fs::read_to_string(space.path("set/croissant.json")).expect("the build wrote it");
    let document: Value = serde_json::from_str(&text).expect("it is JSON");
    let files = document["distribution"].as_array().expect("a list");
    for (file, sha256, _) in shards {
        let found = files.iter().find(|of| of["contentUrl"] == file.as_str()).expect("every shard is described");
        assert_eq!(found["sha256"], sha256.as_str());
        let of = |pattern: &Value| {
            pattern.as_str().and_then(|p| p.strip_suffix("*.parquet")).is_some_and(|p| file.starts_with(p))
        };
        let sets: Vec<_> = files.iter().filter(|set| of(&set["includes"])).collect();
        assert!(sets.len() == 1 && sets[0].get("containedIn").is_none(), "{file}: {sets:?}");
    }
}

/// A folder made by another way in another order of builds is the same but for times.
#[test]
fn a_grown_set_is_that_of_one_build() {
    let space = Space::with(PIPELINE);
    space.build("grown", &["--set", "vars.n=8"]);
    space.build("grown", &[]);
    space.build("at_once", &[]);
    assert_eq!(space.shards("grown"), space.shards("at_once"));
    for name in ["README.md", "croissant.json", "dataset.json", "index.parquet", "statistics.parquet", "overview.png"] {
        let read = |to: &str| fs::read(space.path(to).join(name)).expect("the build wrote it");
        assert!(read("grown") == read("at_once"), "{name}");
    }
}

/// A data set is a target of `run` too: the same shards, in the folder of outputs, and stages beside it run as always.
#[test]
fn a_data_set_is_a_target_of_run() {
    let space = Space::with(&PIPELINE.replace("vars: {n: 16}", "vars: {n: 4}"));
    let said = space.turbid(&["run", "p.yaml", "spots", "maps"]).ok();
    assert!(said.contains("samples in outputs/datasets"), "{said}");
    assert!(said.lines().any(|line| line.starts_with("maps")), "{said}");
    let folder = "outputs/datasets/drawn/spots";
    drop(space.build("set", &[]));
    assert_eq!(space.shards(folder), space.shards("set"));
    space.verify(folder).ok();
    assert!(space.turbid(&["run", "p.yaml", "spot"]).fails(2).contains("there is no stage `spot`"));
}
