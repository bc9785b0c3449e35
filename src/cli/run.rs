//! `turbid run`: run what is stale, then say what was done and where it lies.

mod whole;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Instant, SystemTime};

use clap::Args;
use serde_json::{Value, json};

use crate::digest::Digest;
use crate::memo::{self, Recalled};
use crate::plan::{InstanceId, PREVIEW_INSTANCES, Plan, StageId};
use crate::registry::Registry;
use crate::report::figures::Figures;
use crate::report::measures::errors;
use crate::resolve::{Resolver, State, Survey};
use crate::run::log::{Logged, RunLog, note_up_to_date};
use crate::run::progress::{Json, Work, choose};
use crate::run::{self, End, Interrupt, Options, Progress, Summary, latest};
use crate::store::{Store, StoreError};
use crate::threads;
use crate::unchanged::{self, Closing, Request, Seen};

use super::elsewhere::{self, Elsewhere, pushed_text, traffic_text};
use super::memory::{MemoryLimit, too_large};
use super::part::PartOf;
use super::simd::simd_level;
use super::{Done, Failure, Pipeline, print, print_json, report_of};

#[derive(Args, Clone)]
pub struct Run {
    #[command(flatten)]
    pipeline: Pipeline,
    /// Stages (or STAGE.PORT) to bring up to date, or studies and data sets; all leaves by default
    #[arg(value_name = "STAGE")]
    targets: Vec<String>,
    /// Run a stage from its start even where its result is stored, and compare the two: where they differ the run fails
    #[arg(long, value_name = "STAGE")]
    force: Vec<String>,
    #[command(flatten)]
    part: PartOf,
    /// Store the result of a forced stage even where it differs from the stored one
    #[arg(long, requires = "force")]
    replace: bool,
    /// Go on with what does not depend on a failed stage
    #[arg(long)]
    keep_going: bool,
    /// Threads to use; all of the machine by default
    #[arg(short = 'j', long = "jobs", value_name = "N", value_parser = threads::parse)]
    jobs: Option<usize>,
    #[command(flatten)]
    memory: MemoryLimit,
    #[command(flatten)]
    elsewhere: Elsewhere,
    /// Print events as JSON lines
    #[arg(long)]
    json: bool,
}

