//! `docs/payloads.md` against what stages make: every layer and column of small runs stands there, with its unit.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::Value;
use turbid::registry::Registry;
use turbid_contract::payload::MaskReason;

use super::{pages, root};
use crate::space::Space;

/// Names of a payload's layers or columns, each with its unit.
type Rows = BTreeMap<String, String>;

/// The tables of the page, by payload.
fn described() -> BTreeMap<String, Rows> {
    let text = std::fs::read_to_string(root().join("docs/payloads.md")).expect("the page is there");
    let mut found: BTreeMap<String, Rows> = BTreeMap::new();
    for section in text.split("\n## ").skip(1) {
        let (name, rest) = section.split_once('\n').expect("a heading is a line");
        let rows = found.entry(name.to_owned()).or_default();
        for line in rest.lines().filter(|line| line.starts_with("| `")) {
            let cells: Vec<&str> = line.split('|').map(str::trim).collect();
            let names = cells[1].split('`').skip(1).step_by(2);
            rows.extend(names.map(|name| (name.to_owned(), cells[2].to_owned())));
        }
    }
    found
}

/// Whether a table that says `said` fits the unit `is`.
fn fits(said: &str, is: &str) -> bool {
    // These say in words what depends on the frames or on the quantity.
    let in_words = ["unit of the input", "square of the unit", "square of the unit, mm^-2", "own unit"];
    in_words.contains(&said) || said == is
}

/// Every payload that a port holds has a section, and every stage's ports name payloads that have one.
#[test]
fn every_payload_is_described() {
    let described = described();
    for row in Registry::builtin().rows() {
        for payload in (row.outputs)().iter().map(|port| port.payload) {
            assert!(described.contains_key(payload), "docs/payloads.md has no section {payload} ({})", row.name);
        }
    }
}

/// Most stages, with all that they can make, as small as they go.
const SMALL: &str = "\
pipeline: small
stages:
  tissue:
    use: scene
    with: &scene
      media: {m: {mu_a: 0.1, mu_s_prime: 1, g: 0.8, n: 1.0}}
      objects: {block: {slab: {thickness: 100, top: 0}, medium: m}}
      camera: {position: [0, 0, 500], look_at: [0, 0, 0], field: [40, 40], pixels: [8, 8]}
      projector: {position: [35, 0, 500], look_at: [0, 0, 0], field: [320, 320], power: 5, pixels: [64, 64]}
  phantom: {use: scene, with: *scene}
  shown: {use: pattern, in: {scene: tissue}, with: {f_x: [0.05], phases: 3}}
  shots: {use: render, in: {scene: tissue, pattern: shown}, with: {samples: 64}}
  frames: {use: render, in: {scene: tissue}, with: {f_x: [0, 0.1], phases: 3, samples: 256, photons: 1000}}
  phantom_frames: {use: render, in: {scene: phantom}, with: {f_x: [0, 0.1], phases: 3, samples: 256}}
  modulation: {use: demodulate, in: {frames: frames, covariance: frames.covariance}}
  phantom_modulation: {use: demodulate, in: {frames: phantom_frames, covariance: phantom_frames.covariance}}
  reflectance:
    use: calibrate
    in: {sample: modulation, reference: phantom_modulation}
    with: {reference: {mu_a: 0.1, mu_s_prime: 1, g: 0.8, n: 1.0}, model: diffusion, convention: camera}
  table:
    use: build_lut
    with: {model: diffusion, f_x: [0, 0.1], mu_a: {logspace: [0.02, 0.4, 16]}, mu_s_prime: {logspace: [0.3, 3, 16]}, g: 0.8, n: 1.0, convention: camera}
  maps:
    use: invert
    in: {reflectance: reflectance, lut: table, height: frames.truth, scene: tissue}
  metrics: {use: compare, in: {estimate: maps, truth: frames.truth}}
  means: {use: summarize, in: {metrics: [metrics]}}
  levels: {use: tabulate, in: {values: frames}}
  height: {use: profilometry, in: {sample: modulation.phase, scene: tissue}, with: {f_x: 0.1, heights: [-1, 1]}}
  seen: {use: sensor, in: {frames: frames}, with: {bits: 12, full_well: 10000}}
  readings:
    use: calibrate_dis
    with:
      media: {m: {mu_a: 0.05, mu_s_prime: 1, g: 0.8, n: 1.0}}
      spheres:
        diameter: 100
        wall_reflectance: 0.98
        ports: {entrance: {round: {diameter: 10}}, sample: {round: {diameter: 10}}, detector: {round: {diameter: 10}}}
      sample: {thickness: 1}
      beam: {collimated: {diameter: 1}}
      standard: {reflectance: 0.99}
      samples: 2000
  fit: {use: calibrate_iad, in: {readings: readings}}
  scores: {use: compare, in: {estimate: fit, truth: readings}}
";

/// What the runs make stands in the page, with the unit that it has.
#[test]
fn layers_and_columns_are_as_described() {
    let space = Space::with(SMALL);
    let registry = Registry::builtin();
    let file: Value = serde_yaml::from_str(SMALL).expect("it is YAML");
    // All ports of all stages, those that nobody takes too.
    let ports = |(name, stage): (&String, &Value)| -> Vec<String> {
        let row = registry.find(stage["use"].as_str().expect("a kind")).expect("a stage");
        (row.outputs)().iter().map(|port| format!("{name}.{}", port.name)).collect()
    };
    let stages = file["stages"].as_object().expect("a map");
    // These need phantoms.
    let wanted: Vec<String> = stages.iter().flat_map(ports).filter(|port| port != "table.design").collect();
    let mut arguments = vec!["run", "p.yaml"];
    arguments.extend(wanted.iter().map(String::as_str));
    space.turbid(&arguments).ok();
    let (described, mut seen, mut wrong) = (described(), BTreeSet::new(), BTreeSet::new());
    let shown = space.turbid(&["show", "p.yaml", "--json"]).json();
    for instance in shown["instances"].as_array().expect("a list") {
        for port in instance["ports"].as_object().expect("a map").values() {
            let payload = port["payload"].as_str().expect("a name");
            seen.insert(payload.to_owned());
            let rows = &described[payload];
            for part in ["layers", "columns"].iter().flat_map(|which| port[which].as_array().into_iter().flatten()) {
                let [name, unit] = ["name", "unit"].map(|key| part[key].as_str().unwrap_or_default());
                // A column for each axis.
                let known = rows.get(name).is_some_and(|said| fits(said, unit)) || name.starts_with("axis ");
                if !known {
                    wrong.insert(format!("{payload}: `{name}` has the unit `{unit}`, not {:?}", rows.get(name)));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "docs/payloads.md: {wrong:#?}");
    let unseen: Vec<&String> = described.keys().filter(|payload| !seen.contains(*payload)).collect();
    assert_eq!(
        unseen,
        ["concentrations", "design", "sections", "transfer", "wavelengths"],
        "payloads that no small run makes"
    );
}

/// The table of masks has every reason under its number.
#[test]
fn masks_are_explained() {
    let pages = pages();
    let page = pages.iter().find(|page| page.name == "docs/concepts.md").expect("the page is there");
    for reason in MaskReason::ALL {
        let row = format!("| {} | {} |", reason.code(), reason.text());
        assert!(page.text.contains(&row), "docs/concepts.md has no row `{row}`");
    }
}
