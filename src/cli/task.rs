//! `turbid task JOB ROUND SHARD`: what an engine starts. One shard of a job, unless job or pipeline were changed meanwhile.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;

use crate::registry::Registry;
use crate::submit::Job;
use crate::submit::job::Marked;
use crate::terminal::tell;

use super::{Done, Failure, perform};

/// So often a task looks whether it is to stop: ten thousand of them ask a file system a thousand times a second.
const LOOK: Duration = Duration::from_secs(10);

#[derive(Args)]
pub struct Task {
    /// The file of the job
    job: PathBuf,
    round: usize,
    shard: u32,
}

impl Task {
    pub fn run(&self, registry: &Registry) -> Done {
        let Self { round, shard, .. } = *self;
        let marks = Marked::of(&self.job, round, shard);
        marks.forget();
        let done = Job::read(&self.job).map_err(Failure::Input).and_then(|job| self.work(&job, registry));
        let code = done.as_ref().err().map_or(0, Failure::code);
        marks.ended(code.into()).map_err(Failure::Failed)?;
        done
    }

    fn work(&self, job: &Job, registry: &Registry) -> Done {
        let work = &job.work;
        if !(1..=work.shards).contains(&self.shard) {
            let text =
                format!("{}: the job has shards 1 to {}, and no {}", self.job.display(), work.shards, self.shard);
            return Err(Failure::Input(text));
        }
        std::env::set_current_dir(&work.cwd).map_err(|e| Failure::Failed(format!("{}: {e}", work.cwd.display())))?;
        if let Some(path) = work.changed().first() {
            return Err(Failure::Input(format!(
                "{} changed since the job was submitted (as it was: {}); submit again, what is done is kept",
                path.display(),
                job.folder.display()
            )));
        }
        let stop = job.stop();
        if stop.exists() {
            return Err(Failure::Interrupted);
        }
        // As Ctrl-C would: the run stops at the next tile and keeps what is finished.
        std::thread::spawn(move || {
            while !stop.exists() {
                std::thread::sleep(LOOK);
            }
            tell(&format!("{} is there: the task stops", stop.display()));
            drop(signal_hook::low_level::raise(signal_hook::consts::SIGTERM));
        });
        perform(&work.command_of(self.shard), registry)
    }
}
