//! A scenario undisturbed: what each of its broken cases is compared with.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::folder;
use super::program::{Done, Place};
use super::scenarios::{Damage, REPAIR, STAGES, Scenario};
use super::tracer::{Action, Logged};

pub struct Reference {
    pub scenario: &'static Scenario,
    /// What was there before the command.
    pub base: PathBuf,
    /// Calls of the command that change a file, those that only read, and all that it changed.
    pub calls: u64,
    pub reads: u64,
    pub log: Vec<Logged>,
    /// Digests before the command, after it, and after the plain run that comes next.
    pub digests_before: BTreeSet<String>,
    pub digests_done: BTreeSet<String>,
    pub digests: BTreeSet<String>,
    /// `outputs/latest` after the plain run.
    pub latest: BTreeMap<PathBuf, Option<Vec<u8>>>,
    /// Instances that are up to date before the command, and after it.
    pub kept: BTreeSet<String>,
    /// The file that the command writes: before and after it.
    pub written: Option<[Option<Vec<u8>>; 2]>,
}

fn well(done: Done, what: &[&str]) -> io::Result<Done> {
    let ok = done.code == Some(0);
    if ok {
        Ok(done)
    } else {
        Err(io::Error::other(format!("undisturbed `{}`: {}", what.join(" "), done.last_words())))
    }
}

/// The sorted digests of all blobs.
pub fn digests(program: &Path, place: &Place) -> io::Result<BTreeSet<String>> {
    let what = ["cache", "digests"];
    let done = well(place.run(program, &what, "digests")?, &what)?;
    Ok(done.out.lines().filter(|line| !line.is_empty()).map(str::to_owned).collect())
}

impl Reference {
    /// Runs the scenario undisturbed, in folders below `space`. Error: it does not go well.
    pub fn of(scenario: &'static Scenario, program: &Path, space: &Path) -> io::Result<Self> {
        let space = space.join(scenario.name);
        let base = Place::new(space.join("base"))?;
        scenario.prepare(program, &base)?;
        let next = |place: &Place| -> io::Result<Done> {
            if scenario.damage != Damage::None {
                well(place.run(program, REPAIR, "repaired")?, REPAIR)?;
            }
            well(place.run(program, scenario.next, "next")?, scenario.next)
        };
        let copy = |name: &str| -> io::Result<Place> {
            folder::copy(&base.work(), &space.join(name).join("work"))?;
            Place::new(space.join(name))
        };
        let started = |done: &Done| done.instances("started").into_iter().collect::<BTreeSet<_>>();

        let stale_before = started(&next(&copy("not-done")?)?);
        let place = copy("done")?;
        let written = |place: &Place| scenario.writes.map(|name| fs::read(place.work().join(name)).ok());
        let before = written(&base);
        let (done, [calls, reads], log) = place.run_broken(program, scenario.command, true, &mut |_, _| Action::Go)?;
        well(done, scenario.command)?;
        let digests_done = digests(program, &place)?;
        let after = written(&place);
        let stale_after = started(&next(&place)?);
        let kept =
            STAGES.map(str::to_owned).into_iter().filter(|s| !stale_before.contains(s) && !stale_after.contains(s));
        let reference = Self {
            scenario,
            calls,
            reads,
            log,
            digests_before: digests(program, &base)?,
            digests_done,
            digests: digests(program, &place)?,
            latest: folder::latest(&place.outputs()),
            kept: kept.collect(),
            written: before.zip(after).map(|(before, after)| [before, after]),
            base: base.work(),
        };
        if reference.latest.is_empty() || reference.latest.values().any(Option::is_none) {
            return Err(io::Error::other("an undisturbed run leaves nothing whole in outputs/latest"));
        }
        Ok(reference)
    }
}
