//! `--memory`, and what commands say of the memory that instances take.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use clap::Args;

use crate::memory::{Budget, SMALL};
use crate::plan::{InstanceId, Plan, StageId};
use crate::resolve::Survey;
use crate::spec::{Diagnostic, Kind, Mistake, Section};

use super::cache::{parse_size, size_text};

#[derive(Args, Clone)]
pub(super) struct MemoryLimit {
    /// Memory that stages may take together, for example 8GB; by default what the machine has free
    #[arg(long, value_name = "SIZE", value_parser = parse_size)]
    memory: Option<u64>,
}

impl MemoryLimit {
    /// What there is for a run on `threads` threads; `None` where nobody knows.
    pub fn budget(&self, threads: usize) -> Option<Budget> {
        Budget::of(self.memory, threads)
    }
}

/// Instances that need more than there is, a mistake for each stage: with where the stage stands, what it needs, what there is and the way out.
pub(super) fn too_large(plan: &Plan, survey: &Survey, budget: Option<Budget>) -> Vec<Diagnostic> {
    let Some(Budget { bytes: most, by }) = budget else { return Vec::new() };
    let mut largest: BTreeMap<StageId, (u64, InstanceId)> = BTreeMap::new();
    for (id, detail) in survey.plans.iter() {
        let need = detail.memory.unwrap_or(0);
        if need > most.max(SMALL) {
            let stage = plan.stage_of(id);
            let entry = largest.entry(stage).or_insert((need, id));
            // Of equal ones the first.
            if need > entry.0 || (need == entry.0 && id < entry.1) {
                *entry = (need, id);
            }
        }
    }
    let told = |(stage, (need, id)): (StageId, (u64, InstanceId))| {
        let (name, use_name) = (plan.label(id), plan.row(stage).name);
        let message = format!(
            "`{name}` ({use_name}) needs about {} of memory, and there are {} {}",
            size_text(need),
            size_text(most),
            by.text()
        );
        let hint = "fewer pixels, frames or nodes need less; more memory can be named with --memory SIZE, where this figure is wrong";
        let mistake = Mistake::new(Kind::Memory, message);
        plan.spec.diagnostic(stage, Section::Stage, &[] as &[&str], mistake, Some(hint.to_owned()))
    };
    largest.into_iter().map(told).collect()
}

/// Bytes that a run takes at the most on `threads` threads: what is ready runs side by side, in the order of the run, as far as it fits into `budget`. Where
/// all take equally long, that is what happens; else it may be less.
pub(super) fn at_most(plan: &Plan, survey: &Survey, budget: Option<Budget>, threads: usize) -> u64 {
    let need = |id: &InstanceId| survey.plans.get(id).and_then(|detail| detail.memory).unwrap_or(0);
    let runs = |id: &InstanceId| survey.plans.contains_key(id) && !survey.twins.contains_key(id);
    let mut missing: HashMap<InstanceId, usize> = HashMap::new();
    let mut consumers: HashMap<InstanceId, Vec<InstanceId>> = HashMap::new();
    let mut ready = Vec::new();
    for id in plan.needed_instances().filter(runs) {
        let sources: BTreeSet<InstanceId> = plan.sources(id).map(|from| from.0).filter(runs).collect();
        if sources.is_empty() {
            ready.push(id);
        } else {
            missing.insert(id, sources.len());
            sources.into_iter().for_each(|source| consumers.entry(source).or_default().push(id));
        }
    }
    let mut ready: BTreeSet<InstanceId> = ready.into_iter().collect();
    let mut most = 0;
    while !ready.is_empty() {
        let (mut taken, mut begun) = (0_u64, Vec::new());
        while let Some(&id) = ready.first() {
            let sum = taken.saturating_add(need(&id));
            if begun.len() == threads || (!begun.is_empty() && budget.is_some_and(|budget| sum > budget.bytes)) {
                break;
            }
            ready.pop_first();
            taken = sum;
            begun.push(id);
        }
        most = most.max(taken);
        for id in begun.iter().flat_map(|id| consumers.remove(id).unwrap_or_default()) {
            let left = missing.get_mut(&id).expect("consumers are among the instances that run");
            *left -= 1;
            if *left == 0 {
                ready.insert(id);
            }
        }
    }
    most
}
