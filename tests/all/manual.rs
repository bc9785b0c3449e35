//! The manual names what a file may say.

use std::collections::BTreeSet;
use std::path::Path;

use serde_json::Value;
use turbid::registry::Registry;

/// Names of fields, and values that can be chosen.
fn words_of(schema: &Value, words: &mut BTreeSet<String>) {
    match schema {
        Value::Object(map) => {
            for (key, value) in map {
                match (key.as_str(), value) {
                    ("properties", Value::Object(fields)) => words.extend(fields.keys().cloned()),
                    ("const", Value::String(choice)) => drop(words.insert(choice.clone())),
                    ("enum", Value::Array(choices)) => {
                        words.extend(choices.iter().filter_map(|c| c.as_str().map(str::to_owned)));
                    }
                    _ => {}
                }
                words_of(value, words);
            }
        }
        Value::Array(values) => values.iter().for_each(|value| words_of(value, words)),
        _ => {}
    }
}

#[test]
fn pipeline_files_name_every_key_of_scene_and_render() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/pipeline-files.md");
    let text = std::fs::read_to_string(page).expect("the page is there");
    let said: BTreeSet<&str> = text.split(|c: char| !c.is_alphanumeric() && c != '_').collect();
    for stage in ["scene", "render", "pattern"] {
        let mut words = BTreeSet::new();
        words_of(&(Registry::builtin().find(stage).expect("a stage").schema)(), &mut words);
        assert!(words.len() > 8, "{stage}: the schema was not understood");
        // `-x` is a direction.
        let missing: Vec<&String> = words.iter().filter(|w| !said.contains(w.trim_start_matches('-'))).collect();
        assert!(missing.is_empty(), "docs/pipeline-files.md does not name {missing:?} of {stage}");
    }
}

/// Every field says what it is or holds, no way of several is required, and each stage shows how it is written.
#[test]
fn manuals_leave_nothing_blank() {
    let space = crate::space::Space::new();
    for row in Registry::builtin().rows() {
        let manual = space.turbid(&["stages", row.name]).ok();
        // A line that ends in a colon says nothing, but for the headings.
        let fields = manual.split("\nexample:\n").next().unwrap_or_default();
        let blank = fields.lines().find(|line| line.starts_with("  ") && line.trim_end().ends_with(':'));
        assert_eq!(blank, None, "{}", row.name);
        let example = manual.split("\nexample:\n").nth(1).unwrap_or_else(|| panic!("{} has no example", row.name));
        assert!(example.contains(&format!("use: {}", row.name)), "{}: {example}", row.name);
    }
    let manual = space.turbid(&["stages", "calibrate_iad"]).ok();
    assert!(manual.contains("thickness: Thickness of the sample, > 0. (number, mm)"), "units are missing: {manual}");
    assert!(manual.contains("slides: Index and absorption"), "what a type says of itself is missing: {manual}");
    let manual = space.turbid(&["stages", "build_lut"]).ok();
    assert!(manual.contains("logspace (one of these)") && !manual.contains("logspace (required)"), "{manual}");
}
