//! Collects what a report shows from plan, store and outputs.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

use serde_json::Value;
use turbid_contract::StagePlan;

use crate::plan::{InstanceId, Plan, StageId};
use crate::resolve::{Resolver, State, Survey};
use crate::run::{End, Summary};
use crate::statistics::{shown_unit, significant};
use crate::store::InstanceRecord;

use super::figures::Figures;
use super::history::{self, timestamp_text};
use super::measures::errors;
use super::page::{Cell, Edge, Grid, Node, NodeState, Page};
use super::params::{params, shortened};
use super::pictures::Pictures;
use super::question::question;
use super::studies::studies;

/// Rows of the table of instances, and of that of measures.
const MOST_ROWS: usize = 500;
/// Warnings in words of their own.
const MOST_WARNINGS: usize = 40;

/// What a report is made of.
pub struct Source<'a> {
    pub resolver: &'a Resolver<'a>,
    pub survey: &'a Survey,
    pub outputs: &'a Path,
    /// The folder that the page goes to.
    pub folder: &'a Path,
    /// The command that makes the results.
    pub command: String,
    /// What the check of the file warns of.
    pub warnings: Vec<String>,
    /// Processor and time, as they are told.
    pub here: String,
}

type Records = Vec<(InstanceId, Arc<InstanceRecord>)>;

/// The page of a pipeline.
pub fn gather(of: &Source<'_>) -> Page {
    let Source { resolver, survey, outputs, .. } = of;
    let (plan, store) = (resolver.plan, resolver.store);
    let mut summary = Summary::default();
    for id in plan.needed_instances() {
        if let Some(State::Hit(brief)) = &survey.states[id] {
            summary.ends.insert(id, End::Hit(brief.clone()));
        }
    }
    let records: BTreeMap<StageId, Records> = plan
        .needed
        .iter()
        .map(|&stage| {
            let hit = |id| match &survey.states[id] {
                Some(State::Hit(brief)) => Some((id, store.record(&brief.key)?)),
                _ => None,
            };
            (stage, plan.instances_of(stage).filter_map(hit).collect())
        })
        .collect();
    let said: BTreeMap<StageId, StagePlan> = plan
        .needed
        .iter()
        .filter_map(|&stage| {
            let first = plan.instances_of(stage).next()?;
            let plan = survey.plans.get(&first).map(|plan| StagePlan::clone(plan));
            Some((stage, plan.or_else(|| resolver.stage_plan(first, &survey.outputs))?))
        })
        .collect();
    let all = plan.needed_instances().count();
    let there = summary.ends.len();
    let figures = Figures::read(plan, store, &summary);
    let heads = figures.blocks().into_iter().map(|lines| {
        let mut lines = lines.into_iter();
        let head = lines.next().unwrap_or_default();
        Grid { head, rows: lines.map(|line| line.into_iter().map(Cell::Text).collect()).collect(), ..Grid::default() }
    });
    let mut pictures = Pictures::of(plan, store, outputs, of.folder);
    // What the file is there for comes first, also where a page is full.
    let shown =
        plan.needed.iter().rev().filter_map(|stage| pictures.stage(*stage, &records[stage])).collect::<Vec<_>>();
    let picture_notes = (pictures.left_out > 0)
        .then(|| format!("{} pictures more than a page carries: outputs/latest has them all", pictures.left_out));
    let nodes = plan.spec.stages.ids().map(|stage| node(plan, survey, stage)).collect();
    let places: BTreeMap<StageId, usize> = plan.spec.stages.ids().enumerate().map(|(k, stage)| (stage, k)).collect();
    let (costs, cost_notes) = costs(plan, &records);
    Page {
        pipeline: plan.spec.pipeline.clone(),
        about: plan.spec.about.clone(),
        question: plan.spec.sources.first().map(|source| question(&source.text)).unwrap_or_default(),
        state: match there {
            0 => "Nothing has run yet.".to_owned(),
            n if n == all => format!("All {all} instances are up to date."),
            n => format!("{n} of {all} instances are up to date."),
        },
        hint: (there < all).then(|| format!("`{}` makes what is missing.", of.command)),
        figures: heads.collect(),
        figure_notes: figures.notes().to_vec(),
        studies: studies(plan, outputs, of.folder),
        shown,
        picture_notes: picture_notes.into_iter().collect(),
        nodes,
        edges: edges(plan, &places),
        stages: stages(plan, survey, &records, &said),
        costs,
        cost_notes,
        measures: measures(plan, &records),
        params: plan
            .needed
            .iter()
            .map(|&stage| (plan.spec.stages[stage].name.clone(), params(resolver, stage)))
            .filter(|(_, grid)| !grid.rows.is_empty())
            .collect(),
        warnings: warnings(of, &records),
        left_out: left_out(plan, &said),
        provenance: provenance(of, &records),
        instances: instances(plan, survey, &records, &pictures),
    }
}

