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
    let cases: [(&str, &[&str], &[&str]); 6] = [
        ("quickstart", &["vars.samples=32", "vars.reference_samples=32"], &["frames", "phantom_frames", "table"]),
        ("polyp_shape", &["vars.samples=16", "vars.pixels=40"], &["frames", "flat_frames", "opaque_frames"]),
        ("fringe_depth", &["vars.samples=16"], &["frames", "opaque_frames"]),
        ("dis_iad", &["vars.samples=4000"], &["readings"]),
        (
            "tube_two_materials",
            &["vars.samples=8", "vars.tissue_samples=8", "vars.pixels=[24,24]", "vars.projector_pixels=[100,100]"],
            &["reference_frames", "phantom_frames", "frames"],
        ),
        ("checks/kernel_limits", &[], &["frames_of_sixteen", "frames_of_seventeen", "frames_of_wide"]),
    ];
    for (name, set, stages) in cases {
        let (space, file) = (Space::new(), shipped(name));
        let with = |verb: &str, stages: &[&str]| {
            let set = set.iter().flat_map(|set| ["--set", set]);
            let arguments: Vec<&str> =
                [verb, &file, "--json"].into_iter().chain(stages.iter().copied()).chain(set).collect();
            space.turbid(&arguments).json()
        };
        let planned = with("plan", stages);
        with("run", stages);
        let shown: Vec<Value> = stages.iter().map(|stage| with("show", &[stage])).collect();
        let shown: Vec<(String, &Value)> = shown.iter().flat_map(instances).collect();
        let mut compared = 0;
        for (label, plan) in instances(&planned) {
            let stage = plan["stage"].as_str().expect("a stage");
            let Some(amount) = plan["work"]["amount"].as_f64().filter(|_| stages.contains(&stage)) else { continue };
            let unit = plan["work"]["unit"].as_str().expect("a unit");
            let ran = shown.iter().find(|(known, _)| *known == label);
            let (_, ran) = ran.unwrap_or_else(|| panic!("{name}: {label} did not run"));
            let counted = ran["measures"][unit]["value"].as_f64().unwrap_or_else(|| panic!("{name}, {label}: {ran}"));
            let ratio = amount / counted;
            assert!((0.5..=2.0).contains(&ratio), "{name}, {label}: {amount:e} {unit} foreseen, {counted:e} counted");
            // The kernel of the plan is the one of the record.
            assert_eq!(plan["kernel"], ran["kernel"], "{name}, {label}");
            compared += 1;
        }
        assert!(compared >= stages.len(), "{name}: {compared} instances with work\n{planned}");
    }
}

/// On both sides of two limits: the plan and the record say by which kernel, and why not by a faster one.
#[test]
fn plan_and_record_name_the_kernel() {
    let (space, file) = (Space::new(), shipped("checks/kernel_limits"));
    let bodies = "17 bodies (a hole counts as one): f32 lanes hold up to 16";
    let reach = "the camera sees up to 452.5 mm beside its middle, 67882 mean free paths at mu_s = 150 mm^-1: f32 lanes hold up to 4096 in each part of an image (a pixel, or a 64th of its sides)";
    let expected = [
        ("\"frames_of_sixteen\" {}", "16 paths abreast in f32, 16 bodies", None),
        (
            "\"frames_of_seventeen\" {}",
            "16 paths abreast in f32, 17 bodies, light connections one by one, starts one by one",
            Some(bodies),
        ),
        ("\"frames_of_wide\" {\"mu_s\":140}", "16 paths abreast in f32, 1 body", None),
        ("\"frames_of_wide\" {\"mu_s\":150}", "one path after the other in f64, 1 body", Some(reach)),
    ];
    let agrees = |listing: &Value| {
        let found = instances(listing);
        for (label, kernel, refused) in expected {
            let (_, instance) = found.iter().find(|(known, _)| known == label).unwrap_or_else(|| panic!("{listing}"));
            assert_eq!(instance["kernel"], kernel, "{label}");
            assert_eq!(instance["refused"][0].as_str(), refused, "{label}");
        }
    };
    agrees(&space.turbid(&["plan", &file, "--json"]).json());
    let text = space.turbid(&["plan", &file]).ok();
    assert!(text.contains(bodies) && text.contains(reach), "{text}");
    let few = ["--set", "stages.frames_of_sixteen.with.samples=8"];
    space.turbid(&["run", &file, few[0], few[1]]).ok();
    agrees(&space.turbid(&["show", &file, "--json", few[0], few[1]]).json());
    let text = space.turbid(&["show", &file, "frames_of_seventeen"]).ok();
    assert!(text.contains(bodies), "{text}");
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

/// A render with control variates walks several images; its own checkpoint is no work of an earlier run, and no more CPU seconds are counted than all threads have.
#[test]
fn a_run_does_not_resume_itself() {
    let file = shipped("quickstart");
    let space = Space::new();
    let with = |verb: &str| space.turbid(&[verb, &file, "frames", "--json", "--set", "vars.samples=64"]).json();
    with("run");
    let record = &with("show")["instances"][0];
    let (spent, seconds) =
        (record["cpu_seconds"].as_f64().expect("a number"), record["seconds"].as_f64().expect("a number"));
    let threads = std::thread::available_parallelism().map_or(1, usize::from) as f64;
    assert!(spent <= 1.05 * threads * seconds, "{spent} CPU s in {seconds} s of {threads} threads");
}

/// Light does not end in a white cavity; the plan does, and says so.
#[test]
fn light_without_an_end_does_not_keep_the_plan() {
    let space = Space::with(
        "pipeline: cavity\nstages:\n  scene:\n    use: scene\n    with:\n      media: {}\n      objects: {wall: {sphere_shell: {inner_diameter: 20, wall: 5, center: [0, 0, 0]}, surface: {lambertian: 1}}}\n      camera: {position: [0, 0, 8], look_at: [0, 0, 0], field: [4, 4], pixels: [8, 8]}\n      projector: {position: [2, 0, 8], look_at: [0, 0, 0], field: [4, 4], power: 5}\n  frames: {use: render, in: {scene: scene}, with: {f_x: [0.1], samples: 64, method: path}}\n",
    );
    let text = space.turbid(&["plan", "p.yaml"]).ok();
    assert!(text.contains("frames (no earlier result), much longer than its pilot, which did not end"), "{text}");
    let planned = space.turbid(&["plan", "p.yaml", "--json"]).json();
    let (_, plan) = instances(&planned).into_iter().find(|(label, _)| label.contains("frames")).expect("it is planned");
    assert_eq!(plan["seconds_by"], "at_least", "{plan}");
}
