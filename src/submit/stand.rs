//! Where each shard of an array stands, by what its task left in the folder of the job and what the engine says.

use std::collections::BTreeMap;

use super::engine::{Look, Task};
use super::job::Marks;

/// Where a shard stands.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Stand {
    Waits(Option<String>),
    Runs,
    Done,
    Ended(Why),
}

/// How a task ended that did not end well.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Why {
    /// By itself, with this exit code.
    Code(i32),
    /// It was killed, or never began; in the engine's words.
    Killed(String),
    /// The engine does not know of it any more, and it left nothing.
    Lost,
    Cancelled,
}

impl Why {
    /// Whether the same would happen again, or is not wanted again.
    pub fn is_final(&self) -> bool {
        // Code 2: the input is wrong, or not any more what was submitted.
        matches!(self, Self::Cancelled | Self::Code(2))
    }

    pub fn text(&self) -> String {
        match self {
            Self::Code(1) => "failed".to_owned(),
            Self::Code(2) => "was refused".to_owned(),
            Self::Code(130) => "was interrupted".to_owned(),
            Self::Code(code) => format!("ended with {code}"),
            Self::Killed(words) => format!("was ended ({words})"),
            Self::Lost => "vanished".to_owned(),
            Self::Cancelled => "was cancelled".to_owned(),
        }
    }
}

/// How many shards stand where, and what became of those that did not end well.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    pub done: usize,
    pub runs: usize,
    pub waits: usize,
    pub failed: BTreeMap<u32, Why>,
    /// What the engine says that tasks wait for, where it is something unusual.
    pub waits_for: Option<String>,
    /// Whether some ended without a word of their own: such a word may still be on its way through a network file system.
    pub unsaid: bool,
}

impl Tally {
    /// `look`: what the engine said last, if it was asked and answered.
    pub fn of(shards: &[u32], marks: &Marks, look: Option<&Look>) -> Self {
        let mut tally = Self::default();
        for &shard in shards {
            match stand(shard, marks, look) {
                Stand::Done => tally.done += 1,
                Stand::Runs => tally.runs += 1,
                Stand::Waits(what) => {
                    tally.waits += 1;
                    tally.waits_for = tally.waits_for.or(what);
                }
                Stand::Ended(why) => {
                    tally.unsaid |= !matches!(why, Why::Code(_));
                    tally.failed.insert(shard, why);
                }
            }
        }
        tally
    }

    pub fn is_over(&self) -> bool {
        self.runs + self.waits == 0
    }

    pub fn text(&self) -> String {
        let of = self.done + self.runs + self.waits + self.failed.len();
        let mut text = format!("{} of {of} shards done", self.done);
        for (count, what) in [(self.runs, "running"), (self.waits, "waiting"), (self.failed.len(), "failed")] {
            if count > 0 {
                text += &format!(", {count} {what}");
            }
        }
        if let Some(what) = &self.waits_for {
            text += &format!(" (waiting for: {what})");
        }
        text
    }
}

/// What a task says of itself counts more than what the engine says, but for one that the engine is going to run again.
fn stand(shard: u32, marks: &Marks, look: Option<&Look>) -> Stand {
    let code = marks.ended.get(&shard).copied();
    let begun = marks.begun.binary_search(&shard).is_ok();
    if code == Some(0) {
        return Stand::Done;
    }
    let task = match look {
        // Nobody asked yet.
        None if code.is_none() => return if begun { Stand::Runs } else { Stand::Waits(None) },
        None | Some(Look::Unknown) => None,
        Some(Look::Tasks(tasks)) => tasks.get(&shard),
    };
    match (task, code) {
        (Some(Task::Done), _) => Stand::Done,
        (Some(Task::Waits(what)), _) => Stand::Waits(what.clone()),
        // Some engines do not tell these two apart.
        (Some(Task::Runs), _) => {
            if begun {
                Stand::Runs
            } else {
                Stand::Waits(None)
            }
        }
        (Some(Task::Cancelled), _) => Stand::Ended(Why::Cancelled),
        (_, Some(code)) => Stand::Ended(Why::Code(code)),
        (Some(Task::Failed(words)), None) => Stand::Ended(Why::Killed(words.clone())),
        (None, None) => Stand::Ended(Why::Lost),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_and_engine_together_say_where_a_shard_stands() {
        use Stand::{Done, Ended, Runs, Waits};
        let marks = |begun: &[u32], ended: &[(u32, i32)]| Marks {
            begun: begun.to_vec(),
            ended: ended.iter().copied().collect(),
        };
        let look = |task: Task| Some(Look::Tasks(BTreeMap::from([(1, task)])));
        let killed = || Task::Failed("SIGKILL".to_owned());
        for (begun, ended, look, wanted) in [
            (&[][..], &[][..], None, Waits(None)),
            (&[1], &[], None, Runs),
            (&[1], &[(1, 0)], None, Done),
            // It has ended, whatever the engine knows of it.
            (&[1], &[(1, 0)], look(Task::Runs), Done),
            (&[1], &[(1, 0)], Some(Look::Unknown), Done),
            (&[1], &[(1, 1)], look(killed()), Ended(Why::Code(1))),
            // The engine runs it again.
            (&[1], &[(1, 130)], look(Task::Waits(None)), Waits(None)),
            (&[1], &[], look(killed()), Ended(Why::Killed("SIGKILL".to_owned()))),
            (&[1], &[], Some(Look::Unknown), Ended(Why::Lost)),
            (&[1], &[], Some(Look::Tasks(BTreeMap::new())), Ended(Why::Lost)),
            // Its own word is still under way.
            (&[1], &[], look(Task::Done), Done),
            (&[1], &[(1, 130)], look(Task::Cancelled), Ended(Why::Cancelled)),
            (&[], &[], look(Task::Runs), Waits(None)),
        ] {
            let found = stand(1, &marks(begun, ended), look.as_ref());
            assert_eq!(found, wanted, "{begun:?} {ended:?} {look:?}");
        }
        let all = Tally::of(&[1, 2, 3, 4], &marks(&[1, 2, 3], &[(1, 0), (2, 1)]), None);
        assert_eq!((all.done, all.runs, all.waits, all.failed.len(), all.is_over()), (1, 1, 1, 1, false));
        assert_eq!(all.text(), "1 of 4 shards done, 1 running, 1 waiting, 1 failed");
    }
}
