//! What processes that share a store gain: `cargo bench --bench sharing`.
//!
//! 32 renders of about 0.7 s each, by one process with one thread and by two such processes with the same command at once: wall
//! time, and how many instances were computed in all (more than the pipeline has: work done twice). Then 1024 workers, 128 in each
//! of 8 processes, that ask for one random key each: how many hold theirs at once.

mod program;

use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Instant;

use program::{number, run, stage};
use serde_json::Value;
use turbid::digest::Digest;
use turbid::store::Store;

const RENDERS: usize = 32;
/// Scenes, and their frames.
const INSTANCES: u64 = 2 * RENDERS as u64;
/// Wanted of a render, s.
const EACH_S: f64 = 0.7;
const PROCESSES: usize = 8;
const WORKERS: usize = 128;

fn pipeline(renders: usize, samples: u64) -> String {
    let values = if renders == 1 { "[50]".to_owned() } else { format!("{{linspace: [50, 100, {renders}]}}") };
    format!(
        "pipeline: sharing\nseed: 1\nstages:\n  scene:\n    use: scene\n    foreach: {{A_rho: {values}}}\n    with:\n      media: {{m: {{A_rho: \"${{A_rho}}\", S_rho: 5000, g: 0.8, n: 1.0}}}}\n      objects: {{tissue: {{slab: {{thickness: 2000, top: 0}}, medium: m}}}}\n      camera: {{position: [0, 0, 500], look_at: [0, 0, 0], field: [64, 64], pixels: [32, 32]}}\n      projector: {{position: [35, 0, 500], look_at: [0, 0, 0], field: [256, 256], power: 5}}\n  frames:\n    use: render\n    in: {{scene: scene}}\n    with: {{f_x: [0.1], phases: 3, samples: {samples}, method: path}}\n"
    )
}

/// A run on one thread, its events on stdout.
fn start(space: &Path) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_turbid"));
    command.args(["run", "pipeline.yaml", "--json", "-j", "1"]).current_dir(space);
    command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().expect("the program starts")
}

/// Wall seconds of so many processes with one command, and how many instances each computed.
fn together(processes: usize, text: &str) -> (f64, Vec<u64>) {
    let space = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(space.path().join("pipeline.yaml"), text).expect("the folder is ours");
    let began = Instant::now();
    let running: Vec<_> = (0..processes)
        .map(|_| {
            let mut child = start(space.path());
            let mut out = child.stdout.take().expect("it is piped");
            let read = std::thread::spawn(move || {
                let mut text = String::new();
                out.read_to_string(&mut text).expect("events are text");
                text
            });
            (child, read)
        })
        .collect();
    let ran = |(mut child, read): (Child, std::thread::JoinHandle<String>)| {
        assert!(child.wait().expect("it was started").success());
        let text = read.join().expect("it reads");
        let events = text.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
        events.filter(|event| event["event"] == "ran").count() as u64
    };
    let counts = running.into_iter().map(ran).collect();
    (began.elapsed().as_secs_f64(), counts)
}

/// The workers of one process: takes a key each, says how many it got, and holds them until its stdin is closed.
fn hold(outputs: &Path, first: usize) {
    let stores: Vec<Store> = (0..WORKERS).map(|_| Store::open(outputs).expect("the folder is ours")).collect();
    let key = |worker: usize| Digest::of(format!("worker {worker}").as_bytes());
    let locks: Vec<_> =
        stores.iter().enumerate().map(|(i, store)| store.try_lock(&key(first + i), &|| false)).collect();
    println!("{}", locks.iter().filter(|lock| matches!(lock, Ok(Some(_)))).count());
    std::io::stdin().read_to_end(&mut Vec::new()).expect("it is piped");
}

/// How many workers of all processes hold a key of their own at once.
fn contention() -> usize {
    let space = tempfile::tempdir().expect("a temporary folder");
    let itself = std::env::current_exe().expect("a bench is a file");
    let start = |process: usize| {
        let mut command = Command::new(&itself);
        command.arg("hold").arg(space.path()).arg((process * WORKERS).to_string());
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("it starts itself")
    };
    let mut children: Vec<Child> = (0..PROCESSES).map(start).collect();
    let held = |child: &mut Child| {
        let mut line = String::new();
        BufReader::new(child.stdout.as_mut().expect("it is piped")).read_line(&mut line).expect("it says a number");
        line.trim().parse::<usize>().expect("a number")
    };
    let held = children.iter_mut().map(held).sum();
    for mut child in children {
        drop(child.stdin.take());
        child.wait().expect("it was started");
    }
    held
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    if let [_, word, outputs, first] = arguments.as_slice()
        && word == "hold"
    {
        return hold(Path::new(outputs), first.parse().expect("a number"));
    }
    let began = Instant::now();
    println!(
        "{} of {} workers hold a key at once ({:.1} s)",
        contention(),
        PROCESSES * WORKERS,
        began.elapsed().as_secs_f64()
    );
    let space = tempfile::tempdir().expect("a temporary folder");
    let tried = run(space.path(), &pipeline(1, 512)).and_then(|shown| Ok(number(&stage(&shown, "frames")?["seconds"])));
    let samples = (512.0 * EACH_S / tried.expect("it runs")).max(16.0) as u64;
    let text = pipeline(RENDERS, samples);
    println!(
        "| processes, one thread each | s | of one | computed | of {INSTANCES} |\n| --- | --- | --- | --- | --- |"
    );
    let (one, _) = together(1, &text);
    for processes in [1, 2] {
        let (wall, counts) = if processes == 1 { (one, vec![INSTANCES]) } else { together(processes, &text) };
        let sum: u64 = counts.iter().sum();
        println!("| {processes} | {wall:.2} | {:.2} | {counts:?} | {sum} |", wall / one);
    }
}
