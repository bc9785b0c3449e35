//! What a run did: how each of its instances ended.

use std::collections::HashMap;
use std::sync::Arc;

use crate::brief::Brief;
use crate::plan::InstanceId;
use crate::store::{InstanceRecord, Store};

/// How an instance ended.
#[derive(Clone, Debug)]
pub enum End {
    Hit(Arc<Brief>),
    Ran(Arc<Brief>),
    Failed(String),
    /// Something that it needs failed, or the run stopped before its turn.
    Skipped,
}

/// What a run did.
#[derive(Default)]
pub struct Summary {
    pub ends: HashMap<InstanceId, End>,
    pub seconds: f64,
    pub interrupted: bool,
}

impl Summary {
    /// What a further round of the same run did. What ran in an earlier one did run, although it was found later.
    pub fn add(&mut self, more: Self) {
        for (id, end) in more.ends {
            match (self.ends.get(&id), &end) {
                (Some(End::Ran(before)), End::Hit(found)) if before.key == found.key => {}
                _ => drop(self.ends.insert(id, end)),
            }
        }
        self.seconds += more.seconds;
        self.interrupted |= more.interrupted;
    }

    pub fn count(&self, which: impl Fn(&End) -> bool) -> usize {
        self.ends.values().filter(|end| which(end)).count()
    }

    pub fn hits(&self) -> usize {
        self.count(|end| matches!(end, End::Hit(_)))
    }

    pub fn ran(&self) -> usize {
        self.count(|end| matches!(end, End::Ran(_)))
    }

    pub fn failed(&self) -> usize {
        self.count(|end| matches!(end, End::Failed(_)))
    }

    /// The record of an instance, with its own cost: another one may have done its work.
    pub fn record(&self, id: InstanceId, store: &Store) -> Option<InstanceRecord> {
        let brief = self.brief(id)?;
        let record = store.record(&brief.key)?;
        Some(InstanceRecord { cost: brief.cost, ..InstanceRecord::clone(&record) })
    }

    /// What it made or found.
    pub fn brief(&self, id: InstanceId) -> Option<&Arc<Brief>> {
        match self.ends.get(&id) {
            Some(End::Hit(brief) | End::Ran(brief)) => Some(brief),
            _ => None,
        }
    }
}
