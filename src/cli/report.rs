//! `turbid report`: a pipeline and its results on one page.

use std::path::{Path, PathBuf};
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use clap::Args;

use crate::memory;
use crate::registry::Registry;
use crate::report::gather::{Source, gather};
use crate::report::history::timestamp_text;
use crate::report::html::html;
use crate::resolve::Resolver;
use crate::run::latest::{Command, file_name};
use crate::whole_file::{self, Synced};

use super::{Done, Failure, Pipeline, print, report_of};

#[derive(Args)]
pub struct Report {
    #[command(flatten)]
    pipeline: Pipeline,
    /// The HTML file to write; report.html beside the pictures by default
    #[arg(long, value_name = "FILE")]
    to: Option<PathBuf>,
}

impl Report {
    pub fn run(&self, registry: &Registry) -> Done {
        let began = Instant::now();
        let plan = self.pipeline.plan(registry, &[])?;
        let store = self.pipeline.store_to_read()?;
        let resolver = Resolver::new(&plan, &store);
        let survey = resolver.survey(&[]);
        let report = report_of(&plan, &survey);
        if report.has_errors() {
            return Err(report.into());
        }
        if let Some(unread) = store.unread() {
            return Err(Failure::Failed(unread));
        }
        let outputs = self.pipeline.outputs.path();
        let usual = || outputs.join("latest").join(file_name(&plan.spec.pipeline)).join("report.html");
        let to = self.to.clone().unwrap_or_else(usual);
        if to.is_dir() {
            return Err(Failure::Input(format!("--to {}: a folder; name the file to write", to.display())));
        }
        let folder = to.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let failed = |error: std::io::Error| Failure::Failed(format!("{}: {error}", to.display()));
        match self.to {
            Some(_) if !folder.is_dir() => {
                return Err(Failure::Input(format!("--to {}: there is no folder {}", to.display(), folder.display())));
            }
            Some(_) => {}
            None => std::fs::create_dir_all(folder).map_err(failed)?,
        }
        let page = gather(&Source {
            resolver: &resolver,
            survey: &survey,
            outputs,
            folder,
            command: Command::of(&plan, outputs).run(),
            warnings: report.diagnostics().iter().map(|warning| warning.in_short()).collect(),
            here: here(),
        });
        let text = html(&page);
        whole_file::write(&to, ".new-", text.as_bytes(), Synced::No).map_err(failed)?;
        let milliseconds = began.elapsed().as_secs_f64() * 1e3;
        print(&format!("{} ({:.0} kB, {milliseconds:.0} ms)", to.display(), text.len() as f64 / 1e3));
        Ok(())
    }
}

/// When and where a page was written.
fn here() -> String {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs());
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let on = memory::machine::processor().map_or_else(String::new, |model| format!("{model}, "));
    format!("written {} on {on}{cores} cores", timestamp_text(now))
}
