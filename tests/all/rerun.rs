//! What runs again and what does not.

use crate::space::{SMALL, Space, counts, states};

const INSTANCES: u64 = 7;

#[test]
fn the_second_run_finds_everything_up_to_date() {
    let space = Space::with(SMALL);
    assert!(states(&space, &[]).iter().all(|(_, state)| state != "hit"));
    assert_eq!(counts(&space, &[]), (0, INSTANCES));
    let digests = space.digests();
    assert_eq!(counts(&space, &[]), (INSTANCES, 0));
    assert!(states(&space, &[]).iter().all(|(_, state)| state == "hit"));
    assert_eq!(space.digests(), digests);
}

/// Comments, key order, 1 or 1.0, quantities in other units, labels and pipeline names are not in the key.
#[test]
fn spelling_is_not_in_the_key() {
    let space = Space::with(SMALL);
    counts(&space, &[]);
    let respelt = SMALL
        .replace("pipeline: small", "# a comment\npipeline: other")
        .replace("A_rho: 50, S_rho: 5000", "S_rho: 5.0e3, A_rho: \"0.05 mm^-1\"")
        .replace("thickness: 30", "thickness: \"3 cm\"")
        .replace("tissue", "sample_scene")
        .replace("phantom_modulation", "m2");
    space.write("p.yaml", &respelt);
    assert_eq!(counts(&space, &[]), (INSTANCES, 0));
}

/// One changed parameter: what ran had been shown as run or waits, what was shown as hit was a hit.
#[test]
fn plan_tells_what_run_will_do() {
    let space = Space::with(SMALL);
    counts(&space, &[]);
    let change = ["--set", "stages.tissue.with.media.m.A_rho=60"];
    let planned = states(&space, &change);
    let hits = planned.iter().filter(|(_, state)| state == "hit").count() as u64;
    let stale: Vec<&str> = planned.iter().filter(|(_, s)| s != "hit").map(|(n, _)| n.as_str()).collect();
    assert_eq!(stale, ["tissue", "frames", "modulation", "reflectance"]);
    assert_eq!(counts(&space, &change), (hits, INSTANCES - hits));
}

#[test]
fn explain_names_the_field_and_both_values() {
    let space = Space::with(SMALL);
    counts(&space, &[]);
    let text = space.turbid(&["explain", "p.yaml", "frames", "--set", "vars.samples=32"]).ok();
    assert!(text.contains("with.samples") && text.contains("before: 16") && text.contains("now:    32"), "{text}");
}

/// A change that does not alter the bytes of a stage stops there: two coefficients that mean the same.
#[test]
fn unchanged_bytes_stop_the_wave() {
    let space = Space::with(SMALL);
    counts(&space, &[]);
    // mu_s' = 5 (1 - 0.8) = 1: other params, the same scene.
    let respelt = SMALL.replace("{A_rho: 50, S_rho: 5000, g: 0.8, n: 1.0}", "{mu_a: 0.05, mu_s: 5, g: 0.8, n: 1.0}");
    assert_ne!(respelt, SMALL);
    space.write("p.yaml", &respelt);
    let (hits, ran) = counts(&space, &[]);
    assert_eq!(hits + ran, INSTANCES);
    assert!(ran <= 1, "only the scene may run again, {ran} did");
}

/// A seed moves only what draws.
#[test]
fn a_new_seed_moves_only_what_draws() {
    let space = Space::with(SMALL);
    counts(&space, &[]);
    space.write("p.yaml", &SMALL.replace("seed: 7", "seed: 8"));
    let stale: Vec<String> = states(&space, &[]).into_iter().filter(|(_, s)| s == "run").map(|(n, _)| n).collect();
    assert_eq!(stale, ["frames", "phantom_frames"]);
}

/// Only what a target needs runs, and an optional port only when somebody wants it.
#[test]
fn targets_prune_and_optional_ports_wait_to_be_wanted() {
    let space = Space::with(SMALL);
    assert_eq!(counts(&space, &["frames"]), (0, 2));
    let ports = |space: &Space| -> Vec<String> {
        let shown = space.turbid(&["show", "p.yaml", "frames", "--json"]).json();
        shown["instances"][0]["ports"].as_object().expect("ports").keys().cloned().collect()
    };
    assert_eq!(ports(&space), ["frames"]);
    let frames =
        space.turbid(&["show", "p.yaml", "frames", "--json"]).json()["instances"][0]["ports"]["frames"]["digest"]
            .clone();
    // A further port: the same frames, bit for bit, and the new port beside them.
    assert_eq!(counts(&space, &["frames.truth"]), (1, 1));
    assert_eq!(ports(&space), ["frames", "truth"]);
    let again =
        space.turbid(&["show", "p.yaml", "frames", "--json"]).json()["instances"][0]["ports"]["frames"]["digest"]
            .clone();
    assert_eq!(frames, again);
}