impl Run {
    pub fn run(&self, registry: &Registry) -> Done {
        let (began, clock) = (Instant::now(), SystemTime::now());
        let outputs = self.pipeline.outputs.path();
        let request = Request {
            registry,
            pipeline: &self.pipeline.file,
            outputs,
            overrides: &self.pipeline.set,
            targets: &self.targets,
        };
        let whole = self.part.is_whole();
        if self.force.is_empty()
            && whole
            // What is here may not have been sent yet.
            && !self.elsewhere.is_given()
            && simd_level().is_ok()
            && let Some(closing) = unchanged::recall(&request)
            && note_up_to_date(outputs, &closing.pipeline, closing.hits).is_none()
        {
            self.say(&closing, &Counts { hits: closing.hits, ..Counts::default() }, began, 0);
            return Ok(());
        }
        if let Some((sets, stages)) = self.whole_targets() {
            return self.run_all(sets, stages, registry);
        }
        let (plan, left) = self.pipeline.plan_part(registry, &self.targets, &self.part)?;
        let force = self.forced(&plan)?;
        let simd = simd_level()?;
        let store = if self.part.shard.is_some() {
            self.elsewhere.store_for_shard(&self.pipeline.outputs)?
        } else {
            self.elsewhere.store(&self.pipeline.outputs)?
        };
        let resolver = Resolver::new(&plan, &store);
        let memos = outputs.join("store").join("memos");
        let remembered = if force.is_empty() && whole { memo::recall(&plan, &store, &memos) } else { None };
        let recalled = remembered.is_some();
        let (survey, known_files) = match remembered {
            Some(Recalled { briefs, files }) => (resolver.up_to_date(briefs), files),
            None => {
                elsewhere::bring(&resolver)?;
                (resolver.survey(&force), Vec::new())
            }
        };
        let mut report = report_of(&plan, &survey);
        let jobs = self.jobs.unwrap_or_else(threads::of_machine);
        let stale = survey.states.iter().flatten().any(|state| !matches!(state, State::Hit(_)));
        let budget = if stale { self.memory.budget(jobs) } else { None };
        report.extend(too_large(&plan, &survey, budget));
        if report.has_errors() {
            return Err(report.into());
        }
        let progress = choose(self.json, &Work::of(&plan, &survey));
        for warning in report.diagnostics() {
            progress.warn(&warning.path, &warning.in_short());
        }
        let memory = budget.map(|budget| budget.bytes);
        let options = Options {
            jobs,
            keep_going: self.keep_going,
            force,
            replace: self.replace,
            simd,
            keep_states: true,
            memory,
            live: whole.then(|| outputs.to_owned()),
        };
        let made = Making { resolver: &resolver, outputs, progress: progress.as_ref(), whole }.make(survey, options);
        progress.ended();
        let Made { summary, folder, figures, rounds, unwritten, warned } = made?;
        let quiet = report.diagnostics().is_empty() && !warned && store.unread().is_none();
        if whole
            && (!recalled || rounds > 1)
            && let Some(made) = plan.needed_instances().map(|id| summary.brief(id)).collect::<Option<Vec<_>>>()
        {
            memo::keep(&plan, &made, &resolver.files_read(), &memos);
        }
        // All results are there; that the log, links and pictures in another user's folder cannot be written takes nothing from them.
        let not_renewed = folder.as_ref().err().filter(|_| summary.ran() == 0);
        let not_renewed = not_renewed.map(|message| format!("pictures and links were not renewed: {message}"));
        let unwritten = unwritten.map(|text| format!("the log of this run could not be written: {text}"));
        let warning: Vec<String> = not_renewed.into_iter().chain(unwritten).collect();
        if !warning.is_empty() {
            progress.warn(&plan.spec.pipeline, &warning.join("; "));
        }
        let pushed = self.push(&plan, &store, &summary);
        for warning in elsewhere::warnings(&store) {
            progress.warn(&plan.spec.pipeline, &warning);
        }
        let filled = folder.as_ref().ok().and_then(Option::as_deref);
        let mut closing = closing(&plan, &summary, &figures, filled, outputs);
        closing.texts.extend(pushed.as_ref().ok().cloned().flatten());
        closing.texts.extend(self.part.text(&plan, &self.targets, outputs, left));
        self.say(&closing, &Counts::of(&summary), began, left);
        let local = store.remote().is_none();
        if whole && local && quiet && warning.is_empty() && summary.hits() == summary.ends.len() {
            let made = plan.needed_instances().filter_map(|id| summary.brief(id));
            let blobs = made.flat_map(|brief| brief.outputs.iter().map(|(_, blob)| blob));
            let watched = store.watched(blobs).into_iter();
            if let Some(of_people) = latest::watched(&plan, outputs) {
                let files = if recalled { known_files } else { resolver.files_read() };
                let watched = watched.chain(of_people).collect();
                unchanged::keep(&request, clock, Seen { texts: plan.spec.texts().collect(), files, watched }, closing);
            }
        }
        pushed?;
        if summary.failed() > 0 {
            return Err(Failure::Said);
        }
        if summary.interrupted {
            return Err(Failure::Interrupted);
        }
        match folder {
            Err(message) if summary.ran() > 0 => Err(Failure::Failed(message)),
            _ => Ok(()),
        }
    }

