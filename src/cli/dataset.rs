//! `turbid dataset`: build, plan, verify and look at data sets.

mod stats;

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, Subcommand};
use serde_json::{Value, json};

use crate::dataset::build::{Building, Stopped, Told, finished};
use crate::dataset::{DatasetPlan, Folder as DatasetFolder, Format, Refused, verify};
use crate::estimate::estimates;
use crate::plan::shard::Shard;
use crate::plan::{InstanceId, Plan};
use crate::registry::Registry;
use crate::resolve::Resolver;
use crate::run::progress::{Json, Work, choose};
use crate::run::{Interrupt, Options};
use crate::spec::{DRAW_AXIS, Report};
use crate::store::Store;
use crate::threads;

use super::cache::size_text;
use super::memory::MemoryLimit;
use super::part::told_of_shard;
use super::simd::simd_level;
use super::{Done, Failure, Pipeline, print, print_json};

#[derive(Args)]
pub struct Dataset {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Compute the samples that are missing and write the folder of the data set
    Build(Build),
    /// Show what a build would do: points, splits, shards, CPU hours, bytes
    Plan(Look),
    /// Look whether a folder holds what it should: every shard, every row
    Verify(Folder),
    /// Show statistics of every column by split, what samples cost, and how many there are of each kind
    Stats(Folder),
}

#[derive(Args)]
struct Named {
    #[command(flatten)]
    pipeline: Pipeline,
    /// The data set; may be left out where the file has one
    name: Option<String>,
}

#[derive(Args)]
struct Build {
    #[command(flatten)]
    named: Named,
    /// The folder of the data set
    #[arg(long, value_name = "DIR")]
    to: PathBuf,
    /// What the shards are: Parquet, or tar files of WebDataset
    #[arg(long, value_name = "FORMAT", default_value = "parquet", value_parser = format())]
    format: Format,
    /// Threads to use; all of the machine by default
    #[arg(short = 'j', long = "jobs", value_name = "N", value_parser = threads::parse)]
    jobs: Option<usize>,
    #[command(flatten)]
    memory: MemoryLimit,
    /// Print events as JSON lines
    #[arg(long)]
    json: bool,
    /// Only its samples, and no folder: `turbid run FILE NAME --shard K/N`.
    #[arg(skip)]
    shard: Option<Shard>,
}

#[derive(Args)]
struct Look {
    #[command(flatten)]
    named: Named,
    /// The folder that the data set would go to
    #[arg(long, value_name = "DIR")]
    to: Option<PathBuf>,
    /// What the shards would be: Parquet, or tar files of WebDataset
    #[arg(long, value_name = "FORMAT", default_value = "parquet", value_parser = format())]
    format: Format,
    #[arg(long)]
    json: bool,
}

#[derive(Args)]
struct Folder {
    #[command(flatten)]
    named: Named,
    /// The folder of the data set
    #[arg(long, value_name = "DIR")]
    to: PathBuf,
    /// What its shards must be; whatever they are by default
    #[arg(long, value_name = "FORMAT", value_parser = format())]
    format: Option<Format>,
    #[arg(long)]
    json: bool,
}

fn format() -> impl TypedValueParser<Value = Format> {
    let known = |name: String| Format::NAMES.iter().find(|(known, _)| *known == name).map(|(_, format)| *format);
    PossibleValuesParser::new(Format::NAMES.map(|(name, _)| name))
        .map(move |name| known(name).expect("clap takes these names alone"))
}

impl Dataset {
    /// `turbid dataset build FILE NAME --to DIR`; of a shard, its samples alone.
    pub fn build(
        pipeline: Pipeline,
        name: String,
        to: PathBuf,
        (jobs, memory, json): (Option<usize>, MemoryLimit, bool),
        shard: Option<Shard>,
    ) -> Self {
        let named = Named { pipeline, name: Some(name) };
        Self { command: Command::Build(Build { named, to, format: Format::Parquet, jobs, memory, json, shard }) }
    }

    pub fn run(&self, registry: &Registry) -> Done {
        match &self.command {
            Command::Build(build) => build.run(registry),
            Command::Plan(look) => look.run(registry),
            Command::Verify(folder) => folder.verify(registry),
            Command::Stats(folder) => folder.stats(registry),
        }
    }
}

impl Named {
    /// The plan of the whole file with one point of each draw, and the data set in it.
    fn plan(&self, registry: &Registry) -> Result<(Plan, DatasetPlan), Failure> {
        let plan = self.pipeline.plan_of_first_points(registry)?;
        let dataset = DatasetPlan::build(&plan, self.name.as_deref())?;
        Ok((plan, dataset))
    }
}