fn node_state(plan: &Plan, survey: &Survey, stage: StageId) -> NodeState {
    if !plan.needs(stage) {
        return NodeState::LeftOut;
    }
    let mut state = NodeState::UpToDate;
    for id in plan.instances_of(stage) {
        match &survey.states[id] {
            Some(State::Hit(_)) => {}
            Some(State::Run { .. }) => return NodeState::ToRun,
            _ => state = NodeState::Waits,
        }
    }
    state
}

fn node(plan: &Plan, survey: &Survey, stage: StageId) -> Node {
    let spec = &plan.spec.stages[stage];
    let instances = plan.instances_of(stage).len();
    Node { name: spec.name.clone(), kind: spec.use_name.clone(), instances, state: node_state(plan, survey, stage) }
}

/// One edge for each pair of stages, with the ports that it stands for.
fn edges(plan: &Plan, places: &BTreeMap<StageId, usize>) -> Vec<Edge> {
    let mut found: BTreeMap<(usize, usize), BTreeSet<String>> = BTreeMap::new();
    for edge in plan.edges() {
        found.entry((places[&edge.from], places[&edge.to])).or_default().insert(edge.label());
    }
    let edge = |((from, to), ports): ((usize, usize), BTreeSet<String>)| Edge {
        from,
        to,
        ports: ports.into_iter().collect::<Vec<_>>().join(", "),
    };
    found.into_iter().map(edge).collect()
}

fn heads(heads: &[&str]) -> Vec<String> {
    heads.iter().map(|head| (*head).to_owned()).collect()
}

fn stages(
    plan: &Plan,
    survey: &Survey,
    records: &BTreeMap<StageId, Records>,
    said: &BTreeMap<StageId, StagePlan>,
) -> Grid {
    let row = |stage: StageId| {
        let spec = &plan.spec.stages[stage];
        let inputs: BTreeSet<&str> = spec.inputs.iter().flat_map(|i| &i.sources).map(|s| s.stage.as_str()).collect();
        let of = records.get(&stage).and_then(|records| records.first()).map(|(_, record)| record);
        let detail = said.get(&stage);
        let kernel = of.and_then(|record| record.kernel.clone()).or_else(|| detail.and_then(|d| d.kernel.clone()));
        let refused = of.map_or_else(|| detail.map(|d| d.refused.clone()).unwrap_or_default(), |r| r.refused.clone());
        let slower =
            if refused.is_empty() { String::new() } else { format!("; slower because {}", refused.join("; ")) };
        vec![
            Cell::text(&spec.name),
            Cell::text(format!("{} {}", plan.row(stage).name, plan.row(stage).version)),
            Cell::text(plan.instances_of(stage).len().to_string()),
            Cell::text(node_state(plan, survey, stage).text()),
            Cell::text(inputs.into_iter().collect::<Vec<_>>().join(", ")),
            Cell::text(detail.and_then(|d| d.method.clone()).unwrap_or_default()),
            Cell::text(kernel.map(|kernel| kernel + &slower).unwrap_or_default()),
        ]
    };
    Grid {
        head: heads(&["stage", "kind and version", "instances", "state", "reads", "method", "kernel"]),
        rows: plan.spec.stages.ids().map(row).collect(),
        ..Grid::default()
    }
}

/// Error and time of each stage; and what all of them took.
fn costs(plan: &Plan, records: &BTreeMap<StageId, Records>) -> (Grid, Vec<Cell>) {
    let cpu = |records: &Records| records.iter().map(|(_, record)| record.cost.cpu_s).sum::<f64>();
    let total: f64 = records.values().map(cpu).sum();
    let mut rows = Vec::new();
    for &stage in &plan.needed {
        let of = &records[&stage];
        if of.is_empty() {
            continue;
        }
        let own = cpu(of);
        let wall: f64 = of.iter().map(|(_, record)| record.cost.wall_s).sum();
        let peak = of.iter().map(|(_, record)| record.cost.peak_bytes).max().unwrap_or(0);
        let share = if total > 0.0 { 100.0 * own / total } else { 0.0 };
        rows.push(vec![
            Cell::text(&plan.spec.stages[stage].name),
            Cell::text(errors(of.iter().map(|(_, record)| record.measures.as_slice()))),
            Cell::run(format!("{own:.2}")),
            Cell::run(format!("{share:.0}")),
            Cell::run(format!("{wall:.2}")),
            Cell::run(format!("{:.0}", peak as f64 / 1e6)),
        ]);
    }
    let notes = match rows.is_empty() {
        true => vec![Cell::text("Nothing has run yet.")],
        false => vec![Cell::run(format!("All of it took {total:.1} CPU s, whenever it was computed."))],
    };
    let head = heads(&["stage", "error that it states", "CPU s", "% of all", "wall s", "peak MB of the process"]);
    (Grid { head, rows, ..Grid::default() }, notes)
}

