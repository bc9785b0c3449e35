//! What is to be handed over: instances of stages and points of studies; what of it is stale, and which shard runs it.

use std::collections::HashSet;
use std::mem::ManuallyDrop;
use std::path::{Path, PathBuf};

use crate::cli::{Failure, Pipeline, report_of};
use crate::dataset::DatasetPlan;
use crate::estimate::{Basis, estimates};
use crate::ids::InstanceId;
use crate::plan::Plan;
use crate::plan::shard::{Home, Split};
use crate::registry::Registry;
use crate::resolve::{Resolver, State};
use crate::spec::TextRead;
use crate::store::Store;
use crate::study::ahead::{self, PointAhead};
use crate::submit::Work;
use crate::submit::batches;
use crate::submit::follow::{Missing, Stale};

/// What was asked for.
pub struct Parts<'a> {
    pipeline: &'a Pipeline,
    registry: &'a Registry,
    /// Of the stages that are asked for; where none is, of the whole file with one point of each draw.
    plan: ManuallyDrop<Plan>,
    /// What tasks give to `turbid run`; `None` where only studies are asked for.
    targets: Option<Vec<String>>,
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
    stale: Vec<InstanceId>,
    points: Vec<Vec<PointAhead>>,
}

impl Ahead {
    pub fn stale(&self) -> usize {
        self.in_shards + self.left
    }
}

impl<'a> Parts<'a> {
    pub fn of(pipeline: &'a Pipeline, asked: &[String], registry: &'a Registry) -> Result<Self, Failure> {
        if asked.is_empty() {
            let plan = pipeline.plan(registry, &[])?;
            return Ok(Self { pipeline, registry, plan, targets: Some(Vec::new()), studies: Vec::new() });
        }
        let whole = pipeline.plan_of_first_points(registry)?;
        let (mut targets, mut studies) = (Vec::new(), Vec::new());
        for target in asked {
            let spec = &whole.spec;
            if spec.studies.iter().any(|study| study.name == *target) {
                needs_tables("study")?;
                studies.push(target.clone());
            } else if spec.datasets.iter().any(|set| set.name == *target) && spec.stage(target).is_none() {
                needs_tables("dataset")?;
                let dataset = DatasetPlan::build(&whole, Some(target))?;
                targets.extend(dataset.targets.iter().map(ToString::to_string));
            } else {
                targets.push(target.clone());
            }
        }
        let plan = if targets.is_empty() { ManuallyDrop::new(whole) } else { pipeline.plan(registry, &targets)? };
        let targets = (!targets.is_empty()).then_some(targets);
        Ok(Self { pipeline, registry, plan, targets, studies })
    }

    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// The first look: what is stale, and how long it takes; what nobody knows counts as `least_s` CPU seconds.
    pub fn ahead(&self, least_s: f64) -> Result<Ahead, Failure> {
        let store = self.pipeline.store_to_read()?;
        let mut ahead = Ahead {
            hits: 0,
            in_shards: 0,
            left: 0,
            cpu_s: 0.0,
            files: Vec::new(),
            stale: Vec::new(),
            points: self.points(&store)?,
        };
        for point in ahead.points.iter().flatten() {
            ahead.hits += point.hits;
            ahead.in_shards += point.stale;
            ahead.cpu_s += point.cpu_s;
        }
        if self.targets.is_none() {
            return Ok(ahead);
        }
        let resolver = Resolver::new(&self.plan, &store);
        let survey = resolver.survey(&[]);
        let report = report_of(&self.plan, &survey);
        if report.has_errors() {
            return Err(report.into());
        }
        let estimates = estimates(&resolver, &survey);
        // What gathers over two shards gathers over more.
        for (id, home) in Split::of(&self.plan, 2).homes() {
            match (&survey.states[id], home) {
                (Some(State::Hit(_)), _) => ahead.hits += 1,
                (_, Home::Left) => ahead.left += 1,
                _ => {
                    ahead.in_shards += 1;
                    ahead.stale.push(id);
                    ahead.cpu_s += match estimates.get(&id) {
                        // It takes longer than anybody knows: worth a task of its own.
                        Some(estimate) if estimate.by == Basis::AtLeast => least_s,
                        Some(estimate) => estimate.seconds,
                        None => 0.0,
                    };
                }
            }
        }
        ahead.files = resolver.files_read().into_iter().map(|(path, _)| path).collect();
        Ok(ahead)
    }

