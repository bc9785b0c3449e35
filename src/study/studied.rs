//! Runs the points of a study, each a run of its own on the same store, and gathers what they say.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::path::Path;

use turbid_contract::{Artifact, ImageStack};

use crate::digest::Digest;
use crate::plan::shard::Shard;
use crate::plan::{InstanceId, Plan};
use crate::registry::Registry;
use crate::resolve::{Resolver, State, Survey};
use crate::run::log::{Logged, RunLog};
use crate::run::progress::Work;
use crate::run::{self, End, Interrupt, Options, Progress};
use crate::spec::{Diagnostic, Report, StageId, StudySpec};
use crate::store::Store;

use super::ahead::{self, first};
use super::found::{Errors, Found, Seen, Spent, spent};
use super::points::{Point, order, points};
use super::quantity::Quantity;

/// What a study works with.
pub struct Studying<'a> {
    pub file: &'a Path,
    /// Those of the command line; the values of a point come after them.
    pub overrides: &'a [String],
    pub study: &'a StudySpec,
    pub registry: &'a Registry,
    pub store: &'a Store,
    pub outputs: &'a Path,
    pub options: &'a Options,
    pub interrupt: &'a Interrupt,
    /// The progress of a run of this much work.
    pub progress: &'a dyn Fn(&Work) -> Box<dyn Progress>,
    /// What a run cannot begin for: instances that need more memory than there is.
    pub refused: &'a dyn Fn(&Plan, &Survey) -> Vec<Diagnostic>,
    /// Told of each point that ended: the point, how many are done, what it says or why it failed.
    pub told: &'a Told<'a>,
}

/// What a caller does with a point that ended.
pub type Told<'a> = dyn Fn(&Point, usize, &Result<Found, String>) + 'a;

/// A point and what it says.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    pub point: Point,
    /// Or why there is nothing to say.
    pub found: Result<Found, String>,
    /// What all points of its repeat share is counted apart.
    pub own: Spent,
    pub shared: Spent,
}

/// Why a study stopped. What was finished is kept.
#[derive(Debug)]
pub enum Stopped {
    Failed(String),
    Interrupted,
}

/// How many results were there, and how many were made.
#[derive(Clone, Copy, Debug, Default)]
pub struct Counts {
    pub hits: usize,
    pub ran: usize,
}

