//! What is to be handed over: instances of stages, samples of data sets, points of studies; what of it is stale, and which shard runs it.

use std::collections::HashSet;
use std::mem::ManuallyDrop;
use std::path::{Path, PathBuf};

use crate::cli::{Failure, Pipeline, report_of};
use crate::dataset::DatasetPlan;
use crate::estimate::{Basis, estimates};
use crate::ids::InstanceId;
use crate::plan::Plan;
use crate::plan::shard::Home;
use crate::registry::Registry;
use crate::resolve::{Resolver, State};
use crate::store::Store;
use crate::study::ahead::{self, PointAhead};
use crate::submit::follow::{Missing, Stale};
use crate::submit::{Work, batches};

use super::dealt::{Dealt, by_place};

/// What was asked for.
pub struct Parts<'a> {
    pipeline: &'a Pipeline,
    registry: &'a Registry,
    /// Of the whole file, with one point of each draw where studies or data sets are asked for.
    whole: Option<ManuallyDrop<Plan>>,
    dealt: Vec<Dealt>,
    studies: Vec<String>,
}

/// What there is to do.
pub struct Ahead {
    pub hits: usize,
    /// Stale instances that shards run, and those that they do not.
    pub in_shards: usize,
    pub left: usize,
    /// CPU seconds of what shards run.
    pub cpu_s: f64,
    /// Files that were read.
    pub files: Vec<PathBuf>,
    /// Of each plan.
    stale: Vec<HashSet<InstanceId>>,
    /// Of each study.
    points: Vec<Vec<PointAhead>>,
}

impl Ahead {
    pub fn stale(&self) -> usize {
        self.in_shards + self.left
    }
}

impl<'a> Parts<'a> {
    pub fn of(pipeline: &'a Pipeline, asked: &[String], registry: &'a Registry) -> Result<Self, Failure> {
        let mut parts = Self { pipeline, registry, whole: None, dealt: Vec::new(), studies: Vec::new() };
        let mut stages = Vec::new();
        if !asked.is_empty() {
            let whole = pipeline.plan_of_first_points(registry)?;
            for target in asked {
                let spec = &whole.spec;
                if spec.studies.iter().any(|study| study.name == *target) {
                    needs_tables("study")?;
                    parts.studies.push(target.clone());
                } else if spec.datasets.iter().any(|set| set.name == *target) && spec.stage(target).is_none() {
                    needs_tables("dataset")?;
                    let dataset = DatasetPlan::build(&whole, Some(target))?;
                    let mut indices: Vec<u64> =
                        dataset.splits.iter().flat_map(|split| split.indices.iter().copied()).collect();
                    indices.sort_unstable();
                    let samples = dataset.of_samples(&whole, registry, &indices)?;
                    parts.dealt.push(Dealt::by_samples(samples, &dataset));
                } else {
                    stages.push(target.clone());
                }
            }
            parts.whole = Some(ManuallyDrop::new(whole));
        }
        if asked.is_empty() || !stages.is_empty() {
            parts.dealt.push(Dealt::by_chains(pipeline.plan(registry, &stages)?));
        }
        Ok(parts)
    }

    /// A plan of the file.
    pub fn plan(&self) -> &Plan {
        match &self.whole {
            Some(whole) => whole,
            None => &self.dealt[0].plan,
        }
    }

    /// The first look: what is stale, and how long it takes; what nobody knows counts as `least_s` CPU seconds.
    pub fn ahead(&self, least_s: f64) -> Result<Ahead, Failure> {
        let store = self.pipeline.store_to_read()?;
        let points = self.points(&store)?;
        let (files, stale) = (Vec::new(), Vec::new());
        let mut ahead = Ahead { hits: 0, in_shards: 0, left: 0, cpu_s: 0.0, files, stale, points };
        for point in ahead.points.iter().flatten() {
            ahead.hits += point.hits;
            ahead.in_shards += point.stale;
            ahead.cpu_s += point.cpu_s;
        }
        for dealt in &self.dealt {
            let resolver = Resolver::new(&dealt.plan, &store);
            let survey = resolver.survey(&[]);
            let report = report_of(&dealt.plan, &survey);
            if report.has_errors() {
                return Err(report.into());
            }
            let estimates = estimates(&resolver, &survey);
            let mut stale = HashSet::new();
            // What gathers over two shards gathers over more.
            for (id, home) in dealt.homes(2) {
                match (&survey.states[id], home) {
                    (Some(State::Hit(_)), _) => ahead.hits += 1,
                    (_, Home::Left) => ahead.left += 1,
                    _ => {
                        ahead.in_shards += 1;
                        stale.insert(id);
                        ahead.cpu_s += match estimates.get(&id) {
                            // It takes longer than anybody knows: worth a task of its own.
                            Some(estimate) if estimate.by == Basis::AtLeast => least_s,
                            Some(estimate) => estimate.seconds,
                            None => 0.0,
                        };
                    }
                }
            }
            ahead.stale.push(stale);
            ahead.files.extend(resolver.files_read().into_iter().map(|(path, _)| path));
        }
        Ok(ahead)
    }

