//! How no-ops grow with stages and instances, and plans with instances: `cargo bench --bench plan -- scale` (some 100 CPU s, most of them to fill stores).
//!
//! Wall time of the whole program, start included, the best of several; the most memory that was resident (Linux, looked at every 2 ms; 0 elsewhere).

pub mod many;

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A scene of 8 x 8 mm on 4 x 4 pixels, in which `mu_a` stands for the absorption, and a render of it.
fn scene(foreach: &str, mu_a: &str) -> String {
    format!(
        "  tissue:
    use: scene
{foreach}    with:
      media: {{m: {{mu_a: {mu_a}, mu_s_prime: 1, g: 0.8, n: 1.0}}}}
      objects: {{block: {{slab: {{thickness: 200, top: 0}}, medium: m}}}}
      camera: {{position: [0, 0, 500], look_at: [0, 0, 0], field: [8, 8], pixels: [4, 4]}}
      projector: {{position: [35, 0, 500], look_at: [0, 0, 0], field: [80, 80], power: 5}}
"
    )
}

const FRAMES: &str = "  frames: {use: render, in: {scene: tissue}, with: {f_x: [0.1], phases: 3, samples: 4}}\n";

fn table(n: &str) -> String {
    format!("{{model: diffusion, f_x: [0, 0.1], g: 0.8, n: {n}, mu_a: [0.01, 0.1], mu_s_prime: [0.5, 1]}}")
}

/// Tables of 2 x 2 nodes, as instances of one stage.
fn tables(count: usize) -> String {
    let with = table("\"${n}\"");
    format!("  t: {{use: build_lut, foreach: {{n: {{linspace: [1.3, 1.4, {count}]}}}}, with: {with}}}\n")
}

/// The same, each a stage of its own.
fn stages(count: usize) -> String {
    let with = |i: usize| table(&(1.3 + i as f64 * 1e-5).to_string());
    (0..count).map(|i| format!("  t{i}: {{use: build_lut, with: {}}}\n", with(i))).collect()
}

/// Stages that each read what the one before it made.
fn chain(count: usize) -> String {
    let before = |i: usize| if i == 0 { "frames".to_owned() } else { format!("s{}", i - 1) };
    let sensor =
        |i: usize| format!("  s{i}: {{use: sensor, in: {{frames: {}}}, with: {{full_scale: 1}}}}\n", before(i));
    scene("", "0.1") + FRAMES + &(0..count - 2).map(sensor).collect::<String>()
}

/// Tables below one scene.
fn levels(count: usize) -> String {
    let stage = "in: {values: frames}, with: {scale: \"${k}\"}";
    let stage = format!("  t: {{use: tabulate, foreach: {{k: {{linspace: [1, 2, {count}]}}}}, {stage}}}\n");
    scene("", "0.1") + FRAMES + &stage
}

fn scenes(count: usize) -> String {
    scene(&format!("    foreach: {{a: {{linspace: [0.01, 0.1, {count}]}}}}\n"), "\"${a}\"")
}

fn turbid(verb: &str, folder: &Path, targets: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_turbid"));
    command.arg(verb).arg(folder.join("p.yaml")).args(targets).arg("--outputs").arg(folder.join("outputs"));
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    command
}

/// The best of `rounds`, each after `before`.
fn wall(command: &mut Command, rounds: usize, before: &dyn Fn()) -> Duration {
    let once = |_| {
        before();
        let began = Instant::now();
        let status = command.status().expect("the program starts");
        assert!(status.success(), "{command:?}: {status}");
        began.elapsed()
    };
    (0..rounds).map(once).min().expect("there are rounds")
}

/// Runs it; the most bytes of memory that it had.
fn peak_while(command: &mut Command) -> u64 {
    let mut child = command.spawn().expect("the program starts");
    let mut most = 0;
    loop {
        if let Some(status) = child.try_wait().expect("it is our child") {
            assert!(status.success(), "{command:?}: {status}");
            return most;
        }
        let status = std::fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap_or_default();
        let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let kb = line.and_then(|line| line.trim().trim_end_matches("kB").trim().parse::<u64>().ok());
        most = most.max(kb.unwrap_or(0) * 1024);
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// A pipeline; which of its stages have run before, where it is a plan.
struct Case {
    what: &'static str,
    stages: String,
    verb: &'static str,
    before: Option<&'static [&'static str]>,
    rounds: usize,
    /// Whether what earlier runs said may be said again.
    noted: bool,
}

pub fn main() {
    let run = |what, stages| Case { what, stages, verb: "run", before: Some(&[]), rounds: 9, noted: true };
    let long = |what, stages| Case { noted: false, ..run(what, stages) };
    let plan = |what, stages| Case { what, stages, verb: "plan", before: None, rounds: 3, noted: true };
    let cases = [
        run("no-op, 1000 instances of build_lut", tables(1000)),
        long("the same, nothing noted of the last run", tables(1000)),
        run("no-op, 2000 stages side by side (build_lut)", stages(2000)),
        long("the same, nothing noted of the last run", stages(2000)),
        run("no-op, 2000 stages in a chain (sensor)", chain(2000)),
        long("the same, nothing noted of the last run", chain(2000)),
        plan("plan, 10,000 tabulate below one scene", levels(10_000)),
        plan("plan, 100,000 tabulate below one scene", levels(100_000)),
        Case { before: Some(&["frames"]), ..plan("the same of 10,000, the frames being there", levels(10_000)) },
        Case { before: Some(&["frames"]), ..plan("the same of 100,000, the frames being there", levels(100_000)) },
        plan("plan, 10,000 build_lut", tables(10_000)),
        plan("plan, 100,000 build_lut", tables(100_000)),
        plan("plan, 10,000 scenes", scenes(10_000)),
        plan("plan, 10,000 scenes, each rendered", scenes(10_000) + FRAMES),
    ];
    println!("| what | wall, ms | memory, MB |\n| --- | --- | --- |");
    for Case { what, stages, verb, before, rounds, noted } in cases {
        let folder = tempfile::tempdir().expect("a temporary folder");
        std::fs::write(folder.path().join("p.yaml"), format!("pipeline: p\nstages:\n{stages}")).expect("there is room");
        if let Some(targets) = before {
            wall(&mut turbid("run", folder.path(), targets), 1, &|| ());
        }
        let notes = folder.path().join("outputs/store/unchanged");
        let forget = || {
            if !noted {
                drop(std::fs::remove_dir_all(&notes))
            }
        };
        let time = wall(&mut turbid(verb, folder.path(), &[]), rounds, &forget);
        let memory = peak_while(&mut turbid(verb, folder.path(), &[]));
        println!("| {what} | {:.1} | {:.0} |", time.as_secs_f64() * 1e3, memory as f64 / 1e6);
    }
}