impl Build {
    fn run(&self, registry: &Registry) -> Done {
        let began = Instant::now();
        let (plan, dataset) = self.named.plan(registry)?;
        let outputs = self.named.pipeline.outputs.path();
        let open = if self.shard.is_some() { Store::open_for_shard } else { Store::open };
        let store = open(outputs).map_err(|e| Failure::Input(e.to_string()))?;
        let jobs = self.jobs.unwrap_or_else(threads::of_machine);
        let memory = self.memory.budget(jobs).map(|budget| budget.bytes);
        let options = Options {
            jobs,
            keep_going: false,
            force: Vec::new(),
            replace: false,
            simd: simd_level()?,
            keep_states: false,
            memory,
            live: None,
        };
        let interrupt = Interrupt::listen().map_err(|e| Failure::Failed(format!("signals: {e}")))?;
        let progress = |work: &Work| choose(self.json, work);
        let told = |told: &Told<'_>| self.told(told);
        let building = Building {
            plan: &plan,
            dataset: &dataset,
            registry,
            store: &store,
            outputs,
            format: self.format,
            options: &options,
            interrupt: &interrupt,
            progress: &progress,
            told: &told,
        };
        let stopped = |stopped| match stopped {
            Stopped::Report(report) => Failure::Report(report),
            Stopped::Input(message) => Failure::Input(message),
            Stopped::Failed(message) => Failure::Failed(message),
            Stopped::Interrupted => Failure::Interrupted,
        };
        if let Some(shard) = self.shard {
            let made = building.make(shard).map_err(stopped)?;
            let counts = (made.samples, made.hits, made.ran);
            told_of_shard((shard, self.json), ("samples", &dataset.spec.name), counts, began.elapsed().as_secs_f64());
            return Ok(());
        }
        let built = building.build(&self.to).map_err(stopped)?;
        if self.json {
            Json::event(finished(&built, began.elapsed().as_secs_f64()));
            return Ok(());
        }
        print(&format!(
            "{}: {} samples in {}, {}; {:.1} CPU s of samples, {} up to date, {} ran, {:.1} s",
            dataset.spec.name,
            built.samples,
            self.to.display(),
            size_text(built.bytes),
            built.cpu_s,
            built.hits,
            built.ran,
            began.elapsed().as_secs_f64(),
        ));
        for (reason, n) in &built.rejects {
            print(&format!("left out: {n} by {reason}"));
        }
        Ok(())
    }

    fn told(&self, told: &Told<'_>) {
        let Told { shard, shards, rejects, kept } = told;
        if self.json {
            Json::event(json!({
                "event": "shard", "file": shard.file, "rows": shard.rows, "bytes": shard.bytes, "sha256": shard.sha256, "kept": kept,
            }));
            return;
        }
        let how = if *kept { "as it was" } else { "written" };
        let left_out = if *rejects > 0 {
            format!("; {rejects} samples left out of {} so far", shard.split)
        } else {
            String::new()
        };
        print(&format!(
            "{} {}/{shards}: {} samples, {}, {how}{left_out}",
            shard.split,
            shard.number + 1,
            shard.rows,
            size_text(shard.bytes)
        ));
    }
}

/// Fewer shards of the training split than this keep many readers from working side by side.
const FEW_SHARDS: usize = 16;

