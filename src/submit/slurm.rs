//! Slurm: arrays by `sbatch`, their states by `squeue`, and by `sacct` where the cluster keeps accounts.

use std::collections::BTreeMap;
use std::process::Command;

use super::engine::{Array, Engine, Look, Task, Ticket, Trouble, ranges, said_by};
use super::program::{self, Said};

/// By its commands, as the user's environment finds them.
pub struct Slurm;

const NO_SLURM: &str = "submit where Slurm's commands are installed, on a login node of the cluster";

/// What Slurm says of a task that no node could begin.
const LAUNCH_FAILED: &str = "launch failed requeued held";

impl Engine for Slurm {
    fn name(&self) -> &'static str {
        "Slurm"
    }

    fn submit(&self, array: &Array<'_>) -> Result<Ticket, Trouble> {
        // In names of files Slurm replaces `%a` by the task's number.
        let log = format!("{}/%a.log", array.folder.display().to_string().replace('%', "%%"));
        let mut command = Command::new("sbatch");
        command
            .args(["--parsable", "--requeue", "--ntasks=1", "--open-mode=append"])
            .arg(format!("--array={}", ranges(array.shards)))
            .arg(format!("--job-name={}", array.name))
            .arg(format!("--cpus-per-task={}", array.threads))
            .arg(format!("--output={log}"))
            .arg(format!("--chdir={}", array.cwd.display()))
            .args(array.options)
            .arg(array.script)
            .arg(array.round.to_string());
        let said = run("sbatch", &mut command)?;
        if !said.good {
            return Err(refusal(&said));
        }
        ticket(&said.out).ok_or_else(|| Trouble::Refused {
            what: format!("`sbatch` gave no job number, but `{}`", said.words()),
            hint: "`squeue --me` shows whether it was submitted all the same".to_owned(),
        })
    }

    fn look(&self, ticket: &Ticket, shards: &[u32]) -> Result<Look, Trouble> {
        let mut command = Command::new("squeue");
        command
            .args(["--noheader", "--array", "--states=all", "--format=%K|%T|%r"])
            .arg(format!("--job={}", ticket.id));
        cluster(&mut command, ticket);
        let said = run("squeue", &mut command)?;
        // Arrays are forgotten some minutes after they ended.
        let forgotten = !said.good && said.err.contains("Invalid job id");
        if !said.good && !forgotten {
            return Err(silence("squeue", &said));
        }
        let mut tasks = queued(&said.out);
        if shards.iter().any(|shard| !tasks.contains_key(shard)) {
            tasks.extend(self.accounts(ticket));
        }
        Ok(if forgotten && tasks.is_empty() { Look::Unknown } else { Look::Tasks(tasks) })
    }

    fn give_up(&self, ticket: &Ticket, shards: &[u32]) {
        let mut command = Command::new("scancel");
        cluster(&mut command, ticket);
        command.args(shards.iter().map(|shard| format!("{}_{shard}", ticket.id)));
        // Those that are gone already are an error of no weight.
        drop(program::run(&mut command, ""));
    }

    fn cancel(&self, ticket: &Ticket) -> Option<String> {
        let place = ticket.place.as_ref().map_or_else(String::new, |place| format!("--clusters={place} "));
        Some(format!("scancel {place}{}", ticket.id))
    }
}

impl Slurm {
    /// What the accounts say; nothing where there are none.
    fn accounts(&self, ticket: &Ticket) -> BTreeMap<u32, Task> {
        let mut command = Command::new("sacct");
        command.args(["--noheader", "--parsable2", "--allocations", "--array", "--format=JobID,State"]);
        command.arg(format!("--jobs={}", ticket.id));
        cluster(&mut command, ticket);
        program::run(&mut command, "").map_or_else(|_| BTreeMap::new(), |said| accounted(&said.out))
    }
}

fn run(program: &str, command: &mut Command) -> Result<Said, Trouble> {
    program::run(command, "").map_err(|why| Trouble::not_run(program, why, NO_SLURM))
}

fn cluster(command: &mut Command, ticket: &Ticket) {
    command.args(ticket.place.iter().map(|place| format!("--clusters={place}")));
}

/// `17` or `17;CLUSTER`, in the last line: what a site's own `sbatch` says comes before.
fn ticket(out: &str) -> Option<Ticket> {
    let line = out.lines().rev().map(str::trim).find(|line| !line.is_empty())?;
    let (id, place) = line.split_once(';').map_or((line, None), |(id, place)| (id, Some(place.to_owned())));
    let is_number = !id.is_empty() && id.chars().all(|c| c.is_ascii_digit());
    is_number.then(|| Ticket { id: id.to_owned(), place, server: None })
}

/// Lines `3|RUNNING|None` of `squeue`.
fn queued(out: &str) -> BTreeMap<u32, Task> {
    let task = |line: &str| {
        let mut words = line.trim().split('|');
        let (shard, state) = (words.next()?.parse().ok()?, words.next()?);
        Some((shard, task(state, words.next().unwrap_or_default())))
    };
    out.lines().filter_map(task).collect()
}

