//! The same key gives the same bytes: threads, vector widths, continued runs.

use crate::space::{SMALL, Space, counts};

fn digests_with(jobs: &str, simd: &str) -> String {
    let space = Space::with(SMALL);
    let output =
        space.command(&["run", "p.yaml", "-j", jobs]).env("TURBID_SIMD", simd).output().expect("the program starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    space.digests()
}

#[test]
fn threads_and_vector_width_do_not_show() {
    let reference = digests_with("1", "baseline");
    assert!(reference.lines().count() > 5);
    for (jobs, simd) in [("2", "baseline"), ("4", "v3"), ("1", "v4")] {
        assert_eq!(digests_with(jobs, simd), reference, "-j {jobs}, {simd}");
    }
}

/// A run continued from 16 to 64 samples gives the bytes of a fresh one of 64.
#[test]
fn a_continued_run_equals_a_fresh_one() {
    let long = ["--set", "vars.samples=64"];
    let fresh = Space::with(SMALL);
    counts(&fresh, &long);
    let continued = Space::with(SMALL);
    counts(&continued, &[]);
    counts(&continued, &long);
    let frames = |space: &Space| {
        let shown = space.turbid(&["show", "p.yaml", "frames", "--json", "--set", "vars.samples=64"]).json();
        shown["instances"][0]["ports"].clone()
    };
    let (fresh, continued) = (frames(&fresh), frames(&continued));
    for port in ["frames", "covariance"] {
        assert!(fresh[port]["digest"].is_string());
        assert_eq!(fresh[port]["digest"], continued[port]["digest"], "{port}");
    }
}

/// A level that does not exist would run as the best one and prove nothing.
#[test]
fn an_unknown_vector_width_is_refused() {
    let space = Space::with(SMALL);
    let output = space.command(&["run", "p.yaml"]).env("TURBID_SIMD", "v9").output().expect("the program starts");
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("TURBID_SIMD = v9 must be baseline, v3, v4 or best"));
}
