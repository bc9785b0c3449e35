//! `store: shards_only`: the store gives back what samples held once their shards are there.

use std::fs;
use std::path::Path;
use std::time::Duration;

use serde_json::Value;

use crate::space::{PIPELINE, Space};

/// [`PIPELINE`] with this in its data set.
fn pipeline(more: &str) -> String {
    PIPELINE.replace("    shards: {rows: 4}", &format!("    shards: {{rows: 4}}\n    {more}"))
}

/// The same of few points: runs of a pipeline draw pictures of all its instances.
fn small(text: &str) -> String {
    text.replace("vars: {n: 16}", "vars: {n: 6}")
}

fn bytes_below(folder: &Path) -> u64 {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|e| if e.path().is_dir() { bytes_below(&e.path()) } else { e.metadata().map_or(0, |m| m.len()) }).sum()
}

fn stat(space: &Space) -> Value {
    serde_json::from_str(&space.turbid(&["cache", "stat", "--json"]).ok()).expect("it is JSON")
}

fn number(of: &Value, key: &str) -> u64 {
    of[key].as_u64().unwrap_or_else(|| panic!("{key} is a number: {of}"))
}

/// The shards are those of a set whose samples stay; building again, nothing runs; a lost shard is computed and is the same.
#[test]
fn shards_are_those_of_a_set_that_is_kept() {
    let kept = Space::with(PIPELINE);
    kept.build("set", &[]);
    let space = Space::with(&pipeline("store: shards_only"));
    let first = space.build("set", &[]);
    assert_eq!(space.shards("set"), kept.shards("set"));
    let of = stat(&space);
    assert_eq!(
        (number(&of, "packed_blobs"), number(&of, "loose_blobs")),
        (0, 0),
        "nothing is shared with other runs: {of}"
    );
    assert!(number(&of, "released_blobs") > number(&first, "samples"), "{of}");
    let said = space.turbid(&["cache", "verify"]).ok();
    assert!(said.contains("all sound") && said.contains("released"), "{said}");

    let second = space.build("set", &[]);
    assert_eq!((number(&second, "ran"), &second["samples"]), (0, &first["samples"]), "{second}");
    let shards = space.shards("set");
    let (file, _, rows) = shards.iter().find(|(_, _, rows)| *rows == 4).expect("a full shard");
    for damage in [true, false] {
        let at = space.path("set").join(file);
        if damage {
            fs::write(&at, "no shard").expect("ours")
        } else {
            fs::remove_file(&at).expect("ours")
        }
        let mended = space.build("set", &[]);
        assert_eq!(number(&mended, "ran"), 3 * rows, "the samples of one shard, and no others: {mended}");
        assert_eq!(space.shards("set"), shards);
        assert_eq!(number(&stat(&space), "packed_blobs"), 0, "given back again");
    }
    space.verify("set").ok();
}

/// With more points full shards stay without their samples being computed again.
#[test]
fn released_samples_of_full_shards_are_not_needed_to_grow() {
    let space = Space::with(&pipeline("store: shards_only"));
    let first = space.build("set", &[]);
    let before = space.shards("set");
    let more = space.build("set", &["--set", "vars.n=32"]);
    let place = |file: &str| file.rsplit_once("-of-").expect("NAME-00000-of-00001").0.to_owned();
    let after = space.shards("set");
    let mut partial = 0;
    for (file, sha256, rows) in &before {
        let (_, now, more) = after.iter().find(|(now, ..)| place(now) == place(file)).expect("shards stay");
        match rows {
            4 => assert_eq!(now, sha256, "{file}"),
            _ if more > rows => partial += rows,
            _ => {}
        }
    }
    let fresh = number(&more, "samples") - number(&first, "samples");
    assert_eq!(
        number(&more, "ran"),
        3 * (fresh + partial),
        "what is new, and the samples of shards that were not full: {more}"
    );
    let at_once = Space::with(PIPELINE);
    at_once.build("set", &["--set", "vars.n=32"]);
    assert_eq!(after, at_once.shards("set"));
}

