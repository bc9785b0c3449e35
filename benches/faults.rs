//! Kills, broken system calls and power cuts: `cargo bench --bench faults [-- OPTIONS]` (Linux on x86-64; about a minute on 2 cores).
//!
//! Runs the program under `ptrace` and breaks its n-th call that changes a file: kills it before, after or amid the call, lets the disk be full or
//! fail, once or from there on; lets reading fail; or shortens what is written and read. For power cuts all calls are logged with their bytes,
//! and states are made that a file system with a journal may hold after a cut at call n (`faults/disk.rs` says which).
//!
//! After each the command must not hang or panic, and must end well with right results or say an error that names what it concerns. The next plain
//! run must end well, with the digests and the files in `outputs/latest` of an undisturbed run; what was published (before the fault; before the
//! last sync where the power is cut) must not be made again; `cache verify` must find nothing, or nothing after `--repair`; no unfinished file
//! may be left. Prints a table; exit status 1 where something is wrong, with the options that repeat the case.
//!
//! ```text
//! --program PATH     another program than the one built here
//! --scenario NAME    of one scenario only: fresh, table, continue, up-to-date, repair, gather, gc, export, beside, force
//! --kind NAME        of one kind only: kill, kill-after, torn, full, full-once, error-once, error, read-once, read, short,
//!                    power-cut
//! --cases N          most cases of each kind in each scenario (6); calls are taken evenly
//! --seed X           other calls, other states
//! --at N             one case: call N (with --scenario and --kind; --seed is the state after a power cut)
//! --keep FOLDER      a new folder where that case is left: broken/ as the fault left it, work/ after the runs that heal
//! --jobs N           cases at once (all cores)
//! ```

#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
#[path = "faults/mod.rs"]
mod faults;

#[cfg(not(all(target_os = "linux", target_arch = "x86_64")))]
fn main() {
    println!("calls are broken on Linux on x86-64 only");
}

#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
fn main() -> std::process::ExitCode {
    campaign::main()
}

