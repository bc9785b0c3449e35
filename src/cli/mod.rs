//! The command line: one file per command; errors leave by one door, with an exit code.

mod cache;
mod check;
mod explain;
mod export;
mod figures;
mod graph;
mod new;
mod plan;
mod run;
mod schema;
mod select;
mod show;
mod stages;

use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};

use crate::plan::{Plan, Target};
use crate::registry::Registry;
use crate::resolve::Survey;
use crate::spec::{self, Report};
use crate::store::Store;

pub use select::Selector;

/// How a command ends when it does not end well.
#[derive(Debug)]
pub enum Failure {
    /// The user's input is wrong: exit 2.
    Input(String),
    /// Mistakes in a pipeline file: exit 2.
    Report(Report),
    /// Something failed while it ran: exit 1.
    Failed(String),
    /// Failed, and all has been said: exit 1.
    Said,
    /// Ctrl-C: exit 130.
    Interrupted,
}

impl From<Report> for Failure {
    fn from(report: Report) -> Self {
        Self::Report(report)
    }
}

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
    /// Draw the stages and how they feed each other
    Graph(graph::Graph),
    /// List the stages, or print the manual of one
    Stages(stages::Stages),
    /// Print the JSON Schema of pipeline files, for editors
    Schema,
    /// Write an output in another format
    Export(export::Export),
    /// Look after the store of results
    Cache(cache::Cache),
    /// Write a commented starter pipeline
    New(new::New),
}

/// What every command that reads a pipeline takes.
#[derive(Args)]
struct Pipeline {
    /// The pipeline file
    file: PathBuf,
    /// Override a value, for example stages.frames.with.samples=64 or vars.f_x=0.2
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    #[command(flatten)]
    outputs: OutputsDir,
}

#[derive(Args)]
struct OutputsDir {
    /// Where results are kept
    #[arg(long, global = true, value_name = "DIR", env = "TURBID_OUTPUTS", default_value = "outputs")]
    outputs: PathBuf,
}

impl Pipeline {
    fn plan(&self, registry: &Registry, targets: &[String]) -> Result<Plan, Failure> {
        let (spec, report) = spec::read(&self.file, &self.set);
        let Some(spec) = spec else { return Err(report.into()) };
        let targets: Vec<Target> = targets.iter().map(|t| Target::parse(t)).collect();
        Ok(Plan::build(spec, report, registry, &targets)?)
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
    // A panic is a bug of ours; it is reported as an error of the stage, without a backtrace.
    std::panic::set_hook(Box::new(|_| {}));
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => {
            let _ = error.print();
            return ExitCode::from(if error.use_stderr() { 2 } else { 0 });
        }
    };
    let done = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| match &cli.command {
        Command::Run(command) => command.run(&registry),
        Command::Plan(command) => command.run(&registry),
        Command::Explain(command) => command.run(&registry),
        Command::Check(command) => command.run(&registry),
        Command::Show(command) => command.run(&registry),
        Command::Graph(command) => command.run(&registry),
        Command::Stages(command) => command.run(&registry),
        Command::Schema => schema::run(&registry),
        Command::Export(command) => command.run(&registry),
        Command::Cache(command) => command.run(),
        Command::New(command) => command.run(),
    }));
    let failure = match done {
        Ok(Ok(())) => return ExitCode::SUCCESS,
        Ok(Err(failure)) => failure,
        Err(panic) => Failure::Failed(crate::run::panic_text(panic.as_ref())),
    };
    let mut stderr = std::io::stderr();
    match failure {
        Failure::Input(message) => {
            let _ = writeln!(stderr, "error: {message}");
            ExitCode::from(2)
        }
        Failure::Report(report) => {
            let colour = stderr.is_terminal() && std::env::var_os("NO_COLOR").is_none();
            let _ = writeln!(stderr, "{}", report.render(colour).trim_end());
            ExitCode::from(2)
        }
        Failure::Failed(message) => {
            let _ = writeln!(stderr, "error: {message}");
            ExitCode::from(1)
        }
        Failure::Said => ExitCode::from(1),
        Failure::Interrupted => {
            let _ = writeln!(stderr, "interrupted; what was finished is kept, the next run goes on from there");
            ExitCode::from(130)
        }
    }
}

/// What a survey found, and what this version cannot run yet.
fn report_of(plan: &Plan, survey: &Survey) -> Report {
    let mut report = Report::from(survey.problems.clone());
    report.extend(plan.spec.not_yet());
    report
}

/// Prints to stdout; a closed pipe (`turbid show | head`) is a normal end, a full disk behind `>` is not.
fn print(text: &str) {
    let mut out = std::io::stdout().lock();
    let newline = if text.ends_with('\n') { "" } else { "\n" };
    let written = out.write_all(text.as_bytes()).and_then(|()| out.write_all(newline.as_bytes()));
    if let Err(error) = written.and_then(|()| out.flush())
        && error.kind() != std::io::ErrorKind::BrokenPipe
    {
        let _ = writeln!(std::io::stderr(), "error: what was to be printed could not be written: {error}");
        std::process::exit(1);
    }
}