/// Whoever asks for a released output has it made again, and it is what it was; a new stage that reads it too.
#[test]
fn what_is_asked_for_is_made_again() {
    let space = Space::with(&small(&pipeline("store: keep")));
    space.build("set", &[]);
    let show = |selector: &str| -> Value {
        serde_json::from_str(&space.turbid(&["show", "p.yaml", selector, "--json"]).ok()).expect("it is JSON")
    };
    let all = show("frames");
    let axes = &all["instances"][0]["axes"]["draw"];
    let selector = format!("frames[draw={axes}]");
    let export = |to: &str| {
        space.turbid(&["export", "p.yaml", &format!("{selector}.frames"), "--to", to]).ok();
        fs::read(space.path(to)).expect("it was written")
    };
    let (shown, exported) = (show(&selector), export("before.npz"));
    space.write("p.yaml", small(&pipeline("store: shards_only")));
    let given_back = space.build("set", &[]);
    assert_eq!(number(&given_back, "ran"), 0);
    assert_eq!(number(&stat(&space), "packed_blobs"), 0);

    // Without a name nothing is computed.
    let listed: Value = serde_json::from_str(&space.turbid(&["show", "p.yaml", "--json"]).ok()).expect("it is JSON");
    assert!(listed["instances"].as_array().expect("a list").len() > 3);
    let port = &listed["instances"].as_array().expect("a list").iter().find(|i| i["stage"] == "frames").expect("one")["ports"]
        ["frames"];
    assert_eq!((&port["released"], port["layers"].is_null()), (&Value::Bool(true), true), "{port}");

    let again = show(&selector);
    assert_eq!(
        again["instances"][0]["ports"], shown["instances"][0]["ports"],
        "digests, layers and numbers are those of before"
    );
    space.build("set", &[]);
    assert_eq!(export("after.npz"), exported);
    // A run finds everything up to date; a new reader has what it reads made again.
    space.build("set", &[]);
    let run = |more: &[&str]| -> Value {
        let text = space.turbid(&[&["run", "p.yaml", "maps", "--json"], more].concat()).ok();
        serde_json::from_str(text.lines().last().expect("a line")).expect("it is JSON")
    };
    let samples =
        listed["instances"].as_array().expect("a list").iter().filter(|i| i["stage"] == "maps").count() as u64;
    assert_eq!(
        (number(&run(&[]), "ran"), number(&run(&[]), "ran")),
        (samples, 0),
        "pictures of scenes, and then nothing"
    );
    let planned = space.turbid(&["plan", "p.yaml", "maps", "--set", "stages.maps.with.low_signal=0.5"]).ok();
    assert!(planned.contains("its bytes were released"), "{planned}");
    let other = run(&["--set", "stages.maps.with.low_signal=0.5"]);
    assert_eq!((number(&other, "ran"), number(&other, "failed")), (2 * samples, 0), "frames and maps: {other}");
    space.turbid(&["cache", "verify"]).ok();
}

/// What a result outside of the data set names stays.
#[test]
fn what_others_name_stays() {
    // The same scenes under another stage's name, rendered the same way: the frames of both are one blob.
    let other = "  others: {use: demodulate, in: {frames: frames}, with: {low_signal: 0.25}}\n";
    let text = pipeline("store: shards_only").replace("datasets:\n", &format!("{other}datasets:\n"));
    let space = Space::with(&small(&text));
    let made = space.turbid(&["run", "p.yaml", "others", "--json"]).ok();
    assert!(made.contains("\"failed\":0"), "{made}");
    let digests = |space: &Space| -> Vec<String> {
        space.turbid(&["cache", "digests"]).ok().lines().map(str::to_owned).collect()
    };
    let before = digests(&space);
    space.build("set", &[]);
    let after = digests(&space);
    let others: Value =
        serde_json::from_str(&space.turbid(&["show", "p.yaml", "others", "--json"]).ok()).expect("it is JSON");
    let mut named = 0;
    for instance in others["instances"].as_array().expect("a list") {
        for (_, port) in instance["ports"].as_object().expect("a map") {
            let digest = port["digest"].as_str().expect("a text").to_owned();
            assert!(before.contains(&digest) && after.contains(&digest), "{instance}");
            named += 1;
        }
    }
    assert!(named > 0 && after.len() < before.len() + named, "{} blobs before, {} after", before.len(), after.len());
}

