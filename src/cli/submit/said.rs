//! What `turbid submit` says, to people and to programs.

use std::cell::Cell;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::cli::print;
use crate::run::progress::Json;
use crate::submit::engine::{Engine, ranges};
use crate::submit::follow::{Event, Unfinished};
use crate::submit::job::{Job, Submission};
use crate::submit::stand::{Tally, Why};
use crate::terminal::tell;

use super::parts::Ahead;

/// How the shards stand is said no more often than this.
const PAUSE: Duration = Duration::from_secs(5);
/// So many shards are named that did not do what they should have done, ...
const SHARDS: usize = 10;
/// ... and of each so many instances.
const INSTANCES: usize = 3;

pub struct Said {
    pub json: bool,
    /// The command that submits the same.
    pub again: String,
    /// The command that runs it here.
    pub run: String,
    pub began: Instant,
}

/// `job 17 of Slurm`
pub fn named(job: &Job, submission: &Submission, engine: &dyn Engine) -> String {
    format!("job {} of {} ({})", submission.ticket.id, engine.name(), job.folder.display())
}

/// The command that ends all tasks.
pub fn cancel(job: &Job, submission: &Submission, engine: &dyn Engine) -> String {
    engine.cancel(&submission.ticket).unwrap_or_else(|| format!("touch '{}'", job.stop().display()))
}

impl Said {
    pub fn up_to_date(&self, hits: usize) {
        match self.json {
            true => self.finished(hits, 0, Vec::new()),
            false => print(&format!("nothing to submit: {hits} of {hits} instances are up to date")),
        }
    }

    /// Nothing is left for shards.
    pub fn only_left(&self, ahead: &Ahead) {
        match self.json {
            true => Json::event(json!({"event": "left", "hits": ahead.hits, "left": ahead.left, "command": self.run})),
            false => print(&format!(
                "nothing to submit: what is left ({} instances) gathers what shards made; run it here: {}",
                ahead.left, self.run
            )),
        }
    }

    pub fn submitted(&self, job: &Job, submission: &Submission, engine: &dyn Engine) {
        if self.json {
            return Json::event(event(job, submission, engine));
        }
        let Submission { round, shards, ticket } = submission;
        let of = job.work.shards;
        let which = match shards.len() {
            1 => format!("1 task, shard {} of {of}", shards[0]),
            n if n == of as usize => format!("{n} tasks"),
            n => format!("{n} tasks, shards {} of {of}", ranges(shards)),
        };
        let again = if *round > 1 { "submitted again" } else { "submitted" };
        tell(&format!("{again} to {}: job {}, {which}; {}", engine.name(), ticket.id, job.folder.display()));
    }

    /// How to go on.
    pub fn ways(&self, job: &Job, submission: &Submission, engine: &dyn Engine) {
        let (follow, cancel) = (format!("{} --follow", self.again), cancel(job, submission, engine));
        if self.json {
            return Json::event(json!({"event": "ways", "follow": follow, "cancel": cancel, "run": self.run}));
        }
        print(&format!("follow it, and gather at its end: {follow}\nend its tasks: {cancel}"));
    }

    pub fn taken_up(&self, name: &str, tally: &Tally, other_number: bool) {
        if self.json {
            return Json::event(
                json!({"event": "taken_up", "job": name, "done": tally.done, "running": tally.runs, "waiting": tally.waits}),
            );
        }
        let note = if other_number { "; its number of shards stays as it is" } else { "" };
        tell(&format!("{name} is at work on this already: {}{note}", tally.text()));
    }

    pub fn warning(&self, message: &str) {
        match self.json {
            true => Json::event(json!({"event": "warning", "message": message})),
            false => tell(&format!("warning: {message}")),
        }
    }

    /// What is said while a job is followed.
    pub fn follower<'a>(&'a self, job: &'a Job, engine: &'a dyn Engine) -> impl Fn(Event<'_>) + 'a {
        let last = Cell::new(None::<Instant>);
        move |event| match event {
            Event::Submitted(submission) => self.submitted(job, submission, engine),
            Event::Warning(message) => self.warning(&message),
            Event::Stands(tally) => {
                let soon = last.get().is_some_and(|last| last.elapsed() < PAUSE);
                if !soon || tally.is_over() {
                    last.set(Some(Instant::now()));
                    self.stands(tally);
                }
            }
        }
    }

    fn stands(&self, tally: &Tally) {
        if !self.json {
            return tell(&tally.text());
        }
        let failed: Vec<u32> = tally.failed.keys().copied().collect();
        let (done, runs, waits, what) = (tally.done, tally.runs, tally.waits, &tally.waits_for);
        Json::event(json!({
            "event": "shards", "done": done, "running": runs, "waiting": waits, "failed": failed, "waits_for": what,
            "seconds": self.began.elapsed().as_secs_f64(),
        }));
    }

    /// What is missing, shard by shard, and where the output of its task lies.
    pub fn unfinished(&self, job: &Job, unfinished: &Unfinished) {
        let Unfinished { why, stale, failed, round } = unfinished;
        let log = |shard: u32| job.log(*round, shard).display().to_string();
        let ended = |shard: u32| failed.get(&shard).map_or_else(|| "made less than it should".to_owned(), Why::text);
        if self.json {
            let shards = stale.shards.iter().map(|(shard, part)| {
                json!({"shard": shard, "why": ended(*shard), "missing": part.count, "instances": part.first, "log": log(*shard)})
            });
            return self.finished(stale.hits, stale.count(), shards.collect());
        }
        let mut shards: Vec<u32> = stale.shards.keys().copied().collect();
        shards.extend(failed.keys().filter(|shard| !stale.shards.contains_key(shard)));
        let mut text = format!("not done: {why}\n");
        for shard in shards.iter().take(SHARDS) {
            text += &format!("shard {shard} {}: {}\n", ended(*shard), log(*shard));
            if let Some(part) = stale.shards.get(shard) {
                let named = part.first.iter().take(INSTANCES).cloned().collect::<Vec<_>>().join(", ");
                let more = part.count.saturating_sub(INSTANCES);
                let more = if more > 0 { format!(" and {more} more") } else { String::new() };
                text += &format!("  missing: {named}{more}\n");
            }
        }
        if shards.len() > SHARDS {
            text += &format!("and {} more shards\n", shards.len() - SHARDS);
        }
        tell(&format!(
            "{text}what is done is kept. Submit the rest again: {} --follow; run it here: {}",
            self.again, self.run
        ));
    }

    fn finished(&self, hits: usize, failed: usize, shards: Vec<Value>) {
        let seconds = self.began.elapsed().as_secs_f64();
        Json::event(json!({
            "event": "finished", "hits": hits, "ran": 0, "failed": failed, "seconds": seconds, "interrupted": false, "shards": shards,
        }));
    }
}

fn event(job: &Job, submission: &Submission, engine: &dyn Engine) -> Value {
    let Submission { round, shards, ticket } = submission;
    json!({
        "event": "submitted", "engine": engine.name(), "id": ticket.id, "round": round, "shards": shards, "of": job.work.shards,
        "folder": job.folder,
    })
}