impl Studying<'_> {
    /// Runs all points, cheap ones first; a row each, in the order of [`points`]. A point that fails is a row with the reason, and the others are run.
    pub fn run(&self) -> Result<(Vec<Row>, Counts), Stopped> {
        let points = points(self.study);
        let (mut found, counts) = self.found(&points)?;
        if self.study.truth.is_none() {
            against_each_other(self.study, &points, &mut found);
        }
        Ok((rows(points, found), counts))
    }

    /// The points of a shard: a block of all of them. What they say, as far as each says it alone.
    pub fn make(&self, shard: Shard) -> Result<(Vec<Result<Found, String>>, Counts), Stopped> {
        let points = points(self.study);
        self.found(&points[shard.block(points.len())])
    }

    /// What some points say, in their order.
    fn found(&self, points: &[Point]) -> Result<(Vec<Result<Found, String>>, Counts), Stopped> {
        let mut found: Vec<Option<Result<Found, String>>> = vec![None; points.len()];
        let (log, counts) = (RefCell::new(None), RefCell::new(Counts::default()));
        for (done, i) in order(points).into_iter().enumerate() {
            let result = self.point(&points[i], &log, &counts);
            if self.interrupt.requested() {
                return Err(Stopped::Interrupted);
            }
            self.store.finish().map_err(|e| Stopped::Failed(e.to_string()))?;
            (self.told)(&points[i], done + 1, &result);
            found[i] = Some(result);
        }
        let counts = counts.into_inner();
        if let Some(log) = log.into_inner() {
            let log: RunLog = log;
            if let Some(text) = log.end_of_parts(counts.hits, counts.ran) {
                crate::terminal::tell(&format!("warning: the log of this run could not be written: {text}"));
            }
        }
        Ok((found.into_iter().map(|f| f.expect("every point was run")).collect(), counts))
    }

    fn point(&self, point: &Point, log: &RefCell<Option<RunLog>>, counts: &RefCell<Counts>) -> Result<Found, String> {
        let plan = ahead::plan(self.file, self.overrides, self.study, self.registry, point)?;
        let looked_at = Looked::of(self.study, &plan)?;
        let resolver = Resolver::new(&plan, self.store);
        let survey = resolver.survey(&[]);
        let mut report = Report::from(survey.problems.clone());
        report.extend((self.refused)(&plan, &survey));
        if report.has_errors() {
            return Err(first(&report));
        }
        let stale = survey.states.iter().flatten().any(|state| !matches!(state, State::Hit(_)));
        if stale && log.borrow().is_none() {
            *log.borrow_mut() = Some(RunLog::begin(self.outputs, &plan));
        }
        let progress = (self.progress)(&Work::of(&plan, &survey));
        let log = log.borrow();
        let logged = log.as_ref().map(|log| Logged { log, progress: progress.as_ref() });
        let told: &dyn Progress = logged.as_ref().map_or(progress.as_ref(), |logged| logged);
        let summary = run::run(&resolver, survey, self.options, told, self.interrupt)?;
        progress.ended();
        if let Some(log) = log.as_ref() {
            log.part(&plan, &summary);
        }
        {
            let mut counts = counts.borrow_mut();
            counts.hits += summary.hits();
            counts.ran += summary.ran();
        }
        let failed = plan.needed_instances().find_map(|id| match summary.ends.get(&id) {
            Some(End::Failed(message)) => Some(format!("{}: {message}", plan.label(id))),
            _ => None,
        });
        if let Some(message) = failed {
            return Err(message);
        }
        let record = |id: InstanceId| summary.record(id, self.store);
        let stack = |id: InstanceId, port: &str| -> Result<ImageStack, String> {
            let blob = summary.brief(id).and_then(|brief| brief.outputs.get(port)).copied();
            let blob = blob.ok_or_else(|| format!("{} has not made `{port}`", plan.label(id)))?;
            match self.store.get(&blob) {
                Ok(Artifact::Images(stack)) => Ok(stack),
                Ok(_) => Err(format!("`{port}` of {} is no image", plan.label(id))),
                Err(error) => Err(format!("`{port}` of {}: {error}", plan.label(id))),
            }
        };
        let mut all = vec![seen(&looked_at.estimate, looked_at.truth.as_ref(), &plan, &stack)?];
        // Of other quantities the truth is the layer of their own names.
        let truth_of_others = looked_at.truth.clone().map(|truth| Quantity { layer: None, ..truth });
        let true_error =
            |seen: &Seen| if seen.truth.is_empty() { Errors::default() } else { seen.error(&self.study.error) };
        let (mut also, mut also_seen) = (Vec::new(), Vec::new());
        for Other { text, quantity, stage, name } in &looked_at.also {
            let looked = quantity.as_ref().map(|quantity| seen(quantity, truth_of_others.as_ref(), &plan, &stack));
            let measured = || {
                let of = plan.instances_of(*stage).filter_map(record);
                let values = of.flat_map(|r| r.measures.clone().into_iter().filter(|m| m.0 == *name).map(|m| m.1));
                // Of several instances the worst.
                values.reduce(f64::max)
            };
            match (looked, measured()) {
                (_, Some(value)) => also.push(Some(value)),
                (Some(Ok(seen)), None) => {
                    also_seen.push(also.len());
                    also.push(true_error(&seen).error);
                    all.push(seen);
                }
                (Some(Err(what)), None) => return Err(format!("also: `{text}` is no measure, and {what}")),
                (None, None) => return Err(format!("also: `{text}` is no measure of its stage")),
            }
        }
        Ok(Found {
            errors: true_error(&all[0]),
            unit: all[0].unit.clone(),
            also,
            also_seen,
            spent: spent(&plan, plan.instances_of(looked_at.estimate.stage), record),
            seen: if self.study.truth.is_some() { Vec::new() } else { all },
        })
    }
}

