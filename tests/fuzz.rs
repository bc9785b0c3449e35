//! Mutated inputs for every reader of the program. Of each: no panic, no abort, no hang; CPU time and memory in proportion to the input; no
//! number that is not finite in a result; and of the store never wrong bytes under a right digest.
//!
//! `TURBID_FUZZ_SECONDS=600 cargo test --test fuzz -- --nocapture` for ten minutes (10 s without the variable), `... -- png exr` for some
//! readers only. `TURBID_FUZZ_SEED` takes another sequence of inputs; the same seed gives the same ones. An input that fails is written to a
//! file, and `TURBID_FUZZ_INPUT=FILE cargo test --test fuzz -- READER` reads it alone. Once mended it goes to
//! `tests/fuzz/regressions/READER/`, named by what it is: these come first in every run.

#[path = "fuzz/allocations.rs"]
mod allocations;
#[path = "fuzz/bytes.rs"]
mod bytes;
#[path = "fuzz/campaign.rs"]
mod campaign;
#[path = "fuzz/checksums.rs"]
mod checksums;
#[path = "fuzz/corpus.rs"]
mod corpus;
#[path = "fuzz/files.rs"]
mod files;
#[path = "fuzz/limits.rs"]
mod limits;
#[path = "fuzz/mutate.rs"]
mod mutate;
#[path = "fuzz/random.rs"]
mod random;
#[path = "fuzz/readers/mod.rs"]
mod readers;
#[path = "fuzz/text.rs"]
mod text;
#[path = "fuzz/worker.rs"]
mod worker;

use std::path::PathBuf;
use std::process::ExitCode;

use readers::Reader;
use worker::Task;

/// Seconds of a run, where no variable says otherwise.
const SECONDS: f64 = 10.0;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let [flag, name, seed, from, seconds, folder] = arguments.as_slice()
        && flag == "--work"
    {
        limits::note_panics();
        let reader = readers::all().into_iter().find(|r| r.name == name).expect("the parent names a reader");
        let number = "the parent writes numbers";
        let (seed, from) = (seed.parse().expect(number), from.parse().expect(number));
        worker::work(&reader, &Task { seed, from, seconds: seconds.parse().expect(number), folder: folder.into() });
        return ExitCode::SUCCESS;
    }
    let names: Vec<&String> = arguments.iter().filter(|a| !a.starts_with('-')).collect();
    let mut readers = readers::all();
    readers.retain(|r| names.is_empty() || names.iter().any(|name| ["fuzz", r.name].contains(&name.as_str())));
    // `cargo test NAME` asks every test program for NAME.
    if readers.is_empty() || arguments.iter().any(|a| a == "--list") {
        return ExitCode::SUCCESS;
    }
    allocations::test();
    checksums::test();
    match variable::<PathBuf>("TURBID_FUZZ_INPUT") {
        Some(path) => repeat(&readers, &path),
        None => all(&readers),
    }
}

/// The value of an environment variable.
fn variable<T: std::str::FromStr>(name: &str) -> Option<T> {
    let text = std::env::var(name).ok()?;
    Some(text.parse().unwrap_or_else(|_| panic!("{name}={text} cannot be read")))
}

/// Reads one input, in this process, with everything that a panic says.
fn repeat(readers: &[Reader], path: &PathBuf) -> ExitCode {
    let input = std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let mut good = true;
    for reader in readers {
        let judged = limits::judge(reader, &input);
        println!("{}: {judged:?}", reader.name);
        good &= judged.is_ok();
    }
    if good { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

fn all(readers: &[Reader]) -> ExitCode {
    let seconds = variable("TURBID_FUZZ_SECONDS").unwrap_or(SECONDS);
    let seed = variable("TURBID_FUZZ_SEED").unwrap_or(1);
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("fuzz");
    std::fs::create_dir_all(&folder).expect("the folder of the build can be written to");
    let parts: u32 = readers.iter().map(|r| r.share).sum();
    println!("fuzz: {} readers, {seconds} s, seed {seed}", readers.len());
    let (mut read, mut failed) = (0, 0);
    for reader in readers {
        let share = seconds * f64::from(reader.share) / f64::from(parts);
        let outcome = campaign::run(reader, seed, share, &folder);
        let counts = outcome.counts;
        println!(
            "{:>10}: {:7} inputs, {:6} taken, {} failed",
            reader.name,
            counts.read,
            counts.taken,
            outcome.failures.len()
        );
        read += counts.read;
        failed += outcome.failures.len();
        for (message, count, paths) in campaign::kinds(&outcome.failures) {
            println!("            {count} x {message}");
            for path in paths {
                println!(
                    "              TURBID_FUZZ_INPUT={} cargo test --test fuzz -- {}",
                    path.display(),
                    reader.name
                );
            }
        }
    }
    println!("fuzz: {read} inputs, {failed} failed");
    if failed == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
