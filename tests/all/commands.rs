//! Every command as a user types it: what it prints, how it ends.

use serde_json::Value;

use crate::space::{SMALL, Space, counts};

#[test]
fn show_gives_layers_units_and_statistics() {
    let space = Space::with(SMALL);
    counts(&space, &[]);
    let shown = space.turbid(&["show", "p.yaml", "frames.frames", "--json"]).json();
    let port = &shown["instances"][0]["ports"]["frames"];
    assert_eq!(port["payload"], "frames");
    let layers = port["layers"].as_array().expect("layers");
    let values: Vec<&Value> = layers.iter().filter(|l| l["kind"] == "value").collect();
    // One frame at f_x = 0 and three phases at 0.1.
    assert_eq!(values.len(), 4);
    for layer in values {
        assert_eq!(layer["unit"], "W mm^-2 sr^-1");
        let number = |name: &str| layer[name].as_f64().unwrap_or_else(|| panic!("{name}: {layer}"));
        assert!(number("min") <= number("mean") && number("mean") <= number("max"));
        assert!(number("mean_se") > 0.0 && number("f_x_per_mm") >= 0.0);
    }
    assert!(space.path().join("outputs/latest/small/frames/frames.png").exists());
    space.turbid(&["show", "p.yaml"]).ok();
}

#[test]
fn exports_are_written() {
    let space = Space::with(SMALL);
    counts(&space, &[]);
    for name in ["a.npz", "a.tiff", "a.csv", "a.mat"] {
        space.turbid(&["export", "p.yaml", "modulation.modulation", "--to", name]).ok();
        assert!(space.path().join(name).metadata().expect("it was written").len() > 500, "{name}");
    }
    let message = space.turbid(&["export", "p.yaml", "modulation.modulation", "--to", "a.jpeg"]).fails(2);
    assert!(message.contains("npz"), "{message}");
}

#[test]
fn graph_stages_schema_and_new_print() {
    let space = Space::with(SMALL);
    assert!(space.turbid(&["graph", "p.yaml"]).ok().contains("-->"));
    assert!(space.turbid(&["graph", "p.yaml", "--format", "dot"]).ok().contains("digraph"));
    let list = space.turbid(&["stages"]).ok();
    for name in ["scene", "render", "demodulate", "calibrate", "build_lut", "invert", "compare"] {
        assert!(list.contains(name), "{list}");
        let manual = space.turbid(&["stages", name]).ok();
        assert!(manual.contains("out:") && manual.contains("with:"), "{manual}");
    }
    let schema: Value = serde_json::from_str(&space.turbid(&["schema"]).ok()).expect("JSON");
    assert!(schema["properties"]["stages"].is_object());
    space.turbid(&["new", "mine"]).ok();
    space.turbid(&["check", "mine.yaml"]).ok();
    assert!(space.turbid(&["new", "mine"]).fails(2).contains("exists"));
}

#[test]
fn cache_commands_work_on_a_store() {
    let space = Space::with(SMALL);
    counts(&space, &[]);
    let stat = space.turbid(&["cache", "stat", "--json", "--outputs", "outputs"]).json();
    assert_eq!(stat, space.turbid(&["cache", "--outputs", "outputs", "stat", "--json"]).json());
    assert!(stat["records"].as_u64() >= Some(7) && stat["bytes"].as_u64() > Some(0));
    space.turbid(&["cache", "verify"]).ok();
    space.turbid(&["cache", "gc", "--max-size", "10GB"]).ok();
    assert_eq!(counts(&space, &[]).1, 0);
    space.turbid(&["cache", "gc", "--max-size", "0"]).ok();
    assert_eq!(space.digests().trim(), "");
    assert_eq!(counts(&space, &[]).0, 0);
}