/// One of `also`: a measure of a stage, or a quantity.
struct Other {
    text: String,
    quantity: Option<Quantity>,
    stage: StageId,
    name: String,
}

/// What a study looks at, in one plan.
struct Looked {
    estimate: Quantity,
    truth: Option<Quantity>,
    also: Vec<Other>,
}

impl Looked {
    fn of(study: &StudySpec, plan: &Plan) -> Result<Self, String> {
        let layer = |text: &str| {
            let quantity = Quantity::read(text, plan)?;
            match &quantity.layer {
                Some(_) => Ok(quantity),
                None => Err(format!("`{text}` names no quantity: write {text}.NAME")),
            }
        };
        let other = |text: &String| {
            let (stage, name) = text.split_once('.').unwrap_or((text, ""));
            let id = plan.spec.stage(stage).ok_or_else(|| format!("there is no stage `{stage}`"))?;
            Ok::<_, String>(Other { text: text.clone(), quantity: layer(text).ok(), stage: id, name: name.to_owned() })
        };
        Ok(Self {
            estimate: layer(&study.estimate)?,
            truth: study.truth.as_ref().map(|text| Quantity::read(text, plan)).transpose()?,
            also: study.also.iter().map(other).collect::<Result<_, _>>()?,
        })
    }
}

/// What a study names that no stage of the pipeline has, found before anything runs.
pub fn mistakes(plan: &Plan) -> Vec<Diagnostic> {
    let spec = &plan.spec;
    let mut found = Vec::new();
    for study in &spec.studies {
        let named = [("estimate", Some(&study.estimate)), ("truth", study.truth.as_ref())];
        for (key, text) in named.into_iter().filter_map(|(key, text)| Some((key, text?))) {
            match Quantity::read(text, plan) {
                Err(message) => found.push(spec.at_study(&study.name, key, message)),
                Ok(quantity) if key == "estimate" && quantity.layer.is_none() => {
                    let message = format!("`{text}` names no quantity: write {text}.NAME");
                    found.push(spec.at_study(&study.name, key, message));
                }
                Ok(_) => {}
            }
        }
        if study.truth.is_none() && study.repeats == 1 && study.error != "masked_percent" {
            let message = "without a truth the error is the scatter of the repeats, and there is one only: name `truth`, or let `repeats` be 2 or more";
            found.push(spec.at_study(&study.name, "estimate", message));
        }
        if spec.stage(&study.name).is_some() {
            let message =
                format!("`{}` is the name of a stage too: `turbid run` could not tell which is meant", study.name);
            found.push(spec.at_study(&study.name, "vary", message));
        }
    }
    found
}

/// The pixels of a quantity over all its instances, each with the truth of the same axes.
fn seen(
    quantity: &Quantity,
    truth: Option<&Quantity>,
    plan: &Plan,
    stack: &dyn Fn(InstanceId, &str) -> Result<ImageStack, String>,
) -> Result<Seen, String> {
    let name = quantity.layer.as_deref().expect("looked at: it names a layer");
    let mut seen = Seen::default();
    for id in plan.instances_of(quantity.stage) {
        let estimate = stack(id, quantity.port)?;
        let label = || plan.label(id);
        let true_stack = match truth {
            None => None,
            Some(truth) => {
                let of = truth.instance_for(&plan.axes(id), plan);
                let of = of.ok_or_else(|| format!("{} has no truth of the same axes", label()))?;
                Some((stack(of, truth.port)?, truth.layer.as_deref().unwrap_or(name)))
            }
        };
        let truth = true_stack.as_ref().map(|(stack, name)| (stack, *name));
        seen.add(&estimate, name, truth).map_err(|what| format!("{}: {what}", label()))?;
    }
    Ok(seen)
}

