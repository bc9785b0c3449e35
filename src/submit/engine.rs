//! What turbid asks of an engine that others run: take an array of tasks, say what became of them.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::program::{NotRun, Said};

/// Where arrays of tasks run.
pub trait Engine {
    /// Its name in sentences.
    fn name(&self) -> &'static str;

    /// Hands over a task for each shard of an array.
    fn submit(&self, array: &Array<'_>) -> Result<Ticket, Trouble>;

    /// What became of the tasks of an array; `shards` are all of its shards, as they were handed over.
    fn look(&self, ticket: &Ticket, shards: &[u32]) -> Result<Look, Trouble>;

    /// Takes tasks that ended badly out of the engine's lists, where it keeps them to be released by hand.
    fn give_up(&self, _: &Ticket, _: &[u32]) {}

    /// The command that ends the tasks of an array; `None` where the engine has none.
    fn cancel(&self, ticket: &Ticket) -> Option<String>;
}

/// Tasks of one kind, one for each shard: `sh SCRIPT ROUND SHARD`, the shard from the engine's own variable where it is not given.
pub struct Array<'a> {
    /// For people who look at the engine's lists.
    pub name: &'a str,
    pub script: &'a Path,
    pub round: usize,
    /// Ascending.
    pub shards: &'a [u32],
    /// The folder of this round: `SHARD.log` in it is what a task says.
    pub folder: &'a Path,
    /// Where tasks begin.
    pub cwd: &'a Path,
    /// Of each task.
    pub threads: usize,
    /// Further options of the engine's own command.
    pub options: &'a [String],
}

/// By what an engine knows an array.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Ticket {
    pub id: String,
    /// Which engine of several: a cluster's name, a server's folder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place: Option<String>,
    /// Which of the servers that were there one after the other: another one counts its jobs from 1 again.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub server: Option<String>,
}

/// What an engine says of tasks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Look {
    /// By shard. One that is not listed has ended, and nothing more is known of it.
    Tasks(BTreeMap<u32, Task>),
    /// The engine knows no such array (any more): none of its tasks is at work.
    Unknown,
}

/// Where a task stands.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Task {
    /// It is going to run; with the engine's word for what it waits for.
    Waits(Option<String>),
    Runs,
    /// It ended well.
    Done,
    /// It ended, and not well; with the engine's words.
    Failed(String),
    /// Somebody ended it.
    Cancelled,
}

impl Task {
    /// Whether it has not ended.
    pub fn is_alive(&self) -> bool {
        matches!(self, Self::Waits(_) | Self::Runs)
    }
}

/// Why an engine did not do what was asked.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Trouble {
    /// What is needed on this machine to reach it is not installed.
    Absent { what: String, hint: String },
    /// It does not answer; it may later.
    Silent { what: String, hint: String },
    /// It said no.
    Refused { what: String, hint: String },
}

impl Trouble {
    /// In one sentence, with the way out.
    pub fn text(&self) -> String {
        let (Self::Absent { what, hint } | Self::Silent { what, hint } | Self::Refused { what, hint }) = self;
        format!("{what}; {hint}")
    }

    /// That a program of the engine could not be run.
    pub fn not_run(program: &str, why: NotRun, hint: &str) -> Self {
        let hint = hint.to_owned();
        match why {
            NotRun::Absent => Self::Absent { what: format!("`{program}` is not on PATH"), hint },
            NotRun::TooLong(limit) => {
                Self::Silent { what: format!("`{program}` had not ended after {} s", limit.as_secs()), hint }
            }
            NotRun::Io(error) => Self::Absent { what: format!("`{program}` cannot be started: {error}"), hint },
        }
    }
}

/// What a program said, in one line for a message.
pub fn said_by(program: &str, said: &Said) -> String {
    let words: Vec<&str> = said.words().lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    if words.is_empty() {
        format!("`{program}` failed without a word")
    } else {
        format!("`{program}`: {}", words.join("; "))
    }
}

/// Numbers as engines take them: `1-3,7`.
pub fn ranges(numbers: &[u32]) -> String {
    let mut runs: Vec<(u32, u32)> = Vec::new();
    for &number in numbers {
        match runs.last_mut() {
            Some((_, last)) if number == *last + 1 => *last = number,
            _ => runs.push((number, number)),
        }
    }
    let text = |(first, last): &(u32, u32)| if first == last { first.to_string() } else { format!("{first}-{last}") };
    runs.iter().map(text).collect::<Vec<_>>().join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_a_row_are_ranges() {
        for (numbers, text) in
            [(vec![], ""), (vec![4], "4"), (vec![1, 2, 3], "1-3"), (vec![1, 2, 4, 7, 8], "1-2,4,7-8")]
        {
            assert_eq!(ranges(&numbers), text);
        }
    }
}
