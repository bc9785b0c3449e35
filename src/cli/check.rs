//! `turbid check`: every mistake that can be found before a run.

use clap::Args;

use crate::registry::Registry;
use crate::resolve::Resolver;
use crate::spec::{Diagnostic, Report};
use crate::store::Store;
use crate::threads;

use super::memory::{MemoryLimit, too_large};
use super::{Done, Failure, Pipeline, print, print_json, study_mistakes};

#[derive(Args)]
pub struct Check {
    #[command(flatten)]
    pipeline: Pipeline,
    #[command(flatten)]
    memory: MemoryLimit,
    /// Print the mistakes as JSON
    #[arg(long)]
    json: bool,
}

impl Check {
    pub fn run(&self, registry: &Registry) -> Done {
        let done = self.check(registry);
        if self.json {
            let (report, code) = match done {
                Ok(report) => (report, 0),
                Err(failure) => failure.told(),
            };
            print_json(&report.to_json().to_string());
            return match code {
                0 => Ok(()),
                1 => Err(Failure::Said),
                _ => Err(Failure::Report(Report::default())),
            };
        }
        let report = done?;
        for warning in report.diagnostics() {
            print(&warning.to_string());
        }
        Ok(())
    }

    /// The warnings of a file without mistakes.
    fn check(&self, registry: &Registry) -> Result<Report, Failure> {
        let plan = self.pipeline.plan(registry, &[])?;
        // A store that cannot be used is a mistake too.
        Store::check(self.pipeline.outputs.path()).map_err(|e| Failure::Input(e.to_string()))?;
        let store = self.pipeline.store_to_read()?;
        let resolver = Resolver::new(&plan, &store);
        // What is in the store already may be as wrong as what is not.
        let survey = resolver.survey(&plan.needed);
        let large = too_large(&plan, &survey, self.memory.budget(threads::of_machine()));
        let mut report = Report::from(survey.problems);
        // The file may be meant for another machine.
        report.extend(large.into_iter().map(Diagnostic::warning));
        report.extend(study_mistakes(&plan));
        report.extend(plan.spec.warnings.iter().cloned());
        if report.has_errors() {
            return Err(report.into());
        }
        if !self.json {
            let (stages, instances) = (plan.needed.len(), plan.needed_instances().count());
            print(&json_free_summary(&plan.spec.pipeline, stages, instances));
        }
        Ok(report)
    }
}

fn json_free_summary(pipeline: &str, stages: usize, instances: usize) -> String {
    format!("{pipeline}: {stages} stages, {instances} instances, no mistakes")
}