#[test]
fn force_runs_a_stage_again_with_the_same_bytes() {
    let space = Space::with(SMALL);
    counts(&space, &[]);
    let digests = space.digests();
    let (_, ran) = counts(&space, &["--force", "frames"]);
    assert_eq!(ran, 1);
    assert_eq!(space.digests(), digests);
}

/// Axes: a grid of scenes, joined by value, gathered, selected.
#[test]
fn a_sweep_has_one_instance_per_point() {
    let sweep = SMALL
        .replace(
            "  tissue:\n    use: scene\n",
            "  tissue:\n    use: scene\n    foreach: {A_rho: [10, 50], S_rho: {linspace: [4000, 6000, 3]}}\n",
        )
        .replace("A_rho: 50, S_rho: 5000", "A_rho: \"${A_rho}\", S_rho: \"${S_rho}\"");
    let space = Space::with(&sweep);
    // 6 x (tissue, frames, modulation, reflectance) and 3 of the phantom.
    assert_eq!(counts(&space, &[]), (0, 27));
    assert_eq!(counts(&space, &[]), (27, 0));
    let one = space.turbid(&["show", "p.yaml", "frames[A_rho=10,S_rho=6000]", "--json"]).json();
    assert_eq!(one["instances"].as_array().map(Vec::len), Some(1));
    // The seed depends on the axes: no two instances share their random streams, whatever their order.
    let reordered = sweep.replace("A_rho: [10, 50]", "A_rho: [50, 10]");
    space.write("p.yaml", &reordered);
    assert_eq!(counts(&space, &[]), (27, 0));
    let more = sweep.replace("A_rho: [10, 50]", "A_rho: [10, 50, 90]");
    space.write("p.yaml", &more);
    assert_eq!(counts(&space, &[]), (27, 12));
}

/// Media that differ by 2e-5 give frames whose means differ by less than that where all see the same random numbers, instances of one stage
/// and those of another; with seeds of their own, or one for each point of an axis, by their noise.
#[test]
fn common_random_numbers_span_instances_and_stages() {
    let three = SMALL
        .replace("  tissue:\n    use: scene\n", "  tissue:\n    use: scene\n    foreach: {A_rho: [50, 50.001]}\n")
        .replace("A_rho: 50, S_rho: 5000", "A_rho: \"${A_rho}\", S_rho: 5000")
        .replace("mu_a: 0.05, mu_s_prime: 1.2", "A_rho: 50.002, S_rho: 5000");
    let means = |seed: &str| -> Vec<f64> {
        let space = Space::with(&three.replace("    use: render\n", &format!("    use: render\n{seed}")));
        counts(&space, &["frames", "phantom_frames"]);
        let mean = |stage: &str| {
            let shown = space.turbid(&["show", "p.yaml", stage, "--json"]).json();
            let layers = &shown["instances"][0]["ports"]["frames"]["layers"];
            layers[0]["mean"].as_f64().expect("a mean")
        };
        ["frames[A_rho=50]", "frames[A_rho=50.001]", "phantom_frames"].map(mean).to_vec()
    };
    let apart = |means: &[f64], i: usize, j: usize| (means[i] / means[j] - 1.0).abs();
    let common = means("    seed: {common: 3}\n");
    assert!(apart(&common, 0, 1) < 2e-5 && apart(&common, 0, 2) < 4e-5, "{common:?}");
    for own in ["", "    seed: 3\n"] {
        let own = means(own);
        // Their noise is a per cent or so: one pair of means in a hundred is nearer than this.
        assert!(apart(&own, 0, 1) > 2e-4 && apart(&own, 0, 2) > 2e-4, "{own:?}");
    }
}

/// Two stages with the same params and inputs are one piece of work, done once; both ran, as the plan had said.
#[test]
fn instances_of_the_same_key_share_one_result() {
    let twins = SMALL.replace("A_rho: 50, S_rho: 5000, g: 0.8, n: 1.0", "mu_a: 0.05, mu_s_prime: 1.2, g: 0.8, n: 1.0");
    let space = Space::with(&twins);
    let plan = space.turbid(&["plan", "p.yaml"]).ok();
    assert!(plan.contains("phantom (the same as tissue)"), "{plan}");
    assert_eq!(counts(&space, &[]), (0, INSTANCES));
    let text = space.turbid(&["cache", "stat", "--json"]).json();
    // One scene, one render, one demodulation, one calibration.
    assert_eq!(text["records"], 4, "{text}");
    assert_eq!(counts(&space, &[]), (INSTANCES, 0));
}

