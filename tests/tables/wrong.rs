//! Mistakes: each has a place and a way out, and most are found before anything is computed.

use crate::space::{PIPELINE, Space};

/// Exit code and words of a build of the pipeline with `from` in place of `to`; nothing is written where `before` says so.
fn refused(from: &str, to: &str, words: &[&str], before: bool) {
    assert!(PIPELINE.contains(from), "{from}");
    let space = Space::with(&PIPELINE.replacen(from, to, 1));
    let said = space.turbid(&["dataset", "build", "p.yaml", "--to", "set"]).fails(2);
    for word in words {
        assert!(said.contains(word), "`{to}` should say `{word}`:\n{said}");
    }
    assert!(said.contains("p.yaml:"), "`{to}` has a place:\n{said}");
    if before {
        assert!(
            !space.path("set").exists() && !space.path("outputs/latest").exists(),
            "`{to}` is found before anything runs"
        );
    }
}

#[test]
fn mistakes_in_the_file_have_a_place() {
    let mu_a = "mu_a: frames.truth.mu_a";
    refused(mu_a, "mu_a: frame.truth.mu_a", &["there is no stage `frame`", "did you mean `frames`?"], true);
    refused(mu_a, "mu_a: frames.truths.mu_a", &["has no output `truths`", "truth"], true);
    refused(mu_a, "mu_a: frames.truth.mua", &["there are", "mu_a"], true);
    refused(mu_a, "draw: frames.truth.mu_a", &["`draw` is a column of every data set already"], true);
    refused("f_x: 0.1, phase: 0", "f_x: 0.3, phase: 0", &["there are", "f_x 0.1 mm^-1"], true);
    refused("test: 0.5,", "test: 0.4,", &["train 0.5, test 0.4", "must sum to 1"], true);
    refused("test: 0.5,", "test: -0.5,", &["must lie in (0, 1]"], true);
    refused("by: patient", "by: width", &["`width` is no group", "patient"], true);
    refused("[[lesion_a, above, 0.15]]", "[[lesion, above, 0.15]]", &["`lesion` is not drawn", "lesion_a"], true);
    refused("shards: {rows: 4}", "shards: {rows: 0}", &["must lie in 1..1000000"], true);
    refused("license: CC-BY-4.0", "published: 31.3.2026", &["published", "a day, such as \"2026-03-31\""], true);
    refused("shards: {rows: 4}", "keep: {map.masked: {below: 5}}", &["there is no stage `map`", "`maps`"], true);
    refused("shards: {rows: 4}", "keep: {maps.masked: {under: 5}}", &["under", "below"], true);
    let table = "  table: {use: build_lut, with: {model: diffusion, f_x: [0, 0.05], g: 0.8, n: 1.0}}\n";
    refused(
        "datasets:\n  spots:\n",
        &format!("{table}datasets:\n  spots:\n    keep: {{table.lut.g: {{below: 1}}}}\n"),
        &["`table` is the same for all samples"],
        true,
    );
    refused(
        "width: {uniform: [4, 8], per: patient}",
        "width: {uniform: [4, 8]}\n        split: {uniform: [0, 1]}",
        &["`split` is a column"],
        true,
    );
    refused("only: [[lesion_a, below, 0.25]]", "only: [[lesion_a, below, 0.001]]", &["lesion_a, below, 0.001"], true);
}

/// What only results can tell.
#[test]
fn mistakes_that_results_tell_have_a_place() {
    refused("shards: {rows: 4}", "keep: {maps.mask: {below: 5}}", &["`maps` has no measure `mask`", "it has"], false);
    refused(
        "shards: {rows: 4}",
        "keep: {maps.masked: {below: -1}}",
        &["every sample is left out", "keep: maps.masked", "widen"],
        false,
    );
    let pixels = "pixels: [6, 6]";
    let vary = PIPELINE
        .replace("width: {uniform: [4, 8], per: patient}", "width: {uniform: [4, 8]}\n        k: {integer: [5, 7]}");
    let space = Space::with(&vary.replace(pixels, "pixels: [6, \"${k}\"]"));
    let said = space.turbid(&["dataset", "build", "p.yaml", "--to", "set"]).fails(2);
    assert!(
        said.contains("p.yaml:") && said.contains("differs between samples: 1 x ") && said.contains("draw none"),
        "{said}"
    );
}

#[test]
fn folders_of_others_are_left_alone() {
    let space = Space::with(PIPELINE);
    std::fs::create_dir(space.path("photos")).expect("the folder is ours");
    space.write("photos/a.txt", "mine");
    let said = space.turbid(&["dataset", "build", "p.yaml", "--to", "photos"]).fails(2);
    assert!(said.contains("holds no data set; choose another folder"), "{said}");
    let said = space.turbid(&["dataset", "build", "p.yaml", "--to", "p.yaml"]).fails(2);
    assert!(said.contains("is no folder"), "{said}");
    space.build("set", &["--set", "vars.n=4"]);
    space.write("p.yaml", PIPELINE.replace("spots:", "others:"));
    for command in ["build", "verify", "stats"] {
        let said = space.turbid(&["dataset", command, "p.yaml", "--to", "set"]).fails(2);
        assert!(said.contains("holds the data set `spots` of pipeline `drawn`, not `others`"), "{command}: {said}");
    }
    let said = space.turbid(&["dataset", "verify", "p.yaml", "--to", "photos"]).fails(2);
    assert!(said.contains("holds no data set"), "{said}");
    let said = space.turbid(&["dataset", "build", "p.yaml", "spots", "--to", "set"]).fails(2);
    assert!(said.contains("there is no data set `spots`") && said.contains("others"), "{said}");
}
