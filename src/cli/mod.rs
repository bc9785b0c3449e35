//! The command line: one file per command; errors leave by one door, with an exit code.

mod cache;
mod check;
#[cfg(feature = "tables")]
mod dataset;
#[cfg(any(test, not(feature = "tables")))]
#[path = "dataset/without.rs"]
mod dataset_without;
mod diff;
mod elsewhere;
mod explain;
mod export;
mod graph;
mod memory;
mod new;
mod not_run;
mod part;
mod plan;
mod released;
mod report;
mod run;
mod runs;
mod schema;
mod select;
mod show;
mod simd;
mod stages;
#[cfg(feature = "tables")]
mod study;
mod submit;
mod task;

use std::io::{IsTerminal, Write};
use std::mem::ManuallyDrop;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};

use crate::panics;
use crate::plan::{Plan, Target};
use crate::registry::Registry;
use crate::resolve::Survey;
use crate::spec::{self, Diagnostic, Kind, Mistake, Report};
use crate::store::{self, Store};
use crate::terminal::{self, print, print_json};

pub use select::Selector;
#[cfg(not(feature = "tables"))]
use {dataset_without as dataset, dataset_without as study};

/// How a command ends when it does not end well.
#[derive(Debug)]
pub enum Failure {
    /// The user's input is wrong: exit 2.
    Input(String),
    /// Mistakes in a pipeline file: exit 2.
    Report(Report),
    /// No run has made yet what was asked for: exit 1.
    NotRun(String),
    /// Something failed while it ran: exit 1.
    Failed(String),
    /// Failed, and all has been said: exit 1.
    Said,
    /// Ctrl-C: exit 130.
    Interrupted,
    /// Ctrl-C, and all has been said: what others do goes on.
    Left,
}

impl From<Report> for Failure {
    fn from(report: Report) -> Self {
        Self::Report(report)
    }
}

impl Failure {
    /// With which code the command ends.
    fn code(&self) -> u8 {
        match self {
            Self::Report(report) => report.exit_code(),
            Self::Input(_) => Kind::Usage.exit_code(),
            Self::NotRun(_) => Kind::NotRun.exit_code(),
            Self::Failed(_) | Self::Said => Kind::Failed.exit_code(),
            Self::Interrupted | Self::Left => INTERRUPTED,
        }
    }

    /// What is to be said, and with which code to end.
    fn told(self) -> (Report, u8) {
        let report = match self {
            Self::Report(report) => report,
            Self::Input(message) => Diagnostic::nowhere(Mistake::new(Kind::Usage, message)).into(),
            Self::NotRun(message) => Diagnostic::nowhere(Mistake::new(Kind::NotRun, message)).into(),
            Self::Failed(message) => Diagnostic::nowhere(Mistake::new(Kind::Failed, message)).into(),
            Self::Said => return (Report::default(), Kind::Failed.exit_code()),
            Self::Interrupted | Self::Left => return (Report::default(), INTERRUPTED),
        };
        let code = report.exit_code();
        (report, code)
    }
}

/// A variable of the environment: set to `json`, mistakes are one line of JSON on stderr, `{"mistakes": [..]}`, for programs.
const ERRORS: &str = "TURBID_ERRORS";

/// What shells give to a program that Ctrl-C ended.
const INTERRUPTED: u8 = 130;

type Done = Result<(), Failure>;

/// Design and simulate spatial frequency domain imaging systems from declarative experiment files.
#[derive(Parser)]
#[command(name = "turbid", version, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Run what is stale
    Run(run::Run),
    /// Show what a run would do, and what it leaves out
    Plan(plan::PlanCommand),
    /// Show why a stage would run: the fields that differ from the nearest earlier result
    Explain(explain::Explain),
    /// Find every mistake in a pipeline file without running it
    Check(check::Check),
    /// Show what a stage made: digest, path, layers, units, statistics, cost
    Show(show::Show),
    /// Write one page on a pipeline: its question, figures, errors, costs and where they come from
    Report(report::Report),
    /// List what ran, when, and how it ended
    Runs(runs::Runs),
    /// Show what two runs, pipelines or instances differ in: parameters, inputs, numbers with z scores, pictures
    Diff(diff::Diff),
    /// Draw the stages and how they feed each other
    Graph(graph::Graph),
    /// List the stages, or print the manual of one
    Stages(stages::Stages),
    /// Print the JSON Schema of pipeline files, for editors
    Schema,
    /// Write an output in another format
    Export(export::Export),
    /// Build and look after data sets (needs a build with `--features tables`)
    Dataset(dataset::Dataset),
    /// Measure errors against run time over what a study varies (needs a build with `--features tables`)
    Study(study::Study),
    /// Hand shards over to HyperQueue or Slurm, and follow them
    Submit(submit::Submit),
    /// What an engine starts: a shard of a job
    #[command(hide = true)]
    Task(task::Task),
    /// Look after the store of results
    Cache(cache::Cache),
    /// Write a commented starter pipeline
    New(new::New),
}

/// What every command that reads a pipeline takes.
#[derive(Args, Clone)]
struct Pipeline {
    /// The pipeline file
    file: PathBuf,
    /// Override a value, for example stages.frames.with.samples=64 or vars.f_x=0.2
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    #[command(flatten)]
    outputs: OutputsDir,
}

#[derive(Args, Clone)]
struct OutputsDir {
    /// Where results are kept
    #[arg(long, global = true, value_name = "DIR", env = "TURBID_OUTPUTS", default_value = "outputs")]
    outputs: PathBuf,
}

