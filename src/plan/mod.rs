//! Spec and registry -> checked graph of stage instances: ports exist, payloads match, axes join, no cycle, pruned.

mod axes;
mod lint;
mod order;
mod ports;
pub mod shard;
mod targets;

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};

use turbid_contract::{Arity, Axes, InPort, OutPort, StageRow};

use crate::registry::Registry;
use crate::spec::{DRAW_AXIS, Diagnostic, Draw, Report, Section, Spec, nearest};

pub use crate::ids::{Id, IdRange, IdVec, InstanceId, StageId};
pub use axes::{MAX_INSTANCES, same_value};
pub use targets::Target;

use axes::{Joined, Piece};
use ports::Link;

/// Previews are made of stages with at most this many instances; beyond it people read `instances.parquet`.
pub const PREVIEW_INSTANCES: usize = 64;

/// A stage's kind with its ports, listed once.
pub(crate) struct StageInfo {
    pub name: &'static str,
    pub row: StageRow,
    pub inputs: Vec<InPort>,
    pub outputs: Vec<OutPort>,
}

/// One stage at one point of its axes.
#[derive(Debug)]
pub struct Instance {
    pub stage: StageId,
    pub axes: Axes,
    /// Sorted by port.
    pub wires: Vec<Wire>,
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
pub struct Plan {
    pub spec: Spec,
    infos: IdVec<StageId, StageInfo>,
    /// In topological order of stages; instances of one stage are neighbours.
    pub instances: IdVec<InstanceId, Instance>,
    ranges: IdVec<StageId, IdRange<InstanceId>>,
    /// Stages that the targets need, in topological order.
    pub needed: Vec<StageId>,
    /// Whether a stage is in `needed`.
    is_needed: IdVec<StageId, bool>,
    wanted: IdVec<StageId, BTreeSet<&'static str>>,
    /// Consumers of each stage.
    consumers: IdVec<StageId, BTreeSet<StageId>>,
    /// The stage whose points the axis `draw` of a stage's instances counts.
    draws: IdVec<StageId, Option<StageId>>,
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
        let mut instances = IdVec::<InstanceId, Instance>::new();
        let mut ranges: IdVec<StageId, _> = IdVec::filled(IdRange::new(0, 0), spec.stages.len());
        let mut draws = IdVec::<StageId, _>::filled(None, spec.stages.len());
        let mut broken: BTreeSet<StageId> =
            spec.stages.ids().filter(|&s| infos[s].is_none() || spec.stages[s].broken).collect();
        for &stage in &order {
            if links[stage].iter().any(|l| l.sources.iter().any(|(_, s)| broken.contains(&s.stage)))
                || broken.contains(&stage)
            {
                broken.insert(stage);
                continue;
            }
            let expanded = draw_of(&spec, stage, &links[stage], &instances, &ranges, &draws).and_then(|draw| {
                draws[stage] = draw;
                expand(&spec, stage, &links[stage], &instances, &ranges)
            });
            match expanded {
                Ok(fresh) => {
                    ranges[stage] = IdRange::new(instances.len(), instances.len() + fresh.len());
                    instances.append(fresh);
                    if instances.len() > MAX_INSTANCES {
                        let message = format!("the pipeline has more than {MAX_INSTANCES} instances");
                        report.push(spec.diagnostic(stage, Section::Foreach, &[] as &[&str], message, None));
                        report.extend(problems);
                        return Err(report);
                    }
                }
                Err((section, path, message, hint)) => {
                    let path: Vec<&str> = path.iter().map(String::as_str).collect();
                    problems.push(spec.diagnostic(stage, section, &path, message, hint));
                    broken.insert(stage);
                }
            }
        }
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
        let (needed, wanted) = targets::select(&spec, &infos, &links, &order, &consumers, &ranges, targets)
            .map_err(|message| Report::from(Diagnostic::error(message, None)))?;
        let mut is_needed = IdVec::<StageId, _>::filled(false, spec.stages.len());
        needed.iter().for_each(|&stage| is_needed[stage] = true);
        Ok(Self { spec, infos, instances, ranges, needed, is_needed, wanted, consumers, draws, part: None })
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

    /// The instances of a stage.
    pub fn instances_of(&self, stage: StageId) -> IdRange<InstanceId> {
        self.ranges[stage]
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
        let draws = self.draws[stage]?;
        Some((draws, self.spec.stages[draws].foreach.draw.as_ref()?))
    }

