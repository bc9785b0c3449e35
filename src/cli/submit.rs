//! `turbid submit`: hands shards over to an engine, and follows them to the end.

mod dealt;
mod parts;
mod said;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::Args;

use crate::digest::Digest;
use crate::input_file;
use crate::registry::Registry;
use crate::run::Interrupt;
use crate::run::latest::Command;
use crate::submit::follow::{End, Following, Stopped, Submitting, submit};
use crate::submit::job::Submission;
use crate::submit::stand::Tally;
use crate::submit::{ENGINES, Engine, Job, Trouble, Work, batches, engine, program};
use crate::terminal::tell;
use crate::threads;
use turbid_contract::file::MOST_BYTES;

use super::{Done, Failure, Pipeline, perform};
use parts::{Ahead, Parts};
use said::Said;

/// So many of the latest jobs may still be at work.
const LATEST_JOBS: usize = 32;

/// A job, what of it was submitted last, and the engine that works on it.
type AtWork = (Job, Submission, Box<dyn Engine>);

#[derive(Args)]
pub struct Submit {
    #[command(flatten)]
    pipeline: Pipeline,
    /// Stages (or STAGE.PORT), studies and data sets to bring up to date; all leaves by default
    #[arg(value_name = "STAGE")]
    targets: Vec<String>,
    /// Who runs the shards: hq (HyperQueue) or slurm
    #[arg(long, value_name = "ENGINE", value_parser = ENGINES)]
    engine: String,
    /// At most so many tasks; by default as many as have enough to do, up to 1000
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    shards: Option<u32>,
    /// Seconds of work that a task has at the least, by the estimates of `turbid plan`
    #[arg(long, value_name = "SECONDS", default_value_t = batches::LEAST_S, value_parser = number)]
    task_seconds: f64,
    /// Stay until all is done: say how far it is, submit again what failed, and gather here at the end
    #[arg(long)]
    follow: bool,
    /// How many times what failed is submitted again
    #[arg(long, value_name = "R", default_value_t = 2)]
    retries: usize,
    /// How long an engine that does not answer is waited for, in minutes
    #[arg(long, value_name = "MINUTES", default_value_t = 60.0, value_parser = number)]
    patience: f64,
    /// Threads of each task
    #[arg(short = 'j', long = "jobs", value_name = "N", default_value_t = 1, value_parser = threads::parse)]
    jobs: usize,
    /// Further options for `sbatch` or `hq submit`, in one argument: --engine-args='--partition=long --time=2:00:00'
    #[arg(long, value_name = "OPTIONS", allow_hyphen_values = true, default_value = "")]
    engine_args: String,
    /// Print events as JSON lines
    #[arg(long)]
    json: bool,
}

fn number(text: &str) -> Result<f64, String> {
    let value = text.parse::<f64>().ok().filter(|value| (0.0..=1e6).contains(value));
    value.ok_or_else(|| "this is a number from 0 to 1000000".to_owned())
}

impl Submit {
    pub fn run(&self, registry: &Registry) -> Done {
        let began = Instant::now();
        let options = program::words(&self.engine_args).map_err(|e| Failure::Input(format!("--engine-args {e}")))?;
        let parts = Parts::of(&self.pipeline, &self.targets, registry)?;
        let least_s = self.task_seconds * self.jobs as f64;
        let ahead = parts.ahead(least_s)?;
        let command = Command::of(parts.plan(), self.pipeline.outputs.path());
        let again = format!("{} --engine {}", command.command("submit", &self.targets), self.engine);
        let said = Said { json: self.json, again, run: command.run_of(&self.targets), began };
        if ahead.stale() == 0 {
            said.up_to_date(ahead.hits);
            return if self.follow { self.gather(registry) } else { Ok(()) };
        }
        if ahead.in_shards == 0 && !self.follow {
            said.only_left(&ahead);
            return Ok(());
        }
        if ahead.in_shards == 0 {
            return self.gather(registry);
        }
        // From here on there may be a job that goes on without us, and Ctrl-C must not leave anybody without its name.
        let interrupt = if self.follow { Interrupt::listen() } else { Ok(Interrupt::default()) };
        let interrupt = interrupt.map_err(|e| Failure::Failed(format!("signals: {e}")))?;
        let engine = engine(&self.engine).expect("clap takes these names alone");
        let work = self.work(&parts, &ahead, options)?;
        let (job, submission, engine) = match self.at_work(&work, &said)? {
            Some((job, submission, engine)) => (job, submission, engine),
            None => {
                let tasks = batches::tasks(ahead.cpu_s, least_s, self.shards);
                let work = Work { shards: parts.shards(tasks, &ahead), ..work };
                let (job, submission) = self.submit(work, &parts, &ahead, engine.as_ref())?;
                said.submitted(&job, &submission, engine.as_ref());
                (job, submission, engine)
            }
        };
        if !self.follow {
            said.ways(&job, &submission, engine.as_ref());
            return Ok(());
        }
        self.follow(&parts, (job, submission, engine), &interrupt, &said, registry)
    }

    /// What is to be done, for any number of shards.
    fn work(&self, parts: &Parts<'_>, ahead: &Ahead, options: Vec<String>) -> Result<Work, Failure> {
        let whole = |path: &Path| {
            std::path::absolute(path).map_err(|error| Failure::Input(format!("{}: {error}", path.display())))
        };
        let outputs = whole(self.pipeline.outputs.path())?;
        let read =
            parts.plan().spec.texts().map(|text| text.path().to_owned()).chain(ahead.files.iter().cloned()).collect();
        Ok(Work {
            form: Work::FORM,
            pipeline: parts.plan().spec.pipeline.clone(),
            file: whole(&self.pipeline.file)?,
            cwd: whole(Path::new("."))?,
            overrides: self.pipeline.set.clone(),
            targets: self.targets.clone(),
            engine: self.engine.clone(),
            options,
            shards: 1,
            threads: self.jobs,
            command: parts::command(&self.pipeline, &self.targets, &outputs, self.jobs)?,
            read: digests(read)?,
            outputs,
        })
    }

