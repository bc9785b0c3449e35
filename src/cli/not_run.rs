//! Results that were asked for and are not there: which run makes them, or whether one is at work on them.

use crate::plan::{InstanceId, StageId};
use crate::resolve::{Resolver, State, Survey};

use super::{Failure, Pipeline};

/// So many instances that are to run are looked at.
const MOST: usize = 64;

/// What is said of an instance that is not stored; `target` is what a run is to be asked for.
pub(super) fn not_run(
    pipeline: &Pipeline,
    resolver: &Resolver<'_>,
    survey: &Survey,
    id: InstanceId,
    target: &str,
) -> Failure {
    if let Some(text) = resolver.store.unread() {
        return Failure::Failed(text);
    }
    let plan = resolver.plan;
    let label = plan.label(id);
    let way_out = match at_work(resolver, survey, id) {
        Some(stage) => format!("a run is at work on {}, try again when it has ended", plan.spec.stages[stage].name),
        None => format!("try `turbid run {} {target}`", pipeline.file.display()),
    };
    Failure::NotRun(format!("{label} has not run yet with these parameters; {way_out}"))
}

/// A stage on which another process is at work: that of the instance, or one of those that it waits for.
fn at_work(resolver: &Resolver<'_>, survey: &Survey, id: InstanceId) -> Option<StageId> {
    let plan = resolver.plan;
    let is_run = |id: &InstanceId| matches!(survey.states[*id], Some(State::Run { .. }));
    let candidates = std::iter::once(id).chain(plan.needed_instances().filter(|other| *other != id));
    let held = |id: &InstanceId| {
        let keyed = resolver.state(*id, &survey.outputs, false).ok().and_then(|(_, keyed)| keyed);
        keyed.is_some_and(|keyed| resolver.store.is_at_work(&keyed.key))
    };
    candidates.filter(is_run).take(MOST).find(held).map(|id| plan.stage_of(id))
}
