//! What `turbid plan` foresees of work, against what runs count and record.

use serde_json::Value;

use crate::space::Space;

/// By stage and axes: what `plan` and `show` say of an instance.
fn instances(listing: &Value) -> Vec<(String, &Value)> {
    let all = listing["instances"].as_array().expect("a list").iter();
    all.map(|i| (format!("{} {}", i["stage"], i["axes"]), i)).collect()
}

fn shipped(name: &str) -> String {
    format!("{}/pipelines/{name}.yaml", env!("CARGO_MANIFEST_DIR"))
}

/// Shipped pipelines at few paths: the work of every instance that has a unit is foreseen within a factor of 2, and those that paths are walked for have
/// one. Both are counts, not times.
#[test]
fn the_work_of_shipped_pipelines_is_foreseen() {
    let few = "vars.samples=64";
    let cases: [(&str, &[&str], usize); 7] = [
        ("quickstart", &["--set", few, "--set", "vars.reference_samples=64"], 3),
        ("polyp_shape", &["--set", "vars.samples=16", "--set", "vars.pixels=40"], 4),
        ("fringe_depth", &["--set", few], 5),
        ("dis_iad", &["--set", "vars.samples=4000"], 1),
        (
            "tube_two_materials",
            &["--set", "vars.samples=8", "--set", "vars.tissue_samples=8", "--set", "vars.pixels=[24,24]"],
            3,
        ),
        ("checks/curved_wall", &[], 1),
        ("checks/tilted_plane", &[], 1),
    ];
    for (name, set, least) in cases {
        let (space, file) = (Space::new(), shipped(name));
        let with = |verb: &str| {
            let arguments: Vec<&str> = [verb, &file, "--json"].into_iter().chain(set.iter().copied()).collect();
            space.turbid(&arguments).json()
        };
        let planned = with("plan");
        with("run");
        let shown = with("show");
        let shown = instances(&shown);
        let mut compared = 0;
        for (label, plan) in instances(&planned) {
            let Some(amount) = plan["work"]["amount"].as_f64() else { continue };
            let unit = plan["work"]["unit"].as_str().expect("a unit");
            let (_, ran) = shown.iter().find(|(known, _)| *known == label).expect("it ran");
            let counted = ran["measures"][unit]["value"].as_f64().unwrap_or_else(|| panic!("{name}, {label}: {ran}"));
            let ratio = amount / counted;
            assert!((0.5..=2.0).contains(&ratio), "{name}, {label}: {amount:e} {unit} foreseen, {counted:e} counted");
            // The kernel of the plan is the one of the record.
            assert_eq!(plan["kernel"], ran["kernel"], "{name}, {label}");
            compared += 1;
        }
        assert!(compared >= least, "{name}: {compared} instances with work\n{planned}");
    }
}

/// Five bodies: the record says by which kernel it was made, and why not by a faster one, as the plan said.
#[test]
fn the_record_names_the_kernel() {
    let balls: String = (0..4)
        .map(|i| {
            format!(
                "        b{i}: {{sphere: {{diameter: 3, center: [{}, 0, -3]}}, medium: b{i}, priority: 1}}\n",
                4 * i - 6
            )
        })
        .collect();
    let media: String = (0..4).map(|i| format!("b{i}: {{mu_a: 0.{}, mu_s: 4, g: 0.8, n: 1}}, ", i + 2)).collect();
    let pipeline = format!(
        "pipeline: five\nstages:\n  scene:\n    use: scene\n    with:\n      media: {{{media}m: {{mu_a: 0.1, mu_s: 5, g: 0.8, n: 1}}}}\n      objects:\n        slab: {{slab: {{thickness: 30, top: 0}}, medium: m}}\n{balls}      camera: {{position: [0, 0, 500], look_at: [0, 0, 0], field: [20, 20], pixels: [4, 4]}}\n      projector: {{position: [0, 35, 500], look_at: [0, 0, 0], field: [80, 80], power: 5}}\n  frames:\n    use: render\n    in: {{scene: scene}}\n    with: {{f_x: [0.1], samples: 16}}\n"
    );
    let space = Space::with(&pipeline);
    let reason = "5 bodies (a hole counts as one): f32 lanes hold up to 4";
    let planned = space.turbid(&["plan", "p.yaml", "--json"]).json();
    let (_, plan) = instances(&planned).into_iter().find(|(label, _)| label.contains("frames")).expect("it is planned");
    assert_eq!(plan["refused"][0], reason, "{plan}");
    let text = space.turbid(&["plan", "p.yaml"]).ok();
    assert!(text.contains("kernel: 16 paths abreast in f32, 5 bodies") && text.contains(reason), "{text}");
    space.turbid(&["run", "p.yaml"]).ok();
    let shown = space.turbid(&["show", "p.yaml", "frames", "--json"]).json();
    assert_eq!(shown["instances"][0]["refused"][0], reason, "{shown}");
    let text = space.turbid(&["show", "p.yaml", "frames"]).ok();
    assert!(text.contains(reason), "{text}");
}

/// A longer run that goes on from a shorter one holds the cost of both, and from it the next plan is made: of 8 more paths after 1024 the last run alone
/// is below a tenth.
#[test]
fn what_was_resumed_is_in_the_cost() {
    let pipeline = crate::space::SMALL.replace("vars: {samples: 16}", "vars: {samples: 1024}");
    let space = Space::with(&pipeline);
    let cpu_s = |more: &[&str]| {
        let with = |verb: &str| {
            let arguments: Vec<&str> =
                [verb, "p.yaml", "--json", "frames"].into_iter().chain(more.iter().copied()).collect();
            space.turbid(&arguments).json()
        };
        with("run");
        with("show")["instances"][0]["cpu_seconds"].as_f64().expect("a number")
    };
    let (whole, longer) = (cpu_s(&[]), cpu_s(&["--set", "vars.samples=1032"]));
    assert!(longer > 0.5 * whole, "{longer} CPU s after {whole}");
    let planned = space.turbid(&["plan", "p.yaml", "frames", "--json", "--set", "vars.samples=4096"]).json();
    let (_, plan) = instances(&planned).into_iter().find(|(label, _)| label.contains("frames")).expect("it is planned");
    assert_eq!(plan["seconds_by"], "earlier", "{plan}");
    let seconds = plan["seconds"].as_f64().expect("a number");
    // 4 times the paths; the pilot knows their flights to some percent.
    assert!((2.0..8.0).contains(&(seconds / longer)), "{seconds} s foreseen, {longer} s for a quarter");
}
