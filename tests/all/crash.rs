//! Nothing that happens to a run or to the store gives a wrong result or loses a finished one.

use std::fs;
use std::io::{Read, Seek, SeekFrom, Write};
use std::time::Duration;

use crate::space::{SMALL, Space, counts};

fn reference() -> String {
    let space = Space::with(SMALL);
    counts(&space, &[]);
    space.digests()
}

/// Kills the program at moments spread over its run; after each the next run goes on.
#[test]
fn killed_runs_lose_nothing() {
    let reference = reference();
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
    let reference = reference();
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

/// Any file of the store cut short or gone: the next run heals it.
#[test]
fn truncated_and_missing_pieces_are_made_again() {
    let reference = reference();
    let whole = Space::with(SMALL);
    counts(&whole, &[]);
    let files = whole.files("outputs/store");
    assert!(files.len() >= 3, "{files:?}");
    for (index, _) in files.iter().enumerate() {
        for keep in [0.0, 0.5] {
            let space = Space::with(SMALL);
            counts(&space, &[]);
            let path = space.files("outputs/store")[index].clone();
            if keep == 0.0 {
                fs::remove_file(&path).expect("it is ours");
            } else {
                let half = fs::metadata(&path).expect("it is there").len() / 2;
                let mut permissions = fs::metadata(&path).expect("it is there").permissions();
                #[allow(clippy::permissions_set_readonly_false)]
                permissions.set_readonly(false);
                fs::set_permissions(&path, permissions).expect("it is ours");
                fs::OpenOptions::new().write(true).open(&path).expect("it is ours").set_len(half).expect("it is ours");
            }
            counts(&space, &[]);
            assert_eq!(space.digests(), reference, "{}", path.display());
            assert_eq!(counts(&space, &[]).1, 0, "{}", path.display());
        }
    }
}

/// A flipped bit: found by verify, healed by repair and a run, never a wrong result.
#[test]
fn flipped_bits_are_found_and_healed() {
    let reference = reference();
    let whole = Space::with(SMALL);
    counts(&whole, &[]);
    let count = whole.files("outputs/store").len();
    for index in 0..count {
        let space = Space::with(SMALL);
        counts(&space, &[]);
        let path = space.files("outputs/store")[index].clone();
        let length = fs::metadata(&path).expect("it is there").len();
        if length == 0 {
            continue;
        }
        let mut permissions = fs::metadata(&path).expect("it is there").permissions();
        #[allow(clippy::permissions_set_readonly_false)]
        permissions.set_readonly(false);
        fs::set_permissions(&path, permissions).expect("it is ours");
        let mut file = fs::OpenOptions::new().read(true).write(true).open(&path).expect("it is ours");
        let mut byte = [0];
        file.seek(SeekFrom::Start(length * 2 / 3)).expect("inside");
        file.read_exact(&mut byte).expect("inside");
        file.seek(SeekFrom::Start(length * 2 / 3)).expect("inside");
        file.write_all(&[byte[0] ^ 4]).expect("it is ours");
        drop(file);
        let _ = space.turbid(&["cache", "verify", "--repair"]);
        counts(&space, &[]);
        assert_eq!(space.digests(), reference, "{}", path.display());
        space.turbid(&["cache", "verify"]).ok();
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
