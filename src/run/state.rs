//! Where each instance of a run stands; every change of it passes through [`States::set`].

use std::collections::{BTreeSet, HashMap};
use std::fmt;
use std::sync::Arc;

use crate::brief::Brief;
use crate::plan::{IdVec, InstanceId};

use super::summary::End;

/// Where an instance stands.
///
/// What may follow what (rows: from, columns: to):
///
/// ```text
/// from       | Unknown Want Ready Twin Elsewhere Running Done Failed Skipped
/// Unknown    |    -     x     x    -       -        -     x     -      -
/// Want       |    -     x     x    -       -        -     -     -      x
/// Ready      |    -     x     -    x       x        x     x     x      x
/// Twin       |    -     x     x    -       -        -     -     -      x
/// Elsewhere  |    -     x     x    -       -        -     -     -      x
/// Running    |    -     x     x    -       -        -     x     x      x
/// Done       |    -     x     x    -       -        -     -     -      -
/// Failed     |    -     -     -    -       -        -     -     -      -
/// Skipped    |    -     -     -    -       -        -     -     -      -
/// ```
///
/// Back from `Ready`, `Elsewhere` and `Running` to `Want`: a producer is found damaged. From `Done`: it is that producer. From `Running` to
/// `Ready`: the system has no thread for it now. From `Elsewhere` to `Ready`: the other process is done with it, or gone.
#[derive(Clone, Debug, Default)]
pub enum BuildState {
    /// No target needs it, or nobody has looked yet.
    #[default]
    Unknown,
    /// So many of its producers are not done.
    Want {
        missing: usize,
    },
    /// All that it needs is there; it waits for its turn.
    Ready,
    /// An instance of the same key is at work, and this one waits for what it makes.
    Twin,
    /// Another process holds its key, and is at work on it.
    Elsewhere,
    Running,
    Done {
        brief: Arc<Brief>,
        /// Whether this run made it.
        ran: bool,
    },
    Failed(String),
    /// Something that it needs failed, or the run stopped before its turn.
    Skipped,
}

impl BuildState {
    /// Whether `next` may follow: the table above.
    fn may_become(&self, next: &Self) -> bool {
        use BuildState::{Done, Elsewhere, Failed, Ready, Running, Skipped, Twin, Unknown, Want};
        match self {
            Unknown => matches!(next, Want { .. } | Ready | Done { .. }),
            Want { .. } => matches!(next, Want { .. } | Ready | Skipped),
            Ready => matches!(next, Want { .. } | Twin | Elsewhere | Running | Done { .. } | Failed(_) | Skipped),
            Twin | Elsewhere => matches!(next, Want { .. } | Ready | Skipped),
            Running => matches!(next, Want { .. } | Ready | Done { .. } | Failed(_) | Skipped),
            Done { .. } => matches!(next, Want { .. } | Ready),
            Failed(_) | Skipped => false,
        }
    }
}

impl fmt::Display for BuildState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown => f.write_str("Unknown"),
            Self::Want { missing } => write!(f, "Want ({missing} missing)"),
            Self::Ready => f.write_str("Ready"),
            Self::Twin => f.write_str("Twin"),
            Self::Elsewhere => f.write_str("Elsewhere"),
            Self::Running => f.write_str("Running"),
            Self::Done { brief, ran } => write!(f, "Done ({}, ran: {ran})", brief.key),
            Self::Failed(message) => write!(f, "Failed ({message})"),
            Self::Skipped => f.write_str("Skipped"),
        }
    }
}

/// The states of all instances of a plan.
pub struct States {
    states: IdVec<InstanceId, BuildState>,
    /// Those that are `Ready`, in the order in which they begin.
    ready: BTreeSet<InstanceId>,
    /// How many are `Running`.
    running: usize,
}

impl States {
    pub fn new(instances: usize) -> Self {
        Self { states: IdVec::filled(BuildState::Unknown, instances), ready: BTreeSet::new(), running: 0 }
    }

    pub fn get(&self, id: InstanceId) -> &BuildState {
        &self.states[id]
    }

    /// The one place where a state changes.
    ///
    /// # Panics
    /// Where the table of [`BuildState`] does not have it: a mistake of the scheduler.
    pub fn set(&mut self, id: InstanceId, next: BuildState) {
        let state = &mut self.states[id];
        assert!(state.may_become(&next), "{id:?}: {state} -> {next}");
        match state {
            BuildState::Ready => drop(self.ready.remove(&id)),
            BuildState::Running => self.running -= 1,
            _ => {}
        }
        match next {
            BuildState::Ready => drop(self.ready.insert(id)),
            BuildState::Running => self.running += 1,
            _ => {}
        }
        *state = next;
    }

    pub fn first_ready(&self) -> Option<InstanceId> {
        self.ready.first().copied()
    }

    /// The first that is `Ready` from `start` on, or from the beginning where there is none.
    pub fn ready_from(&self, start: InstanceId) -> Option<InstanceId> {
        self.ready.range(start..).next().copied().or_else(|| self.first_ready())
    }

    pub fn last_ready(&self) -> Option<InstanceId> {
        self.ready.last().copied()
    }

    pub fn running(&self) -> usize {
        self.running
    }

