//! `turbid plan`: every instance as hit, run (reasons) or waits, with the method taken and what is left out.

use clap::Args;
use serde_json::{Value, json};

use crate::plan::Plan;
use crate::registry::Registry;
use crate::resolve::{Resolver, State, Survey};

use super::{Done, Pipeline, print, report_of};

#[derive(Args)]
pub struct PlanCommand {
    #[command(flatten)]
    pipeline: Pipeline,
    /// Stages (or STAGE.PORT) that would be asked for; all leaves by default
    #[arg(value_name = "STAGE")]
    targets: Vec<String>,
    #[arg(long)]
    json: bool,
}

impl PlanCommand {
    pub fn run(&self, registry: &Registry) -> Done {
        let plan = self.pipeline.plan(registry, &self.targets)?;
        let store = self.pipeline.store_to_read()?;
        let resolver = Resolver::new(&plan, &store);
        let survey = resolver.survey(&[]);
        let report = report_of(&plan, &survey);
        if report.has_errors() {
            return Err(report.into());
        }
        if self.json {
            print(&to_json(&plan, &survey).to_string());
        } else {
            print(&to_text(&plan, &survey));
        }
        Ok(())
    }
}

/// State word and reasons of an instance.
fn state(plan: &Plan, state: &State) -> (&'static str, Vec<String>) {
    match state {
        State::Hit(_) => ("hit", Vec::new()),
        State::Run { reasons, .. } => ("run", reasons.clone()),
        State::Waits(stages) => {
            ("waits", stages.iter().map(|&s| format!("for {}", plan.spec.stages[s].name)).collect())
        }
    }
}

fn to_json(plan: &Plan, survey: &Survey) -> Value {
    let instances: Vec<Value> = plan
        .needed_instances()
        .filter_map(|id| survey.states[id].as_ref().map(|s| (id, s)))
        .map(|(id, found)| {
            let instance = &plan.instances[id];
            let (word, reasons) = state(plan, found);
            let mut row = json!({
                "stage": plan.spec.stages[instance.stage].name, "axes": instance.axes, "state": word, "reasons": reasons,
                "left_out": [],
            });
            if let Some(detail) = survey.plans.get(&id) {
                row["left_out"] = json!(detail.left_out);
                row["needs"] = json!(detail.needs);
                row["method"] = json!(detail.method);
                row["seconds"] = json!(detail.seconds);
                row["bytes"] = json!(detail.bytes);
            }
            row
        })
        .collect();
    let unneeded: Vec<&str> = (0..plan.spec.stages.len())
        .filter(|s| !plan.needed.contains(s))
        .map(|s| plan.spec.stages[s].name.as_str())
        .collect();
    json!({"instances": instances, "stages_left_out": unneeded})
}

fn to_text(plan: &Plan, survey: &Survey) -> String {
    let mut text = String::new();
    let mut seconds = 0.0;
    // Of the instances of a stage only the first says what they have in common.
    let mut said = None;
    for id in plan.needed_instances() {
        let Some(found) = &survey.states[id] else { continue };
        let (word, reasons) = state(plan, found);
        let why = if reasons.is_empty() { String::new() } else { format!(" ({})", reasons.join("; ")) };
        text.push_str(&format!("{word:<5} {}{why}\n", plan.label(id)));
        if let Some(detail) = survey.plans.get(&id) {
            seconds += detail.seconds.unwrap_or(0.0);
            let common = Some((plan.instances[id].stage, &detail.method, &detail.needs, &detail.left_out));
            if said == common {
                continue;
            }
            said = common;
            if let Some(method) = &detail.method {
                text.push_str(&format!("        method: {method}\n"));
            }
            if !detail.needs.is_empty() {
                text.push_str(&format!("        needs: {}\n", detail.needs.join(", ")));
            }
            if !detail.left_out.is_empty() {
                text.push_str(&format!("        left out: {}\n", detail.left_out.join(", ")));
            }
        }
    }
    if seconds >= 0.05 {
        text.push_str(&format!("about {seconds:.1} s of work\n"));
    }
    text
}
