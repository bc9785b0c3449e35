//! A build, the same again, and one of more points.

use std::collections::BTreeMap;
use std::fs;
use std::time::SystemTime;

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
    let first = space.build("set", &[]);
    let samples = first["samples"].as_u64().expect("a number");
    let left_out: u64 = first["rejects"].as_object().expect("a map").values().filter_map(|n| n.as_u64()).sum();
    assert_eq!(samples + left_out, 16, "every point is a sample or left out for a reason: {first}");
    let said = space.verify("set").ok();
    assert!(said.contains(&format!("{samples} samples as they should be")), "{said}");
    for name in ["README.md", "croissant.json", "dataset.json", "index.parquet", "costs.parquet", "statistics.parquet"]
    {
        assert!(space.path("set").join(name).is_file(), "{name}");
    }
    let (before, shards) = (written(&space, "set"), space.shards("set"));

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

/// A folder made by another way in another order of builds is the same but for times.
#[test]
fn a_grown_set_is_that_of_one_build() {
    let space = Space::with(PIPELINE);
    space.build("grown", &["--set", "vars.n=8"]);
    space.build("grown", &[]);
    space.build("at_once", &[]);
    assert_eq!(space.shards("grown"), space.shards("at_once"));
    for name in ["README.md", "croissant.json", "dataset.json", "index.parquet", "statistics.parquet"] {
        let read = |to: &str| fs::read(space.path(to).join(name)).expect("the build wrote it");
        assert!(read("grown") == read("at_once"), "{name}");
    }
}