    /// The values that an instance knows by name: its axes, and what is drawn at the point that they name.
    pub fn values(&self, id: InstanceId) -> Cow<'_, Axes> {
        let instance = &self.instances[id];
        let draw = self.draws[instance.stage].and_then(|stage| self.spec.stages[stage].foreach.draw.as_ref());
        match draw.filter(|_| instance.axes.contains_key(DRAW_AXIS)) {
            None => Cow::Borrowed(&instance.axes),
            Some(draw) => {
                let mut values = instance.axes.clone();
                draw.put_into(&mut values);
                Cow::Owned(values)
            }
        }
    }

    /// `frames` or `frames[A_rho=1,S_rho=5000]`; of what is drawn the index.
    pub fn label(&self, id: InstanceId) -> String {
        let instance = &self.instances[id];
        let name = &self.spec.stages[instance.stage].name;
        if instance.axes.is_empty() {
            name.clone()
        } else {
            format!("{name}[{}]", crate::key::axes_text(&instance.axes))
        }
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
        let mut part = IdVec::filled(false, self.instances.len());
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

type Mistake = (Section, Vec<String>, String, Option<String>);

/// The stage whose points the axis `draw` of a stage counts: its own, or that of its sources.
///
/// Error: two of them, whose indices have nothing to do with each other; a drawn name that is an axis already.
fn draw_of(
    spec: &Spec,
    stage: StageId,
    links: &[Link],
    instances: &IdVec<InstanceId, Instance>,
    ranges: &IdVec<StageId, IdRange<InstanceId>>,
    draws: &IdVec<StageId, Option<StageId>>,
) -> Result<Option<StageId>, Mistake> {
    let own = spec.stages[stage].foreach.draw.is_some().then_some(stage);
    let mut found = own.map(|own| (own, None));
    let mut axes = BTreeSet::new();
    for link in links {
        for (source, from) in &link.sources {
            let first = ranges[from.stage].into_iter().next();
            axes.extend(first.into_iter().flat_map(|id| instances[id].axes.keys().map(String::as_str)));
            let Some(draw) = draws[from.stage] else { continue };
            match found {
                Some((other, by)) if other != draw => {
                    let name = |stage: StageId| &spec.stages[stage].name;
                    let by = by.map_or_else(String::new, |by: &str| format!(" (by `{by}`)"));
                    let message =
                        format!("`{}` is drawn by `{}`, and not by `{}`{by}", source.stage, name(draw), name(other));
                    let hint = "one `draw` per chain: draw once, and let both take their values from it";
                    return Err((Section::In, vec![link.port.name.to_owned()], message, Some(hint.to_owned())));
                }
                _ => found = Some((draw, Some(source.stage.as_str()))),
            }
        }
    }
    let draw = found.map(|(draw, _)| draw);
    let drawn = draw.and_then(|draw| spec.stages[draw].foreach.draw.as_ref());
    let names = || drawn.into_iter().flat_map(|draw| draw.names());
    let taken =
        |name: &str| axes.contains(name) || own.is_none() && spec.stages[stage].foreach.names.iter().any(|n| n == name);
    if let Some(name) = names().find(|name| taken(name)) {
        let message = format!("`{name}` is both drawn and an axis");
        return Err((
            Section::Foreach,
            vec![name.to_owned()],
            message,
            Some("give one of them another name".to_owned()),
        ));
    }
    Ok(draw)
}

/// The instances of a stage, from those of its sources and its own `foreach`.
fn expand(
    spec: &Spec,
    stage: StageId,
    links: &[Link],
    instances: &IdVec<InstanceId, Instance>,
    ranges: &IdVec<StageId, IdRange<InstanceId>>,
) -> Result<Vec<Instance>, Mistake> {
    let stage_spec = &spec.stages[stage];
    let at_port = |link: &Link, message: String, hint: Option<String>| {
        (Section::In, vec![link.port.name.to_owned()], message, hint)
    };
    // Axes that one and optional ports bring; a many port gathers the others.
    let mut brought = BTreeSet::new();
    let mut selected: Vec<Selected> = Vec::new();
    for link in links {
        for (source, found) in &link.sources {
            let some = select(instances, ranges[found.stage], source).map_err(|(m, h)| at_port(link, m, h))?;
            if !matches!(link.port.arity, Arity::Many | Arity::Some) {
                brought.extend(some.axes.iter().cloned());
            }
            selected.push(some);
        }
    }
    let mut pieces = Vec::new();
    let mut feeds: Vec<(&Link, &'static str)> = Vec::new();
    let mut some = selected.iter();
    for link in links {
        let many = matches!(link.port.arity, Arity::Many | Arity::Some);
        for (source, found) in &link.sources {
            let Selected { chosen, axes: has } = some.next().expect("one per source");
            let gathered = match (&source.over, many) {
                (Some(over), _) => {
                    if let Some(unknown) = over.iter().find(|name| !has.contains(*name)) {
                        let message = format!("`{}` has no axis `{unknown}` to gather over", source.stage);
                        return Err(at_port(
                            link,
                            message,
                            nearest(unknown, has.iter().map(String::as_str)).map(|n| format!("did you mean `{n}`?")),
                        ));
                    }
                    over.iter().cloned().collect()
                }
                (None, true) => has.difference(&brought).cloned().collect(),
                (None, false) => BTreeSet::new(),
            };
            let names: Vec<String> = has.difference(&gathered).cloned().collect();
            let entries = axes::gather(chosen, &names);
            pieces.push(Piece {
                label: format!("input `{}` ({}.{})", link.port.name, source.stage, found.port.name),
                names,
                entries,
            });
            feeds.push((link, found.port.name));
        }
    }
    let (names, joined) = axes::join(&pieces, stage_spec.product)
        .map_err(|apart| (Section::In, Vec::new(), apart.to_string(), apart.hint()))?;
    if let Some(name) = stage_spec.foreach.names.iter().find(|n| names.contains(n)) {
        let message = format!("an input of `{}` carries the axis `{name}` already", stage_spec.name);
        return Err((Section::Foreach, vec![name.clone()], message, Some("give the new axis another name".to_owned())));
    }
    // Without a `foreach` one point without values.
    let (added, points) = (&stage_spec.foreach.names, &stage_spec.foreach.rows);
    if points.len().saturating_mul(joined.len()) > MAX_INSTANCES {
        let message = format!(
            "`{}` has {} x {} instances, more than {MAX_INSTANCES}",
            stage_spec.name,
            joined.len(),
            points.len()
        );
        return Err((Section::Foreach, Vec::new(), message, None));
    }
    let mut fresh = Vec::with_capacity(points.len() * joined.len());
    for row in &joined {
        for point in points {
            let mut axes = row.axes.clone();
            axes.extend(added.iter().cloned().zip(point.iter().cloned()));
            fresh.push(Instance { stage, axes, wires: wires(&pieces, &feeds, row) });
        }
    }
    Ok(fresh)
}

fn wires(pieces: &[Piece], feeds: &[(&Link, &'static str)], row: &Joined) -> Vec<Wire> {
    let mut by_port: BTreeMap<&'static str, Wire> = BTreeMap::new();
    for ((piece, &(link, out)), &pick) in pieces.iter().zip(feeds).zip(&row.picks) {
        let many = matches!(link.port.arity, Arity::Many | Arity::Some);
        let wire =
            by_port.entry(link.port.name).or_insert_with(|| Wire { port: link.port.name, many, from: Vec::new() });
        wire.from.extend(piece.entries[pick].1.iter().map(|&id| (id, out)));
    }
    by_port.into_values().collect()
}

/// A mistake with its way out.
type Hinted = (String, Option<String>);

/// The instances that `where` leaves, and their axes but for those that it fixes.
struct Selected<'a> {
    chosen: Vec<(InstanceId, &'a Axes)>,
    axes: BTreeSet<String>,
}

fn select<'a>(
    instances: &'a IdVec<InstanceId, Instance>,
    range: IdRange<InstanceId>,
    source: &crate::spec::SourceRef,
) -> Result<Selected<'a>, Hinted> {
    let mut chosen: Vec<(InstanceId, &Axes)> = range.map(|id| (id, &instances[id].axes)).collect();
    for (name, value) in &source.filter {
        let Some((_, axes)) = chosen.first() else { break };
        if !axes.contains_key(name) {
            let hint = nearest(name, axes.keys().map(String::as_str)).map(|n| format!("did you mean `{n}`?"));
            return Err((format!("`{}` has no axis `{name}`", source.stage), hint));
        }
        let all = chosen.clone();
        chosen.retain(|(_, axes)| same_value(&axes[name], value));
        if chosen.is_empty() {
            let mut values: Vec<String> = all.iter().map(|(_, a)| crate::key::value_text(&a[name])).collect();
            values.sort();
            values.dedup();
            values.truncate(12);
            let message = format!("`{}` has no {name} = {}", source.stage, crate::key::value_text(value));
            return Err((message, Some(format!("it has {}", values.join(", ")))));
        }
    }
    let names = chosen.first().into_iter().flat_map(|(_, axes)| axes.keys());
    let axes = names.filter(|name| !source.filter.contains_key(*name)).cloned().collect();
    Ok(Selected { chosen, axes })
}
