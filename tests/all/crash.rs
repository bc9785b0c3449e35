//! Nothing that happens to a run or to the store gives a wrong result or loses a finished one.

use std::fs;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::time::Duration;

use crate::space::{SMALL, Space, counts};

/// A space in which the pipeline has run, and its digests.
fn finished() -> (Space, String) {
    finished_with(SMALL)
}

fn finished_with(text: &str) -> (Space, String) {
    let space = Space::with(text);
    counts(&space, &[]);
    let digests = space.digests();
    (space, digests)
}

/// Lets the owner write to a file of the store, which are read-only against slips of people.
fn unlock(path: &Path) {
    let mut permissions = fs::metadata(path).expect("it is there").permissions();
    #[allow(clippy::permissions_set_readonly_false)]
    permissions.set_readonly(false);
    fs::set_permissions(path, permissions).expect("it is ours");
}

/// Kills the program at moments spread over its run; after each the next run goes on.
#[test]
fn killed_runs_lose_nothing() {
    let (_, reference) = finished();
    let space = Space::with(SMALL);
    for round in 0..12u64 {
        let mut child = space.start(&["run", "p.yaml"]);
        std::thread::sleep(Duration::from_millis(2 + 17 * round));
        // The run may have ended already; then there is nothing to kill.
        let _ = child.kill();
        child.wait().expect("it was started");
    }
    counts(&space, &[]);
    assert_eq!(space.digests(), reference);
    space.turbid(&["cache", "verify"]).ok();
}

#[test]
fn two_runs_at_once_share_a_store() {
    let (_, reference) = finished();
    let space = Space::with(SMALL);
    let mut children: Vec<_> = (0..3).map(|_| space.start(&["run", "p.yaml"])).collect();
    for child in &mut children {
        assert!(child.wait().expect("it was started").success());
    }
    assert_eq!(space.digests(), reference);
    space.turbid(&["cache", "verify"]).ok();
    let (_, ran) = counts(&space, &[]);
    assert_eq!(ran, 0);
}

/// Packs, index and locks vanish again and again while two runs are at work (a sync tool, somebody's `rm`, gc where locks do not
/// work): both end well, soon, with the right results. At last it stops: what is removed for ever nobody can call up to date.
#[test]
fn runs_survive_what_vanishes_beside_them() {
    const REMOVALS: usize = 30;
    let (_, reference) = finished();
    let space = Space::with(SMALL);
    let mut runs: Vec<_> = (0..2).map(|_| space.start(&["run", "p.yaml", "-j", "2"])).collect();
    let began = std::time::Instant::now();
    let mut ended = 0;
    for round in 0.. {
        ended = runs.iter_mut().filter_map(|run| run.try_wait().expect("it was started")).count();
        if ended == runs.len() || began.elapsed() > Duration::from_secs(60) {
            break;
        }
        std::thread::sleep(Duration::from_millis(20));
        let store = space.outputs().join("store");
        match round % 3 {
            _ if round >= REMOVALS => {}
            0 => {
                let packs = fs::read_dir(store.join("packs")).into_iter().flatten().flatten();
                packs.for_each(|pack| drop(fs::remove_file(pack.path())));
            }
            1 => drop(fs::remove_dir_all(store.join("index"))),
            _ => drop(fs::remove_dir_all(store.join("locks"))),
        }
    }
    assert_eq!(ended, 2, "a run hangs");
    for run in &mut runs {
        assert!(run.wait().expect("it has ended").success());
    }
    counts(&space, &[]);
    assert_eq!(space.digests(), reference);
    space.turbid(&["cache", "verify"]).ok();
}

/// Any file of the store cut short or gone: the next run heals it.
#[test]
fn truncated_and_missing_pieces_are_made_again() {
    let (whole, reference) = finished();
    let files = whole.files("outputs/store");
    assert!(files.len() >= 3, "{files:?}");
    for file in &files {
        let inside = file.strip_prefix(whole.path()).expect("below it");
        for keep in [0, 1, 2] {
            let space = Space::copy_of(&whole);
            let path = space.path().join(inside);
            if keep == 0 {
                fs::remove_file(&path).expect("it is ours");
            } else {
                unlock(&path);
                let length = fs::metadata(&path).expect("it is there").len() * keep / 3;
                fs::OpenOptions::new()
                    .write(true)
                    .open(&path)
                    .expect("it is ours")
                    .set_len(length)
                    .expect("it is ours");
            }
            counts(&space, &[]);
            assert_eq!(space.digests(), reference, "{} cut to {keep}/3", inside.display());
            assert_eq!(counts(&space, &[]).1, 0, "{} cut to {keep}/3", inside.display());
        }
    }
}

