//! Stages that do not go together, a pipeline for each kind: found by `check`, at the place of the consumer, with the producer's name, both values and
//! what to do about it.

use crate::space::Space;

/// A chain from two arms to maps, and beside it what a wrong joint takes instead.
const CHAIN: &str = "\
pipeline: chain
stages:
  rig:
    use: scene
    with:
      camera: {position: [0, 0, 500], look_at: [0, 0, 0], field: [12, 12], pixels: [12, 12]}
      projector: {position: [0, 35, 500], look_at: [0, 0, 0], field: [48, 48], power: 5}
  other_rig:
    use: scene
    with:
      camera: {position: [0, 0, 500], look_at: [0, 0, 0], field: [12, 12], pixels: [16, 16]}
      projector: {position: [0, 35, 500], look_at: [0, 0, 0], field: [48, 48], power: 6}
  tissue:
    use: scene
    in: {rig: rig}
    with: &block
      media: {m: {mu_a: 0.05, mu_s_prime: 1.2, g: 0.8, n: 1.0}}
      objects: {block: {slab: {thickness: 2000, top: 0}, medium: m}}
  phantom: {use: scene, in: {rig: rig}, with: *block}
  elsewhere: {use: scene, in: {rig: other_rig}, with: *block}
  frames: {use: render, in: {scene: tissue}, with: {f_x: [0, 0.1], phases: 3, samples: 64}}
  phantom_frames: {use: render, in: {scene: phantom}, with: {f_x: [0, 0.1], phases: 3, samples: 64}}
  other_frames: {use: render, in: {scene: elsewhere}, with: {f_x: [0, 0.1], phases: 3, samples: 64}}
  modulation: {use: demodulate, in: {frames: frames, covariance: frames.covariance}}
  phantom_modulation: {use: demodulate, in: {frames: phantom_frames, covariance: phantom_frames.covariance}}
  other_modulation: {use: demodulate, in: {frames: other_frames, covariance: other_frames.covariance}}
  reflectance:
    use: calibrate
    in: {sample: modulation, reference: phantom_modulation}
    with: {reference: {mu_a: 0.05, mu_s_prime: 1.2, g: 0.8, n: 1.0}, model: diffusion}
  table:
    use: build_lut
    with: {model: diffusion, f_x: [0, 0.1], g: 0.8, n: 1.0, mu_a: [0.01, 0.1], mu_s_prime: [0.5, 2]}
  maps: {use: invert, in: {reflectance: reflectance, lut: table}}
  metrics: {use: compare, in: {estimate: maps, truth: frames.truth}}
  camera: {use: sensor, in: {frames: frames, covariance: frames.covariance}, with: {bits: 12}}
  seen: {use: demodulate, in: {frames: camera, covariance: camera.covariance}}
  levels: {use: tabulate, in: {values: frames, minus: phantom_frames}}
  summary: {use: summarize, in: {metrics: metrics}}
";

/// Overrides, where the mistake stands, and what it says.
const WRONG: [(&str, &[&str], &str, &[&str]); 13] = [
    (
        "convention",
        &["stages.table.with.convention=hemispherical_entered"],
        "stages.maps.in.lut",
        &["`table.lut`", "\"camera\"", "\"hemispherical_entered\""],
    ),
    ("g", &["stages.table.with.g=0.9"], "stages.maps.in.lut", &["`table.lut`", "g = 0.8", "g = 0.9"]),
    ("n", &["stages.table.with.n=1.4"], "stages.maps.in.lut", &["`table.lut`", "n = 1.0", "n = 1.4"]),
    (
        "f_x of table and frames",
        &["stages.table.with.f_x=[0, 0.2]"],
        "stages.maps.in.lut",
        &["`table.lut`", "f_x = 0, 0.2 mm^-1", "needs 0.1"],
    ),
    (
        "f_x of the arms",
        &["stages.phantom_frames.with.f_x=[0, 0.2]"],
        "stages.reflectance.in.reference",
        &["`phantom_modulation.modulation`", "f_x = 0.1 mm^-1", "f_x = 0.2 mm^-1"],
    ),
    (
        "orientation",
        &["stages.phantom_frames.with.orientation_deg=[90]"],
        "stages.reflectance.in.reference",
        &["`phantom_modulation.modulation`", "0 deg", "90 deg"],
    ),
    (
        "wavelength",
        &[
            "stages.other_rig.with.camera.pixels=[12, 12]",
            "stages.rig.with.wavelength_nm=[650]",
            "stages.reflectance.in.reference=other_modulation",
            "stages.reflectance.with.rigs=may_differ",
        ],
        "stages.reflectance.in.reference",
        &["`other_modulation.modulation`", "650 nm"],
    ),
    (
        "size",
        &["stages.metrics.in.truth=other_frames.truth"],
        "stages.metrics.in.truth",
        &["`other_frames.truth`", "12 x 12 pixels", "16 x 16 pixels"],
    ),
    (
        "rig",
        &["stages.other_rig.with.camera.pixels=[12, 12]", "stages.reflectance.in.reference=other_modulation"],
        "stages.reflectance.in.reference",
        &["other_modulation", "5 W", "6 W", "may_differ"],
    ),
    (
        "covariance of other frames",
        &["stages.modulation.in.covariance=other_frames.covariance"],
        "stages.modulation.in.covariance",
        &["`other_frames.covariance`", "12 x 12", "16 x 16"],
    ),
    (
        "unit of the covariance",
        &["stages.seen.in.frames=camera.numbers"],
        "stages.seen.in.covariance",
        &["`camera.covariance`", "`camera.numbers`", "W^2 mm^-4 sr^-2", "the frames are in 1"],
    ),
    (
        "unit of what is subtracted",
        &["stages.levels.in.minus=camera.numbers"],
        "stages.levels.in.minus",
        &["`camera.numbers`", "`frames.frames`", "is in 1 here", "in W mm^-2 sr^-1 on the port `values`"],
    ),
    (
        "a table that is no comparison",
        &["stages.summary.in.metrics=levels"],
        "stages.summary.in.metrics",
        &["`levels.metrics`", "no column `truth`", "`compare`"],
    ),
];