/// What the clock stopped is the run that asks for the samples it reached: the same key, the same bytes, and a further
/// port is added to just those samples.
#[test]
fn a_run_stopped_by_seconds_is_stored_under_the_samples_it_reached() {
    let space = Space::with(&SMALL.replace("samples: \"${samples}\"}", "samples: 10000000, max_seconds: 0.1}"));
    assert_eq!(counts(&space, &["frames"]), (0, 2));
    assert_eq!(counts(&space, &["frames"]), (2, 0));
    let shown = |more: &[&str]| {
        let mut arguments = vec!["show", "p.yaml", "frames", "--json"];
        arguments.extend(more);
        space.turbid(&arguments).json()["instances"][0].clone()
    };
    let first = shown(&[]);
    let samples = first["measures"]["samples"]["value"].as_f64().expect("a render measures its samples");
    assert_eq!(counts(&space, &["frames.truth"]), (1, 1));
    assert_eq!(shown(&[])["ports"]["frames"]["digest"], first["ports"]["frames"]["digest"]);
    let set = [format!("stages.frames.with.samples={samples}"), "stages.frames.with.max_seconds=null".to_owned()];
    let plainly = ["frames", "--set", &set[0], "--set", &set[1]];
    assert_eq!(counts(&space, &plainly), (2, 0));
    let fresh = Space::with(&SMALL.replace("samples: \"${samples}\"", &format!("samples: {samples}")));
    assert_eq!(counts(&fresh, &["frames"]), (0, 2));
    let digest =
        fresh.turbid(&["show", "p.yaml", "frames", "--json"]).json()["instances"][0]["ports"]["frames"]["digest"]
            .clone();
    assert_eq!(digest, first["ports"]["frames"]["digest"]);
}

/// A new point of a sweep has no earlier result; a changed stage at a known point names what changed.
#[test]
fn reasons_compare_with_the_same_point() {
    let sweep = SMALL
        .replace("  tissue:\n    use: scene\n", "  tissue:\n    use: scene\n    foreach: {A_rho: [10, 50]}\n")
        .replace("A_rho: 50,", "A_rho: \"${A_rho}\",");
    let space = Space::with(&sweep);
    counts(&space, &["tissue"]);
    space.write("p.yaml", &sweep.replace("[10, 50]", "[10, 50, 90]").replacen("thickness: 30", "thickness: 31", 1));
    let plan = space.turbid(&["plan", "p.yaml", "tissue"]).ok();
    assert!(plan.contains("tissue[A_rho=50] (with.objects.block.slab.thickness: 30.0 -> 31.0)"), "{plan}");
    assert!(plan.contains("tissue[A_rho=90] (no earlier result)"), "{plan}");
}

#[test]
fn a_forced_stage_must_be_asked_for() {
    let space = Space::with(SMALL);
    let error = space.turbid(&["run", "p.yaml", "frames", "--force", "reflectance"]).fails(2);
    assert!(error.contains("--force reflectance: frames does not need it"), "{error}");
    assert!(!space.outputs().exists());
}

/// Every output has a file for people and programs to open, also those that live in a pack.
#[test]
fn show_gives_a_file_of_every_port() {
    let space = Space::with(SMALL);
    counts(&space, &[]);
    let shown = space.turbid(&["show", "p.yaml", "--json"]).json();
    for instance in shown["instances"].as_array().expect("a list") {
        for (port, described) in instance["ports"].as_object().expect("ports") {
            let path = described["path"].as_str().unwrap_or_else(|| panic!("{port} has no path"));
            let bytes = std::fs::read(space.path().join(path)).expect("the file is there");
            assert_eq!(Some(blake3::hash(&bytes).to_hex().as_str()), described["digest"].as_str(), "{path}");
        }
    }
    assert!(!space.outputs().join("latest/small/frames/covariance.png").exists(), "nobody looks at covariances");
}

/// What every instance of a sweep warns of is said once, and no instance is left out for it.
#[test]
fn a_sweep_warns_once_and_is_planned_whole() {
    let sweep = SMALL
        .replace("  tissue:\n    use: scene\n", "  tissue:\n    use: scene\n    foreach: {A_rho: {range: [1, 151]}}\n")
        .replace("A_rho: 50,", "A_rho: \"${A_rho}\",");
    let space = Space::with(&sweep);
    let planned = states(&space, &["frames"]);
    assert_eq!(planned.len(), 300);
    let checked = space.turbid(&["check", "p.yaml"]).ok();
    // phantom_frames is fitted, and needs no 64 paths for each pixel.
    assert_eq!(checked.matches("samples = 16").count(), 1, "frames, once: {checked}");
}