impl Pipeline {
    /// Never given back: the program ends with the command, and to give back what many stages hold takes as long as to plan them.
    fn plan(&self, registry: &Registry, targets: &[String]) -> Result<ManuallyDrop<Plan>, Failure> {
        let (spec, report) = spec::read(&self.file, &self.set);
        let Some(spec) = spec else { return Err(report.into()) };
        let targets: Vec<Target> = targets.iter().map(|t| Target::parse(t)).collect();
        Ok(ManuallyDrop::new(Plan::build(spec, report, registry, &targets)?))
    }

    /// The same, and of it what is asked for. How many instances no shard runs, because they gather what several make.
    fn plan_part(
        &self,
        registry: &Registry,
        targets: &[String],
        part: &part::PartOf,
    ) -> Result<(ManuallyDrop<Plan>, usize), Failure> {
        let mut plan = self.plan(registry, targets)?;
        let left = part.restrict(&mut plan)?;
        Ok((plan, left))
    }

    /// The same of one point of each draw: of a large one not all instances are held.
    fn plan_of_first_points(&self, registry: &Registry) -> Result<Plan, Failure> {
        let (spec, report) = spec::read(&self.file, &self.set);
        let Some(spec) = spec else { return Err(report.into()) };
        Ok(Plan::build(spec.with_first_points(), report, registry, &[])?)
    }

    fn store_to_read(&self) -> Result<Store, Failure> {
        self.outputs.store_to_read()
    }
}

impl OutputsDir {
    fn path(&self) -> &Path {
        &self.outputs
    }

    fn store_to_read(&self) -> Result<Store, Failure> {
        Store::open_read_only(&self.outputs).map_err(|e| Failure::Input(e.to_string()))
    }
}

/// The whole program: parses the arguments, does the command, reports, and gives the exit code.
pub fn main(registry: Registry) -> ExitCode {
    panics::speak();
    store::return_large_memory();
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) if error.use_stderr() => {
            // Without colours: it quotes what the user, or a name of a file, made it.
            let text = error.render().to_string();
            if for_programs() {
                say(&Failure::Input(text.trim_end().to_owned()).told().0);
            } else {
                terminal::tell(&text);
            }
            return ExitCode::from(2);
        }
        Err(help) => {
            terminal::note(help.print().and_then(|()| std::io::stdout().flush()));
            return ExitCode::from(code_with_lost_output(0));
        }
    };
    let done = cli.command.run(&registry);
    let code = match done {
        Ok(()) => 0,
        Err(failure) => {
            if matches!(failure, Failure::Interrupted) {
                terminal::tell("interrupted; what was finished is kept, the next run goes on from there");
            }
            let (report, code) = failure.told();
            say(&report);
            code
        }
    };
    ExitCode::from(code_with_lost_output(code))
}

/// Whether mistakes are read by a program.
fn for_programs() -> bool {
    std::env::var_os(ERRORS).is_some_and(|format| format == "json")
}

/// Says mistakes on stderr, as people or programs read them.
fn say(report: &Report) {
    if for_programs() {
        if !report.is_empty() {
            terminal::tell_json(&serde_json::json!({"mistakes": report.to_json()}).to_string());
        }
        return;
    }
    let colour = std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|no| no.is_empty());
    terminal::tell_painted(report.render(colour).trim_end());
}

/// Does what another command of turbid would do, given by its arguments.
fn perform(arguments: &[String], registry: &Registry) -> Done {
    let words = std::iter::once("turbid").chain(arguments.iter().map(String::as_str));
    let cli = Cli::try_parse_from(words).map_err(|error| Failure::Input(error.to_string()))?;
    cli.command.run(registry)
}

impl Command {
    /// A panic is a failure like any other.
    fn run(&self, registry: &Registry) -> Done {
        let done = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| match self {
            Self::Run(command) => command.run(registry),
            Self::Plan(command) => command.run(registry),
            Self::Explain(command) => command.run(registry),
            Self::Check(command) => command.run(registry),
            Self::Show(command) => command.run(registry),
            Self::Report(command) => command.run(registry),
            Self::Runs(command) => command.run(),
            Self::Diff(command) => command.run(registry),
            Self::Graph(command) => command.run(registry),
            Self::Stages(command) => command.run(registry),
            Self::Schema => schema::run(registry),
            Self::Export(command) => command.run(registry),
            Self::Dataset(command) => command.run(registry),
            Self::Study(command) => command.run(registry),
            Self::Submit(command) => command.run(registry),
            Self::Task(command) => command.run(registry),
            Self::Cache(command) => command.run(registry),
            Self::New(command) => command.run(),
        }));
        done.unwrap_or_else(|panic| Err(Failure::Failed(panics::text(panic.as_ref()))))
    }
}

/// What was done is done, but whoever waits for what was to be printed must know that it is not all there.
fn code_with_lost_output(code: u8) -> u8 {
    let Some(error) = terminal::lost() else { return code };
    terminal::tell(&format!("error: what was to be printed could not be written: {error}"));
    if code == 0 { 1 } else { code }
}

/// What studies name that the pipeline has not.
fn study_mistakes(plan: &Plan) -> Vec<Diagnostic> {
    crate::study::mistakes(plan)
}

/// What a survey found, and what is wrong with studies.
fn report_of(plan: &Plan, survey: &Survey) -> Report {
    let mut report = Report::from(survey.problems.clone());
    report.extend(study_mistakes(plan));
    report.extend(plan.spec.warnings.iter().cloned());
    report
}