/// Lines `17_3|COMPLETED` of `sacct`; those of tasks that wait together (`17_[4-8]`) say nothing that `squeue` did not.
fn accounted(out: &str) -> BTreeMap<u32, Task> {
    let task = |line: &str| {
        let (id, state) = line.trim().split_once('|')?;
        Some((id.split_once('_')?.1.parse().ok()?, task(state, "")))
    };
    out.lines().filter_map(task).collect()
}

/// By Slurm's word for a state; `CANCELLED by 1000` says who.
fn task(state: &str, reason: &str) -> Task {
    let word = state.split_whitespace().next().unwrap_or_default().trim_end_matches('+');
    match word {
        "COMPLETED" => Task::Done,
        "CANCELLED" | "REVOKED" => Task::Cancelled,
        "RUNNING" | "COMPLETING" | "SIGNALING" | "STAGE_OUT" | "STOPPED" | "SUSPENDED" | "RESIZING" => Task::Runs,
        "FAILED" | "TIMEOUT" | "NODE_FAIL" | "PREEMPTED" | "BOOT_FAIL" | "DEADLINE" | "OUT_OF_MEMORY" => {
            let usual = ["", "None", "NonZeroExitCode"].contains(&reason);
            Task::Failed(if usual { word.to_owned() } else { format!("{word}, {reason}") })
        }
        // Slurm gave up: the task stays in the queue until somebody releases it. What people hold goes on waiting for them.
        _ if reason == LAUNCH_FAILED => Task::Failed(format!("{word}, {reason}")),
        // PENDING, CONFIGURING, REQUEUED, .. and what later versions bring.
        _ => {
            let usual = ["", "None", "Resources", "Priority", "BeginTime"].contains(&reason);
            Task::Waits((!usual).then(|| reason.to_owned()))
        }
    }
}

/// `sbatch` said no. Slurm tells the reason in words alone.
fn refusal(said: &Said) -> Trouble {
    if said.err.contains("Unable to contact") || said.err.contains("timed out") {
        return silence("sbatch", said);
    }
    let words = said.words().to_lowercase();
    let hint = if words.contains("partition") {
        "`sinfo --summarize` lists the partitions; name one with --engine-args=--partition=NAME"
    } else if words.contains("array") {
        "`scontrol show config` says how large arrays may be (MaxArraySize); --shards N submits fewer tasks"
    } else if words.contains("account") || words.contains("permission") || words.contains("association") {
        "name an account that may submit with --engine-args=--account=NAME"
    } else {
        "further options for sbatch go into --engine-args '..'"
    };
    Trouble::Refused { what: said_by("sbatch", said), hint: hint.to_owned() }
}

fn silence(program: &str, said: &Said) -> Trouble {
    let what = format!("Slurm does not answer: {}", said_by(program, said));
    Trouble::Silent { what, hint: "`scontrol ping` tells whether its controller runs".to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As Slurm 22.05 prints them.
    #[test]
    fn answers_of_slurm_are_read() {
        let of = |id: &str, place: Option<&str>| {
            Some(Ticket { id: id.to_owned(), place: place.map(str::to_owned), server: None })
        };
        assert_eq!(ticket("17\n"), of("17", None));
        assert_eq!(ticket("a word of the site\n17;west\n"), of("17", Some("west")));
        assert_eq!(ticket("Submitted\n"), None);
        let tasks = queued(
            "CLUSTER: west\n3|PENDING|Resources\n4|PENDING|PartitionConfig\n1|RUNNING|None\n2|FAILED|NonZeroExitCode\n5|NODE_FAIL|NodeDown\n6|COMPLETED|None\n7|CANCELLED|None\n8|PENDING|launch failed requeued held\n9|PENDING|JobHeldUser\n",
        );
        let wanted = [
            (1, Task::Runs),
            (2, Task::Failed("FAILED".to_owned())),
            (3, Task::Waits(None)),
            (4, Task::Waits(Some("PartitionConfig".to_owned()))),
            (5, Task::Failed("NODE_FAIL, NodeDown".to_owned())),
            (6, Task::Done),
            (7, Task::Cancelled),
            (8, Task::Failed("PENDING, launch failed requeued held".to_owned())),
            (9, Task::Waits(Some("JobHeldUser".to_owned()))),
        ];
        assert_eq!(tasks, BTreeMap::from(wanted));
        let tasks = accounted(
            "17_1|COMPLETED\n17_2|CANCELLED by 1000\n17_[3-8]|PENDING\nSlurm accounting storage is disabled\n",
        );
        assert_eq!(tasks, BTreeMap::from([(1, Task::Done), (2, Task::Cancelled)]));
    }

    #[test]
    fn refusals_name_the_way_out() {
        let told = |err: &str| refusal(&Said { good: false, out: String::new(), err: err.to_owned() });
        let partition = told("sbatch: error: Batch job submission failed: Invalid partition name specified");
        assert!(matches!(&partition, Trouble::Refused { hint, .. } if hint.contains("--partition")), "{partition:?}");
        let array = told("sbatch: error: Batch job submission failed: Invalid job array specification");
        assert!(matches!(&array, Trouble::Refused { hint, .. } if hint.contains("--shards")), "{array:?}");
        let silent =
            told("sbatch: error: Batch job submission failed: Unable to contact slurm controller (connect failure)");
        assert!(matches!(silent, Trouble::Silent { .. }), "{silent:?}");
    }
}
