//! What a run states at its end, and that the documents state nothing else.

use std::collections::BTreeSet;

use crate::record::{Record, of_output, page, pipeline_file, recipe_now, root, rows};
use crate::space::Space;

const RENEW: &str = "`cargo bench --bench figures -- NAME` runs it and renews docs/figures and docs/validation.md";

/// Every figure and run time of the table of pipelines stands in the recorded end of a run of that pipeline.
#[test]
fn the_table_states_what_runs_state() {
    let rows = rows(&page());
    assert!(rows.iter().filter(|row| !row.line.is_empty()).count() > 20, "the table was not understood");
    let mut wrong = Vec::new();
    for row in &rows {
        let name = &row.pipeline;
        match Record::read(name) {
            Err(message) => wrong.push(format!("{message}; {RENEW}")),
            Ok(record) => {
                if !row.named.is_empty() && row.run_time != record.run_time() {
                    wrong.push(format!("{name}: {} in the table, {} in the record", row.run_time, record.run_time()));
                }
                match record.figures(&row.line) {
                    _ if row.line.is_empty() => {}
                    Err(message) => wrong.push(format!("{name}: {message}")),
                    Ok(figures) if figures != row.figures => {
                        let line = row.line.join(" ");
                        wrong
                            .push(format!("{name}, {line}: {:?} in the table, {figures:?} in the record", row.figures));
                    }
                    Ok(_) => {}
                }
            }
        }
    }
    wrong.dedup();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// The run times that the README gives beside its commands are the recorded ones.
#[test]
fn the_readme_gives_recorded_run_times() {
    let text = std::fs::read_to_string(root().join("README.md")).expect("the README is there");
    let mut stated = 0;
    for line in text.lines().filter_map(|line| line.strip_prefix("turbid run pipelines/")) {
        let Some((name, comment)) = line.split_once(".yaml") else { panic!("{line}") };
        let Some(time) = comment.strip_suffix(" CPU s").and_then(|said| said.split_whitespace().last()) else {
            continue;
        };
        let record = Record::read(name).unwrap_or_else(|message| panic!("{message}; {RENEW}"));
        assert_eq!(format!("{time} s"), record.run_time(), "README: {name}");
        stated += 1;
    }
    assert!(stated > 5, "the commands were not understood");
}

/// So are those of the comments that the pipelines begin with.
#[test]
fn the_pipelines_give_recorded_run_times() {
    let names: BTreeSet<String> = rows(&page()).into_iter().map(|row| row.pipeline).collect();
    let mut stated = 0;
    for name in &names {
        let text = std::fs::read_to_string(pipeline_file(name)).expect("a shipped pipeline");
        let Some(said) = text.lines().find_map(|line| line.strip_prefix("# Run time: ")) else { continue };
        let Some((number, _)) = said.split_once(" CPU s") else {
            assert_eq!(said, "below 1 s.", "{name}");
            continue;
        };
        let record = Record::read(name).unwrap_or_else(|message| panic!("{message}; {RENEW}"));
        assert_eq!(format!("{number} s"), record.run_time(), "{name}.yaml");
        stated += 1;
    }
    assert!(stated > 15, "the comments were not understood");
}

/// A pipeline, a VERSION or an input file that changed since the record was made shows.
#[test]
fn recorded_runs_are_of_the_pipelines_as_they_are() {
    let names: BTreeSet<String> = rows(&page()).into_iter().map(|row| row.pipeline).collect();
    let stale: Vec<String> = names
        .into_iter()
        .filter(|name| Record::read(name).map(|record| record.recipe).ok() != Some(recipe_now(name)))
        .collect();
    assert!(stale.is_empty(), "recorded with other stages or params: {}; {RENEW}", stale.join(", "));
}

/// The cheapest of them, run: the end of the run is the record, and the grey levels are 255 exp(-2 mu_a d).
#[test]
fn a_run_ends_with_its_record() {
    let name = "thickness_check";
    let file = pipeline_file(name);
    let space = Space::new();
    let out = space.turbid(&["run", file.to_str().expect("UTF-8")]).ok();
    let now = Record::parse(&of_output(&recipe_now(name), &out)).expect("a record");
    let recorded = Record::read(name).unwrap_or_else(|message| panic!("{message}; {RENEW}"));
    assert_eq!((now.lines, now.recipe), (recorded.lines.clone(), recorded.recipe));
    for (density, mu_a) in [("0.5", 0.5e-3), ("1", 1e-3), ("1.5", 1.5e-3)] {
        let at = format!("A_rho={density},S_rho=0");
        let line = recorded.lines.iter().find(|l| l[0] == "levels" && l[1] == at).unwrap_or_else(|| panic!("{at}"));
        let number = |text: &str| text.trim_matches(['(', ')']).parse::<f64>().expect("a number");
        let (mean, se) = line[3].split_once(' ').expect("a standard error");
        // Rounded to a digit of the error: half of it more.
        let off = number(mean) - 255.0 * (-2.0 * mu_a * 2000.0_f64).exp();
        assert!(off.abs() < 5.0 * number(se), "{line:?}: {off}");
    }
}

/// Stages that a summary takes leave the stage to it; a table of many lines shows the region `all`; programs get every column.
#[test]
fn figures_are_events_too() {
    let file = pipeline_file("iad_phantom");
    let space = Space::new();
    let out = space.turbid(&["run", file.to_str().expect("UTF-8")]).ok();
    assert!(out.contains("these results took"), "{out}");
    let space = Space::with(SMALL_METRICS);
    let out = space.turbid(&["run", "p.yaml"]).ok();
    let lines: Vec<&str> = out.lines().filter(|line| line.starts_with("metrics ")).collect();
    assert!(lines.iter().any(|l| l.contains("block") && l.contains("mu_a")), "{out}");
    let events = space.turbid(&["run", "p.yaml", "--json"]).ok();
    let event = events.lines().find(|l| l.contains(r#""event":"figures""#)).unwrap_or_else(|| panic!("{events}"));
    for column in ["bias_percent", "rmse_percent", "masked_percent", "mean_se", "\"stage\":\"metrics\""] {
        assert!(event.contains(column), "{event}");
    }
    assert!(events.lines().last().is_some_and(|l| l.contains("finished")), "{events}");
}

/// Maps against the truth, few pixels.
const SMALL_METRICS: &str = "\
pipeline: small_metrics
stages:
  tissue:
    use: scene
    with: &scene
      media: {m: {mu_a: 0.1, mu_s_prime: 1, g: 0.8, n: 1.0}}
      objects: {block: {slab: {thickness: 2000, top: 0}, medium: m}}
      camera: {position: [0, 0, 500], look_at: [0, 0, 0], field: [40, 40], pixels: [8, 8]}
      projector: {position: [0, 35, 500], look_at: [0, 0, 0], field: [320, 320], power: 5}
  phantom: {use: scene, with: *scene}
  frames: {use: render, in: {scene: tissue}, with: {f_x: [0, 0.1], phases: 3, samples: 256}}
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
  maps: {use: invert, in: {reflectance: reflectance, lut: table}}
  metrics: {use: compare, in: {estimate: maps, truth: frames.truth}}
";