/// Readings of one medium: a table of one row.
const READINGS: &str = "\
pipeline: readings
seed: 3
stages:
  readings:
    use: calibrate_dis
    foreach: {draw: {n: 12, mu_a: {loguniform: [0.01, 1]}}}
    with:
      media: {m: {mu_a: \"${mu_a}\", mu_s_prime: 1, g: 0.8, n: 1.4}}
      spheres:
        diameter: 100
        wall_reflectance: 0.98
        ports:
          entrance: {round: {diameter: 10}}
          sample: {round: {diameter: 10}}
          detector: {round: {diameter: 10}, sees: wall}
      sample: {thickness: 1, size: [10, 10]}
      beam: {collimated: {diameter: 1}}
      standard: {reflectance: 0.99}
      samples: 500
datasets:
  readings:
    sample: {m_r: readings.readings.m_r}
    keep: {readings.readings.m_t: {above: 0.5}}
    shards: {rows: 4}
    store: shards_only
";

/// Limits on tables are decided again without a run: what they look into stays. Limits that are new have it made again.
#[test]
fn limits_on_tables_are_decided_again() {
    let space = Space::with(READINGS);
    let first = space.build("set", &[]);
    let left_out = number(&first["rejects"], "keep: readings.readings.m_t");
    assert!(left_out > 0 && left_out < 12, "{first}");
    let second = space.build("set", &[]);
    assert_eq!((number(&second, "ran"), &second["rejects"]), (0, &first["rejects"]));
    assert_eq!(number(&stat(&space), "packed_blobs"), 12);

    let limit = "    keep: {readings.readings.m_t: {above: 0.5}}\n";
    let space = Space::with(&READINGS.replace(limit, ""));
    let all = space.build("set", &[]);
    assert_eq!((number(&all, "samples"), number(&stat(&space), "packed_blobs")), (12, 0), "{all}");
    space.write("p.yaml", READINGS);
    let limited = space.build("set", &[]);
    assert_eq!((number(&limited, "ran"), &limited["rejects"]), (12, &first["rejects"]));
}

/// Killed at moments spread over building and giving back: the next build goes on, and ends with the same shards and nothing left.
#[test]
fn killed_builds_go_on() {
    let whole = Space::with(PIPELINE);
    whole.build("set", &[]);
    let space = Space::with(&pipeline("store: shards_only"));
    for round in 0..12_u64 {
        let mut child = space.start(&["dataset", "build", "p.yaml", "--to", "set"]);
        std::thread::sleep(Duration::from_millis(3 + 31 * round));
        let _ = child.kill();
        child.wait().expect("it was started");
    }
    space.build("set", &[]);
    assert_eq!(space.shards("set"), whole.shards("set"));
    assert_eq!(number(&stat(&space), "packed_blobs"), 0);
    space.verify("set").ok();
    space.turbid(&["cache", "verify"]).ok();
}

/// Room comes back: the packs are rewritten by `gc`, and what was released stays so.
#[test]
fn room_comes_back() {
    let space = Space::with(&pipeline("store: shards_only"));
    let first = space.build("set", &["--set", "vars.n=48"]);
    let dead = bytes_below(&space.path("outputs/store"));
    space.turbid(&["cache", "gc", "--max-size", "1GB"]).ok();
    let store = bytes_below(&space.path("outputs/store"));
    assert!(store < dead / 2, "{store} of {dead} bytes");
    let per_sample = (store + bytes_below(&space.path("set"))) as f64 / number(&first, "samples") as f64;
    assert!(per_sample < 30e3, "{per_sample} bytes a sample of 6 x 6 pixels");
    assert!(number(&stat(&space), "released_blobs") > 0);
    let second = space.build("set", &["--set", "vars.n=48"]);
    assert_eq!((number(&second, "ran"), &second["samples"]), (0, &first["samples"]));
    space.turbid(&["cache", "verify"]).ok();
}