    /// Sends what the store elsewhere lacks of the results, also of a run that was interrupted: the next one may be at work elsewhere.
    ///
    /// What is to be said of it; an error does not end the run before its last words.
    fn push(&self, plan: &Plan, store: &Store, summary: &Summary) -> Result<Option<String>, Failure> {
        let Some(remote) = store.remote() else { return Ok(None) };
        let made = plan.needed_instances().filter_map(|id| summary.brief(id));
        let keys: Vec<Digest> = made.map(|brief| brief.key).collect();
        let pushed = store.push(Some(&keys), false, &|_, _| ()).map_err(|error| {
            let later = "the results are here, and `turbid cache push` sends them later";
            Failure::Failed(format!("{error}; {later}"))
        })?;
        let (address, traffic) = (remote.address().to_string(), remote.traffic());
        if self.json {
            Json::event(json!({"event": "pushed", "store": address, "pushed": pushed, "traffic": traffic}));
        }
        Ok(Some(format!("{address}: {}; {}", pushed_text(&pushed), traffic_text(&traffic))))
    }

    /// The last words of a run.
    fn say(&self, closing: &Closing, counts: &Counts, began: Instant, left: usize) {
        let seconds = began.elapsed().as_secs_f64();
        let Counts { hits, ran, failed, interrupted } = counts;
        if self.json {
            closing.events.iter().for_each(|event| print_json(event));
            let mut event = json!({
                "event": "finished", "pipeline": closing.pipeline, "hits": hits, "ran": ran, "failed": failed, "seconds": seconds, "interrupted": interrupted,
            });
            self.part.event(left).into_iter().for_each(|(name, value)| event[name] = value);
            Json::event(event);
        } else {
            let table = &closing.table;
            print(&format!("{table}{hits} up to date, {ran} ran, {failed} failed in {seconds:.2} s\n"));
            closing.texts.iter().for_each(|text| print(text));
        }
    }

    fn forced(&self, plan: &Plan) -> Result<Vec<StageId>, Failure> {
        self.force
            .iter()
            .map(|name| {
                let stage = plan.spec.stage(name).ok_or_else(|| {
                    Failure::Input(format!("--force: there is no stage `{name}` in pipeline `{}`", plan.spec.pipeline))
                })?;
                if plan.needs(stage) {
                    Ok(stage)
                } else {
                    let asked = self.targets.join(", ");
                    Err(Failure::Input(format!("--force {name}: {asked} does not need it; name it as a target too")))
                }
            })
            .collect()
    }
}

/// How many instances ended in which way.
#[derive(Default)]
struct Counts {
    hits: usize,
    ran: usize,
    failed: usize,
    interrupted: bool,
}

impl Counts {
    fn of(summary: &Summary) -> Self {
        let (hits, ran, failed) = (summary.hits(), summary.ran(), summary.failed());
        Self { hits, ran, failed, interrupted: summary.interrupted }
    }
}

/// What a run says at its end, but for its counts and its time.
fn closing(plan: &Plan, summary: &Summary, figures: &Figures, folder: Option<&Path>, outputs: &Path) -> Closing {
    let lies = match folder {
        Some(folder) => where_it_lies(plan, summary, folder, outputs),
        None => Some(format!("results: {} (`turbid show`, `turbid export`)", outputs.join("store").display())),
    };
    let texts = [Some(figures.text()).filter(|text| !text.is_empty()), cost(plan, summary), lies];
    Closing {
        pipeline: plan.spec.pipeline.clone(),
        hits: summary.hits(),
        table: table(plan, summary),
        texts: texts.into_iter().flatten().collect(),
        events: figures.events(plan).iter().map(Value::to_string).collect(),
    }
}

/// So often what was called up to date and then turned out damaged is made again; after that the disk is to blame.
const MOST_ROUNDS: usize = 4;

/// What a run works on and tells.
struct Making<'a> {
    resolver: &'a Resolver<'a>,
    outputs: &'a Path,
    progress: &'a dyn Progress,
    /// Whether all that the targets need takes part. Of less nothing is for people: the run of all fills their folder.
    whole: bool,
}

/// What a run made and left.
struct Made {
    summary: Summary,
    /// The folder for people, or why it could not be brought up to date; none where a part ran.
    folder: Result<Option<PathBuf>, String>,
    figures: Figures,
    rounds: usize,
    /// Whether something was said that the next run would say again.
    warned: bool,
    /// What could not be written of the log.
    unwritten: Option<String>,
}