/// Joints that can be read but are probably not meant: overrides, where it is said, and the words.
const DOUBTFUL: [(&str, &[&str], &str, &[&str]); 2] = [
    (
        "truth of another rig",
        &["stages.other_rig.with.camera.pixels=[12, 12]", "stages.metrics.in.truth=other_frames.truth"],
        "stages.metrics.in.truth",
        &["`maps.maps` and `other_frames.truth`", "5 W against 6 W", "of the render"],
    ),
    (
        "a covariance that is not read",
        &[
            "stages.rig.with.camera.pixels=[16, 16]",
            "stages.seen.with.method=single_shot",
            "stages.seen.with.pixel_mm=3",
        ],
        "stages.seen.in.covariance",
        &["`camera.covariance` is not read", "`method: single_shot`", "phase_shift"],
    ),
];

#[test]
fn doubtful_joints_are_warned_of() {
    let fine = CHAIN.replacen(
        "{frames: camera, covariance: camera.covariance}}",
        "{frames: camera, covariance: camera.covariance}, with: {low_signal: 3}}",
        1,
    );
    let space = Space::with(&fine);
    for (kind, overrides, path, parts) in DOUBTFUL {
        let sets: Vec<&str> = overrides.iter().flat_map(|set| ["--set", set]).collect();
        let said = space.turbid(&[&["check", "p.yaml", "--json"][..], &sets].concat()).ok();
        let all: serde_json::Value = serde_json::from_str(&said).expect("JSON");
        let found = all.as_array().expect("a list").iter().find(|problem| problem["path"] == path);
        let found = found.unwrap_or_else(|| panic!("{kind}: nothing at {path}: {all:#}"));
        let text =
            format!("{} {}", found["message"].as_str().unwrap_or_default(), found["hint"].as_str().unwrap_or_default());
        parts.iter().for_each(|part| assert!(text.contains(part), "{kind}: `{part}` is not in {text}"));
        assert!(found["severity"] == "warning" && found["line"].as_u64() >= Some(1), "{kind}: {found}");
        // A plan tells what a check does.
        let planned = space.turbid(&[&["plan", "p.yaml"][..], &sets].concat());
        assert!(planned.err.contains(parts[0]) && planned.err.contains("warning: "), "{kind}: {}", planned.err);
        planned.ok();
    }
}

#[test]
fn stages_that_do_not_go_together_are_named() {
    let space = Space::with(CHAIN);
    space.turbid(&["check", "p.yaml"]).ok();
    for (kind, overrides, path, parts) in WRONG {
        let sets: Vec<&str> = overrides.iter().flat_map(|set| ["--set", set]).collect();
        let said = space.turbid(&[&["check", "p.yaml", "--json"][..], &sets].concat());
        assert_eq!(said.code, Some(2), "{kind}: {}", said.err);
        let all: serde_json::Value = serde_json::from_str(&said.out).expect("JSON");
        let errors: Vec<_> =
            all.as_array().expect("a list").iter().filter(|problem| problem["severity"] == "error").collect();
        let found = errors.iter().find(|error| error["path"] == path);
        let found = found.unwrap_or_else(|| panic!("{kind}: nothing at {path}: {errors:#?}"));
        let text =
            format!("{} {}", found["message"].as_str().unwrap_or_default(), found["hint"].as_str().unwrap_or_default());
        for part in parts {
            assert!(text.contains(part), "{kind}: `{part}` is not in {text}");
        }
        assert!(found["hint"].is_string() && found["line"].as_u64() >= Some(1), "{kind}: {found}");
    }
}
