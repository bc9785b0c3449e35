//! What a store costs as it grows: look-ups and runs of one instance, and appending, in processes of their own.

use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use turbid::store::Store;

use crate::{fill, key, publish};

/// Says what this process is to do, and in which folder.
const WORK: &str = "TURBID_BENCH_WORK";
/// Records that are appended.
const APPENDED: u64 = 1000;
/// Of so many runs the best counts.
const ROUNDS: usize = 5;
/// One instance, cheap, and its scene.
const PIPELINE: &str = "pipeline: one\nseed: 1\nstages:\n  scene:\n    use: scene\n    with:\n      media: {m: {A_rho: 100, S_rho: 5000, g: 0.8, n: 1.0}}\n      objects: {tissue: {slab: {thickness: 2000, top: 0}, medium: m}}\n      camera: {position: [0, 0, 500], look_at: [0, 0, 0], field: [64, 64], pixels: [8, 8]}\n      projector: {position: [35, 0, 500], look_at: [0, 0, 0], field: [256, 256], power: 5}\n  frames:\n    use: render\n    in: {scene: scene}\n    with: {f_x: [0.1], phases: 3, samples: 1}\n";

/// Wall time and peak memory, MB, of some work.
struct Took {
    ms: f64,
    mb: f64,
}

/// The work of this process, if it is one that another has started.
pub fn work() -> bool {
    let Ok(work) = std::env::var(WORK) else { return false };
    let (what, outputs) = work.split_once(' ').expect("two words");
    let (what, n) = what.split_once('=').unwrap_or((what, "0"));
    let (outputs, n) = (Path::new(outputs), n.parse::<u64>().expect("a number"));
    let begin = Instant::now();
    let mut lasted = None;
    match what {
        "fill" => drop(fill(outputs, n)),
        "look" => {
            let store = Store::open(outputs).expect("it opens");
            assert!(store.record(&key(n / 2)).is_some());
            store.finish().expect("there is room");
        }
        "append" => {
            let store = Store::open(outputs).expect("it opens");
            (n..n + APPENDED).for_each(|i| publish(&store, i));
            store.finish().expect("there is room");
        }
        "digests" => assert!(Store::open_read_only(outputs).expect("it opens").digests().len() as u64 >= n),
        "verify" => assert!(Store::open(outputs).expect("it opens").verify(false).expect("it reads").is_clean()),
        "gc" => drop(Store::open(outputs).expect("it opens").gc(u64::MAX, &[]).expect("it is alone")),
        "run" => {
            let mut turbid = Command::new(env!("CARGO_BIN_EXE_turbid"));
            turbid.arg("run").arg(outputs.join("one.yaml")).arg("--outputs").arg(outputs);
            let done = turbid.output().expect("it starts");
            assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
            let usage = nix::sys::resource::getrusage(nix::sys::resource::UsageWho::RUSAGE_CHILDREN);
            lasted = Some(usage.expect("it ran").max_rss() as f64 / 1e3);
        }
        other => panic!("{other}"),
    }
    println!("{} {}", 1e3 * begin.elapsed().as_secs_f64(), lasted.unwrap_or_else(peak_mb));
    true
}

fn peak_mb() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap_or_default();
    line.trim().trim_end_matches(" kB").parse::<f64>().unwrap_or(0.0) * 1.024e-3
}

fn in_a_process(what: &str, outputs: &Path) -> Took {
    let own = std::env::current_exe().expect("it runs");
    let done = Command::new(own).env(WORK, format!("{what} {}", outputs.display())).output().expect("it starts");
    assert!(done.status.success(), "{what}: {}", String::from_utf8_lossy(&done.stderr));
    let said = String::from_utf8_lossy(&done.stdout).into_owned();
    let mut numbers = said.split_whitespace().map(|word| word.parse().expect("a number"));
    Took { ms: numbers.next().expect("a time"), mb: numbers.next().expect("a size") }
}

fn best(what: &str, outputs: &Path, between: impl Fn()) -> Took {
    let took = (0..ROUNDS).map(|_| {
        between();
        in_a_process(what, outputs)
    });
    took.reduce(|a, b| Took { ms: a.ms.min(b.ms), mb: a.mb.max(b.mb) }).expect("some rounds")
}

fn bytes(folder: &Path) -> u64 {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.filter_map(|entry| entry.metadata().ok()).map(|meta| meta.len()).sum()
}

/// A row for each number of records.
pub fn table(numbers: &[u64]) {
    println!("wall ms, the best of {ROUNDS} (append: the first), and peak MB of the process");
    println!(
        "| records | put and publish, us each | MB | packs, MB | index, B a record | open, look, close | append {APPENDED}, index B more for each | run of one | no-op | all digests | verify | gc |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|");
    for &n in numbers {
        let outputs = tempfile::tempdir().expect("a temporary folder");
        let (path, store) = (outputs.path(), outputs.path().join("store"));
        let filled = in_a_process(&format!("fill={n}"), path);
        let (packs, index) = (bytes(&store.join("packs")), bytes(&store.join("index")));
        let look = best(&format!("look={n}"), path, || ());
        let append = in_a_process(&format!("append={n}"), path);
        let added = bytes(&store.join("index")) as f64 - index as f64;
        std::fs::write(path.join("one.yaml"), PIPELINE).expect("there is room");
        // A run of one instance that is not there: each round another one.
        let rounds = std::cell::Cell::new(0);
        let run = best("run", path, || {
            rounds.set(rounds.get() + 1);
            let text = PIPELINE.replace("seed: 1", &format!("seed: {}", rounds.get()));
            std::fs::write(path.join("one.yaml"), text).expect("there is room");
        });
        std::thread::sleep(Duration::from_millis(200));
        let no_op = best("run", path, || ());
        let [digests, verify, gc] = ["digests", "verify", "gc"].map(|what| in_a_process(&format!("{what}={n}"), path));
        let took = |took: &Took| format!("{:.1} ms, {:.0} MB", took.ms, took.mb);
        println!(
            "| {n} | {:.1} | {:.0} | {:.1} | {:.0} | {} | {}, {:.0} | {} | {} | {} | {} | {} |",
            1e3 * filled.ms / n as f64,
            filled.mb,
            packs as f64 / 1e6,
            index as f64 / n as f64,
            took(&look),
            took(&append),
            added / APPENDED as f64,
            took(&run),
            took(&no_op),
            took(&digests),
            took(&verify),
            took(&gc),
        );
    }
}
