//! `turbid plan`: every instance as hit, run (reasons) or waits, with the method and kernel taken, what is left out, and how long it takes.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::sync::Arc;

use clap::Args;
use serde::Serialize;
use turbid_contract::{Axes, StagePlan};

use crate::estimate::{Basis, Estimates, estimates};
use crate::memory::Budget;
use crate::plan::{InstanceId, Plan, StageId};
use crate::registry::Registry;
use crate::resolve::{Described, Resolver, State, Survey};
use crate::spec::Draw;
use crate::terminal::tell;
use crate::threads;

use super::cache::size_text;
use super::elsewhere::{self, Elsewhere};
use super::memory::{MemoryLimit, at_most, too_large};
use super::part::PartOf;
use super::{Done, Pipeline, print, print_json, report_of};

#[derive(Args)]
pub struct PlanCommand {
    #[command(flatten)]
    pipeline: Pipeline,
    /// Stages (or STAGE.PORT) that would be asked for; all leaves by default
    #[arg(value_name = "STAGE")]
    targets: Vec<String>,
    #[command(flatten)]
    part: PartOf,
    #[command(flatten)]
    memory: MemoryLimit,
    #[command(flatten)]
    elsewhere: Elsewhere,
    #[arg(long)]
    json: bool,
}

impl PlanCommand {
    pub fn run(&self, registry: &Registry) -> Done {
        let (plan, left) = self.pipeline.plan_part(registry, &self.targets, &self.part)?;
        let store = self.elsewhere.store_to_read(&self.pipeline.outputs)?;
        let resolver = Resolver::new(&plan, &store);
        elsewhere::bring(&resolver)?;
        let survey = resolver.survey(&[]);
        let report = report_of(&plan, &survey);
        if report.has_errors() {
            return Err(report.into());
        }
        let estimates = estimates(&resolver, &survey);
        let budget = self.memory.budget(threads::of_machine());
        let memory = Memory { at_most: at_most(&plan, &survey, budget, threads::of_machine()), budget };
        if self.json {
            print_json(&to_json(&resolver, &survey, &estimates, &memory, self.part.event(left)));
        } else {
            print(&to_text(&resolver, &survey, &estimates, &memory));
            if let Some(text) = self.part.text(&plan, &self.targets, self.pipeline.outputs.path(), left) {
                print(&text);
            }
        }
        for warning in report.diagnostics() {
            tell(&warning.to_string());
        }
        elsewhere::warn(&store);
        // The run may be meant for another machine: a plan of it is no mistake.
        for warning in too_large(&plan, &survey, budget) {
            tell(&warning.warning().to_string());
        }
        Ok(())
    }
}

/// State word and reasons of an instance.
fn state(plan: &Plan, state: &State) -> (&'static str, Vec<String>) {
    match state {
        State::Hit(_) => ("hit", Vec::new()),
        State::Run { reasons } => ("run", reasons.to_vec()),
        State::Waits(stages) => {
            ("waits", stages.iter().map(|&s| format!("for {}", plan.spec.stages[s].name)).collect())
        }
    }
}

/// What `--json` says of an instance; the plan's part is left out for those that are up to date.
#[derive(Serialize)]
struct Row<'a> {
    axes: Axes,
    #[serde(skip_serializing_if = "Option::is_none")]
    bytes: Option<Option<u64>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    kernel: Option<&'a str>,
    left_out: &'a [String],
    /// What the outputs will hold, by port.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[serde(serialize_with = "forms")]
    makes: Option<Described>,
    #[serde(skip_serializing_if = "Option::is_none")]
    method: Option<&'a Option<String>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    needs: Option<&'a [String]>,
    reasons: Vec<String>,
    #[serde(skip_serializing_if = "<[String]>::is_empty")]
    refused: &'a [String],
    /// Bytes, at the most.
    #[serde(skip_serializing_if = "Option::is_none")]
    memory: Option<Option<u64>>,
    /// CPU seconds.
    #[serde(skip_serializing_if = "Option::is_none")]
    seconds: Option<Option<f64>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    seconds_by: Option<Basis>,
    stage: &'a str,
    state: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    work: Option<Work>,
}

