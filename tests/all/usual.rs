//! Slips of units are warned of, and shipped pipelines hold none.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use turbid::registry::Registry;
use turbid::spec;
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

/// All scenes and renders of all pipelines, every point of their own axes: none looks as if it stood in another unit.
#[test]
fn shipped_pipelines_hold_no_slip_of_a_unit() {
    let registry = Registry::builtin();
    let (mut looked, mut doubts) = (0, BTreeSet::new());
    for path in pipelines() {
        let spec = spec::load(&path, &[]).unwrap_or_else(|report| panic!("{report}"));
        for (i, stage) in spec.stages.iter_ids().filter(|(_, s)| ["scene", "render"].contains(&s.use_name.as_str())) {
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
