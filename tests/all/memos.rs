//! Notes of what a pipeline led to last time are a short way, never another one's results.

use std::fs;
use std::path::PathBuf;

use crate::space::{SMALL, Space, counts};

fn memos(space: &Space) -> Vec<PathBuf> {
    space.files("outputs/store/memos")
}

fn digest(space: &Space) -> String {
    let bytes = fs::read(space.outputs().join("latest/small/frames/frames.exr")).expect("it was made");
    blake3::hash(&bytes).to_hex().to_string()
}

/// Any memo under any name: swapped, cut, flipped, of another format, a pipe. The run says what is right for its own parameters.
#[cfg(unix)]
#[test]
fn a_memo_is_only_that_of_its_own_plan() {
    let space = Space::with(SMALL);
    let more = ["frames", "--set", "vars.samples=32"];
    counts(&space, &["frames"]);
    let (first, few) = (memos(&space).remove(0), digest(&space));
    counts(&space, &more);
    let (second, many) = (memos(&space).into_iter().find(|path| *path != first).expect("two memos"), digest(&space));
    assert_ne!(few, many);
    let whole = [fs::read(&first).expect("it is there"), fs::read(&second).expect("it is there")];
    let checked = |what: &str| {
        assert_eq!(counts(&space, &more), (2, 0), "{what}");
        assert_eq!(digest(&space), many, "{what}");
        assert_eq!(counts(&space, &["frames"]), (2, 0), "{what}");
        assert_eq!(digest(&space), few, "{what}");
    };
    let put = |path: &PathBuf, bytes: &[u8]| fs::write(path, bytes).expect("it is ours");
    put(&second, &whole[0]);
    checked("the first under both names");
    put(&first, &whole[1]);
    put(&second, &whole[0]);
    checked("swapped");
    // As written by an older turbid: no identity in it.
    let body = &whole[0][13 + 32..whole[0].len() - 32];
    put(&second, &[body, blake3::hash(body).as_bytes()].concat());
    checked("of an older format");
    for at in (0..whole[1].len()).step_by(whole[1].len() / 6) {
        let mut flipped = whole[1].clone();
        flipped[at] ^= 1;
        put(&second, &flipped);
        checked(&format!("flipped at {at}"));
    }
    put(&second, &whole[1][..whole[1].len() / 2]);
    checked("cut");
    fs::remove_file(&second).expect("it is ours");
    assert!(std::process::Command::new("mkfifo").arg(&second).status().expect("mkfifo is there").success());
    checked("a pipe");
}