/// What a stage draws.
#[derive(Serialize)]
struct Drawn<'a> {
    method: &'static str,
    n: u64,
    /// Those that have all conditions met.
    points: usize,
    /// How many are left out by each condition.
    skipped: &'a BTreeMap<String, u64>,
    stage: &'a str,
}

impl<'a> Drawn<'a> {
    fn of(stage: &'a str, draw: &'a Draw) -> Self {
        let (method, points) = (draw.method().name(), draw.indices.len());
        Self { method, n: draw.n(), points, skipped: &draw.skipped, stage }
    }
}

/// The needed stages that draw, with what they draw.
fn drawn(plan: &Plan) -> impl Iterator<Item = (&str, &Draw)> {
    let stages = plan.needed.iter().map(|&stage| &plan.spec.stages[stage]);
    stages.filter_map(|stage| Some((stage.name.as_str(), stage.foreach.draw.as_ref()?)))
}

/// `draw tissue: 640 of 1000 points (sobol); 360 do not meet [lesion_a, below, 0.4]`
fn drawn_line((stage, draw): (&str, &Draw)) -> String {
    let mut line = format!("draw {stage}: {} of {} points ({})", draw.indices.len(), draw.n(), draw.method().name());
    let skipped = draw.skipped.iter().map(|(reason, count)| format!("{count} left out by {reason}"));
    for (i, skipped) in skipped.enumerate() {
        line.push_str(if i == 0 { "; " } else { ", " });
        line.push_str(&skipped);
    }
    line + "\n"
}

/// How much work an instance is.
#[derive(Serialize)]
struct Work {
    amount: f64,
    unit: &'static str,
}

/// Bytes of memory of the whole run.
#[derive(Clone, Copy, Serialize)]
struct Memory {
    /// By what runs side by side.
    at_most: u64,
    /// What there is, where the system tells.
    #[serde(serialize_with = "bytes_of")]
    budget: Option<Budget>,
}

fn forms<S: serde::Serializer>(made: &Option<Described>, to: S) -> Result<S::Ok, S::Error> {
    to.collect_map(made.iter().flatten().map(|(port, form)| (port, &**form)))
}

fn bytes_of<S: serde::Serializer>(budget: &Option<Budget>, to: S) -> Result<S::Ok, S::Error> {
    budget.map(|budget| budget.bytes).serialize(to)
}

#[derive(Serialize)]
struct Listing<'a> {
    #[serde(skip_serializing_if = "Vec::is_empty")]
    draws: Vec<Drawn<'a>>,
    instances: Vec<Row<'a>>,
    memory: Memory,
    /// What is said of a shard.
    #[serde(flatten)]
    shard: BTreeMap<&'static str, serde_json::Value>,
    stages_left_out: Vec<&'a str>,
}