#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod campaign {
    use std::collections::BTreeMap;
    use std::path::{Path, PathBuf};
    use std::process::ExitCode;
    use std::sync::Mutex;
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::time::Instant;

    use super::faults::case::{Case, Outcome, Verdict, run};
    use super::faults::kinds::{KINDS, Kind};
    use super::faults::reference::Reference;
    use super::faults::scenarios::{SCENARIOS, Scenario};
    use super::faults::spread;

    struct Options {
        program: PathBuf,
        scenario: Option<&'static Scenario>,
        kind: Option<Kind>,
        cases: u64,
        seed: u64,
        at: Option<u64>,
        keep: Option<PathBuf>,
        jobs: usize,
    }

    impl Options {
        fn read() -> Result<Self, String> {
            let mut options = Self {
                program: env!("CARGO_BIN_EXE_turbid").into(),
                scenario: None,
                kind: None,
                cases: 6,
                seed: 1,
                at: None,
                keep: None,
                jobs: std::thread::available_parallelism().map_or(1, usize::from),
            };
            let mut arguments = std::env::args().skip(1).filter(|a| a != "--bench");
            while let Some(name) = arguments.next() {
                let value = arguments.next().ok_or(format!("{name} needs a value"))?;
                let number = || value.parse::<u64>().map_err(|_| format!("{name} {value}: not a number"));
                match name.as_str() {
                    "--program" => options.program = value.into(),
                    "--scenario" => {
                        options.scenario = Some(Scenario::named(&value).ok_or(format!("no scenario {value}"))?);
                    }
                    "--kind" => options.kind = Some(Kind::named(&value).ok_or(format!("no kind {value}"))?),
                    "--cases" => options.cases = number()?,
                    "--seed" => options.seed = number()?,
                    "--at" => options.at = Some(number()?),
                    "--keep" => options.keep = Some(value.into()),
                    "--jobs" => options.jobs = number()?.max(1) as usize,
                    _ => return Err(format!("{name} is not known")),
                }
            }
            if options.at.is_some() && (options.scenario.is_none() || options.kind.is_none()) {
                return Err("--at needs --scenario and --kind".to_owned());
            }
            options.program =
                options.program.canonicalize().map_err(|e| format!("{}: {e}", options.program.display()))?;
            Ok(options)
        }

        fn cases(&self, references: &[Reference]) -> Vec<(usize, Case)> {
            let kinds = KINDS.into_iter().filter(|kind| self.kind.is_none_or(|wanted| wanted == *kind));
            let mut all = Vec::new();
            for kind in kinds {
                for (k, reference) in references.iter().enumerate() {
                    // Of two runs at once there is no one order of calls to replay.
                    if kind == Kind::PowerCut && reference.scenario.beside {
                        continue;
                    }
                    match self.at {
                        Some(at) => all.push((k, Case { kind, at, seed: self.seed })),
                        None => {
                            all.extend(spread(reference, kind, self.cases, self.seed).into_iter().map(|case| (k, case)))
                        }
                    }
                }
            }
            all
        }
    }

    #[derive(Default)]
    struct Row {
        calls: u64,
        cases: u64,
        stopped: u64,
        said: u64,
        well: u64,
        failed: u64,
        left_over: u64,
    }

    pub fn main() -> ExitCode {
        match Options::read().and_then(|options| campaign(&options).map_err(|e| e.to_string())) {
            Ok(0) => ExitCode::SUCCESS,
            Ok(_) => ExitCode::FAILURE,
            Err(message) => {
                eprintln!("error: {message}");
                ExitCode::from(2)
            }
        }
    }

    /// Runs all cases and prints the table; how many failed.
    fn campaign(options: &Options) -> std::io::Result<u64> {
        let began = Instant::now();
        let space = tempfile::tempdir()?;
        let scenarios = SCENARIOS.iter().filter(|s| options.scenario.is_none_or(|wanted| wanted.name == s.name));
        let references: Vec<Reference> =
            scenarios.map(|s| Reference::of(s, &options.program, space.path())).collect::<Result<_, _>>()?;
        let cases = options.cases(&references);
        let (next, rows) = (AtomicUsize::new(0), Mutex::new(BTreeMap::<(usize, Kind), Row>::new()));
        std::thread::scope(|threads| -> std::io::Result<()> {
            let work = || -> std::io::Result<()> {
                let mine = std::iter::repeat_with(|| next.fetch_add(1, Ordering::Relaxed));
                mine.take_while(|k| *k < cases.len()).try_for_each(|k| {
                    if k > 0 && k % 200 == 0 {
                        eprintln!("{k} of {} cases, {:.0} s", cases.len(), began.elapsed().as_secs_f64());
                    }
                    let (scenario, case) = cases[k];
                    let verdict = one(options, &references[scenario], case, space.path())?;
                    let Reference { calls, reads, .. } = references[scenario];
                    let calls = if case.kind.reads() { reads } else { calls };
                    rows.lock()
                        .expect("no holder panics")
                        .entry((scenario, case.kind))
                        .or_default()
                        .add(calls, &verdict);
                    Ok(())
                })
            };
            let workers: Vec<_> = (0..options.jobs).map(|_| threads.spawn(work)).collect();
            workers.into_iter().try_for_each(|worker| worker.join().expect("it does not panic"))
        })?;
        let rows = rows.into_inner().expect("no holder panics");
        let all = print_table(&references, &rows);
        println!("\n{} cases in {:.0} s", all.cases, began.elapsed().as_secs_f64());
        Ok(all.failed)
    }

    /// The sum of all rows.
    fn print_table(references: &[Reference], rows: &BTreeMap<(usize, Kind), Row>) -> Row {
        let head = [
            "scenario",
            "fault",
            "calls",
            "cases",
            "stopped, healed",
            "error said, healed",
            "ended well",
            "failed",
            "files left over",
        ];
        println!("| {} |\n{}|", head.join(" | "), "|---".repeat(head.len()));
        let mut all = Row::default();
        for ((scenario, kind), row) in rows {
            row.print(references[*scenario].scenario.name, kind.name());
            all.cases += row.cases;
            all.stopped += row.stopped;
            all.said += row.said;
            all.well += row.well;
            all.failed += row.failed;
            all.left_over += row.left_over;
        }
        all.print("all", "");
        all
    }

    /// Runs a case, and says at once what is wrong and how to see it again.
    fn one(options: &Options, reference: &Reference, case: Case, space: &Path) -> std::io::Result<Verdict> {
        let Case { kind, at, seed } = case;
        let name = format!("{}-{}-{at}-{seed}", reference.scenario.name, kind.name());
        let folder = options.keep.clone().unwrap_or_else(|| space.join(name));
        let verdict = run(&options.program, reference, case, &folder, options.keep.is_some())?;
        if options.keep.is_none() {
            std::fs::remove_dir_all(&folder)?;
        }
        if !verdict.wrong.is_empty() {
            let again =
                format!("--scenario {} --kind {} --at {at} --seed {seed}", reference.scenario.name, kind.name());
            println!("FAILED {again} ({}): {}", verdict.call, verdict.wrong.join("; "));
        }
        Ok(verdict)
    }

    impl Row {
        fn add(&mut self, calls: u64, verdict: &Verdict) {
            self.calls = calls;
            self.cases += 1;
            self.left_over += verdict.left_over as u64;
            let count = match verdict.outcome {
                _ if !verdict.wrong.is_empty() => &mut self.failed,
                Outcome::Stopped => &mut self.stopped,
                Outcome::Said => &mut self.said,
                Outcome::Well => &mut self.well,
            };
            *count += 1;
        }

        fn print(&self, scenario: &str, kind: &str) {
            let Self { calls, cases, stopped, said, well, failed, left_over } = self;
            println!(
                "| {scenario} | {kind} | {calls} | {cases} | {stopped} | {said} | {well} | {failed} | {left_over} |"
            );
        }
    }
}
