//! One case: a call broken, or the power cut after it; what the program says, and whether the next plain run heals all.

use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::calls::{Call, Op};
use super::disk::Disk;
use super::folder;
use super::kinds::Kind;
use super::program::{Done, Place, instances};
use super::random::Random;
use super::reference::{Reference, digests};
use super::scenarios::{Damage, REPAIR, STAGES};

#[derive(Clone, Copy, Debug)]
pub struct Case {
    pub kind: Kind,
    /// The first call that breaks, from 1; the last one before the power cut.
    pub at: u64,
    /// Of the state after a power cut.
    pub seed: u64,
}

/// How a case went where nothing is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The program was stopped.
    Stopped,
    /// It said an error and what it concerns.
    Said,
    /// It ended well, with right results.
    Well,
}

#[derive(Debug)]
pub struct Verdict {
    /// The call that broke.
    pub call: String,
    pub outcome: Outcome,
    /// All that is wrong.
    pub wrong: Vec<String>,
    /// Unfinished files that are still there after the plain run.
    pub left_over: usize,
}

/// Runs a case in `folder`, which is made. Error: the machine does not allow it.
pub fn run(program: &Path, reference: &Reference, case: Case, folder: &Path, keep: bool) -> io::Result<Verdict> {
    let mut wrong = Vec::new();
    let mut broken = None;
    let (outcome, published) = if case.kind == Kind::PowerCut {
        broken = reference.log.iter().find(|logged| logged.number == case.at).map(|logged| logged.call.clone());
        cut(reference, case, folder)?
    } else {
        break_call(program, reference, case, folder, &mut broken, &mut wrong)?
    };
    if keep {
        folder::copy(&folder.join("work"), &folder.join("broken"))?;
    }
    let place = Place::new(folder.to_owned())?;
    heal(program, reference, &place, published, &mut wrong)?;
    let left_over = folder::left_over(&place.work());
    if !left_over.is_empty() {
        wrong.push(format!("unfinished files are left: {left_over:?}"));
    }
    let name = |path: &Path| path.iter().skip_while(|part| *part != "work").skip(1).collect::<PathBuf>();
    let call = broken.map(|call| format!("{:?} {}", call.op, name(&call.path).display())).unwrap_or_default();
    Ok(Verdict { call, outcome, wrong, left_over: left_over.len() })
}

/// Lays out what the disk holds after a power cut; what had been published by then.
fn cut(reference: &Reference, case: Case, folder: &Path) -> io::Result<(Outcome, BTreeSet<String>)> {
    let mut disk = Disk::of(&reference.base)?;
    // The calls were logged in another copy of the same folder.
    let logged_in = reference.base.parent().expect("below the space").with_file_name("done").join("work");
    let pack = |path: &Path| {
        path.extension().is_some_and(|e| e == "pack") && path.parent().is_some_and(|p| p.ends_with("packs"))
    };
    let (mut said, mut safe) = (String::new(), String::new());
    for logged in reference.log.iter().filter(|logged| logged.number <= case.at) {
        let Ok(inside) = logged.call.path.strip_prefix(&logged_in) else {
            said.push_str(&String::from_utf8_lossy(&logged.data));
            continue;
        };
        if logged.call.op == Op::Sync && pack(inside) {
            safe.clone_from(&said);
        }
        disk.make(&logged.moved(&logged_in, &reference.base));
    }
    fs::create_dir_all(folder.join("work"))?;
    disk.cut(&mut Random::new(case.seed), &folder.join("work"))?;
    Ok((Outcome::Stopped, instances(&safe, "ran").into_iter().collect()))
}

/// Runs the command with the call broken; what it had published.
fn break_call(
    program: &Path,
    reference: &Reference,
    case: Case,
    folder: &Path,
    broken: &mut Option<Call>,
    wrong: &mut Vec<String>,
) -> io::Result<(Outcome, BTreeSet<String>)> {
    let scenario = reference.scenario;
    folder::copy(&reference.base, &folder.join("work"))?;
    let place = Place::new(folder.to_owned())?;
    let mut decide = |number: u64, call: &Call| {
        if number == case.at && call.op.only_reads() == case.kind.reads() {
            *broken = Some(call.clone());
        }
        case.kind.action(case.at, number, call)
    };
    let (done, beside) = std::thread::scope(|threads| -> io::Result<_> {
        let second = scenario.beside.then(|| threads.spawn(|| place.run(program, scenario.next, "beside")));
        let (done, ..) = place.run_broken(program, scenario.command, false, &mut decide)?;
        Ok((done, second.map(|second| second.join().expect("it does not panic")).transpose()?))
    })?;
    let mut published: BTreeSet<String> = done.instances("ran").into_iter().collect();
    wrong.extend(done.broke());
    if let Some(beside) = beside {
        wrong.extend(beside.broke().map(|why| format!("the run beside it: {why}")));
        if beside.code != Some(0) {
            wrong.push(format!("the run beside it: {}", beside.last_words()));
        }
        published.extend(beside.instances("ran"));
    }
    let outcome = match done.code {
        None if case.kind.kills() && !done.hung => Outcome::Stopped,
        Some(0) => {
            ended_well(program, reference, &place, wrong)?;
            Outcome::Well
        }
        Some(1 | 2) if !case.kind.kills() && case.kind != Kind::Short => {
            wrong.extend(names_nothing(case.kind, &done));
            Outcome::Said
        }
        _ => {
            wrong.push(done.last_words());
            Outcome::Stopped
        }
    };
    Ok((outcome, published))
}