fn to_json(
    resolver: &Resolver<'_>,
    survey: &Survey,
    estimates: &Estimates,
    memory: &Memory,
    shard: Vec<(&'static str, serde_json::Value)>,
) -> String {
    let plan = resolver.plan;
    let found = plan.needed_instances().filter_map(|id| survey.states[id].as_ref().map(|s| (id, s)));
    let row = |(id, found)| {
        let (word, reasons) = state(plan, found);
        let (detail, estimate) = (survey.plans.get(&id), estimates.get(&id));
        Row {
            axes: plan.values(id),
            bytes: detail.map(|d| d.bytes),
            kernel: detail.and_then(|d| d.kernel.as_deref()),
            left_out: detail.map_or(&[], |d| &d.left_out),
            makes: makes(resolver, survey, id),
            memory: detail.map(|d| d.memory),
            method: detail.map(|d| &d.method),
            needs: detail.map(|d| d.needs.as_slice()),
            reasons,
            refused: detail.map_or(&[], |d| &d.refused),
            seconds: detail.map(|_| estimate.map(|e| e.seconds)),
            seconds_by: estimate.map(|e| e.by),
            stage: plan.stage_name(id),
            state: word,
            work: estimate.and_then(|e| e.work).map(|(amount, unit)| Work { amount, unit }),
        }
    };
    let unneeded = plan.spec.stages.ids().filter(|&s| !plan.needs(s));
    let listing = Listing {
        draws: drawn(plan).map(|(stage, draw)| Drawn::of(stage, draw)).collect(),
        instances: found.map(row).collect(),
        memory: *memory,
        shard: shard.into_iter().collect(),
        stages_left_out: unneeded.map(|s| plan.spec.stages[s].name.as_str()).collect(),
    };
    serde_json::to_string(&listing).expect("names and finite numbers")
}

/// The forms of the ports that are wanted of an instance that is not up to date.
fn makes(resolver: &Resolver<'_>, survey: &Survey, id: InstanceId) -> Option<Described> {
    survey.plans.get(&id)?;
    let wanted = resolver.plan.wanted(resolver.plan.stage_of(id));
    let mut forms = resolver.made(id).unwrap_or_default();
    forms.retain(|port, _| wanted.contains(port));
    Some(forms)
}

/// An estimate below this is not worth a word, s.
const WORTH_S: f64 = 0.05;

/// Memory below this is not worth a word, bytes.
const WORTH_BYTES: u64 = 10_000_000;

/// Two digits: no estimate knows more.
fn rounded(seconds: f64) -> String {
    match seconds {
        s if s < 0.995 => format!("{s:.2}"),
        s if s < 9.95 => format!("{s:.1}"),
        s => {
            let unit = libm::pow(10.0, libm::floor(libm::log10(s)) - 1.0);
            format!("{:.0}", (s / unit).round() * unit)
        }
    }
}

fn to_text(resolver: &Resolver<'_>, survey: &Survey, estimates: &Estimates, memory: &Memory) -> String {
    let plan = resolver.plan;
    let mut text: String = drawn(plan).map(drawn_line).collect();
    let mut seconds = 0.0;
    for &stage in &plan.needed {
        // What one line says, the next ones do not repeat.
        let mut said = HashSet::new();
        for (group, detail) in groups(plan, survey, estimates, stage) {
            text.push_str(&group.line(plan));
            seconds += group.seconds;
            let mut lines = detail.map_or_else(Vec::new, detail_lines);
            let made = group.ids.first().and_then(|&id| makes(resolver, survey, id));
            lines.extend(made.into_iter().flatten().map(|(port, form)| format!("    {port}: {form}\n")));
            lines.into_iter().filter(|line| said.insert(line.clone())).for_each(|line| text.push_str(&line));
        }
    }
    if seconds >= WORTH_S {
        text.push_str(&format!("about {} CPU s of work\n", rounded(seconds)));
    }
    if memory.at_most >= WORTH_BYTES {
        let there_are = memory
            .budget
            .map_or_else(String::new, |budget| format!("; there are {} {}", size_text(budget.bytes), budget.by.text()));
        text.push_str(&format!("memory: at most {} at a time{there_are}\n", size_text(memory.at_most)));
    }
    text
}

/// So many lines of a stage; the rest of its instances are counted.
const LINES: usize = 8;
/// So many equal instances have lines of their own.
const ALONE: usize = 3;

/// What instances of one line have in common: which method and kernel, not what they say of the numbers of one instance, and what is left out.
#[derive(PartialEq, Eq, Hash)]
struct Common<'a>([&'a str; 2], [&'a [String]; 2], Vec<String>);

impl<'a> Common<'a> {
    fn of(detail: &'a StagePlan) -> Self {
        let head =
            |text: &'a Option<String>| text.as_deref().unwrap_or_default().split(" (").next().unwrap_or_default();
        let refused = detail.refused.iter().map(|text| text.chars().filter(|c| !c.is_ascii_digit()).collect());
        Self([head(&detail.method), head(&detail.kernel)], [&detail.needs, &detail.left_out], refused.collect())
    }
}

/// Instances that are told in one line.
struct Group {
    word: &'static str,
    reasons: Vec<String>,
    ids: Vec<InstanceId>,
    /// CPU seconds of all.
    seconds: f64,
    /// Whether one takes longer than anybody waited for.
    endless: bool,
    /// Bytes of the one that takes the most.
    bytes: u64,
    /// The rest of a stage, of whatever reasons.
    is_rest: bool,
}

/// The lines of a stage: equal instances in one, and what they have in common with each other.
fn groups<'a>(
    plan: &Plan,
    survey: &'a Survey,
    estimates: &Estimates,
    stage: StageId,
) -> Vec<(Group, Option<&'a StagePlan>)> {
    let mut groups: Vec<(Group, Option<&StagePlan>)> = Vec::new();
    let mut known: HashMap<_, usize> = HashMap::new();
    // The one before, and where it belongs: mostly there belongs the next one too.
    let mut last: Option<(&State, Option<&Arc<StagePlan>>, usize)> = None;
    for id in plan.instances_of(stage) {
        let Some(found) = &survey.states[id] else { continue };
        let detail = survey.plans.get(&id);
        let like_last = last.filter(|(state, before, _)| state.is_like(found) && same(*before, detail));
        let at = like_last.map_or_else(
            || {
                let (word, reasons) = state(plan, found);
                let key = (word, reasons, detail.map(|detail| Common::of(detail)));
                *known.entry(key).or_insert_with_key(|(word, reasons, _)| {
                    let fresh = Group { word, reasons: reasons.clone(), ..Group::empty() };
                    groups.push((fresh, detail.map(|detail| &**detail)));
                    groups.len() - 1
                })
            },
            |(_, _, at)| at,
        );
        last = Some((found, detail, at));
        let (group, estimate) = (&mut groups[at].0, estimates.get(&id));
        group.ids.push(id);
        group.seconds += estimate.map_or(0.0, |estimate| estimate.seconds);
        group.endless |= estimate.is_some_and(|estimate| estimate.by == Basis::AtLeast);
        group.bytes = group.bytes.max(detail.and_then(|detail| detail.memory).unwrap_or(0));
    }
    // Few of a kind stand for themselves, as long as a stage has few lines.
    let lines: usize = groups.iter().map(|(group, _)| if group.ids.len() <= ALONE { group.ids.len() } else { 1 }).sum();
    if lines <= LINES {
        return groups.into_iter().flat_map(|(group, detail)| group.singles(survey, estimates, detail)).collect();
    }
    let rest = groups.split_off(LINES.min(groups.len()));
    let mut counted: Vec<(Group, Option<&StagePlan>)> = Vec::new();
    for (group, _) in rest {
        match counted.iter_mut().find(|(other, _)| other.word == group.word) {
            Some((other, _)) => other.add(group),
            None => counted.push((Group { is_rest: true, reasons: Vec::new(), ..group }, None)),
        }
    }
    groups.extend(counted);
    groups
}