#[test]
fn wrong_command_lines_end_with_2() {
    let space = Space::with(SMALL);
    for arguments in [
        &["run"][..],
        &["run", "missing.yaml"],
        &["run", "p.yaml", "nothing"],
        &["run", "p.yaml", "frames.nothing"],
        &["run", "p.yaml", "--force", "nothing"],
        &["run", "p.yaml", "-j", "0"],
        &["run", "p.yaml", "--set", "nonsense"],
        &["fly"],
        &["show", "p.yaml", "frames[A=1"],
        &["export", "p.yaml", "frames", "--to", "a.npz"],
        &["stages", "rendr"],
        &["cache", "gc", "--max-size", "ten"],
        &["explain", "p.yaml", "nothing"],
    ] {
        let message = space.turbid(arguments).fails(2);
        assert!(!message.is_empty(), "{arguments:?}");
    }
    assert!(!space.outputs().join("store").exists(), "a wrong command line must write nothing");
}

#[test]
fn outputs_that_cannot_be_written_are_named() {
    let space = Space::with(SMALL);
    space.write("file", "not a folder");
    let message = space.turbid(&["run", "p.yaml", "--outputs", "file"]).fails(2);
    assert!(message.contains("file"), "{message}");
}

/// Layers are told apart by what they are: covariances by their pair, masks by their reasons; what is not known is not shown as `-`.
#[test]
fn show_labels_every_layer() {
    let space = Space::with(SMALL);
    counts(&space, &[]);
    let shown = space.turbid(&["show", "p.yaml", "modulation"]).ok();
    for label in ["m_dc 0/mm ", "m_ac 0.1/mm ", "cov (m_ac 0/mm, m_ac 0.1/mm)"] {
        assert!(shown.contains(label), "{label}:\n{shown}");
    }
    let covariance = space.turbid(&["show", "p.yaml", "frames.covariance"]).ok();
    assert!(covariance.contains("cov (dc 0/mm, re 0.1/mm)"), "{covariance}");
    let frames = space.turbid(&["show", "p.yaml", "frames.frames"]).ok();
    assert!(frames.contains("radiance 0.1/mm 2.0944 rad"), "{frames}");
    for text in [&shown, &covariance, &frames] {
        assert!(!text.contains("± -") && !text.contains("0.0000"), "{text}");
    }
    // Nothing rises a thousand standard errors above the noise: the mask says why.
    let blind = ["--set", "stages.modulation.with.low_signal=1e6"];
    space.turbid(&[&["run", "p.yaml", "modulation"][..], &blind].concat()).ok();
    let shown = space.turbid(&[&["show", "p.yaml", "modulation"][..], &blind].concat()).ok();
    assert!(
        shown.contains("144 pixels signal too weak")
            && shown.contains("every pixel is masked: 144 pixels signal too weak"),
        "{shown}"
    );
}

/// Two files of one name overwrite each other's `latest`: said by the second, and by nobody once one of them is gone.
#[test]
fn pipelines_of_one_name_are_warned_of() {
    let space = Space::with(SMALL);
    counts(&space, &["tissue"]);
    space.write("q.yaml", &SMALL.replace("seed: 7", "seed: 8"));
    let warned = |file: &str| {
        let done = space.turbid(&["run", file, "tissue"]);
        done.err.contains("is a pipeline of this name too") && done.err.contains("latest/small")
    };
    assert!(!warned("p.yaml") && warned("q.yaml") && warned("p.yaml"));
    std::fs::remove_file(space.path().join("q.yaml")).expect("it is ours");
    assert!(!warned("p.yaml"));
}

/// The result that a longer run goes on from is nearer than the latest one, which another f_x made.
#[test]
fn explain_finds_the_result_that_a_run_goes_on_from() {
    let space = Space::with(SMALL);
    counts(&space, &["frames"]);
    counts(&space, &["frames", "--set", "stages.frames.with.f_x=[0, 0.2]"]);
    let explained = space.turbid(&["explain", "p.yaml", "frames", "--set", "vars.samples=32"]).ok();
    assert!(explained.contains("with.samples") && !explained.contains("with.f_x"), "{explained}");
}