    /// Into how many shards to split for at most so many tasks.
    pub fn shards(&self, tasks: u32, ahead: &Ahead) -> u32 {
        batches::shards(tasks, |of| self.stale_shards(of, ahead).len())
    }

    /// Which of so many shards have something to do.
    pub fn stale_shards(&self, of: u32, ahead: &Ahead) -> Vec<u32> {
        let mut shards = vec![false; of as usize];
        for (dealt, stale) in self.dealt.iter().zip(&ahead.stale) {
            dealt.mark(stale, &mut shards);
        }
        for points in &ahead.points {
            for (point, shard) in points.iter().zip(by_place(points.len(), of)) {
                shards[shard as usize] |= point.stale > 0;
            }
        }
        (1..=of).filter(|shard| shards[*shard as usize - 1]).collect()
    }

    /// A fresh look at what is stale of a job that was cut into so many shards.
    pub fn stale(&self, of: u32) -> Result<Stale, Failure> {
        let store = self.pipeline.store_to_read()?;
        let mut stale = Stale::default();
        for points in self.points(&store)? {
            let shards = by_place(points.len(), of);
            for (point, shard) in points.into_iter().zip(shards) {
                stale.hits += point.hits;
                if point.stale > 0 {
                    stale.shards.entry(shard + 1).or_default().add(point.label, point.stale);
                }
            }
        }
        for dealt in &self.dealt {
            // Why something is stale nobody asks here.
            let survey = Resolver::new(&dealt.plan, &store).without_history().survey(&[]);
            let report = report_of(&dealt.plan, &survey);
            if report.has_errors() {
                return Err(report.into());
            }
            for (id, home) in dealt.homes(of) {
                match (&survey.states[id], home) {
                    (Some(State::Hit(_)), _) => stale.hits += 1,
                    (_, Home::Shard(shard)) => {
                        let missing: &mut Missing = stale.shards.entry(shard + 1).or_default();
                        missing.add(dealt.plan.label(id), 1);
                    }
                    // What many shards need is made by each that still has something to do; else here.
                    (_, Home::Shared | Home::Left) => stale.left += 1,
                }
            }
        }
        Ok(stale)
    }

    fn points(&self, store: &Store) -> Result<Vec<Vec<PointAhead>>, Failure> {
        let of = |name: &String| {
            let study = self.plan().spec.studies.iter().find(|study| study.name == *name);
            let study = study.expect("it was found when the targets were read");
            let (file, set) = (&self.pipeline.file, &self.pipeline.set);
            ahead::points(file, set, study, self.registry, store).map_err(Failure::Input)
        };
        self.studies.iter().map(of).collect()
    }
}

/// What a task runs: these targets, of a shard.
pub fn command(
    pipeline: &Pipeline,
    targets: &[String],
    outputs: &Path,
    threads: usize,
) -> Result<Vec<String>, Failure> {
    let mut words = vec!["run".to_owned(), Work::SHARD.to_owned(), format!("--outputs={}", text(outputs)?)];
    // A point that fails takes nothing from the others of its shard.
    words.extend([format!("--jobs={threads}"), "--keep-going".to_owned()]);
    words.extend(pipeline.set.iter().map(|set| format!("--set={set}")));
    words.extend(["--".to_owned(), text(&pipeline.file)?]);
    words.extend(targets.iter().cloned());
    Ok(words)
}

/// A path as an argument of a task.
pub fn text(path: &Path) -> Result<String, Failure> {
    let text = path.to_str().map(str::to_owned);
    text.ok_or_else(|| Failure::Input(format!("{}: tasks cannot be given a path that is no text", path.display())))
}

#[cfg(feature = "tables")]
fn needs_tables(_: &str) -> Result<(), Failure> {
    Ok(())
}

#[cfg(not(feature = "tables"))]
fn needs_tables(command: &str) -> Result<(), Failure> {
    Err(crate::cli::study::without(command))
}