/// Whether two instances share a plan.
fn same(a: Option<&Arc<StagePlan>>, b: Option<&Arc<StagePlan>>) -> bool {
    match (a, b) {
        (Some(a), Some(b)) => Arc::ptr_eq(a, b),
        (a, b) => a.is_none() && b.is_none(),
    }
}

impl Group {
    fn empty() -> Self {
        Self { word: "", reasons: Vec::new(), ids: Vec::new(), seconds: 0.0, endless: false, bytes: 0, is_rest: false }
    }

    fn add(&mut self, other: Self) {
        self.ids.extend(other.ids);
        self.seconds += other.seconds;
        self.endless |= other.endless;
        self.bytes = self.bytes.max(other.bytes);
    }

    /// A line for each instance where there are few.
    fn singles<'a>(
        self,
        survey: &'a Survey,
        estimates: &Estimates,
        detail: Option<&'a StagePlan>,
    ) -> Vec<(Self, Option<&'a StagePlan>)> {
        if self.ids.len() > ALONE {
            return vec![(self, detail)];
        }
        let one = |&id: &InstanceId| {
            let (own, estimate) = (survey.plans.get(&id).map(|own| &**own), estimates.get(&id));
            let single = Self {
                word: self.word,
                reasons: self.reasons.clone(),
                ids: vec![id],
                seconds: estimate.map_or(0.0, |estimate| estimate.seconds),
                endless: estimate.is_some_and(|estimate| estimate.by == Basis::AtLeast),
                bytes: own.and_then(|detail| detail.memory).unwrap_or(0),
                is_rest: false,
            };
            (single, own)
        };
        self.ids.iter().map(one).collect()
    }

    fn line(&self, plan: &Plan) -> String {
        let why = if self.reasons.is_empty() { String::new() } else { format!(" ({})", self.reasons.join("; ")) };
        let about = match self.endless {
            true => ", much longer than its pilot, which did not end".to_owned(),
            false if self.seconds >= WORTH_S => format!(", about {} CPU s", rounded(self.seconds)),
            false => String::new(),
        };
        let each = if self.ids.len() > 1 { " each" } else { "" };
        let holds = match self.bytes {
            bytes if bytes >= WORTH_BYTES => format!(", memory {}{each}", size_text(bytes)),
            _ => String::new(),
        };
        let label = |place: Option<&InstanceId>| place.map_or_else(String::new, |&id| plan.label(id));
        let (first, count) = (label(self.ids.first()), self.ids.len());
        let named = match (count, self.is_rest) {
            (1, _) => first,
            (_, false) => format!("{first} .. {}: {count} instances", label(self.ids.last())),
            (_, true) => format!("{first} and {} more, for other reasons (`--json` has all)", count - 1),
        };
        format!("{:<5} {named}{why}{about}{holds}\n", self.word)
    }
}