/// A flipped bit: found by verify wherever results lie or are found by, healed by repair and a run, never a wrong result.
#[test]
fn flipped_bits_are_found_and_healed() {
    // Frames beyond 64 KiB: the store has pieces of every kind.
    let (whole, reference) = finished_with(&SMALL.replace("pixels: [12, 12]", "pixels: [64, 64]"));
    let mut kinds = std::collections::BTreeSet::new();
    for file in whole.files("outputs/store") {
        let space = Space::copy_of(&whole);
        let path = space.path().join(file.strip_prefix(whole.path()).expect("below it"));
        let length = fs::metadata(&path).expect("it is there").len();
        unlock(&path);
        let mut file = fs::OpenOptions::new().read(true).write(true).open(&path).expect("it is ours");
        let mut byte = [0];
        file.seek(SeekFrom::Start(length * 2 / 3)).expect("inside");
        file.read_exact(&mut byte).expect("inside");
        file.seek(SeekFrom::Start(length * 2 / 3)).expect("inside");
        file.write_all(&[byte[0] ^ 4]).expect("it is ours");
        drop(file);
        let inside = path.strip_prefix(space.outputs()).expect("below it").display().to_string();
        if ["blobs", "checkpoints", "index", "packs"].iter().any(|kind| inside.contains(&format!("store/{kind}"))) {
            space.turbid(&["cache", "verify"]).fails(1);
            kinds.insert(inside.split('/').nth(1).expect("in the store").to_owned());
        }
        space.turbid(&["cache", "verify", "--repair"]).ok();
        counts(&space, &[]);
        assert_eq!(space.digests(), reference, "{inside}");
        space.turbid(&["cache", "verify"]).ok();
    }
    assert_eq!(kinds.len(), 4, "of each kind there is a file: {kinds:?}");
}

/// Files of the store get the rights that the user gives to new files: a group that shares a folder shares the store.
#[cfg(unix)]
#[test]
fn the_umask_holds_in_the_store() {
    use std::os::unix::fs::PermissionsExt;
    for (umask, packs) in [("007", 0o660), ("077", 0o600), ("022", 0o644)] {
        let space = Space::with(SMALL);
        let script = format!("umask {umask}; exec {} run p.yaml frames", env!("CARGO_BIN_EXE_turbid"));
        let run = std::process::Command::new("sh").args(["-c", &script]).current_dir(space.path()).output();
        assert!(run.expect("sh is there").status.success());
        let checkpoints = space.files("outputs/store/checkpoints");
        assert!(!checkpoints.is_empty());
        let index = space.files("outputs/store/index");
        assert_eq!(index.len(), 1, "{index:?}");
        let format = space.outputs().join("store/format");
        for file in space.files("outputs/store/packs").into_iter().chain(checkpoints).chain(index).chain([format]) {
            assert_eq!(
                fs::metadata(&file).expect("it was listed").permissions().mode() & 0o777,
                packs,
                "umask {umask}"
            );
        }
    }
}

/// A long run that is interrupted stops soon, with 130, and keeps what it finished.
#[cfg(unix)]
#[test]
fn interrupt_stops_and_keeps() {
    let space = Space::with(SMALL);
    let child = space.start(&["run", "p.yaml", "--set", "vars.samples=2000000"]);
    std::thread::sleep(Duration::from_millis(600));
    let interrupted = std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    assert!(interrupted.expect("kill is there").success());
    let began = std::time::Instant::now();
    let mut child = child;
    let status = child.wait().expect("it was started");
    assert_eq!(status.code(), Some(130));
    assert!(began.elapsed() < Duration::from_secs(20));
    let (hits, _) = counts(&space, &["tissue", "phantom"]);
    assert_eq!(hits, 2);
}

/// Places of the payloads in a pack: kind of the entry, start, length.
fn payloads(pack: &[u8]) -> Vec<(u8, usize, usize)> {
    let starts = (0..pack.len()).filter(|&at| pack[at..].starts_with(b"TFr1"));
    let length = |at: usize| u64::from_le_bytes(pack[at + 16..at + 24].try_into().expect("eight bytes")) as usize;
    starts.map(|at| (pack[at + 4], at + 88, length(at))).collect()
}

/// A blob that nobody reads is damaged, and so is a record, which makes the run gather the packs at its end: what it called up to date, and left
/// behind there, is made again by the same run.
#[test]
fn what_a_run_calls_up_to_date_is_there_after_it() {
    let targets = ["frames"];
    let space = Space::with(SMALL);
    counts(&space, &targets);
    let reference = space.digests();
    let pack = space.files("outputs/store/packs").remove(0);
    unlock(&pack);
    let mut bytes = fs::read(&pack).expect("it is there");
    let all = payloads(&bytes);
    let (_, blob, length) = *all.iter().find(|(kind, ..)| *kind == 2).expect("a blob");
    let (_, record, _) = *all.iter().rev().find(|(kind, ..)| *kind == 1).expect("a record");
    bytes[blob + length / 2] ^= 1;
    bytes[record + 4] ^= 1;
    fs::write(&pack, bytes).expect("it is ours");
    fs::remove_dir_all(space.outputs().join("store/memos")).expect("it is ours");
    let (hits, ran) = counts(&space, &targets);
    assert!(hits + ran == 2 && ran >= 1, "{hits} {ran}");
    space.turbid(&["export", "p.yaml", "tissue.scene", "--to", "a.npz"]).ok();
    space.turbid(&["cache", "verify"]).ok();
    assert_eq!(space.digests(), reference);
    assert_eq!(counts(&space, &targets), (2, 0));
}