impl Look {
    fn run(&self, registry: &Registry) -> Done {
        let (plan, dataset) = self.named.plan(registry)?;
        if let Some(to) = &self.to {
            let fits = DatasetFolder::fits(to, &plan.spec.pipeline, &dataset.spec.name, self.format);
            fits.map_err(|refused| match refused {
                Refused::Input(message) => Failure::Input(message),
                Refused::Failed(message) => Failure::Failed(message),
            })?;
        }
        let store = self.named.pipeline.store_to_read()?;
        let (_, draw) = plan.draw_of(dataset.draws).expect("the stage draws");
        // One sample stands for all: forms and costs are alike.
        let first: Vec<u64> =
            dataset.splits.iter().flat_map(|split| split.indices.iter().copied()).min().into_iter().collect();
        let sample = dataset.of_samples(&plan, registry, &first)?;
        let resolver = Resolver::new(&sample, &store);
        let survey = resolver.survey(&[]);
        let report = Report::from(survey.problems.clone());
        if report.has_errors() {
            return Err(report.into());
        }
        let form = |feature: &crate::dataset::Feature| {
            let id = sample.instances_of(feature.stage).into_iter().next()?;
            resolver.made(id)?.get(feature.port).map(|form| (**form).clone())
        };
        let shapes = dataset.shapes(form, &plan)?;
        let points: usize = dataset.splits.iter().map(|split| split.indices.len()).sum();
        // What is not drawn is computed once.
        let times = |id: &InstanceId| if sample.axis(*id, DRAW_AXIS).is_some() { points as f64 } else { 1.0 };
        let seconds: f64 = estimates(&resolver, &survey).iter().map(|(id, of)| of.seconds * times(&id)).sum();
        let features = dataset.features.iter().zip(&shapes);
        let sizes = features.filter_map(|(feature, shape)| Some(shape.as_ref()?.values() * feature.spec.dtype.bytes()));
        let bytes = sizes.sum::<usize>() as u64 * points as u64;
        let shards = |indices: &[u64]| indices.len().div_ceil(dataset.spec.rows);
        if self.json {
            let splits: Vec<Value> = dataset
                .splits
                .iter()
                .map(|split| json!({"split": split.name, "points": split.indices.len(), "shards": shards(&split.indices)}))
                .collect();
            print_json(
                &json!({
                    "dataset": dataset.spec.name, "n": draw.n(), "points": points, "acceptance": draw.acceptance(),
                    "skipped": draw.skipped, "splits": splits, "cpu_hours": seconds / 3600.0, "bytes": bytes,
                })
                .to_string(),
            );
            return Ok(());
        }
        let mut text =
            format!("{}: {points} of {} points ({:.1} %)\n", dataset.spec.name, draw.n(), 100.0 * draw.acceptance());
        for (reason, n) in &draw.skipped {
            text += &format!("  {n} left out by {reason}\n");
        }
        for split in &dataset.splits {
            text += &format!("{}: {} samples, {} shards\n", split.name, split.indices.len(), shards(&split.indices));
        }
        for (feature, shape) in dataset.features.iter().zip(&shapes) {
            let what = match shape.as_ref().map(|shape| (&shape.tensor, &shape.unit)) {
                Some((Some([c, h, w]), unit)) => format!("{c} x {h} x {w}, {unit}"),
                Some((None, unit)) => format!("a number, {unit}"),
                None => "known after the first run".to_owned(),
            };
            text += &format!("  {}: {} ({what})\n", feature.spec.name, feature.spec.from.join("."));
        }
        text += &format!("about {:.2} CPU h, {} before compression", seconds / 3600.0, size_text(bytes));
        print(&text);
        for split in &dataset.splits {
            if split.indices.is_empty() {
                crate::terminal::tell(&format!("warning: the split `{}` is empty", split.name));
            }
        }
        if dataset.splits.first().is_some_and(|train| shards(&train.indices) < FEW_SHARDS) {
            let message = format!(
                "warning: {} has fewer than {FEW_SHARDS} shards: few readers can work side by side; `shards: {{rows: ..}}` makes more",
                dataset.splits[0].name
            );
            crate::terminal::tell(&message);
        }
        Ok(())
    }
}

impl Folder {
    /// The folder holds the data set that is named.
    fn known(&self, registry: &Registry) -> Done {
        let (plan, dataset) = self.named.plan(registry)?;
        verify::is_of(&self.to, &plan.spec.pipeline, &dataset.spec.name, self.format).map_err(Failure::Input)
    }

    fn verify(&self, registry: &Registry) -> Done {
        self.known(registry)?;
        let verified = verify::verify(&self.to).map_err(Failure::Input)?;
        if self.json {
            let text =
                json!({"shards": verified.shards, "rows": verified.rows, "findings": verified.findings}).to_string();
            print_json(&text);
        } else {
            verified.findings.iter().for_each(|finding| print(finding));
            print(&format!("{} shards, {} samples as they should be", verified.shards, verified.rows));
        }
        match verified.findings.len() {
            0 => Ok(()),
            _ if self.json => Err(Failure::Said),
            n => {
                Err(Failure::Failed(format!("{n} findings in {}; `turbid dataset build` mends them", shown(&self.to))))
            }
        }
    }

    fn stats(&self, registry: &Registry) -> Done {
        self.known(registry)?;
        stats::run(&self.to, self.json)
    }
}

fn shown(path: &Path) -> String {
    path.display().to_string()
}
