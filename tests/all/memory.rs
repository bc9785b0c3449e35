//! What a run takes of memory: told before, compared with what there is, and not much more than was told.

use std::process::Stdio;

use serde_json::Value;

use crate::space::{SMALL, Space, counts};

/// Lights and views of a slab, at `pixels` x `pixels`; two paths are enough for memory.
fn large(pixels: u32, frames: u32) -> String {
    let f_x: Vec<String> = (1..=frames / 3).map(|k| format!("{}", f64::from(k) * 0.05)).collect();
    SMALL
        .replace("samples: 16", "samples: 2")
        .replace("pixels: [12, 12]", &format!("pixels: [{pixels}, {pixels}]"))
        .replace("f_x: [0, 0.1]", &format!("f_x: [0, {}]", f_x.join(", ")))
}

fn instance<'a>(listing: &'a Value, stage: &str) -> &'a Value {
    let all = listing["instances"].as_array().expect("a list");
    all.iter().find(|i| i["stage"] == stage).unwrap_or_else(|| panic!("no {stage} in {listing}"))
}

/// Of instances that ran alone the estimate holds what the process had at the most, and is not more than half as much again: of images of 4 and 16 MB a
/// layer, 4 and 7 frames. What the program has without any instance (here at most 64 MB: its code, tables and threads) does not belong to it, nor does
/// what an allocator keeps of the instance before: each runs in a process of its own.
#[test]
fn the_memory_of_large_instances_is_foreseen() {
    const BASE: f64 = 64e6;
    for (pixels, frames) in [(700, 6), (1000, 3)] {
        let space = Space::with(&large(pixels, frames));
        let planned = space.turbid(&["plan", "p.yaml", "--json", "modulation"]).json();
        for stage in ["frames", "modulation"] {
            space.turbid(&["run", "p.yaml", "-j", "1", stage]).ok();
        }
        let shown = space.turbid(&["show", "p.yaml", "--json", "modulation"]).json();
        let frames_shown = space.turbid(&["show", "p.yaml", "--json", "frames"]).json();
        for (stage, shown) in [("frames", &frames_shown), ("modulation", &shown)] {
            let foreseen = instance(&planned, stage)["memory"].as_f64().expect("it is reckoned");
            let peak = instance(shown, stage)["peak_bytes"].as_f64().expect("it ran");
            // Elsewhere than on Linux nobody tells.
            if peak == 0.0 {
                continue;
            }
            let what = format!("{stage} of {pixels}^2 pixels, {frames} frames: {foreseen:e} foreseen, {peak:e} taken");
            assert!(foreseen + BASE >= peak, "{what}");
            assert!(foreseen <= 1.5 * peak, "{what}");
        }
        let at_most = planned["memory"]["at_most"].as_f64().expect("a number");
        assert!(at_most >= instance(&planned, "frames")["memory"].as_f64().expect("a number"), "{planned}");
    }
}

/// What can never fit is a mistake before anything runs, with its place, its need, what there is and the way out; a plan of it is still told, with a
/// warning; and with memory enough it runs.
#[test]
fn what_cannot_fit_is_refused() {
    let space = Space::with(&large(4096, 3));
    let refused = space.turbid(&["run", "p.yaml", "--memory", "300MB"]).fails(2);
    for part in
        ["p.yaml:19:3: error", "`frames` (render) needs about", "GB of memory", "300.0 MB by --memory", "--memory SIZE"]
    {
        assert!(refused.contains(part), "`{part}` is missing:\n{refused}");
    }
    assert!(!space.outputs().join("runs").exists(), "nothing was begun");
    let plan = space.turbid(&["plan", "p.yaml", "--memory", "300MB"]);
    assert_eq!(plan.code, Some(0), "{}", plan.err);
    assert!(
        plan.out.contains("memory: at most") && plan.err.contains("warning") && plan.err.contains("frames"),
        "{}",
        plan.err
    );
    let check = space.turbid(&["check", "p.yaml", "--memory", "300MB"]).ok();
    assert!(check.contains("warning") && check.contains("needs about"), "{check}");
    let space = Space::with(SMALL);
    // The smallest are not reckoned with: what they take is the program's own.
    assert_eq!(counts(&space, &["--memory", "1MB"]), (0, 7));
}

/// Under a limit of the address space, too: the program ends with an error, not by a signal.
#[cfg(target_os = "linux")]
#[test]
fn a_limit_of_the_process_is_seen() {
    let space = Space::with(&large(3000, 3));
    let mut limited = std::process::Command::new("sh");
    let run = format!("ulimit -v 500000; exec {} run p.yaml", env!("CARGO_BIN_EXE_turbid"));
    let done = limited.args(["-c", &run]).current_dir(space.path()).stdin(Stdio::null()).output().expect("sh is there");
    let said = String::from_utf8_lossy(&done.stderr);
    assert_eq!(done.status.code(), Some(2), "{said}");
    assert!(said.contains("of the address space that this process may have (ulimit -v)"), "{said}");
}

/// Instances that do not fit together run one after the other, to the same bytes.
#[test]
fn what_does_not_fit_together_runs_in_turn() {
    let text = large(800, 3);
    let (wide, narrow) = (Space::with(&text), Space::with(&text));
    let planned = wide.turbid(&["plan", "p.yaml", "--json", "modulation", "phantom_modulation"]).json();
    let one = instance(&planned, "frames")["memory"].as_u64().expect("a number");
    assert!(one > 64_000_000, "{one} bytes are too few to be reckoned with");
    let is_frames = |event: &Value| event["instance"].as_str().is_some_and(|label| label.contains("frames"));
    let run = |space: &Space, memory: u64| {
        let bytes = memory.to_string();
        let out =
            space.turbid(&["run", "p.yaml", "--json", "-j", "2", "--memory", &bytes, "frames", "phantom_frames"]).ok();
        // The most that were at work at a time.
        let mut most = 0;
        let mut running = 0;
        for line in out.lines() {
            let event: Value = serde_json::from_str(line).expect("events are JSON");
            match event["event"].as_str() {
                Some("started") if is_frames(&event) => running += 1,
                Some("ran") if is_frames(&event) => running -= 1,
                _ => {}
            }
            most = most.max(running);
        }
        most
    };
    assert_eq!(run(&narrow, one + one / 2), 1);
    assert_eq!(run(&wide, 3 * one), 2);
    assert_eq!(wide.digests(), narrow.digests());
}