/// What stages noted of their work: of several instances the range.
fn measures(plan: &Plan, records: &BTreeMap<StageId, Records>) -> Option<Grid> {
    let mut rows = Vec::new();
    for &stage in &plan.needed {
        let mut found: BTreeMap<(&str, &str), [f64; 2]> = BTreeMap::new();
        for (name, value, unit) in records[&stage].iter().flat_map(|(_, record)| &record.measures) {
            let range = found.entry((name, unit)).or_insert([*value; 2]);
            *range = [range[0].min(*value), range[1].max(*value)];
        }
        rows.extend(found.into_iter().map(|((name, unit), [low, high])| {
            let text = match low == high {
                true => significant(low),
                false => format!("{} to {}", significant(low), significant(high)),
            };
            // Times differ from run to run.
            let value = if unit.split('/').any(|part| matches!(part, "s" | "ns" | "us" | "ms")) {
                Cell::Run(text)
            } else {
                Cell::Text(text)
            };
            vec![Cell::text(&plan.spec.stages[stage].name), Cell::text(name), value, Cell::text(shown_unit(unit))]
        }));
    }
    let more = rows.len().checked_sub(MOST_ROWS).filter(|more| *more > 0);
    rows.truncate(MOST_ROWS);
    let more = more.map(|more| format!("and {more} more: `turbid show FILE`"));
    (!rows.is_empty()).then(|| Grid {
        head: heads(&["stage", "measure", "value", "unit"]),
        rows,
        more,
        ..Grid::default()
    })
}

/// Of the file, of what ran, and what failed the last time; each once, with how often.
fn warnings(of: &Source<'_>, records: &BTreeMap<StageId, Records>) -> Vec<String> {
    let plan = of.resolver.plan;
    let mut found: Vec<(String, usize)> = Vec::new();
    let mut add = |text: String| match found.iter_mut().find(|(known, _)| *known == text) {
        Some((_, times)) => *times += 1,
        None => found.push((text, 1)),
    };
    let stale = |id: InstanceId| !matches!(of.survey.states[id], Some(State::Hit(_)));
    let failures: BTreeMap<String, String> =
        history::last_failures(of.outputs, &plan.spec.pipeline).into_iter().collect();
    if !failures.is_empty() {
        for id in plan.needed_instances().filter(|&id| stale(id)) {
            let label = plan.label(id);
            if let Some(message) = failures.get(&label) {
                add(format!("{label} failed in the last run: {message}"));
            }
        }
    }
    of.warnings.iter().cloned().for_each(&mut add);
    for (&stage, records) in records {
        let name = &plan.spec.stages[stage].name;
        for text in records.iter().flat_map(|(_, record)| &record.warnings) {
            add(format!("{name}: {text}"));
        }
    }
    let more = found.len().saturating_sub(MOST_WARNINGS);
    let told = found.into_iter().take(MOST_WARNINGS).map(|(text, times)| match times {
        1 => text,
        times => format!("{text} ({times} instances)"),
    });
    told.chain((more > 0).then(|| format!("and {more} more: `turbid show FILE`"))).collect()
}

/// What each stage does not need for this scene; and the stages that nobody asked for.
fn left_out(plan: &Plan, said: &BTreeMap<StageId, StagePlan>) -> Vec<(String, Vec<String>)> {
    let stages = plan.needed.iter().filter_map(|stage| {
        let items = &said.get(stage)?.left_out;
        (!items.is_empty()).then(|| (plan.spec.stages[*stage].name.clone(), items.clone()))
    });
    let unneeded: Vec<String> = plan
        .spec
        .stages
        .iter_ids()
        .filter(|(stage, _)| !plan.needs(*stage))
        .map(|(_, stage)| stage.name.clone())
        .collect();
    let whole = (!unneeded.is_empty()).then(|| ("stages that nothing asked for".to_owned(), unneeded));
    stages.chain(whole).collect()
}

