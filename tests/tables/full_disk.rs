//! A disk that runs full in the middle of a shard: it is said, with a way out, and the next build goes on.

use std::fs;

use crate::space::{PIPELINE, Space};

/// [`PIPELINE`] with shards of 16 samples of 24 x 24 pixels: longer than all else in the folder.
fn long_shards() -> String {
    PIPELINE.replace("shards: {rows: 4}", "shards: {rows: 16}").replace("pixels: [6, 6]", "pixels: [24, 24]")
}

/// No file may be longer than a limit, which to a program is a full disk. What was there stays, and nothing half-written is left.
#[test]
fn a_shard_that_does_not_fit_is_said_and_healed() {
    for store in ["keep", "shards_only"] {
        let text = long_shards().replace("    far:", &format!("    store: {store}\n    far:"));
        let space = Space::with(&text.replace("vars: {n: 16}", "vars: {n: 12}"));
        space.build("set", &[]);
        let small: Vec<_> = space.shards("set").into_iter().map(|(file, ..)| file).collect();
        let whole = Space::with(&long_shards());
        whole.build("set", &[]);
        let longest =
            whole.shards("set").iter().map(|(file, ..)| length(&whole, file)).max().expect("there are shards");
        let manifest = fs::metadata(whole.path("set/dataset.json")).expect("it was written").len();
        assert!(longest > manifest + 8192, "a shard of {longest} bytes, a manifest of {manifest}");

        // All is computed and there; then the shard does not fit.
        space.write("p.yaml", long_shards());
        space.build("elsewhere", &[]);
        space.write("p.yaml", &text);
        let said =
            space.turbid_with_files_of_at_most(longest - 4096, &["dataset", "build", "p.yaml", "--to", "set"]).fails(1);
        assert!(said.contains("the disk is full") && said.contains("build again"), "{store}: {said}");
        assert!(said.contains("data/") && !said.contains("writing"), "{store}: {said}");
        let left = fs::read_dir(space.path("set/data")).expect("it is there").flatten();
        let left: Vec<String> = left.map(|e| e.file_name().to_string_lossy().into_owned()).collect();
        assert!(left.iter().all(|name| name.ends_with(".parquet")) && left.len() >= small.len(), "{store}: {left:?}");
        let healed = space.build("set", &[]);
        assert_eq!(space.shards("set"), whole.shards("set"), "{store}: {healed}");
        space.verify("set").ok();
        space.turbid(&["cache", "verify"]).ok();
    }
}

fn length(space: &Space, file: &str) -> u64 {
    fs::metadata(space.path("set").join(file)).expect("the build wrote it").len()
}
