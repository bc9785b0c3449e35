//! Building a data set: shard by shard, each of its samples brought up to date, looked at, and written.

mod finish;
mod moments;

use std::collections::{BTreeMap, HashMap};
use std::path::Path;
use std::sync::Arc;

use rayon::prelude::*;
use serde_json::{Value, json};
use turbid_contract::Artifact;
use turbid_draw::Type;

use super::feature::Shape;
use super::folder::{Folder, Refused};
use super::index::Entry;
use super::manifest::{ColumnOf, ShardOf};
use super::plan::{DatasetPlan, Keep, Limited};
use super::shard::{Sample, encode};
use moments::{ShardMoments, join, moments};

use crate::digest::PartHasher;
use crate::plan::{InstanceId, Plan, StageId};
use crate::registry::Registry;
use crate::resolve::Resolver;
use crate::run::log::RunLog;
use crate::run::{self, End, Interrupt, Options, Progress};
use crate::spec::{DRAW_AXIS, Draw, Kind, Mistake, Report};
use crate::store::{Blob, InstanceRecord, Store};

/// Of so many samples that cannot be computed the others are built; more are a mistake in the file.
const MOST_UNFIT: f64 = 0.1;

/// What a build works with.
pub struct Building<'a> {
    pub plan: &'a Plan,
    pub dataset: &'a DatasetPlan,
    pub registry: &'a Registry,
    pub store: &'a Store,
    pub outputs: &'a Path,
    pub options: &'a Options,
    pub interrupt: &'a Interrupt,
    /// The progress of a run of this much work.
    pub progress: &'a dyn Fn(&run::progress::Work) -> Box<dyn Progress>,
    /// Told of each shard that is there.
    pub told: &'a dyn Fn(&Told<'_>),
}

/// A shard that is there.
pub struct Told<'a> {
    pub shard: &'a ShardOf,
    pub shards: usize,
    pub rejects: u64,
    /// Whether it was there already.
    pub kept: bool,
}

/// How a build ended.
#[derive(Debug)]
pub struct Built {
    pub samples: u64,
    pub rejects: BTreeMap<String, u64>,
    pub hits: usize,
    pub ran: usize,
    pub cpu_s: f64,
    pub bytes: u64,
}

/// Why a build stopped. What was finished is kept.
#[derive(Debug)]
pub enum Stopped {
    Report(Report),
    Input(String),
    Failed(String),
    Interrupted,
}

impl From<Refused> for Stopped {
    fn from(refused: Refused) -> Self {
        match refused {
            Refused::Input(message) => Self::Input(message),
            Refused::Failed(message) => Self::Failed(message),
        }
    }
}

/// A sample with the blobs of its features.
struct Found {
    sample: Sample,
    blobs: Vec<Blob>,
}

/// Why a sample could not be read: the feature at fault, if it is one, and what is wrong.
type NotRead<'f> = (Option<&'f str>, String);

/// What is known of all samples while it is built.
#[derive(Default)]
struct State {
    columns: Option<Vec<ColumnOf>>,
    entries: BTreeMap<u64, Entry>,
    shards: Vec<ShardOf>,
    moments: BTreeMap<String, ShardMoments>,
    unfit: u64,
    hits: usize,
    ran: usize,
}

