//! What sets of a thousand to a million cheap instances cost: `cargo bench --bench plan -- many [MOST]` (a million takes an hour).
//!
//! Tables of 2 x 2 nodes, one for each value of an axis, in a store that is empty at first. CPU seconds of the whole program, start
//! included; wall time; the most memory that was resident (Linux, looked at every 2 ms); files and bytes of the outputs folder then.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use super::{peak_while, turbid};

/// As many as are allowed by default.
const SIZES: [usize; 4] = [1000, 10_000, 100_000, 1_000_000];

/// So many tables; those of fewer are the first of those of more.
fn tables(count: usize, first: f64) -> String {
    let step = 1e-7;
    let last = first + count as f64 * step;
    let with = super::table("\"${n}\"");
    format!(
        "pipeline: p\nstages:\n  t: {{use: build_lut, foreach: {{n: {{range: [{first}, {last:.9}, {step}]}}}}, with: {with}}}\n"
    )
}

struct Cost {
    cpu_s: f64,
    wall: Duration,
    peak: u64,
}

/// CPU seconds of the programs that have ended.
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
fn cpu_s() -> f64 {
    use nix::sys::resource::{UsageWho, getrusage};
    use nix::sys::time::TimeValLike;
    let usage = getrusage(UsageWho::RUSAGE_CHILDREN).expect("the system tells");
    let seconds = |time: nix::sys::time::TimeVal| time.num_microseconds() as f64 / 1e6;
    seconds(usage.user_time()) + seconds(usage.system_time())
}

#[cfg(not(all(target_os = "linux", target_arch = "x86_64")))]
fn cpu_s() -> f64 {
    f64::NAN
}

fn cost(command: &mut Command) -> Cost {
    let (before, began) = (cpu_s(), Instant::now());
    let peak = peak_while(command);
    Cost { cpu_s: cpu_s() - before, wall: began.elapsed(), peak }
}

/// Number of files below a folder, and their bytes.
fn size(folder: &Path) -> (usize, u64) {
    let (mut files, mut bytes, mut open) = (0, 0, vec![folder.to_owned()]);
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
            match entry.metadata() {
                Ok(meta) if meta.is_dir() => open.push(entry.path()),
                Ok(meta) => (files, bytes) = (files + 1, bytes + meta.len()),
                Err(_) => {}
            }
        }
    }
    (files, bytes)
}

fn row(count: usize, what: &str, folder: &Path, command: &mut Command) {
    let Cost { cpu_s, wall, peak } = cost(command);
    let (files, bytes) = size(&folder.join("outputs"));
    println!(
        "| {count} | {what} | {cpu_s:.2} | {:.2} | {:.0} | {files} | {:.1} |",
        wall.as_secs_f64(),
        peak as f64 / 1e6,
        bytes as f64 / 1e6
    );
}

pub fn main(most: usize) {
    println!(
        "| instances | what | CPU, s | wall, s | memory, MB | files | bytes, MB |\n| --- | --- | --- | --- | --- | --- | --- |"
    );
    for count in SIZES.into_iter().filter(|&count| count <= most) {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let folder = folder.path();
        let write = |count, first| fs::write(folder.join("p.yaml"), tables(count, first)).expect("there is room");
        let of = |verb: &str| turbid(verb, folder, &[]);
        write(count, 1.3);
        row(count, "plan", folder, &mut of("plan"));
        row(count, "first run", folder, &mut of("run"));
        row(count, "no-op, the first", folder, &mut of("run"));
        row(count, "no-op, the next", folder, &mut of("run"));
        write(1, 1.45);
        row(count, "one instance more, as a pipeline", folder, &mut of("run"));
        fs::remove_dir_all(folder.join("outputs")).expect("it is there");
        write(count / 2, 1.3);
        row(count, "half of it", folder, &mut of("run"));
        write(count, 1.3);
        row(count, "plan of the other half", folder, &mut of("plan"));
        row(count, "run of the other half", folder, &mut of("run"));
    }
}