/// Two stages of one kind, asked for one after the other: each has its own results, although nothing else in the two commands differs.
#[test]
fn stages_of_one_kind_are_told_apart() {
    let space = Space::with(SMALL);
    assert_eq!(counts(&space, &["phantom"]), (0, 1));
    assert_eq!(counts(&space, &["phantom"]), (1, 0));
    assert_eq!(counts(&space, &["tissue"]), (0, 1), "what is noted of the phantom says nothing of the tissue");
    let scene = |stage: &str| {
        let shown = space.turbid(&["show", "p.yaml", stage, "--json"]).json();
        let path = space.path().join(format!("outputs/latest/small/{stage}/scene.parquet"));
        let digest = blake3::hash(&std::fs::read(path).expect("it was made")).to_hex().to_string();
        assert_eq!(shown["instances"][0]["ports"]["scene"]["digest"], digest, "{stage}");
        digest
    };
    assert_ne!(scene("phantom"), scene("tissue"));
}

/// The record of the frames in the store of a space, with what went in.
fn record_of_frames(store: &turbid::store::Store) -> (turbid::store::InstanceRecord, turbid::store::Recipe) {
    store.records().find(|(record, _)| record.provenance.stage == "frames").expect("it ran")
}

/// A stored result that is not what its key stands for: a forced run finds that out, leaves it and its checkpoints do not survive; with `--replace` the new one takes
/// its place.
#[test]
fn a_forced_stage_is_compared_with_what_is_stored() {
    use turbid_contract::Artifact;
    let space = Space::with(SMALL);
    counts(&space, &["frames"]);
    let right = space.digests();
    let store = turbid::store::Store::open(&space.outputs()).expect("it is ours");
    let (mut record, recipe) = record_of_frames(&store);
    let port = record.ports.get_mut("frames").expect("its port");
    let Ok(Artifact::Images(mut stack)) = store.get(&port.blob) else { panic!("frames are images") };
    stack.layers[0].data.mapv_inplace(|pixel| 1.5 * pixel);
    port.blob = store.put(&Artifact::Images(stack)).expect("it is finite");
    store.publish(&record, &recipe).expect("there is room");
    drop(store);
    let wrong = space.digests();
    assert_ne!(wrong, right);
    let told = space.turbid(&["run", "p.yaml", "frames", "--force", "frames"]).fails(1);
    assert!(told.contains("came out different from the stored one") && told.contains("--replace"), "{told}");
    assert_eq!(space.digests(), wrong);
    assert_eq!(space.files("outputs/store/checkpoints").len(), 0);
    let done = space.turbid(&["run", "p.yaml", "frames", "--force", "frames", "--replace"]);
    assert!(done.code == Some(0) && done.err.contains("came out different"), "{}", done.err);
    assert_eq!(space.digests(), right);
    space.turbid(&["run", "p.yaml", "--replace"]).fails(2);
}

/// A checkpoint whose check holds and whose state is wrong: a forced stage starts from the start, finds it and removes it, and what a longer run
/// gives is what it gives without any.
#[test]
fn a_forced_stage_goes_on_from_no_checkpoint() {
    use turbid::digest::{Digest, PartHasher};
    let longer = ["frames", "--set", "vars.samples=64"];
    let space = Space::with(SMALL);
    counts(&space, &["frames"]);
    let right = space.digests();
    let files = space.files("outputs/store/checkpoints");
    assert_eq!(files.len(), 1);
    let name = files[0].file_name().and_then(|n| n.to_str()).expect("plain").trim_end_matches(".state").to_owned();
    let (key, progress) = name.split_once('-').expect("key and progress");
    let (key, progress): (Digest, _) =
        (key.parse().expect("a digest"), u64::from_str_radix(progress, 16).expect("hex"));
    let mut bytes = std::fs::read(&files[0]).expect("it is there");
    // The last number of the state, halved.
    let end = bytes.len();
    let number = f64::from_le_bytes(bytes[end - 8..].try_into().expect("eight bytes"));
    bytes[end - 8..].copy_from_slice(&(0.5 * number + 1.0).to_le_bytes());
    let check = PartHasher::new("turbid checkpoint v1").part("key", &key.0);
    let check = check.part("progress", &progress.to_le_bytes()).part("state", &bytes[64..]).finish();
    bytes[32..64].copy_from_slice(&check.0);
    std::fs::write(&files[0], &bytes).expect("it is ours");
    let done = space.turbid(&["run", "p.yaml", "frames", "--force", "frames"]);
    assert!(done.code == Some(0) && done.err.contains("checkpoint came out different"), "{}", done.err);
    assert_eq!(space.digests(), right);
    assert_ne!(std::fs::read(&files[0]).ok(), Some(bytes), "the wrong one is gone");
    counts(&space, &longer);
    let fresh = Space::with(SMALL);
    counts(&fresh, &longer);
    let frames = |space: &Space| {
        let shown = space.turbid(&[&["show", "p.yaml"], &longer[..], &["--json"]].concat()).json();
        shown["instances"][0]["ports"]["frames"]["digest"].clone()
    };
    assert_eq!(frames(&space), frames(&fresh));
}
