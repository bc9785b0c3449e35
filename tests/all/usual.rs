//! Slips of units are warned of, and shipped pipelines hold none.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use turbid::registry::Registry;
use turbid::spec;
use turbid_contract::serde_json::{Value, json};
use turbid_contract::{Axes, Known, Problems};

use crate::space::Space;

fn pipelines() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines");
    let mut found = Vec::new();
    for folder in [root.clone(), root.join("checks")] {
        for entry in std::fs::read_dir(folder).expect("pipelines are shipped") {
            let path = entry.expect("it was listed").path();
            found.extend(path.extension().is_some_and(|e| e == "yaml").then_some(path));
        }
    }
    found.sort();
    found
}

/// Stages that hold their params against what is usual.
const DOUBTING: [&str; 7] = ["scene", "render", "pattern", "predistort", "calibrate", "calibrate_dis", "build_lut"];

/// All scenes, renders, patterns, instruments, phantoms and tables of all pipelines, every point of their own axes: none looks as if it stood in another
/// unit.
#[test]
fn shipped_pipelines_hold_no_slip_of_a_unit() {
    let registry = Registry::builtin();
    let (mut looked, mut doubts) = (0, BTreeSet::new());
    for path in pipelines() {
        let spec = spec::load(&path, &[]).unwrap_or_else(|report| panic!("{report}"));
        for (i, stage) in spec.stages.iter_ids().filter(|(_, s)| DOUBTING.contains(&s.use_name.as_str())) {
            let row = registry.find(&stage.use_name).expect("it is built in");
            for values in &stage.foreach.rows {
                let axes: Axes = stage.foreach.names.iter().cloned().zip(values.iter().cloned()).collect();
                // Axes that come with inputs are not known here.
                let Ok(params) = spec.params(i, &axes) else { continue };
                looked += usize::from(stage.use_name == "scene");
                let mut problems = Problems::default();
                row.check(&params, &Known::default(), &mut problems);
                let (_, warnings) = problems.into_parts();
                let units = warnings.iter().filter(|w| {
                    w.hint
                        .as_ref()
                        .is_some_and(|h| h.starts_with("if another unit") || h.starts_with("lengths are in mm"))
                });
                doubts.extend(units.map(|w| format!("{}: {}: {w}", path.display(), stage.name)));
            }
        }
    }
    assert!(looked > 120, "{looked} scenes");
    assert_eq!(doubts, BTreeSet::new());
}

/// A coefficient or frequency off by 10 or 1000 in any stage that takes one gets its usual range and the way out; the same in the right unit does not.
#[test]
fn every_stage_that_takes_a_coefficient_doubts_it() {
    let registry = Registry::builtin();
    let doubts = |stage: &str, params: Value| -> Vec<String> {
        let mut problems = Problems::default();
        registry.find(stage).expect("it is built in").check(&params, &Known::default(), &mut problems);
        let told = problems.into_parts().1.into_iter().filter(|w| w.message.contains("is unusual"));
        told.map(|w| w.to_string()).collect()
    };
    let spheres = json!({"diameter": 100, "wall_reflectance": 0.98, "ports": {"entrance": {"round": {"diameter": 10}},
        "sample": {"round": {"diameter": 10}}, "detector": {"round": {"diameter": 10}, "sees": "wall"}}});
    let instrument = |medium: Value| {
        json!({"media": {"m": medium}, "spheres": spheres, "sample": {"thickness": 1, "size": [10, 10]},
            "beam": {"collimated": {"diameter": 1}}, "standard": {"reflectance": 0.99}, "samples": 1000})
    };
    let phantom =
        |mu_a: f64, mu_s_prime: f64| json!({"reference": {"mu_a": mu_a, "mu_s_prime": mu_s_prime, "g": 0.8, "n": 1.4}});
    let table = |f_x: f64, mu_a: [f64; 3], mu_s_prime: [f64; 3]| json!({"model": "diffusion", "f_x": [0, f_x], "mu_a": mu_a, "mu_s_prime": mu_s_prime, "g": 0.8, "n": 1.4});
    let (low, high) = ([0.005, 0.05, 0.5], [0.2, 1.0, 4.0]);
    for (stage, good, wrong, told) in [
        ("calibrate", phantom(0.02, 1.0), phantom(20.0, 1.0), "reference.mu_a: mu_a = 20 mm^-1 is unusual"),
        (
            "calibrate",
            phantom(0.02, 1.0),
            phantom(0.02, 10.0),
            "reference.mu_s_prime: mu_s_prime = 10 mm^-1 is unusual",
        ),
        ("pattern", json!({"f_x": [0, 0.1]}), json!({"f_x": [0, 100]}), "f_x.1: f_x = 100 mm^-1 is unusual"),
        (
            "calibrate_dis",
            instrument(json!({"A_rho": 25, "S_rho": 4236, "g": 0.8, "n": 1.0})),
            instrument(json!({"A_rho": 0.025, "S_rho": 4236, "g": 0.8, "n": 1.0})),
            "media.m.A_rho: A_rho = 0.025 m^-1 is unusual",
        ),
        (
            "calibrate_dis",
            instrument(json!({"mu_a": 0.025, "mu_s": 4.2, "g": 0.8, "n": 1.0})),
            instrument(json!({"mu_a": 25, "mu_s": 4.2, "g": 0.8, "n": 1.0})),
            "media.m.mu_a: mu_a = 25 mm^-1 is unusual",
        ),
        ("build_lut", table(0.1, low, high), table(100.0, low, high), "f_x.1: f_x = 100 mm^-1 is unusual"),
        (
            "build_lut",
            table(0.1, low, high),
            table(0.1, [5.0, 50.0, 500.0], high),
            "mu_a.1: mu_a = 50 mm^-1 is unusual",
        ),
        ("build_lut", table(0.1, low, high), table(0.1, low, [2.0, 10.0, 40.0]), "mu_s_prime.1: mu_s_prime = 10 mm^-1"),
    ] {
        assert_eq!(doubts(stage, good), Vec::<String>::new(), "{stage}");
        let said = doubts(stage, wrong);
        assert!(
            said.len() == 1 && said[0].starts_with(told) && said[0].contains("if another unit is meant"),
            "{stage}: {said:?}"
        );
    }
}

/// One warning with place, range and unit, of a sweep the worst; `run` tells the way out too.
#[test]
fn a_slip_is_told_once_by_check_and_by_run() {
    let text = crate::space::SMALL.replacen("A_rho: 50,", "A_rho: \"${a}\",", 1);
    let space =
        Space::with(&text.replacen("    use: scene\n", "    use: scene\n    foreach: {a: [0.05, 0.1, 50]}\n", 1));
    let told = space.turbid(&["check", "p.yaml"]).ok();
    let message =
        "stages.tissue.with.media.m.A_rho: A_rho = 0.05 m^-1 is unusual: tissue and phantoms have 0.3 to 1000 m^-1";
    assert_eq!(told.matches("is unusual").count(), 1, "{told}");
    for part in [
        message,
        "(the largest of 2 instances)",
        "= help: if another unit is meant, write it: `0.05 cm^-1` or `0.05 mm^-1`",
    ] {
        assert!(told.contains(part), "{part}\n{told}");
    }
    let run = space.turbid(&["run", "p.yaml", "tissue"]);
    assert!(run.err.contains("(if another unit is meant, write it: `0.05 cm^-1`"), "{}{}", run.out, run.err);
}