    fn submit(
        &self,
        work: Work,
        parts: &Parts<'_>,
        ahead: &Ahead,
        engine: &dyn Engine,
    ) -> Result<(Job, Submission), Failure> {
        // The digests were taken after the texts were read.
        if let Some(text) = parts.plan().spec.texts().find(|text| !text.is_same()) {
            let text = format!("{} changed while it was read; submit again", text.path().display());
            return Err(Failure::Input(text));
        }
        let program = std::env::current_exe().map_err(|e| Failure::Failed(format!("where this program lies: {e}")))?;
        let shards = parts.stale_shards(work.shards, ahead);
        let job = Job::begin(work, &program, parts.plan().spec.files()).map_err(Failure::Failed)?;
        let submitted = submit(&job, engine, 1, shards).map_err(|error| {
            // Nothing was submitted: nobody is to find it.
            drop(std::fs::remove_dir_all(&job.folder));
            match error {
                Submitting::Engine(trouble) => of_trouble(&trouble),
                Submitting::Job(message) => Failure::Failed(message),
            }
        })?;
        Ok((job, submitted))
    }

    /// A job that is at work on this very thing. Others of the same file, and files of jobs that were edited, are told.
    fn at_work(&self, work: &Work, said: &Said) -> Result<Option<AtWork>, Failure> {
        for job in Job::all(&work.outputs).into_iter().take(LATEST_JOBS) {
            let job = match job {
                Ok(job) if job.work.file == work.file => job,
                Ok(_) => continue,
                Err(message) => {
                    said.warning(&message);
                    continue;
                }
            };
            let (Some(submission), Some(engine)) = (job.submissions().pop(), engine(&job.work.engine)) else {
                continue;
            };
            let marks = job.marks(submission.round);
            if job.stop().exists() || submission.shards.iter().all(|shard| marks.ended.contains_key(shard)) {
                continue;
            }
            let name = said::named(&job, &submission, engine.as_ref());
            let tally = match engine.look(&submission.ticket, &submission.shards) {
                Ok(look) => Tally::of(&submission.shards, &marks, Some(&look)),
                Err(trouble) => {
                    said.warning(&format!("{name} may still be at work: {}", trouble.text()));
                    continue;
                }
            };
            if tally.is_over() {
                continue;
            }
            let other = job.work.differs(work);
            if other.is_empty() {
                said.taken_up(&name, &tally, self.shards.is_some_and(|shards| shards != job.work.shards));
                return Ok(Some((job, submission, engine)));
            }
            let cancel = said::cancel(&job, &submission, engine.as_ref());
            said.warning(&format!(
                "{name} is at work too, and on something else: {}; to end it: {cancel}",
                other.join("; ")
            ));
        }
        Ok(None)
    }

    fn follow(
        &self,
        parts: &Parts<'_>,
        (job, submission, engine): AtWork,
        interrupt: &Interrupt,
        said: &Said,
        registry: &Registry,
    ) -> Done {
        let (job, engine) = (&job, engine.as_ref());
        let stale = || parts.stale(job.work.shards);
        let told = said.follower(job, engine);
        let following = Following {
            job,
            engine,
            retries: self.retries,
            patience: Duration::from_secs_f64(60.0 * self.patience),
            interrupt,
            stale: &stale,
            told: &told,
        };
        let end = following.follow(submission.clone()).map_err(|stopped| match stopped {
            Stopped::Look(failure) => failure,
            Stopped::Job(message) => Failure::Failed(message),
            Stopped::Engine(trouble) => {
                said.ways(job, &submission, engine);
                of_trouble(&trouble)
            }
        })?;
        match end {
            End::Done(_) => self.gather(registry),
            End::Interrupted => {
                let last = job.submissions().pop().unwrap_or(submission);
                tell("interrupted: nobody follows any more, and the tasks go on");
                said.ways(job, &last, engine);
                Err(Failure::Left)
            }
            End::Unfinished(unfinished) => {
                said.unfinished(job, &unfinished);
                Err(Failure::Said)
            }
        }
    }

    /// What gathers over shards, what else is left, and `outputs/latest`: a plain run here.
    fn gather(&self, registry: &Registry) -> Done {
        let mut words = vec!["run".to_owned(), format!("--outputs={}", parts::text(self.pipeline.outputs.path())?)];
        words.extend(self.pipeline.set.iter().map(|set| format!("--set={set}")));
        words.extend(self.json.then(|| "--json".to_owned()));
        words.extend(["--".to_owned(), parts::text(&self.pipeline.file)?]);
        words.extend(self.targets.iter().cloned());
        perform(&words, registry)
    }
}

/// How a command ends for this: an engine that does not answer fails, everything else is what was asked for.
fn of_trouble(trouble: &Trouble) -> Failure {
    match trouble {
        Trouble::Silent { .. } => Failure::Failed(trouble.text()),
        Trouble::Absent { .. } | Trouble::Refused { .. } => Failure::Input(trouble.text()),
    }
}

fn digests(files: Vec<PathBuf>) -> Result<Vec<(PathBuf, Digest)>, Failure> {
    let digest = |path: PathBuf| {
        let path = std::path::absolute(&path).unwrap_or(path);
        match input_file::digest(&path, MOST_BYTES) {
            Ok((digest, _)) => Ok((path, digest)),
            Err(refused) => Err(Failure::Input(format!("{}: {refused}", path.display()))),
        }
    };
    files.into_iter().map(digest).collect()
}
