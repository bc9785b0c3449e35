//! Spec and registry -> checked graph of stage instances: ports exist, payloads match, axes join, no cycle, pruned.

mod axes;
mod edges;
mod expand;
mod feeds;
mod lint;
mod order;
mod points;
mod ports;
pub mod shard;
mod targets;

use std::collections::BTreeSet;

use serde_json::Value;
use turbid_contract::{Axes, InPort, OutPort, StageRow};

use crate::key::axes_text;
use crate::registry::Registry;
use crate::spec::{DRAW_AXIS, Diagnostic, Draw, Report, Section, Spec, nearest};

pub use crate::ids::{Id, IdMap, IdRange, IdVec, InstanceId, StageId};
pub use axes::{MAX_INSTANCES, same_value};
pub use targets::Target;

use axes::MAX_ALL;
use expand::{Expanded, Expansion};

/// Previews are made of stages with at most this many instances; beyond it people read `instances.parquet`.
pub const PREVIEW_INSTANCES: usize = 64;

/// A stage's kind with its ports, listed once.
pub(crate) struct StageInfo {
    pub name: &'static str,
    pub row: StageRow,
    pub inputs: Vec<InPort>,
    pub outputs: Vec<OutPort>,
}

/// What feeds one input port.
#[derive(Debug)]
pub struct Wire {
    pub port: &'static str,
    pub many: bool,
    /// Producing instances with the port taken from each; in order of axis values for a many port.
    pub from: Vec<(InstanceId, &'static str)>,
}

/// The checked graph of a pipeline.
///
/// An instance is a number. Its axes, what feeds it and its params are worked out when somebody asks: of a million instances no
/// million lists are held.
pub struct Plan {
    pub spec: Spec,
    infos: IdVec<StageId, StageInfo>,
    /// The instances of each stage. In topological order of stages; those of one stage are neighbours.
    expanded: IdVec<StageId, Expanded>,
    /// Where the instances of a stage begin, and which stage that is, in the order of instances.
    starts: Vec<(InstanceId, StageId)>,
    count: usize,
    /// Stages that the targets need, in topological order.
    pub needed: Vec<StageId>,
    /// Whether a stage is in `needed`.
    is_needed: IdVec<StageId, bool>,
    wanted: IdVec<StageId, BTreeSet<&'static str>>,
    /// Consumers of each stage.
    consumers: IdVec<StageId, BTreeSet<StageId>>,
    /// Whether an instance takes part, where not all that the targets need do.
    part: Option<IdVec<InstanceId, bool>>,
}

impl Plan {
    /// Checks the whole file against the registry, then keeps what the targets need (all leaves by default).
    ///
    /// `report` holds what reading the file found already; on any mistake all of them come back, those in params too.
    pub fn build(spec: Spec, mut report: Report, registry: &Registry, targets: &[Target]) -> Result<Self, Report> {
        let mut problems = Vec::new();
        let infos = infos(&spec, registry, &mut problems);
        let links = ports::link(&spec, &infos, &mut problems);
        let order = match order::topological(&spec) {
            Ok(order) => order,
            Err(cycle) => {
                let names: Vec<&str> = cycle.iter().map(|&s| spec.stages[s].name.as_str()).collect();
                let message = format!("the stages feed each other in a circle: {}", names.join(" -> "));
                // Payloads that do not match along the circle are the same mistake, and show where it is.
                let inputs: Vec<String> = names.iter().map(|name| format!("stages.{name}.in")).collect();
                let along = |p: &Diagnostic| inputs.iter().any(|i| p.path.starts_with(i.as_str()));
                let (mismatches, others): (Vec<_>, Vec<_>) = problems.into_iter().partition(along);
                problems = others;
                problems.push(match mismatches.into_iter().next() {
                    Some(mut first) => {
                        first.hint = Some(std::mem::replace(&mut first.message, message));
                        first
                    }
                    None => spec.diagnostic(cycle[0], Section::In, &[] as &[&str], message, None),
                });
                problems.extend(lint::params(&spec, &infos));
                report.extend(problems);
                return Err(report);
            }
        };
        let mut expansion = Expansion::new(&spec);
        let mut broken: BTreeSet<StageId> =
            spec.stages.ids().filter(|&s| infos[s].is_none() || spec.stages[s].broken).collect();
        for &stage in &order {
            if links[stage].iter().any(|l| l.sources.iter().any(|(_, s)| broken.contains(&s.stage)))
                || broken.contains(&stage)
            {
                broken.insert(stage);
                continue;
            }
            match expansion.add(stage, &links[stage]) {
                Ok(()) if expansion.count > MAX_ALL => {
                    let message = format!("the stages have more than {MAX_ALL} instances together");
                    report.push(spec.diagnostic(stage, Section::Foreach, &[] as &[&str], message, None));
                    report.extend(problems);
                    return Err(report);
                }
                Ok(()) => {}
                Err((section, path, message, hint)) => {
                    let path: Vec<&str> = path.iter().map(String::as_str).collect();
                    problems.push(spec.diagnostic(stage, section, &path, message, hint));
                    broken.insert(stage);
                }
            }
        }
        let Expansion { expanded, starts, count, .. } = expansion;
        if !problems.is_empty() || report.has_errors() {
            problems.extend(lint::params(&spec, &infos));
            report.extend(problems);
            return Err(report);
        }
        let infos: IdVec<StageId, StageInfo> =
            infos.into_iter().map(|i| i.expect("every unknown stage was reported")).collect();
        let mut consumers = IdVec::<StageId, _>::filled(BTreeSet::new(), spec.stages.len());
        for (stage, links) in links.iter_ids() {
            for (_, source) in links.iter().flat_map(|l| &l.sources) {
                consumers[source.stage].insert(stage);
            }
        }
        let (needed, wanted) = targets::select(&spec, &infos, &links, &order, &consumers, &expanded, targets)
            .map_err(|message| Report::from(Diagnostic::error(message, None)))?;
        let mut is_needed = IdVec::<StageId, _>::filled(false, spec.stages.len());
        needed.iter().for_each(|&stage| is_needed[stage] = true);
        Ok(Self { spec, infos, expanded, starts, count, needed, is_needed, wanted, consumers, part: None })
    }