/// Without a truth: the error of a repeat is its distance from the mean of all repeats of its point.
fn against_each_other(study: &StudySpec, points: &[Point], found: &mut [Result<Found, String>]) {
    let groups: BTreeSet<String> = points.iter().map(|point| format!("{:?}", point.values)).collect();
    for group in groups {
        let places: Vec<usize> = (0..points.len()).filter(|&i| format!("{:?}", points[i].values) == group).collect();
        let mut all: Vec<(usize, Vec<Seen>)> = Vec::new();
        for place in places {
            if let Ok(found) = &mut found[place] {
                all.push((place, std::mem::take(&mut found.seen)));
            }
        }
        for k in 0..all.first().map_or(0, |(_, seen)| seen.len()) {
            let repeats: Vec<&Seen> = all.iter().map(|(_, seen)| &seen[k]).collect();
            for ((place, _), seen) in all.iter().zip(from_their_mean(&repeats)) {
                let errors = seen.error(&study.error);
                let Ok(found) = &mut found[*place] else { continue };
                if k == 0 {
                    found.errors = errors;
                } else {
                    let at = found.also_seen[k - 1];
                    found.also[at] = errors.error;
                }
            }
        }
    }
}

/// Each repeat against the mean of all, which stands for the truth, by sqrt(n / (n - 1)) further from it, as the mean holds its own n-th part. A pixel counts where it
/// does in all. None where there are fewer than two repeats, or of different size.
fn from_their_mean(repeats: &[&Seen]) -> Vec<Seen> {
    let n = repeats.len();
    let pixels = repeats.first().map_or(0, |seen| seen.estimate.len());
    if n < 2 || repeats.iter().any(|seen| seen.estimate.len() != pixels) {
        return Vec::new();
    }
    let mean = |i: usize| repeats.iter().map(|seen| f64::from(seen.estimate[i])).sum::<f64>() / n as f64;
    let mean: Vec<f64> = (0..pixels).map(mean).collect();
    let counts: Vec<bool> = (0..pixels).map(|i| repeats.iter().all(|seen| seen.counts[i])).collect();
    let wider = (n as f64 / (n as f64 - 1.0)).sqrt();
    let against = |seen: &&Seen| Seen {
        estimate: (0..pixels).map(|i| (mean[i] + wider * (f64::from(seen.estimate[i]) - mean[i])) as f32).collect(),
        truth: mean.iter().map(|m| *m as f32).collect(),
        counts: counts.clone(),
        ..(*seen).clone()
    };
    repeats.iter().map(against).collect()
}

/// Costs of each point: what is its own, and what all points of its repeat share.
fn rows(points: Vec<Point>, found: Vec<Result<Found, String>>) -> Vec<Row> {
    let shared_of = |repeat: u64| -> BTreeSet<Digest> {
        let mut all =
            points.iter().zip(&found).filter(|(p, _)| p.repeat == repeat).filter_map(|(_, f)| f.as_ref().ok());
        let Some(first) = all.next() else { return BTreeSet::new() };
        let (mut keys, mut several): (BTreeSet<Digest>, bool) = (first.spent.keys().copied().collect(), false);
        for other in all {
            several = true;
            keys.retain(|key| other.spent.contains_key(key));
        }
        // A point alone shares nothing.
        if several { keys } else { BTreeSet::new() }
    };
    let repeats: BTreeSet<u64> = points.iter().map(|point| point.repeat).collect();
    let shared: std::collections::BTreeMap<u64, BTreeSet<Digest>> =
        repeats.into_iter().map(|repeat| (repeat, shared_of(repeat))).collect();
    let mut rows = Vec::with_capacity(points.len());
    for (point, found) in points.into_iter().zip(found) {
        let shared = &shared[&point.repeat];
        let sum = |in_shared: bool| {
            let spent = found.iter().flat_map(|f| &f.spent).filter(|(key, _)| shared.contains(key) == in_shared);
            spent.fold(Spent::default(), |sum, (_, spent)| sum.and(*spent))
        };
        let (own, of_all) = (sum(false), sum(true));
        rows.push(Row { own, shared: of_all, point, found });
    }
    rows
}