    /// Into how many shards to split for at most so many tasks.
    pub fn shards(&self, tasks: u32, ahead: &Ahead) -> u32 {
        batches::shards(tasks, |of| self.stale_shards(of, ahead).len())
    }

    /// Which of so many shards have something to do.
    pub fn stale_shards(&self, of: u32, ahead: &Ahead) -> Vec<u32> {
        let mut shards = vec![false; of as usize];
        if self.targets.is_some() {
            let stale: HashSet<InstanceId> = ahead.stale.iter().copied().collect();
            let homes = Split::of(&self.plan, of);
            for (id, home) in homes.homes() {
                if let Home::Shard(shard) = home {
                    shards[shard as usize] |= stale.contains(&id);
                }
            }
        }
        for (place, point) in ahead.points.iter().flat_map(|points| points.iter().enumerate()) {
            shards[place % of as usize] |= point.stale > 0;
        }
        (1..=of).filter(|shard| shards[*shard as usize - 1]).collect()
    }

    /// A fresh look at what is stale of a job that was cut into so many shards.
    pub fn stale(&self, of: u32) -> Result<Stale, Failure> {
        let store = self.pipeline.store_to_read()?;
        let mut stale = Stale::default();
        for points in self.points(&store)? {
            for (place, point) in points.into_iter().enumerate() {
                stale.hits += point.hits;
                if point.stale > 0 {
                    let shard = (place % of as usize) as u32 + 1;
                    stale.shards.entry(shard).or_default().add(point.label, point.stale);
                }
            }
        }
        if self.targets.is_none() {
            return Ok(stale);
        }
        let survey = Resolver::new(&self.plan, &store).with_history_of(0).survey(&[]);
        let report = report_of(&self.plan, &survey);
        if report.has_errors() {
            return Err(report.into());
        }
        for (id, home) in Split::of(&self.plan, of).homes() {
            match (&survey.states[id], home) {
                (Some(State::Hit(_)), _) => stale.hits += 1,
                (_, Home::Shard(shard)) => {
                    let missing: &mut Missing = stale.shards.entry(shard + 1).or_default();
                    missing.add(self.plan.label(id), 1);
                }
                // What many shards need is made by each that still has something to do; else here.
                (_, Home::Shared | Home::Left) => stale.left += 1,
            }
        }
        Ok(stale)
    }

    fn points(&self, store: &Store) -> Result<Vec<Vec<PointAhead>>, Failure> {
        let of = |name: &String| {
            let study = self.plan.spec.studies.iter().find(|study| study.name == *name);
            let study = study.expect("it was found when the targets were read");
            let (file, set) = (&self.pipeline.file, &self.pipeline.set);
            ahead::points(file, set, study, self.registry, store).map_err(Failure::Input)
        };
        self.studies.iter().map(of).collect()
    }

    /// What a task runs.
    pub fn commands(&self, outputs: &Path, threads: usize) -> Result<Vec<Vec<String>>, Failure> {
        let (file, outputs) = (text(&self.pipeline.file)?, text(outputs)?);
        let command = |name: &str, flags: &[&str], targets: &[String]| {
            let mut words = vec![name.to_owned()];
            words.extend([Work::SHARD.to_owned(), format!("--outputs={outputs}"), format!("--jobs={threads}")]);
            words.extend(flags.iter().map(|flag| (*flag).to_owned()));
            words.extend(self.pipeline.set.iter().map(|set| format!("--set={set}")));
            words.extend(["--".to_owned(), file.clone()]);
            words.extend(targets.iter().cloned());
            words
        };
        let run = self.targets.iter().map(|targets| command("run", &["--keep-going"], targets));
        let studies = self.studies.iter().map(|study| command("study", &[], std::slice::from_ref(study)));
        Ok(run.chain(studies).collect())
    }

    /// The texts that were read: pipeline file, what it includes, tables.
    pub fn texts(&self) -> impl Iterator<Item = TextRead> {
        self.plan.spec.texts()
    }
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