    pub fn row(&self, stage: StageId) -> &StageRow {
        &self.infos[stage].row
    }

    pub fn inputs(&self, stage: StageId) -> &[InPort] {
        &self.infos[stage].inputs
    }

    pub fn outputs(&self, stage: StageId) -> &[OutPort] {
        &self.infos[stage].outputs
    }

    /// All instances, also those that no target needs; inputs come first, and those of one stage are neighbours.
    pub fn instances(&self) -> IdRange<InstanceId> {
        IdRange::new(0, self.count)
    }

    /// The instances of a stage.
    pub fn instances_of(&self, stage: StageId) -> IdRange<InstanceId> {
        self.expanded[stage].ids()
    }

    /// The stage of an instance.
    pub fn stage_of(&self, id: InstanceId) -> StageId {
        self.starts[self.starts.partition_point(|(first, _)| *first <= id) - 1].1
    }

    /// The name of the stage of an instance.
    pub fn stage_name(&self, id: InstanceId) -> &str {
        &self.spec.stages[self.stage_of(id)].name
    }

    /// The stage of an instance, expanded, and its place among its instances.
    fn found(&self, id: InstanceId) -> (&Expanded, usize) {
        let expanded = &self.expanded[self.stage_of(id)];
        (expanded, expanded.place(id))
    }

    /// The axes of an instance with their values, sorted by name.
    pub fn point(&self, id: InstanceId) -> impl Iterator<Item = (&String, &Value)> + Clone {
        let (expanded, place) = self.found(id);
        expanded.points.at(&self.spec, place)
    }

    /// The same as a map.
    pub fn axes(&self, id: InstanceId) -> Axes {
        self.point(id).map(|(name, value)| (name.clone(), value.clone())).collect()
    }

    /// The value of one axis of an instance.
    pub fn axis(&self, id: InstanceId, name: &str) -> Option<&Value> {
        let (expanded, place) = self.found(id);
        Some(expanded.points.value(&self.spec, expanded.points.axis(name)?, place))
    }

    /// The names of the axes of a stage's instances, sorted.
    pub fn axis_names(&self, stage: StageId) -> impl ExactSizeIterator<Item = &str> {
        self.expanded[stage].points.names().map(String::as_str)
    }