impl Building<'_> {
    /// Brings every sample up to date and writes the folder `to`.
    pub fn build(&self, to: &Path) -> Result<Built, Stopped> {
        let dataset = &self.dataset.spec;
        self.look_ahead()?;
        let (folder, before) = Folder::open(to, &self.plan.spec.pipeline, &dataset.name)?;
        let mut state = State::default();
        let manifest = self.manifest(&state);
        if before.is_none() {
            folder.keep(&manifest).map_err(Stopped::Failed)?;
        }
        let before: HashMap<(String, usize), ShardOf> =
            before.into_iter().flat_map(|m| m.shards).map(|s| ((s.split.clone(), s.number), s)).collect();
        let rows = dataset.rows;
        let mut empty = Vec::new();
        for split in &self.dataset.splits {
            let of = split.shards(rows).count();
            for (number, indices) in split.shards(rows).enumerate() {
                let found = self.samples(&split.name, indices, &mut state)?;
                let file = format!("data/{}-{number:05}-of-{of:05}.parquet", split.name);
                if found.is_empty() && state.columns.is_none() {
                    empty.push((split.name.clone(), number, of, file));
                    continue;
                }
                self.shard(&folder, (&split.name, number, of, &file), found, &before, &mut state)?;
            }
        }
        let Some(columns) = state.columns.clone() else {
            let rejects = self.manifest(&state).rejects;
            let reasons: Vec<String> = rejects.iter().map(|(reason, n)| format!("{n} by {reason}")).collect();
            let message = format!("every sample is left out: {}", reasons.join(", "));
            return Err(self.wrong(&["keep"], message, Some("widen the limits".to_owned())));
        };
        for (split, number, of, file) in empty {
            self.shard(&folder, (&split, number, of, &file), Vec::new(), &before, &mut state)?;
        }
        let place = |shard: &ShardOf| self.dataset.splits.iter().position(|split| split.name == shard.split);
        state.shards.sort_by_key(|shard| (place(shard), shard.number));
        self.finish(&folder, &columns, state)
    }

    /// The samples of these raw indices: up to date, and within the limits of `keep`.
    fn samples(&self, split: &str, indices: &[u64], state: &mut State) -> Result<Vec<Found>, Stopped> {
        let (_, draw) = self.plan.draw_of(self.dataset.draws).expect("the stage draws");
        let mut fit: Vec<u64> = indices.to_vec();
        let mut plan = self.of(&fit)?;
        let mut resolver = Resolver::new(&plan, self.store);
        let mut survey = resolver.survey(&[]);
        if Report::from(survey.problems.clone()).has_errors() {
            // Which of them it is, each of them says alone.
            let unfit: Vec<(u64, String)> = fit
                .iter()
                .filter_map(|&index| self.unfit(index).map(|why| Some((index, why?))).transpose())
                .collect::<Result<_, _>>()?;
            state.unfit += unfit.len() as u64;
            let all = state.entries.len() + indices.len();
            if unfit.is_empty() || state.unfit as f64 > (MOST_UNFIT * all as f64).max(1.0) {
                return Err(Stopped::Report(Report::from(survey.problems)));
            }
            for (index, reason) in unfit {
                fit.retain(|&other| other != index);
                let group = self.group(draw, index);
                state
                    .entries
                    .insert(index, Entry { split: split.to_owned(), group, reject: reason, ..Entry::default() });
            }
            drop(resolver);
            plan = self.of(&fit)?;
            resolver = Resolver::new(&plan, self.store);
            survey = resolver.survey(&[]);
            if Report::from(survey.problems.clone()).has_errors() {
                return Err(Stopped::Report(Report::from(survey.problems)));
            }
        }
        let work = run::progress::Work::of(&plan, &survey);
        let stale = survey.states.iter().flatten().any(|state| !matches!(state, crate::resolve::State::Hit(_)));
        let log = stale.then(|| RunLog::begin(self.outputs, &plan));
        let progress = (self.progress)(&work);
        let summary = run::run(&resolver, survey, self.options, progress.as_ref(), self.interrupt);
        progress.ended();
        let summary = summary.map_err(Stopped::Failed)?;
        self.store.finish().map_err(|e| Stopped::Failed(e.to_string()))?;
        if let Some(log) = log {
            drop(log.end(&plan, &summary));
        }
        state.hits += summary.hits();
        state.ran += summary.ran();
        if summary.interrupted {
            return Err(Stopped::Interrupted);
        }
        if let Some((id, message)) = summary.ends.iter().find_map(|(id, end)| match end {
            End::Failed(message) => Some((*id, message)),
            _ => None,
        }) {
            return Err(Stopped::Failed(format!("{}: {message}", plan.label(id))));
        }
        let mut found = Vec::new();
        let places = by_index(&plan);
        for &index in &fit {
            let records: BTreeMap<StageId, &Arc<InstanceRecord>> = plan
                .needed
                .iter()
                .filter_map(|&stage| Some((stage, summary.record(*places.get(&(stage, index))?)?)))
                .collect();
            let mut entry = Entry { split: split.to_owned(), group: self.group(draw, index), ..Entry::default() };
            for (stage, record) in &records {
                let name = &plan.spec.stages[*stage].name;
                entry
                    .measures
                    .extend(record.measures.iter().map(|(measure, value, _)| (format!("{name}.{measure}"), *value)));
                entry.seed = entry.seed.or(record.seed);
                entry.cpu_s += record.cost.cpu_s;
                entry.wall_s += record.cost.wall_s;
            }
            entry.reject = self.rejected(&records)?.unwrap_or_default();
            if entry.reject.is_empty() {
                let blob = |feature: &super::feature::Feature| records[&feature.stage].ports[feature.port].blob;
                let blobs = self.dataset.features.iter().map(blob).collect();
                let draws = draw.point(index).map_err(Stopped::Failed)?;
                let sample = Sample { index, group: entry.group, draws, values: Vec::new() };
                found.push(Found { sample, blobs });
            }
            state.entries.insert(index, entry);
        }
        Ok(found)
    }

    fn of(&self, indices: &[u64]) -> Result<Plan, Stopped> {
        self.dataset.of_samples(self.plan, self.registry, indices).map_err(Stopped::Report)
    }

    /// Why a sample cannot be computed, if it cannot.
    fn unfit(&self, index: u64) -> Result<Option<String>, Stopped> {
        let plan = self.of(&[index])?;
        let problems = Report::from(Resolver::new(&plan, self.store).survey(&[]).problems);
        let first = problems.diagnostics().into_iter().find(|d| d.severity == crate::spec::Severity::Error).cloned();
        Ok(first.map(|problem| format!("{}: {}", problem.path, problem.message)))
    }

    fn group(&self, draw: &Draw, index: u64) -> Option<i64> {
        let by = self.dataset.spec.by.as_ref()?;
        let place = draw.names().position(|name| name == by)?;
        draw.point(index).ok()?.get(place)?.as_i64()
    }

    /// The limit that a sample does not meet.
    fn rejected(&self, records: &BTreeMap<StageId, &Arc<InstanceRecord>>) -> Result<Option<String>, Stopped> {
        for limit in &self.dataset.keep {
            let record = records[&limit.stage];
            let value = self.limited(limit, record)?;
            // What is not known is not within a limit.
            if !value.is_some_and(|value| limit.spec.holds(value)) {
                return Ok(Some(format!("keep: {}", limit.spec.text)));
            }
        }
        Ok(None)
    }

    fn limited(&self, limit: &Keep, record: &InstanceRecord) -> Result<Option<f64>, Stopped> {
        match &limit.on {
            Limited::Measure(name) => match record.measures.iter().find(|(measure, ..)| measure == name) {
                Some((_, value, _)) => Ok(Some(*value)),
                None => {
                    let known: Vec<&str> = record.measures.iter().map(|(name, ..)| name.as_str()).collect();
                    let message = format!("`{}` has no measure `{name}`", limit.spec.stage);
                    let hint = match known.as_slice() {
                        [] => "it has none; a column of a table is STAGE.PORT.COLUMN".to_owned(),
                        known => format!("it has {}", known.join(", ")),
                    };
                    Err(self.wrong(&["keep", &limit.spec.text], message, Some(hint)))
                }
            },
            Limited::Column { port, column } => {
                let artifact = self.store.get(&record.ports[*port].blob).map_err(|e| Stopped::Failed(e.to_string()))?;
                let at = ["keep", limit.spec.text.as_str()];
                let Artifact::Table(table) = artifact else {
                    return Err(self.wrong(&at, format!("`{port}` is no table"), None));
                };
                let found = table.columns.iter().find(|known| known.name == *column && known.cells.len() == 1);
                let Some(found) = found else {
                    let names: Vec<&str> = table.columns.iter().map(|known| known.name.as_str()).collect();
                    let message = match table.rows() {
                        1 => format!("`{port}` has no column `{column}`"),
                        rows => format!("`{port}` has {rows} rows, and a limit is on a table of one"),
                    };
                    return Err(self.wrong(&at, message, Some(format!("it has {}", names.join(", ")))));
                };
                Ok(super::feature::number_of(&found.cells))
            }
        }
    }

    /// Writes a shard, unless the one that is there was made from the same.
    fn shard(
        &self,
        folder: &Folder,
        (split, number, of, file): (&str, usize, usize, &str),
        found: Vec<Found>,
        before: &HashMap<(String, usize), ShardOf>,
        state: &mut State,
    ) -> Result<(), Stopped> {
        let key = self.key(&found);
        let rows = found.len() as u64;
        for (row, found) in found.iter().enumerate() {
            let entry = state.entries.get_mut(&found.sample.index).expect("it was found above");
            entry.shard = file.to_owned();
            entry.row = Some(row as u64);
        }
        let (_, draw) = self.plan.draw_of(self.dataset.draws).expect("the stage draws");
        let types: Vec<Type> = draw.types().collect();
        let samples = self.load(found, state)?;
        let columns = state.columns.clone().expect("a sample or an earlier one has been loaded");
        let there = before.get(&(split.to_owned(), number));
        let kept = there.filter(|there| there.key == key && folder.take_over(there, file));
        let shard = match kept {
            Some(there) => ShardOf { file: file.to_owned(), ..there.clone() },
            None => {
                let (bytes, checks) = encode(&columns, &types, &samples).map_err(Stopped::Input)?;
                let of = folder.write(file, &bytes).map_err(Stopped::Failed)?;
                let (split, file) = (split.to_owned(), file.to_owned());
                ShardOf { file, split, number, rows, bytes: of.bytes, sha256: of.sha256, checks, key }
            }
        };
        let rejects = state.entries.values().filter(|e| e.split == split && !e.reject.is_empty()).count() as u64;
        (self.told)(&Told { shard: &shard, shards: of, rejects, kept: kept.is_some() });
        let moments = moments(&columns, &samples);
        let joined = state.moments.remove(split).map_or_else(|| moments.clone(), |before| join(before, &moments));
        state.moments.insert(split.to_owned(), joined);
        let moved = there.is_none_or(|there| *there != shard);
        state.shards.push(shard);
        // Where nothing is new the manifest of the last build still holds.
        if moved { folder.keep(&self.manifest(state)).map_err(Stopped::Failed) } else { Ok(()) }
    }

    /// A mistake at its place below the data set.
    fn wrong(&self, at: &[&str], message: String, hint: Option<String>) -> Stopped {
        let path = [&["datasets", self.dataset.spec.name.as_str()], at].concat();
        Stopped::Report(self.plan.spec.at_path(&path, Mistake::new(Kind::Graph, message), hint).into())
    }

    /// Finds layers and columns that are not there by what is known of the first sample before it is computed.
    fn look_ahead(&self) -> Result<(), Stopped> {
        let Some(first) = self.dataset.splits.iter().filter_map(|split| split.indices.first()).min() else {
            return Ok(());
        };
        let sample = self.of(&[*first])?;
        let resolver = Resolver::new(&sample, self.store);
        let survey = resolver.survey(&[]);
        // Whether one sample or all of them are wrong, the build finds out.
        if Report::from(survey.problems).has_errors() {
            return Ok(());
        }
        let form = |feature: &super::feature::Feature| {
            let id = sample.instances_of(feature.stage).into_iter().next()?;
            resolver.made(id)?.get(feature.port).map(|form| (**form).clone())
        };
        self.dataset.shapes(form, self.plan).map(drop).map_err(Stopped::Report)
    }

    /// What a shard is made from.
    fn key(&self, found: &[Found]) -> String {
        let mut parts = PartHasher::new("turbid dataset shard 1");
        parts.add("dtype", self.dataset.spec.dtype.name().as_bytes());
        for feature in &self.dataset.features {
            parts.add("feature", format!("{:?}", (&feature.spec, feature.port, &feature.part)).as_bytes());
        }
        for Found { sample, blobs } in found {
            parts.add("sample", &sample.index.to_le_bytes());
            parts.add("draws", Value::from(sample.draws.clone()).to_string().as_bytes());
            parts.add("group", format!("{:?}", sample.group).as_bytes());
            blobs.iter().for_each(|blob| parts.add("blob", &blob.digest.0));
        }
        parts.finish().to_string()
    }

    /// Reads the features of the samples; all samples must hold the same.
    fn load(&self, found: Vec<Found>, state: &mut State) -> Result<Vec<Sample>, Stopped> {
        // Which feature is at fault, if it is one.
        let (features, store) = (&self.dataset.features, self.store);
        let read = |Found { mut sample, blobs }: Found| -> Result<(Sample, Vec<Shape>), NotRead<'_>> {
            let mut shapes = Vec::new();
            let mut artifacts: HashMap<Blob, Artifact> = HashMap::new();
            for (feature, blob) in features.iter().zip(&blobs) {
                if !artifacts.contains_key(blob) {
                    let artifact = store.get(blob).map_err(|e| (None, e.to_string()))?;
                    artifacts.insert(*blob, artifact);
                }
                let taken = feature.take(&artifacts[blob]);
                let (shape, values) = taken.map_err(|message| (Some(feature.spec.name.as_str()), message))?;
                shapes.push(shape);
                sample.values.push(values);
            }
            Ok((sample, shapes))
        };
        let read: Result<Vec<(Sample, Vec<Shape>)>, _> = found.into_par_iter().map(read).collect();
        let read = read.map_err(|(feature, message)| match feature {
            Some(name) => self.wrong(&["sample", name], message, None),
            None => Stopped::Failed(message),
        })?;
        for (sample, shapes) in &read {
            let columns = self.columns(shapes);
            match &state.columns {
                None => state.columns = Some(columns),
                Some(first) if *first != columns => {
                    let (a, b) = first.iter().zip(&columns).find(|(a, b)| a != b).expect("they differ");
                    let message = format!(
                        "`{}` differs between samples: {} in the first, {} in sample {}",
                        a.name,
                        a.form(),
                        b.form(),
                        sample.index
                    );
                    let hint = "all samples have the same pixels, layers and units: draw none of them".to_owned();
                    return Err(self.wrong(&["sample", &a.name], message, Some(hint)));
                }
                Some(_) => {}
            }
        }
        Ok(read.into_iter().map(|(sample, _)| sample).collect())
    }

    fn columns(&self, shapes: &[Shape]) -> Vec<ColumnOf> {
        let column = |name: &str, dtype: &str, about: &str| ColumnOf {
            name: name.to_owned(),
            dtype: dtype.to_owned(),
            shape: None,
            unit: String::new(),
            channels: Vec::new(),
            pixel_mm: None,
            about: about.to_owned(),
        };
        let mut columns = vec![
            column("id", "string", "name of the sample"),
            column("draw", "int64", "raw index of the drawn point"),
            column("group", "int64", "group that no two splits share"),
        ];
        let (_, draw) = self.plan.draw_of(self.dataset.draws).expect("the stage draws");
        for (name, of) in draw.names().zip(draw.types()) {
            let dtype = match of {
                Type::Float => "float64",
                Type::Integer => "int64",
                Type::Text => "string",
            };
            // A feature may be the map of what is drawn as a number.
            let taken = self.dataset.features.iter().any(|feature| feature.spec.name == name);
            let name = if taken { format!("draw.{name}") } else { name.to_owned() };
            columns.push(column(&name, dtype, "drawn"));
        }
        for (feature, shape) in self.dataset.features.iter().zip(shapes) {
            let dtype = if shape.tensor.is_some() { self.dataset.spec.dtype.name() } else { "float64" };
            columns.push(ColumnOf {
                shape: shape.tensor,
                unit: shape.unit.clone(),
                channels: shape.channels.clone(),
                pixel_mm: shape.pixel_mm,
                ..column(&feature.spec.name, dtype, &feature.spec.from.join("."))
            });
        }
        columns
    }
}

/// The instance of each stage at each raw index.
fn by_index(plan: &Plan) -> HashMap<(StageId, u64), InstanceId> {
    let index = |id: InstanceId| plan.instances[id].axes.get(DRAW_AXIS).and_then(Value::as_u64);
    plan.needed_instances().filter_map(|id| Some(((plan.instances[id].stage, index(id)?), id))).collect()
}

/// What `--json` prints at the end.
pub fn finished(built: &Built, seconds: f64) -> Value {
    json!({
        "event": "finished", "samples": built.samples, "rejects": built.rejects, "hits": built.hits, "ran": built.ran,
        "cpu_s": built.cpu_s, "bytes": built.bytes, "seconds": seconds,
    })
}