/// How an instance works and what it leaves out, below its line; of several those of the first.
fn detail_lines(detail: &StagePlan) -> Vec<String> {
    let line = |head: &str, text: &str| format!("        {head}: {text}\n");
    let method = detail.method.iter().map(|method| line("method", method));
    let kernel = detail.kernel.iter().map(|kernel| line("kernel", kernel));
    let refused = detail.refused.iter().map(|refused| line("slower because", refused));
    let needs = (!detail.needs.is_empty()).then(|| line("needs", &detail.needs.join(", ")));
    let left_out = (!detail.left_out.is_empty()).then(|| wrapped("        left out: ", &detail.left_out));
    method.chain(kernel).chain(refused).chain(needs).chain(left_out).collect()
}

/// Items behind a head, as many to a line as fit, `;` between them (an item may hold a comma).
fn wrapped(head: &str, items: &[String]) -> String {
    const WIDTH: usize = 100;
    let mut lines = vec![head.to_owned()];
    for (i, item) in items.iter().enumerate() {
        let end = if i + 1 < items.len() { ";" } else { "" };
        let line = lines.last_mut().expect("there is the head");
        let begun = line.chars().count() > head.chars().count();
        if begun && line.chars().count() + item.chars().count() + 2 > WIDTH {
            lines.push(" ".repeat(head.chars().count()));
        } else if begun {
            line.push(' ');
        }
        lines.last_mut().expect("there is a line").push_str(&format!("{item}{end}"));
    }
    lines.iter().map(|line| format!("{line}\n")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Items stay whole and in order, a comma in one is none between two, no line is wider than a hundred characters.
    #[test]
    fn what_is_left_out_stands_in_lines() {
        let items: Vec<String> = (0..28).map(|i| format!("thing {i}, of some kind")).collect();
        let text = wrapped("    left out: ", &items);
        assert!(text.lines().count() > 5 && text.lines().all(|line| line.chars().count() <= 100), "{text}");
        let joined = text.lines().map(str::trim).collect::<Vec<_>>().join(" ");
        assert_eq!(joined, format!("left out: {}", items.join("; ")));
    }
}
