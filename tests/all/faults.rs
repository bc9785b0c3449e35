//! A few of the cases of `cargo bench --bench faults`, and the laws of what makes them.

#[path = "../../benches/faults/mod.rs"]
#[allow(dead_code, reason = "the bench takes more")]
mod harness;

use std::fs;
use std::path::{Path, PathBuf};

use harness::calls::{Call, Op};
use harness::case::run;
use harness::disk::Disk;
use harness::kinds::Kind;
use harness::random::Random;
use harness::reference::Reference;
use harness::scenarios::Scenario;
use harness::spread;
use harness::tracer::Logged;

/// Whether this system lets one process trace another: some containers do not, and then there is nothing to try.
fn may_trace() -> bool {
    let mut command = std::process::Command::new("true");
    harness::stops::stopping(&mut command, 1);
    match command.spawn() {
        Ok(mut child) => {
            child.kill().and_then(|()| child.wait()).expect("it is ours");
            true
        }
        Err(error) => {
            eprintln!("processes cannot be traced here ({error}): no call is broken");
            false
        }
    }
}

/// Runs cases of one kind, spread over the calls of a scenario; none may leave anything wrong.
fn none_fails(scenario: &str, kinds: &[(Kind, u64)]) {
    if !may_trace() {
        return;
    }
    let (program, space) = (Path::new(env!("CARGO_BIN_EXE_turbid")), tempfile::tempdir().expect("a temporary folder"));
    let scenario = Scenario::named(scenario).expect("it is in the list");
    let reference = Reference::of(scenario, program, space.path()).expect("it goes well undisturbed");
    for (kind, cases) in kinds {
        let chosen = spread(&reference, *kind, *cases, 1);
        assert!(!chosen.is_empty(), "{}: nothing is written", scenario.name);
        for case in chosen {
            let folder = space.path().join(format!("{}-{}-{}", kind.name(), case.at, case.seed));
            let verdict = run(program, &reference, case, &folder, false).expect("calls can be broken here");
            assert!(
                verdict.wrong.is_empty(),
                "cargo bench --bench faults -- --scenario {} --kind {} --at {} --seed {}: {:?}",
                scenario.name,
                kind.name(),
                case.at,
                case.seed,
                verdict.wrong
            );
        }
    }
}

#[test]
fn runs_that_are_killed_are_healed_by_the_next() {
    none_fails("table", &[(Kind::Kill, 9), (Kind::Torn, 3)]);
}

#[test]
fn full_disks_are_said_and_healed() {
    none_fails("table", &[(Kind::Full, 9), (Kind::FullOnce, 3)]);
}

#[test]
fn power_cuts_lose_nothing_that_was_synced() {
    none_fails("table", &[(Kind::PowerCut, 9)]);
}

#[test]
fn collecting_garbage_loses_nothing_that_is_kept() {
    none_fails("gc", &[(Kind::KillAfter, 3), (Kind::ErrorOnce, 3), (Kind::PowerCut, 3)]);
}

#[test]
fn exports_are_whole_or_as_before() {
    none_fails("export", &[(Kind::Torn, 2), (Kind::Full, 2), (Kind::Short, 2)]);
}

/// Each call of the list jumps to the last instruction (stop), whatever falls through meets the one before (pass).
#[test]
fn the_filter_stops_at_what_it_lists() {
    use harness::stops::{CALLS, filter};
    let program = filter();
    assert_eq!(program.len(), CALLS.len() + 3);
    for (at, step) in program.iter().enumerate().skip(1).take(CALLS.len()) {
        assert_eq!((at + 1 + usize::from(step.jt), step.jf), (program.len() - 1, 0), "call {}", step.k);
    }
    let ends: Vec<u32> = program[CALLS.len() + 1..].iter().map(|step| step.k).collect();
    assert_eq!(ends, [libc::SECCOMP_RET_ALLOW, libc::SECCOMP_RET_TRACE]);
}

/// A command that is traced does what it does alone, and each change below the folder is seen with its bytes.
#[test]
fn a_traced_command_is_seen_and_undisturbed() {
    use harness::tracer::{Action, Follow, follow};
    if !may_trace() {
        return;
    }
    let space = tempfile::tempdir().expect("a temporary folder");
    let folder = space.path().canonicalize().expect("it is there");
    let mut shell = std::process::Command::new("sh");
    shell.arg("-c").arg("mkdir d; printf abc > d/f; mv d/f d/g; rm d/g; exit 3").current_dir(&folder);
    let mut seen = Vec::new();
    let mut decide = |_: u64, call: &Call| {
        if !call.op.only_reads() {
            seen.push(call.path.strip_prefix(&folder).expect("below it").to_owned());
        }
        Action::Go
    };
    let what = Follow { folder: &folder, said: Path::new("/dev/null"), log: true, decide: &mut decide };
    let ended = follow(shell, what).expect("calls can be followed here");
    assert_eq!((ended.code, ended.hung, ended.calls), (Some(3), false, 5));
    assert_eq!(seen, ["d", "d/f", "d/f", "d/g", "d/g"].map(PathBuf::from));
    assert_eq!(ended.log[2].data, b"abc");
    assert_eq!(ended.log[3].call.op, Op::Rename { from: folder.join("d/f") });
}

/// A file that is written, synced, renamed and whose folder is synced is there after every power cut; what is not synced is lost after
/// some, whole after some, and torn after some.
#[test]
fn what_was_synced_stays() {
    const PAGE: usize = 4096;
    let space = tempfile::tempdir().expect("a temporary folder");
    let root = space.path().join("root");
    fs::create_dir(&root).expect("ours");
    let mut disk = Disk::of(&root).expect("readable");
    let bytes = vec![7; 3 * PAGE];
    let [folder, fresh, safe, loose] = ["d", "d/new", "d/safe", "d/loose"].map(|name| root.join(name));
    let write = || Op::Write { offset: 0, bytes: bytes.len() as u64 };
    for (op, path) in [
        (Op::MakeFolder, &folder),
        (Op::Create, &fresh),
        (write(), &fresh),
        (Op::Sync, &fresh),
        (Op::Rename { from: fresh.clone() }, &safe),
        (Op::Sync, &folder),
        (Op::Create, &loose),
        (write(), &loose),
    ] {
        disk.make(&Logged { number: 0, call: Call { op, path: path.clone() }, data: bytes.clone() });
    }
    let (mut gone, mut whole, mut torn) = (0, 0, 0);
    for seed in 0..100 {
        let at = space.path().join(format!("{seed}"));
        fs::create_dir(&at).expect("ours");
        disk.cut(&mut Random::new(seed), &at).expect("written");
        assert_eq!(fs::read(at.join("d/safe")).expect("it was synced"), bytes, "seed {seed}");
        assert!(!at.join("d/new").exists(), "seed {seed}");
        match fs::read(at.join("d/loose")) {
            Err(_) => gone += 1,
            Ok(found) if found == bytes => whole += 1,
            Ok(_) => torn += 1,
        }
    }
    assert!(gone > 9 && whole > 9 && torn > 9, "{gone} gone, {whole} whole, {torn} torn");
}
