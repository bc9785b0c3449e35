//! Outputs that a command reads and whose bytes were released: they are made again, and agree with what they were.

use std::collections::{BTreeMap, BTreeSet};

use crate::plan::{InstanceId, Plan, StageId, Target};
use crate::registry::Registry;
use crate::resolve::{Resolver, State};
use crate::run::progress::{Work, choose};
use crate::run::{self, End, Interrupt, Options};
use crate::spec::{DRAW_AXIS, Report};
use crate::store::Store;
use crate::threads;

use super::simd::simd_level;
use super::{Done, Failure, Pipeline};

/// Runs again those of the instances of which outputs (or this one) were released, with all that they need for it.
///
/// Mistakes of the pipeline are left to whoever looks next. Errors: an instance failed, or came out different.
pub(super) fn make_again(
    pipeline: &Pipeline,
    registry: &Registry,
    plan: &Plan,
    ids: &[InstanceId],
    port: Option<&str>,
) -> Done {
    let looked = pipeline.store_to_read()?;
    if !looked.has_released() {
        return Ok(());
    }
    let survey = Resolver::new(plan, &looked).survey(&[]);
    let mut gone: BTreeMap<InstanceId, BTreeSet<&str>> = BTreeMap::new();
    for &id in ids {
        let Some(State::Hit(brief)) = &survey.states[id] else { continue };
        let asked = brief.outputs.iter().filter(|(name, _)| port.is_none_or(|port| port == *name));
        let released = asked.filter(|(_, blob)| looked.is_released(blob)).map(|(name, _)| name);
        let released: BTreeSet<&str> = released.collect();
        if !released.is_empty() {
            gone.insert(id, released);
        }
    }
    if gone.is_empty() {
        return Ok(());
    }
    let store = Store::open(pipeline.outputs.path()).map_err(|e| Failure::Input(e.to_string()))?;
    let few = of_points(plan, registry, &gone)?;
    let resolver = Resolver::new(&few, &store);
    let name = |plan: &Plan, id: InstanceId| (plan.stage_of(id), plan.axes_text(id));
    let gone: BTreeMap<_, _> = gone.into_iter().map(|(id, ports)| (name(plan, id), ports)).collect();
    for id in few.needed_instances() {
        let ports = gone.get(&name(&few, id));
        ports.into_iter().flatten().for_each(|port| resolver.ask(id, port));
    }
    let survey = resolver.survey(&[]);
    let report = Report::from(survey.problems.clone());
    if report.has_errors() {
        return Err(report.into());
    }
    let options = Options {
        jobs: threads::of_machine(),
        keep_going: false,
        force: Vec::new(),
        replace: false,
        simd: simd_level()?,
        keep_states: false,
        memory: None,
        live: None,
    };
    let interrupt = Interrupt::listen().map_err(|e| Failure::Failed(format!("signals: {e}")))?;
    // On stderr: stdout is what the command was asked for.
    let progress = choose(false, &Work::of(&few, &survey));
    let summary = run::run(&resolver, survey, &options, progress.as_ref(), &interrupt);
    progress.ended();
    let summary = summary.map_err(Failure::Failed)?;
    store.finish().map_err(|e| Failure::Failed(e.to_string()))?;
    if summary.interrupted {
        return Err(Failure::Interrupted);
    }
    match summary.ends.values().find(|end| matches!(end, End::Failed(_))) {
        Some(_) => Err(Failure::Said),
        None => Ok(()),
    }
}

/// The plan of these points alone: others may never have run, and need not run now.
fn of_points(plan: &Plan, registry: &Registry, gone: &BTreeMap<InstanceId, BTreeSet<&str>>) -> Result<Plan, Failure> {
    let mut points: BTreeMap<StageId, BTreeSet<u64>> = BTreeMap::new();
    let mut targets: Vec<Target> = Vec::new();
    for (&id, ports) in gone {
        let index = plan.axis(id, DRAW_AXIS).and_then(serde_json::Value::as_u64);
        if let Some(((draws, _), index)) = plan.draw_of(plan.stage_of(id)).zip(index) {
            points.entry(draws).or_default().insert(index);
        }
        for port in ports {
            let stage = plan.stage_name(id).to_owned();
            let target = Target { stage, port: Some((*port).to_owned()) };
            if !targets.contains(&target) {
                targets.push(target);
            }
        }
    }
    let mut spec = plan.spec.clone();
    for (draws, indices) in points {
        spec = spec.with_points(draws, &indices.into_iter().collect::<Vec<_>>());
    }
    Ok(Plan::build(spec, Report::default(), registry, &targets)?.without_previews())
}
