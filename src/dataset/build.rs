//! Building a data set: shard by shard, each of its samples brought up to date, looked at, and written.

mod finish;
mod load;
mod moments;
mod part;
mod release;

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use serde_json::{Value, json};
use turbid_contract::Artifact;
use turbid_draw::Type;

use super::folder::{Folder, Refused};
use super::format::Format;
use super::index::{Point, Points, file_of};
use super::manifest::{ColumnOf, FileOf, ShardOf};
use super::plan::{DatasetPlan, Keep, Limited};
use super::shard;
use super::webdataset;
use moments::{ShardMoments, join};
pub use part::Made;
use release::Releases;

use crate::plan::{InstanceId, Plan, StageId};
use crate::registry::Registry;
use crate::resolve::{Resolver, Survey};
use crate::run::log::RunLog;
use crate::run::{self, End, Interrupt, Options, Progress, Summary};
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
    /// What the shards are to be.
    pub format: Format,
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

/// A share is told of so many points at least, where there are so many.
const FIRST: usize = 512;

/// Points that are computed in one go: their plan and their records are held at once.
const WINDOW: usize = 128;
/// A sample with the blobs of its features.
struct Found {
    index: u64,
    blobs: Vec<Blob>,
}

/// What is known of all samples while it is built.
#[derive(Default)]
struct State {
    columns: Option<Vec<ColumnOf>>,
    points: Points,
    shards: Vec<ShardOf>,
    /// Shards of an earlier build that were not come to yet, by split and number.
    before: BTreeMap<(String, usize), ShardOf>,
    columns_before: Vec<ColumnOf>,
    moments: BTreeMap<String, ShardMoments>,
    unfit: u64,
    hits: usize,
    ran: usize,
    releases: Releases,
    /// Of this build, once something was computed.
    log: Option<RunLog>,
}

