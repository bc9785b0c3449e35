//! Follows a job until its shards have done what there was to do, and submits again what failed.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use crate::run::Interrupt;

use super::engine::{Array, Engine, Look, Ticket, Trouble};
use super::job::{Job, Submission};
use super::stand::{Tally, Why};

/// The folder of the job is looked at so often: a list of names, no file is opened.
const GLANCE: Duration = Duration::from_millis(250);
/// The engine is asked first after, and then less and less often ...
const FIRST_LOOK: Duration = Duration::from_secs(2);
/// ... down to: administrators do not like to see their scheduler asked every second.
const LAST_LOOK: Duration = Duration::from_secs(30);
/// What ended without a word is believed when the engine says so again after this.
const SECOND_LOOK: Duration = Duration::from_secs(3);

/// So many missing instances of a shard are named.
const NAMED: usize = 10;

/// What a fresh look at pipeline and store found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Stale {
    /// What is not up to date, by the shard that runs it.
    pub shards: BTreeMap<u32, Missing>,
    /// How many are not up to date that no shard runs, because they gather what several make.
    pub left: usize,
    /// How many are up to date.
    pub hits: usize,
}

impl Stale {
    /// How many are not up to date.
    pub fn count(&self) -> usize {
        self.left + self.shards.values().map(|missing| missing.count).sum::<usize>()
    }
}

/// Instances that are not up to date.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Missing {
    pub count: usize,
    /// Names of the first few.
    pub first: Vec<String>,
}

impl Missing {
    /// Adds `count` instances that this name stands for.
    pub fn add(&mut self, name: String, count: usize) {
        self.count += count;
        if self.first.len() < NAMED {
            self.first.push(name);
        }
    }
}

/// What happens meanwhile.
pub enum Event<'a> {
    Submitted(&'a Submission),
    Stands(&'a Tally),
    Warning(String),
}

/// A job that is followed.
pub struct Following<'a, E> {
    pub job: &'a Job,
    pub engine: &'a dyn Engine,
    /// So many more times failed shards are submitted.
    pub retries: usize,
    /// So long an engine that does not answer is waited for.
    pub patience: Duration,
    pub interrupt: &'a Interrupt,
    pub stale: &'a dyn Fn() -> Result<Stale, E>,
    pub told: &'a dyn Fn(Event<'_>),
}

/// How following ended.
pub enum End {
    /// All that shards run is up to date.
    Done(Stale),
    /// It is not.
    Unfinished(Unfinished),
    /// Ctrl-C: the tasks go on.
    Interrupted,
}

/// What is left of a job that is over, and why it is not submitted again.
pub struct Unfinished {
    pub why: String,
    pub stale: Stale,
    /// How the tasks of the last round ended.
    pub failed: BTreeMap<u32, Why>,
    pub round: usize,
}

/// Why following stopped.
pub enum Stopped<E> {
    Look(E),
    Engine(Trouble),
    Job(String),
}

/// Submits a round of a job.
pub fn submit(job: &Job, engine: &dyn Engine, round: usize, shards: Vec<u32>) -> Result<Submission, Submitting> {
    let folder = job.begin_round(round).map_err(Submitting::Job)?;
    let (name, script) = (format!("turbid-{}", job.work.pipeline.replace(char::is_whitespace, "_")), job.script());
    let array = Array {
        name: &name,
        script: &script,
        round,
        shards: &shards,
        folder: &folder,
        cwd: &job.work.cwd,
        threads: job.work.threads,
        options: &job.work.options,
    };
    let ticket = engine.submit(&array).map_err(Submitting::Engine)?;
    let submission = Submission { round, shards, ticket };
    job.submitted(&submission).map_err(Submitting::Job)?;
    Ok(submission)
}

/// Why a round could not be submitted.
pub enum Submitting {
    Engine(Trouble),
    Job(String),
}

impl<E> From<Submitting> for Stopped<E> {
    fn from(error: Submitting) -> Self {
        match error {
            Submitting::Engine(trouble) => Self::Engine(trouble),
            Submitting::Job(message) => Self::Job(message),
        }
    }
}

/// How a round ended.
enum Round {
    Over(BTreeMap<u32, Why>),
    Interrupted,
}

