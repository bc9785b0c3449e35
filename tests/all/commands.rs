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