    pub fn is_done(&self, id: InstanceId) -> bool {
        matches!(self.states[id], BuildState::Done { .. })
    }

    pub fn is_running(&self, id: InstanceId) -> bool {
        matches!(self.states[id], BuildState::Running)
    }

    /// How the needed instances ended; what had no turn is skipped.
    pub fn ends(mut self, needed: impl Iterator<Item = InstanceId>) -> HashMap<InstanceId, End> {
        let mut end = |id: InstanceId| {
            use BuildState::{Elsewhere, Ready, Twin, Want};
            if matches!(self.states[id], Want { .. } | Ready | Twin | Elsewhere) {
                self.set(id, BuildState::Skipped);
            }
            match std::mem::take(&mut self.states[id]) {
                BuildState::Done { brief, ran: true } => End::Ran(brief),
                BuildState::Done { brief, ran: false } => End::Hit(brief),
                BuildState::Failed(message) => End::Failed(message),
                BuildState::Skipped => End::Skipped,
                state => panic!("{id:?} is {state} at the end of the run"),
            }
        };
        needed.map(|id| (id, end(id))).collect()
    }
}

#[cfg(test)]
mod tests {
    use std::panic::{AssertUnwindSafe, catch_unwind};

    use super::*;
    use crate::digest::Digest;
    use crate::plan::Id;
    use crate::store::{Cost, InstanceRecord, Provenance};

    fn brief() -> Arc<Brief> {
        let record = InstanceRecord {
            key: Digest::of(b"key"),
            use_name: "odd".to_owned(),
            version: 1,
            ports: Default::default(),
            cost: Cost::default(),
            seed: None,
            state_key: None,
            measures: Vec::new(),
            reached: None,
            warnings: Vec::new(),
            kernel: None,
            refused: Vec::new(),
            provenance: Provenance::default(),
        };
        Arc::new(Brief::of(&record, &[]))
    }

    /// One of each, in the order of the table.
    fn kinds() -> [BuildState; 9] {
        use BuildState::{Done, Elsewhere, Failed, Ready, Running, Skipped, Twin, Unknown, Want};
        let done = Done { brief: brief(), ran: true };
        [Unknown, Want { missing: 2 }, Ready, Twin, Elsewhere, Running, done, Failed("no disk".to_owned()), Skipped]
    }

    /// The table of the doc comment, row by row.
    fn table() -> Vec<(String, Vec<bool>)> {
        let lines = include_str!("state.rs").lines().filter_map(|line| line.strip_prefix("/// "));
        let rows = lines.filter_map(|line| line.split_once('|')).filter(|(from, _)| from.trim() != "from");
        let cells = |cells: &str| cells.split_whitespace().map(|cell| cell == "x").collect();
        rows.map(|(from, row)| (from.trim().to_owned(), cells(row))).collect()
    }

    /// Every pair of states: what the table has happens and is counted, what it has not ends with both names.
    #[test]
    fn states_follow_each_other_as_the_table_says() {
        let (kinds, table, id) = (kinds(), table(), InstanceId::new(1));
        assert_eq!(table.len(), kinds.len());
        for (from, (name, row)) in kinds.iter().zip(&table) {
            assert!(from.to_string().starts_with(name.as_str()), "{from} stands in the row of {name}");
            assert_eq!(row.len(), kinds.len(), "{name}");
            for (to, &legal) in kinds.iter().zip(row) {
                let mut states = States::new(2);
                states.states[id] = from.clone();
                states.ready.extend(matches!(from, BuildState::Ready).then_some(id));
                states.running = usize::from(matches!(from, BuildState::Running));
                let done = catch_unwind(AssertUnwindSafe(|| states.set(id, to.clone())));
                match done {
                    Ok(()) => {
                        assert!(legal, "{from} -> {to}");
                        assert_eq!(states.get(id).to_string(), to.to_string());
                        assert_eq!(states.first_ready().is_some(), matches!(to, BuildState::Ready), "{from} -> {to}");
                        assert_eq!(states.running() > 0, matches!(to, BuildState::Running), "{from} -> {to}");
                    }
                    Err(panic) => {
                        assert!(!legal, "{from} -> {to}");
                        let text = crate::panics::text(panic.as_ref());
                        assert!(text.contains(&format!("{id:?}: {from} -> {to}")), "{text}");
                    }
                }
            }
        }
    }

    /// What had no turn is skipped; an instance that nobody looked at, or that still runs, is a mistake of ours.
    #[test]
    fn runs_end_with_an_end_for_each() {
        let ends = |state: BuildState| {
            let mut states = States::new(1);
            let id = InstanceId::new(0);
            states.states[id] = state;
            catch_unwind(AssertUnwindSafe(|| states.ends(std::iter::once(id)))).ok().map(|mut ends| ends.remove(&id))
        };
        let words = kinds().map(|state| match ends(state) {
            Some(Some(End::Ran(_))) => "ran",
            Some(Some(End::Failed(_))) => "failed",
            Some(Some(End::Skipped)) => "skipped",
            Some(_) => "another",
            None => "panic",
        });
        assert_eq!(words, ["panic", "skipped", "skipped", "skipped", "skipped", "panic", "ran", "failed", "skipped"]);
    }
}
