//! Studies as a user runs them: points, errors, costs, and every mistake.

use serde_json::Value;

use crate::space::Space;

const PIPELINE: &str = "\
pipeline: noise
vars: {samples: 16}
stages:
  tissue:
    use: scene
    with:
      camera: {position: [0, 0, 500], look_at: [0, 0, 0], field: [24, 24], pixels: [12, 12]}
      projector: {position: [0, 35, 500], look_at: [0, 0, 0], field: [96, 96], power: 5}
      media: {m: {mu_a: 0.05, mu_s_prime: 1.2, g: 0.8, n: 1.0}}
      objects: {block: {slab: {thickness: 2000, top: 0}, medium: m}}
  frames: {use: render, in: {scene: tissue}, with: {f_x: [0, 0.1], phases: 3, samples: \"${samples}\", method: path}}
  modulation: {use: demodulate, in: {frames: frames, covariance: frames.covariance}, with: &all {noise_bias: keep, low_signal: 0}}
  exact: {use: render, in: {scene: tissue}, with: {f_x: [0, 0.1], phases: 3, samples: 256, method: fit}}
  exact_modulation: {use: demodulate, in: {frames: exact, covariance: exact.covariance}, with: *all}
studies:
  paths:
    vary: {vars.samples: [256, 16, 64]}
    repeats: 4
    estimate: modulation.m_dc
    truth: exact_modulation.modulation.m_dc
    error: rmse_percent
    also: [modulation.m_ac, \"frames.error: m_ac per pixel\"]
";

/// The events of a study of `p.yaml` by their kinds.
fn events(space: &Space, arguments: &[&str]) -> Vec<Value> {
    let arguments = [&["study", "p.yaml", "--json"], arguments].concat();
    let said = space.turbid(&arguments).ok();
    said.lines().map(|line| serde_json::from_str(line).expect("events are JSON")).collect()
}

/// The cells of a column of a CSV file without quotes.
fn column(csv: &str, name: &str) -> Vec<String> {
    let at = csv.lines().next().and_then(|head| head.split(',').position(|c| c == name)).expect("a column");
    csv.lines().skip(1).filter_map(|line| line.split(',').nth(at).map(str::to_owned)).collect()
}

fn of<'a>(events: &'a [Value], kind: &str) -> Vec<&'a Value> {
    events.iter().filter(|event| event["event"] == kind).collect()
}

/// Stated errors are right, noise falls with the root of the paths, and what is there is found again with what it cost.
#[test]
fn points_have_errors_and_costs() {
    let space = Space::with(PIPELINE);
    let first = events(&space, &[]);
    let points = of(&first, "point");
    assert_eq!(points.len(), 12);
    // Cheap ones first, so that longer ones go on from them.
    let order: Vec<u64> = points.iter().filter_map(|p| p["values"]["vars.samples"].as_u64()).collect();
    assert_eq!(order[..6], [16, 64, 256, 16, 64, 256]);
    let means = of(&first, "study_point");
    let errors: Vec<f64> = means.iter().filter_map(|m| m["error"].as_f64()).collect();
    // 256, 16, 64 as the file says. Of 4 x 144 pixels and more a root mean square is known to 4 % and less.
    assert!(
        (errors[1] / errors[0] / 4.0 - 1.0).abs() < 0.25 && (errors[1] / errors[2] / 2.0 - 1.0).abs() < 0.25,
        "{errors:?}"
    );
    for mean in &means {
        let [ratio, low, high] = [0, 1, 2].map(|k| mean["ratio"][k].as_f64().expect("all errors are known"));
        assert!(low < ratio && ratio < high && (0.8..1.25).contains(&ratio), "{mean}");
    }
    let csv = std::fs::read_to_string(space.path("outputs/latest/noise/studies/paths/study.csv")).expect("it is there");
    let head = csv.lines().next().expect("a line of names");
    for name in
        ["vars.samples", "error (%)", "stated_se (%)", "shared_cpu_seconds (s)", "flights", "modulation.m_ac", "failed"]
    {
        assert!(head.split(',').any(|column| column == name), "{name} is not in {head}");
    }
    assert_eq!(csv.lines().count(), 13);
    let folder = space.path("outputs/latest/noise/studies/paths");
    assert!(folder.join("study.parquet").exists());
    let svg = std::fs::read_to_string(folder.join("study.svg")).expect("it is there");
    assert!(svg.contains("modulation.m_dc: error ~ time^"), "{svg}");
    // The report shows it, whoever built the program: picture, points, slope. Another definition and damage are said.
    let report = |what: &str| {
        space.turbid(&["report", "p.yaml", "--to", "r.html"]).ok();
        let page = std::fs::read_to_string(space.path("r.html")).expect("it was written");
        assert!(page.contains(what), "`{what}` is missing");
        page
    };
    let page = report("data:image/svg+xml;base64,");
    assert!(page.contains("samples = 256") && page.contains("error ~ time^"), "points and slope");
    let found = std::fs::read_to_string(folder.join("study.json")).expect("it is there");
    std::fs::write(folder.join("study.json"), found.replace("\"repeats\": 4", "\"repeats\": 5")).expect("it is ours");
    report("another definition");
    std::fs::write(folder.join("study.json"), &found[..found.len() / 2]).expect("it is ours");
    report("what it found is damaged");
    std::fs::write(folder.join("study.json"), &found).expect("it is ours");
    std::fs::write(folder.join("study.svg"), "<!doctype html><script>alert(1)</script>").expect("it is ours");
    assert!(!report("study.svg is damaged").contains("alert(1)"));
    std::fs::remove_dir_all(&folder).expect("it is ours");
    report("it has not run yet");
    // The truth of another quantity is that of its own name: M_AC is about a third of M_DC, and would be 70 % off.
    let others = column(&csv, "modulation.m_ac");
    assert!(others.iter().all(|error| error.parse::<f64>().is_ok_and(|e| e > 0.0)), "{others:?}");
    let mean = others.iter().filter_map(|error| error.parse::<f64>().ok()).fold(f64::MAX, f64::min);
    assert!(mean < 50.0, "{others:?}");
    let second = events(&space, &["paths"]);
    assert_eq!(of(&second, "finished")[0]["ran"], 0);
    let errors_again: Vec<&Value> = of(&second, "study_point").iter().map(|m| &m["error"]).collect();
    assert_eq!(errors_again, means.iter().map(|m| &m["error"]).collect::<Vec<_>>());
    // Repeat 0 is the file itself, and a target of `run` as well.
    let run = space.turbid(&["run", "p.yaml", "modulation", "--set", "vars.samples=64"]).ok();
    for stage in ["frames", "modulation"] {
        let line = run.lines().find(|line| line.starts_with(stage)).unwrap_or_else(|| panic!("{run}"));
        assert!(line.contains(" hit"), "{run}");
    }
    assert!(space.turbid(&["run", "p.yaml", "paths"]).ok().contains("12 points, 0 failed"));
    let forced = space.turbid(&["run", "p.yaml", "paths", "--force", "frames"]).fails(2);
    assert!(forced.contains("studies and data sets are not forced"), "{forced}");
}

/// A run that goes on from a shorter one has followed the same paths and costs what a fresh one does: flights say it exactly.
#[test]
fn going_on_costs_what_a_fresh_run_does() {
    let flights = |values: &str| {
        let space = Space::with(&PIPELINE.replace("[256, 16, 64]", values));
        drop(events(&space, &[]));
        let csv =
            std::fs::read_to_string(space.path("outputs/latest/noise/studies/paths/study.csv")).expect("it is there");
        let column = |line: &str, name: &str| {
            let at = csv.lines().next().and_then(|head| head.split(',').position(|c| c == name)).expect("a column");
            line.split(',').nth(at).map(str::to_owned)
        };
        let line = csv.lines().find(|line| column(line, "vars.samples").as_deref() == Some("256")).expect("a row");
        (column(line, "flights"), column(line, "error (%)"))
    };
    assert_eq!(flights("[256, 16, 64]"), flights("[256]"));
}

/// A point that cannot be run is named, and the others are run.
#[test]
fn points_that_fail_are_named_beside_the_others() {
    let space = Space::with(&PIPELINE.replace("vars.samples: [256, 16, 64]", "vars.samples: [16, -3]"));
    let said = space.turbid(&["study", "p.yaml"]).fails(1);
    assert!(
        said.contains("8 points, 4 failed") && said.contains("failed: samples = -3, repeat 0 and 3 more: "),
        "{said}"
    );
    let csv = std::fs::read_to_string(space.path("outputs/latest/noise/studies/paths/study.csv")).expect("it is there");
    assert!(csv.lines().nth(5).is_some_and(|line| line.contains("samples")), "{csv}");
}

/// Without a truth repeats are compared with each other; a result against itself is exact, and no logarithm of 0.
#[test]
fn no_truth_and_no_error() {
    let truth = "    truth: exact_modulation.modulation.m_dc\n";
    let space = Space::with(&PIPELINE.replace(truth, ""));
    let events = events(&space, &[]);
    for mean in of(&events, "study_point") {
        let ratio = mean["ratio"][0].as_f64().expect("a ratio");
        assert!((0.8..1.25).contains(&ratio), "{mean}");
    }
    let space = Space::with(&PIPELINE.replace("exact_modulation.modulation.m_dc", "modulation.modulation.m_dc"));
    let said = space.turbid(&["study", "p.yaml"]).ok();
    assert!(said.contains("0 (exact)") && !said.contains("time^") && !said.contains("study.svg"), "{said}");
}

#[test]
fn mistakes_have_a_place() {
    for (from, to, words) in [
        ("estimate: modulation.m_dc", "estimate: modulations.m_dc", "there is no stage `modulations`"),
        ("estimate: modulation.m_dc", "estimate: modulation", "names no quantity"),
        ("estimate: modulation.m_dc", "estimate: tissue.mu_a", "is no image"),
        ("estimate: modulation.m_dc", "estimate: modulation.covariances.m_dc", "has no output `covariances`"),
        ("repeats: 4", "repeats: 0", "must lie in [1, 1000]"),
        ("also: [modulation.m_ac,", "also: [modulations.m_ac,", "there is no stage `modulations`"),
        ("error: rmse_percent", "error: rms_percent", "rmse_percent"),
        ("vars.samples: [256, 16, 64]", "vars.sample: [256, 16, 64]", "did you mean `samples`?"),
        ("  paths:\n", "  frames:\n", "is the name of a stage too"),
        ("vars.samples: [256, 16, 64]", "vars.samples: {range: [1, 5000]}", "more than 10000 points"),
    ] {
        assert!(PIPELINE.contains(from), "{from}");
        for command in ["check", "study"] {
            let said = Space::with(&PIPELINE.replacen(from, to, 1)).turbid(&[command, "p.yaml"]).fails(2);
            assert!(
                said.contains(words) && said.contains("p.yaml:"),
                "{command}, `{to}` should say `{words}`:\n{said}"
            );
        }
    }
    let truth = "    truth: exact_modulation.modulation.m_dc\n";
    let one = PIPELINE.replace(truth, "").replace("repeats: 4", "repeats: 1");
    assert!(Space::with(&one).turbid(&["study", "p.yaml"]).fails(2).contains("the scatter of the repeats"));
    let space = Space::with(PIPELINE);
    assert!(space.turbid(&["study", "p.yaml", "path"]).fails(2).contains("did you mean `paths`?"));
    let layer = Space::with(&PIPELINE.replace("estimate: modulation.m_dc", "estimate: modulation.m_cd"));
    assert!(layer.turbid(&["study", "p.yaml"]).fails(1).contains("there is no layer `m_cd`"));
    let also = Space::with(&PIPELINE.replace("also: [modulation.m_ac,", "also: [modulation.m_cd,"));
    assert!(also.turbid(&["study", "p.yaml"]).fails(1).contains("`modulation.m_cd` is no measure, and"));
    let reference = PIPELINE.replace("    repeats: 4\n", "    repeats: 4\n    reference: peers.csv\n");
    let space = Space::with(&reference);
    assert!(space.turbid(&["study", "p.yaml"]).fails(2).contains("peers.csv"));
    space.write("peers.csv", "label,seconds,error\nCycles,3,1\n");
    assert!(space.turbid(&["study", "p.yaml"]).fails(2).contains("no column `cpu_seconds`"));
}