impl Making<'_> {
    /// Runs what is stale and publishes it, until all that is called up to date is there and whole.
    fn make(&self, mut survey: Survey, mut options: Options) -> Result<Made, Failure> {
        let Self { resolver, outputs, progress, whole } = *self;
        let (plan, store) = (resolver.plan, resolver.store);
        let failed = |e: StoreError| Failure::Failed(e.to_string());
        let (mut log, mut interrupt) = (None, Interrupt::default());
        let mut summary = Summary::default();
        let mut rival = None;
        for rounds in 1..=MOST_ROUNDS {
            let stale = survey.states.iter().flatten().any(|state| !matches!(state, State::Hit(_)));
            if stale && log.is_none() {
                interrupt = Interrupt::listen().map_err(|e| Failure::Failed(format!("signals: {e}")))?;
                log = Some(RunLog::begin(outputs, plan));
            }
            let logged = log.as_ref().map(|log| Logged { log, progress });
            let told: &dyn Progress = logged.as_ref().map_or(progress, |logged| logged);
            summary.add(run::run(resolver, survey, &options, told, &interrupt).map_err(Failure::Failed)?);
            let mut dropped = store.finish().map_err(failed)?.dropped;
            rival = rival.or_else(|| if whole { latest::rival(plan, outputs) } else { None });
            let published = match whole {
                true => latest::publish(plan, store, &summary, outputs).map(Some),
                false => Ok(None),
            };
            let lost = published.as_ref().is_ok_and(|published| published.as_ref().is_some_and(|made| made.lost));
            let figures = Figures::read(plan, store, &summary);
            if figures.lost || lost {
                dropped.extend(store.finish().map_err(failed)?.dropped);
            }
            let gone = |id: &InstanceId| summary.brief(*id).is_some_and(|brief| dropped.contains(&brief.key));
            let gone: Vec<InstanceId> = plan.needed_instances().filter(gone).collect();
            if gone.is_empty() || summary.interrupted || summary.failed() > 0 {
                if gone.is_empty() && lost {
                    let text = "a stored output could not be read this time; its pictures are drawn by the next run";
                    told.warn(&plan.spec.pipeline, text);
                }
                let unwritten = self.end(log.as_ref(), rival.as_deref(), &summary);
                let warned = figures.lost || lost || rival.is_some();
                let folder = published.map(|published| published.map(|made| made.folder));
                return Ok(Made { summary, folder, figures, rounds, warned, unwritten });
            }
            for &id in &gone {
                told.warn(&plan.label(id), "a stored output is damaged or gone; it is made again");
                summary.ends.remove(&id);
            }
            // What was forced has run.
            options.force.clear();
            survey = resolver.survey(&[]);
            let report = report_of(plan, &survey);
            if report.has_errors() {
                return Err(report.into());
            }
        }
        self.end(log.as_ref(), None, &summary);
        let text = format!("stored outputs were damaged {MOST_ROUNDS} times over; check the disk");
        Err(Failure::Failed(text))
    }

    /// The log's end; and what could not be written of it.
    fn end(&self, log: Option<&RunLog>, rival: Option<&Path>, summary: &Summary) -> Option<String> {
        let plan = self.resolver.plan;
        let name = &plan.spec.pipeline;
        if let Some(other) = rival {
            let other = other.display();
            let message = format!(
                "{other} is a pipeline of this name too; latest/{name} now holds the files of this one, and `turbid show` and `export` still find those of the other; give one of them another `pipeline:` name"
            );
            self.progress.warn(name, &message);
        }
        match log {
            Some(log) => log.end(plan, self.resolver.store, summary),
            None => note_up_to_date(self.outputs, name, summary.hits()),
        }
    }
}

