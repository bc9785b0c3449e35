//! How well `turbid plan` foresees what runs cost: `cargo bench --bench plan [-- PART_OF_A_NAME]`.
//!
//! Every shipped pipeline in a store of its own, those of minutes at fewer paths: CPU seconds foreseen before anything has run, CPU seconds recorded, and the
//! same of each stage that takes more than 0.2 CPU s or is said to. Last the worst factor, of pipelines and of such stages.
//!
//! `cargo bench --bench plan -- scale` says how long no-ops and plans of many stages and instances take ([`scale`]), and `-- many [MOST]` what sets of
//! up to a million instances cost from the first plan to the last no-op ([`scale::many`]).

mod scale;

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

/// Pipelines, and what is set for those that take minutes.
const SHIPPED: [(&str, &[&str]); 19] = [
    ("camera_8bit", &[]),
    ("dis_iad", &[]),
    ("dis_iad_paper", &[]),
    ("fringe_depth", &["samples=1024"]),
    ("iad_phantom", &[]),
    ("lut_compare", &["photons=50000", "samples=256", "reference_samples=512"]),
    ("measured", &[]),
    ("measured_source", &[]),
    ("paper_size", &[]),
    ("planar_barrett", &["samples=512"]),
    ("planar_scc", &["samples=512"]),
    ("polyp_shape", &["samples=512"]),
    ("quickstart", &[]),
    ("snapshot", &[]),
    ("speckle", &[]),
    ("thickness_check", &["samples=2048"]),
    ("tube_pattern", &[]),
    ("tube_sectioned", &[]),
    ("tube_two_materials", &[]),
];
/// CPU seconds from which a stage counts.
const COUNTS_S: f64 = 0.2;

fn turbid(verb: &str, name: &str, set: &[&str], outputs: &Path) -> Result<Value, String> {
    let mut command = Command::new(env!("CARGO_BIN_EXE_turbid"));
    command.arg(verb).arg(format!("{}/pipelines/{name}.yaml", env!("CARGO_MANIFEST_DIR"))).arg("--json");
    command.arg("--outputs").arg(outputs).env("NO_COLOR", "1");
    command.args(set.iter().flat_map(|set| ["--set".to_owned(), format!("vars.{set}")]));
    let done = command.output().map_err(|e| e.to_string())?;
    let said = String::from_utf8_lossy(&done.stdout).into_owned();
    if !done.status.success() {
        return Err(String::from_utf8_lossy(&done.stderr).into_owned());
    }
    serde_json::from_str(said.lines().last().unwrap_or_default()).map_err(|e| e.to_string())
}

/// Sum of a field over the instances of each stage.
fn by_stage(listing: &Value, field: &str) -> BTreeMap<String, f64> {
    let mut sums = BTreeMap::new();
    for instance in listing["instances"].as_array().into_iter().flatten() {
        let stage = instance["stage"].as_str().unwrap_or_default().to_owned();
        *sums.entry(stage).or_insert(0.0) += instance[field].as_f64().unwrap_or(0.0);
    }
    sums
}

fn factor(foreseen: f64, took: f64) -> f64 {
    if foreseen > 0.0 { (foreseen / took).max(took / foreseen) } else { f64::INFINITY }
}

fn main() {
    let wanted = std::env::args().nth(1).filter(|a| !a.starts_with("--")).unwrap_or_default();
    if wanted == "scale" {
        return scale::main();
    }
    if wanted == "many" {
        let most = std::env::args().nth(2).and_then(|most| most.parse().ok());
        return scale::many::main(most.unwrap_or(1_000_000));
    }
    println!("| pipeline | stage | foreseen, CPU s | took, CPU s | ratio |\n| --- | --- | --- | --- | --- |");
    let mut worst = [(1.0, String::new()), (1.0, String::new())];
    for (name, set) in SHIPPED.iter().filter(|(name, _)| name.contains(&wanted)) {
        let space = tempfile::tempdir().expect("a temporary folder");
        let with = |verb: &str| turbid(verb, name, set, space.path());
        let found = with("plan").and_then(|plan| with("run").and_then(|_| Ok((plan, with("show")?))));
        let (plan, shown) = match found {
            Ok(found) => found,
            Err(error) => {
                println!("| {name} | {} | | | |", error.lines().next().unwrap_or_default());
                continue;
            }
        };
        let (foreseen, took) = (by_stage(&plan, "seconds"), by_stage(&shown, "cpu_seconds"));
        let sums = [&foreseen, &took].map(|stages| stages.values().sum::<f64>());
        let mut say = |of: usize, stage: &str, [foreseen, took]: [f64; 2]| {
            println!("| {name} {} | {stage} | {foreseen:.2} | {took:.2} | {:.2} |", set.join(" "), foreseen / took);
            let factor = factor(foreseen, took);
            if factor > worst[of].0 {
                worst[of] = (factor, format!("{name} {stage}"));
            }
        };
        say(0, "all", sums);
        for (stage, &took) in &took {
            let foreseen = foreseen.get(stage).copied().unwrap_or(0.0);
            if foreseen.max(took) >= COUNTS_S {
                say(1, stage, [foreseen, took]);
            }
        }
    }
    for (what, (factor, of)) in ["pipelines", "stages"].iter().zip(&worst) {
        println!("worst of {what}: a factor {factor:.2} ({of})");
    }
}