/// An error has to name what it concerns: a path of the outputs or a stage, and what happened to it.
fn names_nothing(kind: Kind, done: &Done) -> Option<String> {
    let text = done.text();
    let place = STAGES.iter().chain(&["outputs", "exported", "p.yaml"]).any(|name| text.contains(name));
    // What cannot be read may pass for what is not there.
    let cause = kind.reads() || ["(os error ", "is full"].iter().any(|cause| text.contains(cause));
    (!place || !cause).then(|| format!("the error names no place or no cause: {}", done.last_words()))
}

/// Who says that all went well has done all.
fn ended_well(program: &Path, reference: &Reference, place: &Place, wrong: &mut Vec<String>) -> io::Result<()> {
    if digests(program, place)? != reference.digests_done {
        wrong.push("exit 0, but the digests are not those of an undisturbed command".to_owned());
    }
    if let (Some(name), Some([_, after])) = (reference.scenario.writes, &reference.written)
        && fs::read(place.work().join(name)).ok() != *after
    {
        wrong.push(format!("exit 0, but {name} is not what an undisturbed command writes"));
    }
    if reference.scenario.repairs() {
        let verified = place.run(program, &["cache", "verify"], "verify")?;
        if verified.code != Some(0) {
            wrong.push(format!("repair: exit 0, then verify: {}", verified.last_words()));
        }
    }
    Ok(())
}

/// The next plain run: it goes well, has the same results as if nothing had happened, and makes again nothing that was published.
fn heal(
    program: &Path,
    reference: &Reference,
    place: &Place,
    published: BTreeSet<String>,
    wrong: &mut Vec<String>,
) -> io::Result<()> {
    let scenario = reference.scenario;
    if let (Some(name), Some(whole)) = (scenario.writes, &reference.written)
        && !whole.contains(&fs::read(place.work().join(name)).ok())
    {
        wrong.push(format!("{name} is neither the old one nor the new one"));
    }
    if scenario.damage != Damage::None {
        // A run does not read what it does not need: bits that flipped are found by `verify`.
        let repaired = place.run(program, REPAIR, "repaired")?;
        if repaired.code != Some(0) {
            wrong.push(format!("repair once more: {}", repaired.last_words()));
        }
    }
    let next = place.run(program, scenario.next, "next")?;
    wrong.extend(next.broke().map(|why| format!("next run: {why}")));
    if next.code != Some(0) {
        wrong.push(format!("next run: {}", next.last_words()));
        return Ok(());
    }
    let lost: Vec<_> =
        next.instances("started").into_iter().filter(|i| published.contains(i) || reference.kept.contains(i)).collect();
    if !lost.is_empty() {
        wrong.push(format!("published, and made again: {}", lost.join(", ")));
    }
    compare(program, reference, place, "after the next run", wrong)?;
    let verified = place.run(program, &["cache", "verify"], "verify")?;
    if verified.code != Some(0) {
        let repaired = place.run(program, REPAIR, "repair")?;
        let again = place.run(program, &["cache", "verify"], "verify")?;
        if repaired.code != Some(0) || again.code != Some(0) {
            wrong.push(format!("verify: {}; repair: {}", again.last_words(), repaired.last_words()));
        }
        let healed = place.run(program, scenario.next, "healed")?;
        if healed.code != Some(0) {
            wrong.push(format!("run after repair: {}", healed.last_words()));
        }
        compare(program, reference, place, "after repair", wrong)?;
    }
    let last = place.run(program, scenario.next, "last")?;
    if last.code != Some(0) || !last.instances("started").is_empty() {
        wrong.push(format!("something is left to do: {}", last.last_words()));
    }
    if let (Some(name), Some([_, after])) = (scenario.writes, &reference.written) {
        let done = place.run(program, scenario.command, "written")?;
        if done.code != Some(0) || fs::read(place.work().join(name)).ok() != *after {
            wrong.push(format!("the command once more: {}", done.last_words()));
        }
    }
    Ok(())
}

fn compare(
    program: &Path,
    reference: &Reference,
    place: &Place,
    when: &str,
    wrong: &mut Vec<String>,
) -> io::Result<()> {
    let found = digests(program, place)?;
    let missing = reference.digests.difference(&found).count();
    let strange =
        found.iter().filter(|d| !reference.digests.contains(*d) && !reference.digests_before.contains(*d)).count();
    if missing + strange > 0 {
        wrong.push(format!("{when}: {missing} digests missing, {strange} of other results"));
    }
    let latest = folder::latest(&place.outputs());
    let differing = reference.latest.iter().filter(|(path, bytes)| latest.get(*path) != Some(*bytes));
    let differing: Vec<_> = differing.map(|(path, _)| path.display().to_string()).collect();
    if !differing.is_empty() {
        wrong.push(format!("{when}: latest is not what it should be: {}", differing.join(", ")));
    }
    let more: Vec<_> =
        latest.keys().filter(|path| !reference.latest.contains_key(*path) && !unfinished(path)).collect();
    if !more.is_empty() {
        wrong.push(format!("{when}: latest holds more: {more:?}"));
    }
    Ok(())
}

/// Counted by themselves.
fn unfinished(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    name.starts_with("new-") || name.ends_with(".new")
}