/// A file that is not there: its folder is, and what it holds is named.
#[test]
fn missing_input_files_are_looked_for() {
    let space = Space::new();
    space.write("shots/s_0_0.png", "");
    space.write("shots/s_0.1_0deg.png", "");
    let pipeline = "stages: {frames: {use: import_frames, with: {pattern: 'shots/s_{f_x}_{phase}.png', f_x: [0, 0.1], phases: 3}}}";
    space.write("p.yaml", pipeline);
    let message = space.turbid(&["check", "p.yaml"]).fails(2);
    assert!(message.contains("its folder has s_0.1_0deg.png"), "{message}");
    space.write("p.yaml", &pipeline.replace("shots/", "shot/"));
    let message = space.turbid(&["check", "p.yaml"]).fails(2);
    assert!(message.contains("there is no folder"), "{message}");
}

/// Links and pictures are a service: where they cannot be renewed, a run in which nothing ran says so and ends well, and one that made results
/// ends with 1.
#[test]
fn what_people_look_at_takes_nothing_from_results() {
    let space = Space::with(SMALL);
    counts(&space, &["phantom"]);
    let latest = space.outputs().join("latest");
    std::fs::remove_dir_all(&latest).expect("it is ours");
    std::fs::write(&latest, "in the way").expect("it is ours");
    let done = space.turbid(&["run", "p.yaml", "phantom"]);
    assert!(done.code == Some(0) && done.err.contains("pictures and links were not renewed"), "{}", done.err);
    space.turbid(&["run", "p.yaml", "tissue"]).fails(1);
}

/// A file name at the limit of file systems, or of characters that no terminal shows, or that is no UTF-8.
#[cfg(unix)]
#[test]
fn any_name_of_a_pipeline_file_will_do() {
    use std::os::unix::ffi::OsStrExt;
    let space = Space::new();
    let long = "n".repeat(250) + ".yaml";
    let odd: [&[u8]; 4] = [long.as_bytes(), b"line\nbreak.yaml", b"bell\x07.yaml", b"latin-\xe9.yaml"];
    for name in odd.map(std::ffi::OsStr::from_bytes) {
        std::fs::write(space.path().join(name), SMALL).expect("the folder is ours");
        for verb in ["check", "run"] {
            let mut command = space.command(&[verb]);
            command.arg(name).args((verb == "run").then_some("tissue"));
            let done = command.output().expect("it starts");
            assert!(done.status.success(), "{verb} {name:?}: {}", String::from_utf8_lossy(&done.stderr));
        }
        std::fs::remove_dir_all(space.outputs()).expect("it is ours");
    }
}

/// More threads than any run can use are refused before anything starts, and none too.
#[test]
fn numbers_of_threads_are_bounded() {
    let space = Space::with(SMALL);
    for jobs in ["0", "100000", "1000000", "-1", "many"] {
        let message = space.turbid(&["run", "p.yaml", &format!("-j{jobs}")]).fails(2);
        assert!(message.contains("whole number from 1 to") && message.contains("without -j"), "{message}");
    }
    assert!(!space.outputs().exists());
    space.turbid(&["run", "p.yaml", "tissue", "-j", "256"]).ok();
}

/// The log of a run is a service: where it cannot be written the run says so, and all else is as always.
#[test]
fn a_log_that_cannot_be_written_ends_no_run() {
    let space = Space::with(SMALL);
    space.write("outputs/runs", "in the way");
    for _ in 0..2 {
        let done = space.turbid(&["run", "p.yaml", "tissue"]);
        assert!(done.err.contains("the log of this run could not be written: outputs/runs"), "{}", done.err);
        done.ok();
    }
    assert_eq!(space.turbid(&["run", "p.yaml", "tissue", "--json"]).json()["hits"], 1);
}
