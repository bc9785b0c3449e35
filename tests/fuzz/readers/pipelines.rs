//! Pipeline files: with what they include, vars, axes, and tables of values; up to what `turbid check` says of them.

use std::fs;
use std::path::Path;

use turbid::plan::Plan;
use turbid::registry::Registry;
use turbid::resolve::Resolver;
use turbid::spec;
use turbid::store::Store;

use super::{Reader, Seen, no_more, nothing};
use crate::files::{self, Entry, What};
use crate::mutate::Form;

/// Pipelines of more instances are planned, not checked: each of them takes its time, and all are read alike.
const CHECKED: usize = 200;
/// Bytes of the plan of an instance.
const INSTANCE: usize = 2048;
/// What checks of stages make of a scene, whatever the size of the pipeline: shapes in cells, fields of view.
const CHECK: usize = 8 << 20;

pub fn readers() -> Vec<Reader> {
    vec![
        Reader { name: "pipeline", form: Form::Texts, share: 8, claims: nothing, seeds: shipped, read, law: no_more },
        Reader { name: "foreach", form: Form::Texts, share: 4, claims: nothing, seeds: swept, read, law: no_more },
    ]
}

fn of(texts: &[(&str, &[u8])]) -> Vec<u8> {
    let entry = |(name, text): &(&str, &[u8])| Entry { name: (*name).to_owned(), what: What::File(text.to_vec()) };
    files::join(&texts.iter().map(entry).collect::<Vec<_>>())
}

/// The pipelines that are shipped, each with the files that it names.
fn shipped() -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines");
    let mut texts = Vec::new();
    for folder in [folder.join("checks"), folder] {
        for entry in fs::read_dir(folder).expect("pipelines are shipped").flatten() {
            let path = entry.path();
            if path.extension().is_some_and(|e| e == "yaml") {
                texts.push((path.clone(), fs::read(&path).expect("the file is ours")));
            }
        }
    }
    texts.sort();
    texts
        .into_iter()
        .filter_map(|(path, text)| Some(of_shipped(&path, &text)).filter(|i| read(i).is_ok_and(|s| s.taken)))
        .collect()
}

/// A pipeline beside the small files of its `data` that it names.
fn of_shipped(path: &Path, text: &[u8]) -> Vec<u8> {
    let folder = path.parent().expect("it lies in a folder");
    let mut entries = vec![Entry { name: "p.yaml".to_owned(), what: What::File(text.to_vec()) }];
    let text = String::from_utf8_lossy(text);
    for word in text.split(|c: char| c.is_whitespace() || ",\"'{}[]".contains(c)) {
        let named = entries.iter().any(|e| e.name == word);
        if word.contains('.')
            && !named
            && let Ok(bytes) = fs::read(folder.join(word))
        {
            entries.push(Entry { name: word.to_owned(), what: What::File(bytes) });
        }
    }
    files::join(&entries)
}

fn swept() -> Vec<Vec<u8>> {
    vec![
        of(&[("p.yaml", INCLUDES.as_bytes()), ("base.yaml", BASE.as_bytes()), ("points.csv", POINTS.as_bytes())]),
        of(&[("p.yaml", SPACINGS.as_bytes())]),
    ]
}

fn read(input: &[u8]) -> Result<Seen, String> {
    let folder = tempfile::tempdir().map_err(|e| e.to_string())?;
    files::write(folder.path(), &files::split(input)).map_err(|e| format!("the input cannot be written: {e}"))?;
    let (spec, report) = spec::read(&folder.path().join("p.yaml"), &[]);
    // What is shown to the user is made from any mistakes, too.
    drop((report.to_string(), report.to_json()));
    let refused = Ok(Seen::as_large(false, input));
    let Some(spec) = spec else { return refused };
    let plan = match Plan::build(spec, report, &Registry::builtin(), &[]) {
        Ok(plan) => plan,
        Err(report) => {
            drop((report.to_string(), report.to_json()));
            return refused;
        }
    };
    let instances = plan.instances().len();
    let mut taken = true;
    if instances <= CHECKED {
        let store = Store::open_read_only(folder.path()).map_err(|e| e.to_string())?;
        let survey = Resolver::new(&plan, &store).survey(&[]);
        taken = !spec::Report::from(survey.problems).has_errors();
    }
    Ok(Seen { taken, decoded: input.len() + INSTANCE * instances + CHECK })
}

const BASE: &str = "\
vars: {samples: 64, f: [0, 0.1], p: &p {field: [32, 32], power: 5}}
stages:
  slab:
    use: scene
    with:
      media: {m: {mu_a: \"${mu_a}\", mu_s_prime: 1, g: 0.8, n: 1.0}}
      objects: {s: {slab: {thickness: 10 cm, top: 0}, medium: m}}
      camera: {position: [0, 0, 500], look_at: [0, 0, 0], field: [8, 8], pixels: [8, 8]}
      projector: {<<: *p, position: [35, 0, 500], look_at: [0, 0, 0]}
";

const INCLUDES: &str = "\
pipeline: swept
about: |
  Two lines
  of text
seed: 7
include: base.yaml
vars: {samples: 16, twice: \"${samples}\"}
stages:
  slab:
    foreach: {csv: points.csv, k: [a, b]}
  frames:
    use: render
    in: {scene: slab}
    seed: {common: 3}
    with: {f_x: \"${f}\", phases: 3, samples: \"${twice}\"}
  some:
    use: demodulate
    in: {frames: {from: frames, where: {k: a}}}
studies:
  s: {vary: {stages.frames.with.samples: [16, 32]}, estimate: some, error: rmse_percent}
";

const POINTS: &str = "# measured\nmu_a, name, n\n0.01,\"a, \"\"b\"\"\",1.0\n\n1e-3,\"2\",1.4\n0.1,x,true\n";

const SPACINGS: &str = "\
pipeline: spacings
stages:
  slab:
    use: scene
    foreach:
      mu_a: {logspace: [0.001, 0.1, 3]}
      a: {linspace: [0, 1, 2]}
      b: {range: [0, 2]}
      zip: [[a, b]]
    with:
      media: {m: {mu_a: \"${mu_a}\", mu_s_prime: 1, g: 0.8, n: 1.0}}
      objects: {s: {slab: {thickness: 100, top: 0}, medium: m}}
      camera: {position: [0, 0, 500], look_at: [0, 0, 0], field: [8, 8], pixels: [8, 8]}
      projector: {position: [35, 0, 500], look_at: [0, 0, 0], field: [32, 32], power: 5}
";
