//! `turbid explain`: the fields in which a stage differs from the nearest earlier result.

use clap::Args;

use crate::registry::Registry;
use crate::resolve::{Resolver, State};
use crate::spec::Report;

use super::{Done, Failure, Pipeline, print, report_of};

/// So many instances are explained.
const MOST: usize = 32;

#[derive(Args)]
pub struct Explain {
    #[command(flatten)]
    pipeline: Pipeline,
    /// The stage to explain
    stage: String,
}

impl Explain {
    pub fn run(&self, registry: &Registry) -> Done {
        let plan = self.pipeline.plan(registry, std::slice::from_ref(&self.stage))?;
        let stage = plan.spec.stage(&self.stage).ok_or_else(|| {
            Failure::Input(format!("there is no stage `{}` in pipeline `{}`", self.stage, plan.spec.pipeline))
        })?;
        let store = self.pipeline.store_to_read()?;
        let resolver = Resolver::new(&plan, &store);
        let survey = resolver.survey(&[]);
        let report = report_of(&plan, &survey);
        if report.has_errors() {
            return Err(report.into());
        }
        let mut text = String::new();
        for id in plan.instances_of(stage).take(MOST) {
            text.push_str(&plan.label(id));
            match &survey.states[id] {
                Some(State::Hit(brief)) => text.push_str(&format!(": up to date, key {}\n", brief.key)),
                Some(State::Waits(on)) => {
                    let names: Vec<&str> = on.iter().map(|&s| plan.spec.stages[s].name.as_str()).collect();
                    text.push_str(&format!(": waits for {}; explain those first\n", names.join(", ")));
                }
                Some(State::Run { reasons }) => {
                    let (_, job) = resolver.state(id, &survey.outputs, false).map_err(Report::from)?;
                    let job = job.expect("an instance that runs has a job");
                    let nearest = resolver.history().nearest(&plan, id, &job.dependencies);
                    // The fields below say it better than the short reasons, which compare with the latest result of this name.
                    match &nearest {
                        Some((_, differences)) if !differences.is_empty() => text.push_str(": runs\n"),
                        _ => text.push_str(&format!(": runs ({})\n", reasons.join("; "))),
                    }
                    match nearest {
                        None => text.push_str("  no earlier result of this kind of stage\n"),
                        Some((record, differences)) => {
                            let (record, _) = &*record;
                            let from = &record.provenance;
                            text.push_str(&format!(
                                "  nearest earlier result: {} of {}, key {}\n",
                                from.stage, from.pipeline, record.key
                            ));
                            for difference in differences {
                                let side =
                                    |text: &Option<String>| text.clone().unwrap_or_else(|| "(nothing)".to_owned());
                                text.push_str(&format!(
                                    "  {}\n    before: {}\n    now:    {}\n",
                                    difference.field,
                                    side(&difference.before),
                                    side(&difference.now)
                                ));
                            }
                        }
                    }
                }
                None => text.push_str(": not needed\n"),
            }
        }
        let more = plan.instances_of(stage).len().saturating_sub(MOST);
        if more > 0 {
            text.push_str(&format!("and {more} more instances; `turbid plan` says how many of them run\n"));
        }
        print(&text);
        Ok(())
    }
}
