//! A run that has nothing to do says what the last one said, and only while nothing was touched.

use std::fs;
use std::path::{Path, PathBuf};
use std::thread::sleep;
use std::time::Duration;

use serde_json::Value;

use crate::space::{Space, counts};

const PIPELINE: &str = "\
include: base.yaml
stages:
  lut: {use: build_lut, foreach: {csv: n.csv}, with: {model: diffusion, f_x: [0, 0.1], g: 0.8, n: \"${n}\", mu_a: \"${mu_a}\", mu_s_prime: [0.5, 2]}}
";

fn space() -> Space {
    let space = Space::with(PIPELINE);
    space.write("base.yaml", "vars: {mu_a: [0.01, 0.1]}\n");
    space.write("n.csv", "n\n1.33\n1.40\n");
    space
}

/// What stands in a note that was changed by hand: who prints it has believed the note.
const MARK: &str = "said by the note";

/// Longer than a change takes to settle.
fn settle() {
    sleep(Duration::from_millis(150));
}

/// The notes of a space, marked: runs with these arguments that go the short way say so from now on.
fn mark(space: &Space, more: &[&str]) -> Vec<PathBuf> {
    let folder = space.outputs().join("store/unchanged");
    let _ = fs::remove_dir_all(&folder);
    settle();
    assert_eq!(counts(space, more).1, 0, "all is up to date");
    let notes = space.files("outputs/store/unchanged");
    assert_eq!(notes.len(), 1, "the run has noted what it said");
    for note in &notes {
        let bytes = fs::read(note).expect("it is ours");
        let mut value: Value = serde_json::from_slice(&bytes[..bytes.len() - 32]).expect("a note is JSON");
        value["closing"]["texts"].as_array_mut().expect("a list").push(MARK.into());
        put(note, &value);
    }
    notes
}

fn put(note: &Path, value: &Value) {
    let mut bytes = value.to_string().into_bytes();
    let check = blake3::hash(&bytes);
    bytes.extend(check.as_bytes());
    fs::write(note, bytes).expect("it is ours");
}

/// Whether a run goes the short way.
fn is_short(space: &Space, more: &[&str]) -> bool {
    let arguments: Vec<&str> = ["run", "p.yaml"].iter().chain(more).copied().collect();
    space.turbid(&arguments).ok().contains(MARK)
}

/// The same words, to the letter but for the time, and a line in the log.
#[cfg(unix)]
#[test]
fn the_short_way_says_what_the_long_way_says() {
    let space = space();
    counts(&space, &[]);
    settle();
    let without_time = |text: String| {
        text.split_once(" failed in ").map(|(a, b)| (a.to_owned(), b[b.find('\n').unwrap()..].to_owned()))
    };
    let said = || without_time(space.turbid(&["run", "p.yaml"]).ok()).expect("it says how long it took");
    let long = said();
    assert_eq!(space.files("outputs/store/unchanged").len(), 1);
    let log = || fs::read_to_string(space.outputs().join("runs/log.jsonl")).expect("it is written").lines().count();
    let before = log();
    assert_eq!(said(), long);
    assert_eq!(counts(&space, &[]), (2, 0), "for programs too");
    assert_eq!(log(), before + 2);
    mark(&space, &[]);
    assert!(is_short(&space, &[]), "that was the short way");
    assert!(!is_short(&space, &["--set", "vars.mu_a=[0.02, 0.1]"]), "another request");
    assert!(!is_short(&space, &["lut.lut"]), "another target");
}

/// Whatever is touched of what a run looks at sends the next one the long way, which mends it.
#[cfg(unix)]
#[test]
fn whatever_is_touched_is_looked_at() {
    let space = space();
    counts(&space, &[]);
    let latest = space.outputs().join("latest/p");
    let shown = || {
        let mut all = Vec::new();
        for path in space.files("outputs/latest/p/lut") {
            all.push((path.clone(), fs::read(&path).expect("it is there")));
        }
        all
    };
    let right = shown();
    assert!(right.len() >= 4, "files and pictures: {right:?}");
    let copy = right[0].0.clone();
    let rewritten = |path: &Path, change: &dyn Fn(&mut Vec<u8>)| {
        let mut permissions = fs::metadata(path).expect("it is there").permissions();
        #[allow(clippy::permissions_set_readonly_false)]
        permissions.set_readonly(false);
        fs::set_permissions(path, permissions).expect("it is ours");
        let modified = fs::metadata(path).and_then(|meta| meta.modified()).expect("a time");
        let mut bytes = fs::read(path).expect("it is there");
        change(&mut bytes);
        fs::write(path, bytes).expect("it is ours");
        // As if nothing had been.
        fs::File::options().write(true).open(path).and_then(|file| file.set_modified(modified)).expect("it is ours");
    };
    let flip = |bytes: &mut Vec<u8>| {
        let half = bytes.len() / 2;
        bytes[half] ^= 1;
    };
    let pack = space.files("outputs/store/packs").remove(0);
    type Way<'a> = (&'a str, u64, &'a dyn Fn());
    let ways: [Way; 9] = [
        ("a comment in the pipeline", 0, &|| space.write("p.yaml", &format!("# note\n{PIPELINE}"))),
        ("an included file", 2, &|| space.write("base.yaml", "vars: {mu_a: [0.02, 0.1]}\n")),
        ("back again", 0, &|| space.write("base.yaml", "vars: {mu_a: [0.01, 0.1]}\n")),
        ("a table of axes", 1, &|| space.write("n.csv", "n\n1.33\n1.45\n")),
        ("back again", 0, &|| space.write("n.csv", "n\n1.33\n1.40\n")),
        ("a file for people", 0, &|| rewritten(&copy, &flip)),
        ("the folder for people", 0, &|| fs::remove_dir_all(&latest).expect("it is ours")),
        ("the store", 2, &|| {
            space.turbid(&["cache", "gc", "--max-size", "1B"]).ok();
        }),
        ("a pack", u64::MAX, &|| rewritten(&pack, &|bytes| bytes.iter_mut().for_each(|byte| *byte ^= 1))),
    ];
    for (what, ran, touch) in ways {
        mark(&space, &[]);
        touch();
        let done = space.turbid(&["run", "p.yaml"]).ok();
        assert!(!done.contains(MARK), "{what}: the note was believed\n{done}");
        if ran != u64::MAX {
            assert!(done.contains(&format!(" {ran} ran,")), "{what}: {done}");
        }
        if !matches!(what, "an included file" | "a table of axes") {
            assert_eq!(shown(), right, "{what}");
        }
    }
}

/// A note that is damaged, of another request or in the way is none.
#[cfg(unix)]
#[test]
fn a_note_is_only_that_of_its_own_request() {
    let space = space();
    counts(&space, &[]);
    let own = mark(&space, &[]).remove(0);
    let (bytes, more) = (fs::read(&own).expect("it is ours"), ["--set", "vars.mu_a=[0.02, 0.1]"]);
    counts(&space, &more);
    let other = mark(&space, &more).remove(0);
    fs::write(&other, &bytes).expect("it is ours");
    assert!(!is_short(&space, &more), "that of another request");
    let own = mark(&space, &more).remove(0);
    let bytes = fs::read(&own).expect("it is ours");
    for at in (0..bytes.len()).step_by(bytes.len() / 4) {
        let mut flipped = bytes.clone();
        flipped[at] ^= 1;
        fs::write(&own, flipped).expect("it is ours");
        assert!(!is_short(&space, &more), "flipped at {at}");
    }
    fs::write(&own, &bytes[..bytes.len() / 2]).expect("it is ours");
    assert!(!is_short(&space, &more), "cut");
    // The records' use must be noted now and then.
    let mut old: Value = serde_json::from_slice(&bytes[..bytes.len() - 32]).expect("a note is JSON");
    let day = 86_400_000_000_000_i64;
    old["began_ns"] = (old["began_ns"].as_i64().expect("a time") - day).into();
    put(&own, &old);
    assert!(!is_short(&space, &more), "a day old");
}
