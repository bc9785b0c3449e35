//! What a run would do with each instance.

use std::collections::HashMap;
use std::sync::Arc;

use turbid_contract::StagePlan;

use crate::brief::Brief;
use crate::plan::{IdMap, IdVec, InstanceId, StageId};
use crate::spec::Diagnostic;

use super::AllOutputs;

/// What a run would do with an instance.
pub enum State {
    /// The store holds its outputs.
    Hit(Arc<Brief>),
    /// It has to run.
    Run { reasons: Arc<[String]> },
    /// It has no key until these stages have run.
    Waits(Arc<[StageId]>),
}

impl State {
    pub(super) fn run(reason: String) -> Self {
        Self::Run { reasons: [reason].into() }
    }

    /// Whether it says the same in the same words, which the two share.
    pub fn is_like(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Hit(_), Self::Hit(_)) => true,
            (Self::Run { reasons }, Self::Run { reasons: others }) => Arc::ptr_eq(reasons, others),
            (Self::Waits(stages), Self::Waits(others)) => Arc::ptr_eq(stages, others),
            _ => false,
        }
    }

    /// The same, which shares its words with another one where they are equal: in a sweep most are.
    pub(super) fn sharing(self, other: Option<&Self>) -> Self {
        match (self, other) {
            (Self::Run { reasons }, Some(Self::Run { reasons: known }))
                if !Arc::ptr_eq(&reasons, known) && reasons == *known =>
            {
                Self::Run { reasons: known.clone() }
            }
            (Self::Waits(stages), Some(Self::Waits(known))) if stages == *known => Self::Waits(known.clone()),
            (own, _) => own,
        }
    }
}

/// States of all needed instances, with the mistakes and warnings found on the way.
pub struct Survey {
    pub states: IdVec<InstanceId, Option<State>>,
    pub outputs: AllOutputs,
    /// The plan of every instance that is not a hit; instances of a stage with equal plans share one.
    pub plans: IdMap<InstanceId, Arc<StagePlan>>,
    /// Instances whose work another one with the same key does.
    pub twins: HashMap<InstanceId, InstanceId>,
    pub problems: Vec<Diagnostic>,
}

impl Survey {
    /// Of a plan with so many instances, of which nothing is known yet.
    pub(super) fn of(instances: usize) -> Self {
        Self {
            states: (0..instances).map(|_| None).collect(),
            outputs: IdVec::filled(None, instances),
            plans: IdMap::default(),
            twins: HashMap::new(),
            problems: Vec::new(),
        }
    }
}
