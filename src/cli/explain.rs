//! `turbid explain`: the fields in which a stage differs from the nearest earlier result.

use clap::Args;
use serde::Serialize;

use crate::explain::Difference;
use crate::plan::{InstanceId, Plan};
use crate::registry::Registry;
use crate::resolve::{Resolver, State, Survey};
use crate::spec::Report;

use super::{Done, Failure, Pipeline, print, print_json, report_of};

/// So many instances are explained.
const MOST: usize = 32;

#[derive(Args)]
pub struct Explain {
    #[command(flatten)]
    pipeline: Pipeline,
    /// The stage to explain
    stage: String,
    #[arg(long)]
    json: bool,
}

/// Why an instance would run, or that it would not.
#[derive(Serialize)]
struct Explained {
    instance: String,
    /// `hit`, `run`, `waits`, or `not needed`.
    state: &'static str,
    /// Of a hit.
    key: Option<String>,
    /// Of what waits: the stages that it waits for; of what runs: short reasons.
    reasons: Vec<String>,
    nearest: Option<Nearest>,
}

/// The earlier result that is most like it.
#[derive(Serialize)]
struct Nearest {
    stage: String,
    pipeline: String,
    key: String,
    differences: Vec<Difference>,
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
        let explained = plan.instances_of(stage).take(MOST).map(|id| explain(&resolver, &survey, id));
        let explained = explained.collect::<Result<Vec<Explained>, Failure>>()?;
        let more = plan.instances_of(stage).len().saturating_sub(MOST);
        if self.json {
            let listing = serde_json::json!({"instances": explained, "more": more});
            print_json(&listing.to_string());
            return Ok(());
        }
        let mut text: String = explained.iter().map(Explained::text).collect();
        if more > 0 {
            text.push_str(&format!("and {more} more instances; `turbid plan` says how many of them run\n"));
        }
        print(&text);
        Ok(())
    }
}

fn explain(resolver: &Resolver<'_>, survey: &Survey, id: InstanceId) -> Result<Explained, Failure> {
    let plan: &Plan = resolver.plan;
    let instance = plan.label(id);
    let plain = |state, key, reasons| Explained { instance: instance.clone(), state, key, reasons, nearest: None };
    Ok(match &survey.states[id] {
        Some(State::Hit(brief)) => plain("hit", Some(brief.key.to_string()), Vec::new()),
        Some(State::Waits(on)) => {
            plain("waits", None, on.iter().map(|&stage| plan.spec.stages[stage].name.clone()).collect())
        }
        Some(State::Run { reasons }) => {
            let (_, job) = resolver.state(id, &survey.outputs, false).map_err(Report::from)?;
            let job = job.expect("an instance that runs has a job");
            let nearest = resolver.history().nearest(plan, id, &job.dependencies).map(|(record, differences)| {
                let (record, _) = &*record;
                Nearest {
                    stage: record.provenance.stage.clone(),
                    pipeline: record.provenance.pipeline.clone(),
                    key: record.key.to_string(),
                    differences,
                }
            });
            Explained { nearest, ..plain("run", None, reasons.to_vec()) }
        }
        None => plain("not needed", None, Vec::new()),
    })
}

impl Explained {
    fn text(&self) -> String {
        let Self { instance, reasons, nearest, .. } = self;
        let why = match (self.state, nearest) {
            ("hit", _) => format!("up to date, key {}", self.key.as_deref().unwrap_or_default()),
            ("waits", _) => format!("waits for {}; explain those first", reasons.join(", ")),
            // The fields below say it better than the short reasons, which compare with the latest result of this name.
            ("run", Some(nearest)) if !nearest.differences.is_empty() => "runs".to_owned(),
            ("run", _) => format!("runs ({})", reasons.join("; ")),
            (state, _) => state.to_owned(),
        };
        let mut text = format!("{instance}: {why}\n");
        match nearest {
            None if self.state == "run" => text.push_str("  no earlier result of this kind of stage\n"),
            None => {}
            Some(Nearest { stage, pipeline, key, differences }) => {
                text.push_str(&format!("  nearest earlier result: {stage} of {pipeline}, key {key}\n"));
                for Difference { field, before, now } in differences {
                    let side = |text: &Option<String>| text.clone().unwrap_or_else(|| "(nothing)".to_owned());
                    text.push_str(&format!("  {field}\n    before: {}\n    now:    {}\n", side(before), side(now)));
                }
            }
        }
        text
    }
}