impl<E> Following<'_, E> {
    /// From the last round that was submitted on.
    pub fn follow(&self, mut submission: Submission) -> Result<End, Stopped<E>> {
        let mut left = self.retries;
        loop {
            let failed = match self.round(&submission)? {
                Round::Over(failed) => failed,
                Round::Interrupted => return Ok(End::Interrupted),
            };
            let round = submission.round;
            let changed = self.job.work.changed();
            if let Some(path) = changed.first() {
                let copies = self.job.folder.display();
                let why = format!("{} changed since the job was submitted (as it was: {copies})", path.display());
                return Ok(End::Unfinished(Unfinished { why, stale: Stale::default(), failed, round }));
            }
            let stale = (self.stale)().map_err(Stopped::Look)?;
            if stale.shards.is_empty() {
                return Ok(End::Done(stale));
            }
            let why = match failed.values().find(|why| why.is_final()) {
                Some(why) => Some(format!("a task {}", why.text())),
                None if self.job.stop().exists() => Some("it was stopped".to_owned()),
                None if left == 0 => Some(format!("{} tries did not do it", self.retries + 1)),
                None => None,
            };
            if let Some(why) = why {
                return Ok(End::Unfinished(Unfinished { why, stale, failed, round }));
            }
            left -= 1;
            let ended: Vec<u32> = failed.keys().copied().collect();
            self.engine.give_up(&submission.ticket, &ended);
            let shards: Vec<u32> = stale.shards.keys().copied().collect();
            let Some(again) = self.again(round + 1, &shards)? else { return Ok(End::Interrupted) };
            (self.told)(Event::Submitted(&again));
            submission = again;
        }
    }

    /// Submits once more, as soon as the engine answers; nothing after Ctrl-C.
    fn again(&self, round: usize, shards: &[u32]) -> Result<Option<Submission>, Stopped<E>> {
        let mut silence = Silence::default();
        loop {
            match submit(self.job, self.engine, round, shards.to_vec()) {
                Err(Submitting::Engine(trouble @ Trouble::Silent { .. })) => self.silent(&mut silence, trouble)?,
                submitted => return Ok(Some(submitted?)),
            }
            if !self.pause(LAST_LOOK.min(self.patience / 4)) {
                return Ok(None);
            }
        }
    }

    /// Until no task of a round is at work any more.
    fn round(&self, submission: &Submission) -> Result<Round, Stopped<E>> {
        let Submission { round, shards, ticket } = submission;
        let (mut look, mut asked, mut pause) = (None, Instant::now(), FIRST_LOOK);
        let (mut silence, mut told, mut second) = (Silence::default(), None, false);
        loop {
            let mut answered = false;
            if asked.elapsed() >= pause {
                if let Some(found) = self.look(ticket, shards, &mut silence)? {
                    (look, answered) = (Some(found), true);
                }
                (asked, pause) = (Instant::now(), (pause * 3 / 2).min(LAST_LOOK));
            }
            let marks = self.job.marks(*round);
            let tally = Tally::of(shards, &marks, look.as_ref());
            if told.as_ref() != Some(&tally) {
                (self.told)(Event::Stands(&tally));
            }
            if tally.is_over() && tally.failed.is_empty() {
                return Ok(Round::Over(tally.failed));
            }
            // Of what failed the engine must say that it is not going to run it again.
            if tally.is_over() && answered {
                if !tally.unsaid || second {
                    return Ok(Round::Over(tally.failed));
                }
                second = true;
            } else if answered {
                second = false;
            }
            if tally.is_over() || shards.iter().all(|shard| marks.ended.contains_key(shard)) {
                pause = pause.min(SECOND_LOOK);
            }
            told = Some(tally);
            if !self.pause(GLANCE) {
                return Ok(Round::Interrupted);
            }
        }
    }

    fn look(&self, ticket: &Ticket, shards: &[u32], silence: &mut Silence) -> Result<Option<Look>, Stopped<E>> {
        match self.engine.look(ticket, shards) {
            Ok(look) => {
                *silence = Silence::default();
                Ok(Some(look))
            }
            // Ctrl-C ends the engine's own command too.
            Err(_) if self.interrupt.requested() => Ok(None),
            Err(trouble @ Trouble::Silent { .. }) => self.silent(silence, trouble).map(|()| None),
            Err(trouble) => Err(Stopped::Engine(trouble)),
        }
    }

    /// Once a warning, and after long enough the end.
    fn silent(&self, silence: &mut Silence, trouble: Trouble) -> Result<(), Stopped<E>> {
        let since = *silence.since.get_or_insert_with(Instant::now);
        if since.elapsed() >= self.patience {
            return Err(Stopped::Engine(trouble));
        }
        if !std::mem::replace(&mut silence.told, true) {
            let minutes = self.patience.as_secs_f64() / 60.0;
            (self.told)(Event::Warning(format!("{}; waiting for it, up to {minutes:.0} min", trouble.text())));
        }
        Ok(())
    }

    /// Whether to go on after this while.
    fn pause(&self, time: Duration) -> bool {
        let end = Instant::now() + time;
        loop {
            if self.interrupt.requested() {
                return false;
            }
            let rest = end.saturating_duration_since(Instant::now());
            if rest.is_zero() {
                return true;
            }
            std::thread::sleep(rest.min(Duration::from_millis(100)));
        }
    }
}

/// Since when an engine has not answered.
#[derive(Default)]
struct Silence {
    since: Option<Instant>,
    told: bool,
}