impl Building<'_> {
    /// Brings every sample up to date and writes the folder `to`.
    pub fn build(&self, to: &Path) -> Result<Built, Stopped> {
        let dataset = &self.dataset.spec;
        self.look_ahead()?;
        let (folder, before) = Folder::open(to, &self.plan.spec.pipeline, &dataset.name, self.format)?;
        let points = self.dataset.splits.iter().map(|split| split.indices.len()).sum();
        let mut state = State { points: Points::for_points(points), ..State::default() };
        match before {
            None => folder.keep(&self.manifest(&state)).map_err(Stopped::Failed)?,
            Some(before) => {
                state.columns_before = before.columns;
                state.before = before.shards.into_iter().map(|s| ((s.split.clone(), s.number), s)).collect();
            }
        }
        let rows = dataset.rows;
        let mut empty = Vec::new();
        for (place, split) in self.dataset.splits.iter().enumerate() {
            for (number, indices) in split.shards(rows).enumerate() {
                let found = self.samples((place, number), indices, &mut state)?;
                if found.is_empty() && state.columns.is_none() {
                    empty.push((place, number));
                } else {
                    self.shard(&folder, (place, number), found, &mut state)?;
                }
                self.give_back(&folder, &mut state)?;
            }
        }
        let Some(columns) = state.columns.clone() else {
            let rejects = self.manifest(&state).rejects;
            let reasons: Vec<String> = rejects.iter().map(|(reason, n)| format!("{n} by {reason}")).collect();
            let message = format!("every sample is left out: {}", reasons.join(", "));
            return Err(self.wrong(&["keep"], message, Some("widen the limits".to_owned())));
        };
        for at in empty {
            self.shard(&folder, at, Vec::new(), &mut state)?;
        }
        let place = |shard: &ShardOf| self.dataset.splits.iter().position(|split| split.name == shard.split);
        state.shards.sort_by_key(|shard| (place(shard), shard.number));
        self.finish(&folder, &columns, state)
    }

    /// The samples of these raw indices: up to date, and within the limits of `keep`.
    fn samples(&self, at: (usize, usize), indices: &[u64], state: &mut State) -> Result<Vec<Found>, Stopped> {
        let mut found = Vec::new();
        for indices in indices.chunks(WINDOW) {
            self.window(at, indices, &mut found, state)?;
            self.store.settle().map_err(|e| Stopped::Failed(e.to_string()))?;
        }
        Ok(found)
    }

    fn window(
        &self,
        (split, shard): (usize, usize),
        indices: &[u64],
        found: &mut Vec<Found>,
        state: &mut State,
    ) -> Result<(), Stopped> {
        let mut fit: Vec<u64> = indices.to_vec();
        let mut plan = self.of(&fit)?;
        let mut resolver = self.resolver(&plan, &self.read_by_limits());
        let mut survey = resolver.survey(&[]);
        let mut reasons: HashMap<u64, String> = HashMap::new();
        if Report::from(survey.problems.clone()).has_errors() {
            // Which of them it is, each of them says alone.
            reasons = fit
                .iter()
                .filter_map(|&index| self.unfit(index).map(|why| Some((index, why?))).transpose())
                .collect::<Result<_, _>>()?;
            state.unfit += reasons.len() as u64;
            // By the first few alone one in ten cannot be told.
            let seen = state.points.all().len() + indices.len();
            let all = seen.max(FIRST.min(state.points.expected()));
            if reasons.is_empty() || state.unfit as f64 > (MOST_UNFIT * all as f64).max(1.0) {
                return Err(Stopped::Report(Report::from(survey.problems)));
            }
            fit.retain(|index| !reasons.contains_key(index));
            drop(resolver);
            plan = self.of(&fit)?;
            resolver = self.resolver(&plan, &self.read_by_limits());
            survey = resolver.survey(&[]);
            if Report::from(survey.problems.clone()).has_errors() {
                return Err(Stopped::Report(Report::from(survey.problems)));
            }
        }
        let summary = self.run(&resolver, survey, &mut state.log)?;
        state.hits += summary.hits();
        state.ran += summary.ran();
        let places = by_index(&plan);
        for &index in indices {
            let (seed, cpu_s, wall_s, row) = (None, 0.0, 0.0, Ok(0));
            let at = (split as u16, shard as u32);
            state.points.push(Point { index, seed, cpu_s, wall_s, shard: at, row });
            let mut reject = reasons.remove(&index);
            if reject.is_none() {
                let record = |stage: StageId| Some((stage, summary.record(*places.get(&(stage, index))?, self.store)?));
                let records: BTreeMap<StageId, InstanceRecord> =
                    plan.needed.iter().filter_map(|&stage| record(stage)).collect();
                for (&stage, record) in &records {
                    let name = plan.spec.stages[stage].name.as_str();
                    for (place, (measure, value, _)) in record.measures.iter().enumerate() {
                        state.points.measure((stage, name), place, measure, *value);
                    }
                    let point = state.points.last_mut().expect("it was pushed above");
                    point.seed = point.seed.or(record.seed);
                    point.cpu_s += record.cost.cpu_s;
                    point.wall_s += record.cost.wall_s;
                }
                reject = self.rejected(&records)?;
                if reject.is_none() {
                    let blob = |feature: &super::feature::Feature| records[&feature.stage].ports[feature.port].blob;
                    found.push(Found { index, blobs: self.dataset.features.iter().map(blob).collect() });
                }
            }
            let reject = reject.map(|reason| state.points.number_of(&reason));
            let point = state.points.last_mut().expect("it was pushed above");
            point.row = reject.map_or_else(|| Ok(found.len() as u32 - 1), Err);
        }
        self.may_go(&plan, &summary, state);
        Ok(())
    }

    /// Notes what may be given back once the shard of these samples is there. What limits look into stays: they are decided again.
    fn may_go(&self, plan: &Plan, summary: &Summary, state: &mut State) {
        if !self.dataset.spec.shards_only {
            return;
        }
        let kept = self.read_by_limits();
        for id in plan.needed_instances().filter(|&id| plan.axis(id, DRAW_AXIS).is_some()) {
            let of_stage = kept.iter().filter(|(stage, _)| *stage == plan.stage_of(id));
            let but: Vec<&str> = of_stage.map(|(_, port)| *port).collect();
            if let Some(brief) = summary.brief(id) {
                state.releases.add(self.store, brief, &but);
            }
        }
    }

    /// Which outputs limits of `keep` look into: their bytes must be there.
    fn read_by_limits(&self) -> Vec<(StageId, &'static str)> {
        let port = |limit: &Keep| match limit.on {
            Limited::Measure(_) => None,
            Limited::Column { port, .. } => Some((limit.stage, port)),
        };
        self.dataset.keep.iter().filter_map(port).collect()
    }

    /// States of samples; these outputs of theirs must be there, not only their records.
    fn resolver<'p>(&'p self, plan: &'p Plan, read: &[(StageId, &'static str)]) -> Resolver<'p> {
        // Why a sample is computed nobody asks.
        let resolver = Resolver::new(plan, self.store).without_history();
        for (stage, port) in read {
            plan.instances_of(*stage).into_iter().for_each(|id| resolver.ask(id, port));
        }
        resolver
    }

    /// Computes what is missing. What fails or is interrupted ends the build.
    fn run(&self, resolver: &Resolver<'_>, survey: Survey, log: &mut Option<RunLog>) -> Result<Summary, Stopped> {
        let plan = resolver.plan;
        let work = run::progress::Work::of(plan, &survey);
        let stale = survey.states.iter().flatten().any(|state| !matches!(state, crate::resolve::State::Hit(_)));
        if stale && log.is_none() {
            *log = Some(RunLog::begin(self.outputs, plan));
        }
        let progress = (self.progress)(&work);
        let summary = run::run(resolver, survey, self.options, progress.as_ref(), self.interrupt);
        progress.ended();
        let summary = summary.map_err(Stopped::Failed)?;
        if let Some(log) = log {
            log.part(plan, &summary);
        }
        let failed = summary.ends.iter().find_map(|(id, end)| match end {
            End::Failed(message) => Some(format!("{}: {message}", plan.label(*id))),
            _ => None,
        });
        if summary.interrupted || failed.is_some() {
            // What was finished is kept.
            self.store.finish().map_err(|e| Stopped::Failed(e.to_string()))?;
        }
        match failed {
            _ if summary.interrupted => Err(Stopped::Interrupted),
            Some(message) => Err(Stopped::Failed(message)),
            None => Ok(summary),
        }
    }

    /// Computes samples again whose bytes are needed and not there any more. Their digests must agree.
    fn again(&self, indices: &[u64], state: &mut State) -> Result<(), Stopped> {
        let read: Vec<(StageId, &'static str)> = self.dataset.features.iter().map(|f| (f.stage, f.port)).collect();
        for indices in indices.chunks(WINDOW) {
            let plan = self.of(indices)?;
            let resolver = self.resolver(&plan, &read);
            let survey = resolver.survey(&[]);
            let report = Report::from(survey.problems.clone());
            if report.has_errors() {
                return Err(Stopped::Report(report));
            }
            let summary = self.run(&resolver, survey, &mut state.log)?;
            state.ran += summary.ran();
            self.may_go(&plan, &summary, state);
        }
        Ok(())
    }

    /// Gives back what samples left in the store whose shards are there.
    fn give_back(&self, folder: &Folder, state: &mut State) -> Result<(), Stopped> {
        if !self.dataset.spec.shards_only {
            return Ok(());
        }
        folder.sync().map_err(Stopped::Failed)?;
        state.releases.release(self.store).map_err(|e| Stopped::Failed(e.to_string()))
    }

    fn of(&self, indices: &[u64]) -> Result<Plan, Stopped> {
        self.dataset.of_samples(self.plan, self.registry, indices).map_err(Stopped::Report)
    }

    /// Why a sample cannot be computed, if it cannot.
    fn unfit(&self, index: u64) -> Result<Option<String>, Stopped> {
        let plan = self.of(&[index])?;
        let problems = Report::from(self.resolver(&plan, &[]).survey(&[]).problems);
        let first = problems.diagnostics().into_iter().find(|d| d.severity == crate::spec::Severity::Error).cloned();
        Ok(first.map(|problem| format!("{}: {}", problem.path, problem.message)))
    }

    /// Place among the drawn names of the group that splits go by.
    fn group(&self, draw: &Draw) -> Option<usize> {
        let by = self.dataset.spec.by.as_ref()?;
        draw.names().position(|name| name == by)
    }

    /// The limit that a sample does not meet.
    fn rejected(&self, records: &BTreeMap<StageId, InstanceRecord>) -> Result<Option<String>, Stopped> {
        for limit in &self.dataset.keep {
            let record = &records[&limit.stage];
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
        (place, number): (usize, usize),
        found: Vec<Found>,
        state: &mut State,
    ) -> Result<(), Stopped> {
        let split = &self.dataset.splits[place];
        let of = split.indices.len().div_ceil(self.dataset.spec.rows);
        let file = file_of(&split.name, number, of, self.format);
        let key = self.key(&found)?;
        let there = state.before.get(&(split.name.clone(), number)).cloned();
        let columns_before = || Some(state.columns_before.clone()).filter(|columns| !columns.is_empty());
        let kept =
            there.as_ref().filter(|there| there.key == key && folder.take_over(there, &file)).and_then(|there| {
                // What it holds is known without a look into it.
                let columns = state.columns.clone().or_else(columns_before)?;
                let moments = moments::read(&there.moments, columns.len())?;
                Some((ShardOf { file: file.clone(), ..there.clone() }, columns, moments))
            });
        let is_kept = kept.is_some();
        let (shard, columns, moments) = match kept {
            Some(kept) => kept,
            None => {
                let (_, draw) = self.plan.draw_of(self.dataset.draws).expect("the stage draws");
                let types: Vec<Type> = draw.types().collect();
                let samples = self.load(&found, state)?;
                let columns = state.columns.clone().expect("a sample or an earlier one has been loaded");
                let encode = match self.format {
                    Format::Parquet => shard::encode,
                    Format::WebDataset => webdataset::encode,
                };
                let (bytes, checks) = encode(&columns, &types, &samples).map_err(Stopped::Input)?;
                let written = folder.write(&file, &bytes).map_err(Stopped::Failed)?;
                let FileOf { bytes, sha256 } = written;
                let (moments, rows) = (moments::moments(&columns, &samples), samples.len() as u64);
                let (split, text) = (split.name.clone(), moments::text(&moments));
                let shard = ShardOf { file, split, number, rows, bytes, sha256, checks, key, moments: text };
                (shard, columns, moments)
            }
        };
        state.columns = Some(columns);
        state.before.remove(&(split.name.clone(), number));
        let rejects = state.points.rejected(place);
        (self.told)(&Told { shard: &shard, shards: of, rejects, kept: is_kept });
        let joined = state.moments.remove(&split.name).map_or_else(|| moments.clone(), |before| join(before, &moments));
        state.moments.insert(split.name.clone(), joined);
        let moved = there.is_none_or(|there| there != shard);
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
        let resolver = self.resolver(&sample, &[]);
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
}

/// The instance of each stage at each raw index.
fn by_index(plan: &Plan) -> HashMap<(StageId, u64), InstanceId> {
    let index = |id: InstanceId| plan.axis(id, DRAW_AXIS).and_then(Value::as_u64);
    plan.needed_instances().filter_map(|id| Some(((plan.stage_of(id), index(id)?), id))).collect()
}

/// What `--json` prints at the end.
pub fn finished(built: &Built, seconds: f64) -> Value {
    json!({
        "event": "finished", "samples": built.samples, "rejects": built.rejects, "hits": built.hits, "ran": built.ran,
        "cpu_s": built.cpu_s, "bytes": built.bytes, "seconds": seconds,
    })
}