    /// What feeds an instance, sorted by port.
    pub fn wires(&self, id: InstanceId) -> Vec<Wire> {
        let (expanded, place) = self.found(id);
        expanded.feeds.wires(place)
    }

    /// The instances that feed an instance, with the port taken from each, in the order of its wires.
    pub fn sources(&self, id: InstanceId) -> impl Iterator<Item = (InstanceId, &'static str)> + Clone + '_ {
        let (expanded, place) = self.found(id);
        expanded.feeds.sources(place)
    }

    /// Whether the targets need a stage.
    pub fn needs(&self, stage: StageId) -> bool {
        self.is_needed[stage]
    }

    /// Ports of a stage that are to be there after the run.
    pub fn wanted(&self, stage: StageId) -> &BTreeSet<&'static str> {
        &self.wanted[stage]
    }

    /// The same without what is made for people alone.
    pub fn without_previews(mut self) -> Self {
        for stage in self.infos.ids() {
            let outputs = &self.infos[stage].outputs;
            self.wanted[stage].retain(|name| !outputs.iter().any(|port| port.name == *name && port.preview));
        }
        self
    }

    pub fn consumers(&self, stage: StageId) -> &BTreeSet<StageId> {
        &self.consumers[stage]
    }

    /// The stage whose points the axis `draw` of this stage's instances counts.
    pub fn draw_of(&self, stage: StageId) -> Option<(StageId, &Draw)> {
        let draws = self.expanded[stage].draws?;
        Some((draws, self.spec.stages[draws].foreach.draw.as_ref()?))
    }

    /// The values that an instance knows by name: its axes, and what is drawn at the point that they name.
    pub fn values(&self, id: InstanceId) -> Axes {
        let (mut values, stage) = (self.axes(id), self.stage_of(id));
        if let Some((_, draw)) = self.draw_of(stage).filter(|_| values.contains_key(DRAW_AXIS)) {
            draw.put_into(&mut values);
        }
        values
    }

    /// `A_rho=1,S_rho=5000`; empty where the instance has no axes.
    pub fn axes_text(&self, id: InstanceId) -> String {
        axes_text(self.point(id))
    }

    /// `frames` or `frames[A_rho=1,S_rho=5000]`; of what is drawn the index.
    pub fn label(&self, id: InstanceId) -> String {
        let (name, axes) = (self.stage_name(id), self.axes_text(id));
        if axes.is_empty() { name.to_owned() } else { format!("{name}[{axes}]") }
    }

    /// The needed instances, in an order in which inputs come first.
    pub fn needed_instances(&self) -> impl Iterator<Item = InstanceId> + '_ {
        self.needed.iter().flat_map(|&stage| self.needed_of(stage))
    }

    /// Those of one stage.
    pub fn needed_of(&self, stage: StageId) -> impl Iterator<Item = InstanceId> + '_ {
        self.instances_of(stage)
            .filter(move |&id| self.is_needed[stage] && self.part.as_ref().is_none_or(|part| part[id]))
    }

    /// From now on only these instances are needed; with each those that feed it must be among them. Which outputs are wanted
    /// does not change, nor do keys.
    pub fn restrict(&mut self, to: &[InstanceId]) {
        let mut part = IdVec::filled(false, self.count);
        to.iter().for_each(|&id| part[id] = true);
        self.part = Some(part);
    }
}

fn infos(spec: &Spec, registry: &Registry, problems: &mut Vec<Diagnostic>) -> IdVec<StageId, Option<StageInfo>> {
    let info = |(at, stage): (StageId, &crate::spec::StageSpec)| {
        if stage.use_name.is_empty() {
            return None;
        }
        let Some(row) = registry.find(&stage.use_name) else {
            let names: Vec<&str> = registry.rows().iter().map(|r| r.name).collect();
            let hint = match nearest(&stage.use_name, names.iter().copied()) {
                Some(name) => format!("did you mean `{name}`?"),
                None => format!("known stages: {}", names.join(", ")),
            };
            problems.push(spec.diagnostic(
                at,
                Section::Use,
                &[] as &[&str],
                format!("there is no stage kind `{}`", stage.use_name),
                Some(hint),
            ));
            return None;
        };
        Some(StageInfo { name: row.name, row: row.clone(), inputs: (row.inputs)(), outputs: (row.outputs)() })
    };
    spec.stages.iter_ids().map(info).collect()
}