/// What the results cost, whenever they were made: CPU seconds of all instances, memory of the one that took the most.
fn cost(plan: &Plan, summary: &Summary) -> Option<String> {
    let made = || plan.needed_instances().filter_map(|id| summary.brief(id));
    let cpu: f64 = made().map(|brief| brief.cost.cpu_s).sum();
    let peak = made().map(|brief| brief.cost.peak_bytes).max()?;
    Some(format!("\nthese results took {cpu:.1} CPU s, and at most {:.0} MB", peak as f64 / 1e6))
}

/// The folder, what is in it, and how to get at what is not.
fn where_it_lies(plan: &Plan, summary: &Summary, folder: &Path, outputs: &Path) -> Option<String> {
    let made = |stage: StageId| plan.instances_of(stage).filter(|id| summary.brief(*id).is_some()).count();
    let (many, few): (Vec<StageId>, Vec<StageId>) =
        plan.needed.iter().filter(|&&stage| made(stage) > 0).partition(|&&stage| made(stage) > PREVIEW_INSTANCES);
    let folder = folder.display();
    let mut text = match (few.is_empty(), many.is_empty()) {
        (true, true) => return None,
        (true, false) => format!("lists of results: {folder}"),
        (false, _) => format!("results and pictures: {folder}"),
    };
    // The last stage is what the others are there for.
    let Some(&last) = many.last() else { return Some(text) };
    let named: Vec<String> =
        many.iter().map(|&s| format!("{} ({} instances)", plan.spec.stages[s].name, made(s))).collect();
    text.push_str(&format!(
        "\nwith more than {PREVIEW_INSTANCES} instances only a list, instances.parquet, with the command for each, and no pictures: {}",
        named.join(", ")
    ));
    let port = plan.outputs(last).iter().find(|port| plan.wanted(last).contains(port.name) && !port.preview);
    if let Some(port) = port {
        let axes: Vec<&str> = plan.axis_names(last).collect();
        let (command, name) = (latest::Command::of(plan, outputs), &plan.spec.stages[last].name);
        text.push_str(&format!("\nall of {name}: {}", command.all(name, port.name, &axes)));
    }
    Some(text)
}

/// One row per stage: state, seconds, error.
fn table(plan: &Plan, summary: &Summary) -> String {
    let mut rows = vec![["stage".to_owned(), "state".to_owned(), "seconds".to_owned(), "error".to_owned()]];
    for &stage in &plan.needed {
        let ends: Vec<&End> = plan.instances_of(stage).filter_map(|id| summary.ends.get(&id)).collect();
        if ends.is_empty() {
            continue;
        }
        let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
        let mut wall = 0.0;
        for end in &ends {
            let word = match end {
                End::Hit(_) => "hit",
                End::Ran(_) => "ran",
                End::Failed(_) => "failed",
                End::Skipped => "not run",
            };
            *counts.entry(word).or_default() += 1;
            if let End::Ran(brief) = end {
                wall += brief.cost.wall_s;
            }
        }
        let state = match counts.iter().next() {
            Some((word, 1)) if counts.len() == 1 => (*word).to_owned(),
            _ => counts.iter().map(|(word, n)| format!("{n} {word}")).collect::<Vec<_>>().join(", "),
        };
        let wall = if counts.contains_key("ran") { format!("{wall:.2}") } else { String::new() };
        let error = errors(ends.iter().filter_map(|end| match end {
            End::Hit(brief) | End::Ran(brief) => Some(brief.errors()),
            End::Failed(_) | End::Skipped => None,
        }));
        rows.push([plan.spec.stages[stage].name.clone(), state, wall, error]);
    }
    let width = |column: usize| rows.iter().map(|r| r[column].chars().count()).max().unwrap_or(0);
    let widths = [width(0), width(1), width(2), width(3)];
    let mut text = String::new();
    for [stage, state, wall, error] in &rows {
        let line =
            format!("{stage:<0$}  {state:<1$}  {wall:>2$}  {error:<3$}", widths[0], widths[1], widths[2], widths[3]);
        text.push_str(line.trim_end());
        text.push('\n');
    }
    text
}