fn provenance(of: &Source<'_>, records: &BTreeMap<StageId, Records>) -> Grid {
    let plan = of.resolver.plan;
    let all = || records.values().flatten().map(|(_, record)| record);
    let versions: BTreeSet<&str> = all().map(|record| record.provenance.turbid_version.as_str()).collect();
    let times: Vec<u64> = all().map(|record| record.provenance.started).collect();
    let mut rows: Vec<(&str, Cell)> = vec![
        ("command", Cell::text(&of.command)),
        ("turbid", Cell::text(env!("CARGO_PKG_VERSION"))),
        ("results made by turbid", Cell::text(versions.into_iter().collect::<Vec<_>>().join(", "))),
        ("seed of the pipeline", Cell::text(plan.spec.seed.to_string())),
    ];
    let seeds = plan.spec.stages.iter().filter_map(|stage| Some((stage.name.as_str(), stage.seed?)));
    let seeds: Vec<String> = seeds.map(|(name, seed)| format!("{name}: {seed:?}")).collect();
    if !seeds.is_empty() {
        rows.push(("seeds of stages", Cell::text(seeds.join(", "))));
    }
    for source in
        plan.spec.sources.iter().take(plan.spec.sources.len() - plan.spec.overrides.len().min(plan.spec.sources.len()))
    {
        let digest = crate::digest::Digest::of(source.text.as_bytes());
        rows.push(("file", Cell::text(format!("{} (BLAKE3 {})", source.name, digest.short()))));
    }
    for given in &plan.spec.overrides {
        rows.push(("--set", Cell::text(shortened(given))));
    }
    for (name, value) in &plan.spec.vars {
        let text = match value {
            Value::String(text) => text.clone(),
            other => other.to_string(),
        };
        rows.push(("var", Cell::text(format!("{name}: {}", shortened(&text)))));
    }
    if let (Some(first), Some(last)) = (times.iter().min(), times.iter().max()) {
        let (first, last) = (timestamp_text(*first), timestamp_text(*last));
        let text = if first == last { first } else { format!("{first} to {last}") };
        rows.push(("computed", Cell::run(text)));
    }
    rows.push(("this page", Cell::run(&of.here)));
    Grid {
        head: heads(&["what", "value"]),
        rows: rows.into_iter().map(|(name, cell)| vec![Cell::text(name), cell]).collect(),
        ..Grid::default()
    }
}

fn instances(plan: &Plan, survey: &Survey, records: &BTreeMap<StageId, Records>, pictures: &Pictures<'_>) -> Grid {
    let mut rows = Vec::new();
    let count = plan.needed_instances().count();
    for id in plan.needed_instances().take(MOST_ROWS) {
        let label = Cell::text(plan.label(id));
        let of = &records[&plan.stage_of(id)];
        let record = of.binary_search_by_key(&id, |(id, _)| *id).ok().map(|at| &of[at].1);
        rows.push(match (&survey.states[id], record) {
            (_, Some(record)) => {
                let ports = record.ports.keys().map(|port| (port, pictures.link(id, record, port)));
                let ports: Vec<(&String, Option<String>)> = ports.collect();
                let file = match ports.iter().find_map(|(port, link)| Some((port, link.as_ref()?))) {
                    Some((port, href)) => Cell::Link { text: format!("{port} and others"), href: href.clone() },
                    None => Cell::text(record.ports.keys().cloned().collect::<Vec<_>>().join(", ")),
                };
                vec![
                    label,
                    Cell::text("up to date"),
                    Cell::text(record.key.short()),
                    file,
                    Cell::run(format!("{:.2}", record.cost.cpu_s)),
                    Cell::run(timestamp_text(record.provenance.started)),
                ]
            }
            (other, None) => {
                let text = match other {
                    Some(State::Run { reasons }) => format!("to run: {}", shortened(&reasons.join("; "))),
                    _ => "waits".to_owned(),
                };
                let mut row = vec![label, Cell::text(text)];
                row.resize(6, Cell::text(""));
                row
            }
        });
    }
    Grid {
        head: heads(&["instance", "state", "key", "outputs", "CPU s", "computed"]),
        rows,
        more: (count > MOST_ROWS).then(|| format!("and {} more: `turbid show FILE --json`", count - MOST_ROWS)),
        ..Grid::default()
    }
}
