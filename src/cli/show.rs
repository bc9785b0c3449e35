//! `turbid show`: what the stored outputs hold: digest, path, layers, units, statistics, cost.

mod describe;
mod places;
mod text;

use std::collections::BTreeMap;

use clap::Args;
use serde::Serialize;
use serde_json::json;

use crate::plan::StageId;
use crate::registry::Registry;
use crate::resolve::{Resolver, State};
use crate::run::latest::Files;

use super::elsewhere::{self, Elsewhere};
use super::not_run::not_run;
use super::released::make_again;
use super::select::Selector;
use super::{Done, Failure, Pipeline, print, print_json, report_of};
use describe::{Described, Shown};
use places::Places;

/// Of a stage of more instances than this ...
const MANY: usize = 8;
/// ... so many are shown to people who asked for no one of them.
const SHOWN: usize = 4;

#[derive(Args)]
pub struct Show {
    #[command(flatten)]
    pipeline: Pipeline,
    /// STAGE[axis=value,…][.PORT]; everything by default
    #[arg(value_name = "STAGE")]
    selector: Option<String>,
    #[command(flatten)]
    elsewhere: Elsewhere,
    #[arg(long)]
    json: bool,
    /// With --json: only where the outputs are, as file, offset and length, and their pictures; nothing is read
    #[arg(long, requires = "json")]
    places: bool,
}

#[derive(Serialize)]
struct Listing {
    instances: Vec<Shown>,
}

impl Show {
    pub fn run(&self, registry: &Registry) -> Done {
        let selector = self.selector.as_deref().map(Selector::parse).transpose()?;
        let targets: Vec<String> = selector.iter().map(|s| s.stage.clone()).collect();
        let plan = self.pipeline.plan(registry, &targets)?;
        let ids = match &selector {
            Some(selector) => selector.instances(&plan)?,
            None => plan.needed_instances().collect(),
        };
        if selector.is_some() {
            let port = selector.as_ref().and_then(|s| s.port.as_deref());
            let all = self.json || ids.len() <= MANY;
            let read = &ids[..if all { ids.len() } else { SHOWN }];
            make_again(&self.pipeline, registry, &plan, read, port)?;
        }
        let store = self.elsewhere.store_to_read(&self.pipeline.outputs)?;
        let resolver = Resolver::new(&plan, &store);
        elsewhere::bring(&resolver)?;
        let survey = resolver.survey(&[]);
        let report = report_of(&plan, &survey);
        if report.has_errors() {
            return Err(report.into());
        }
        let port = selector.as_ref().and_then(|s| s.port.as_deref());
        let outputs = self.pipeline.outputs.path();
        let files = self.places.then(|| Files::of(&plan, outputs));
        let mut places = Vec::new();
        let mut counts: BTreeMap<StageId, usize> = BTreeMap::new();
        ids.iter().for_each(|&id| *counts.entry(plan.stage_of(id)).or_default() += 1);
        let (mut instances, mut seen, mut more) = (Vec::new(), BTreeMap::new(), BTreeMap::new());
        for id in ids {
            let stage = plan.stage_of(id);
            match &survey.states[id] {
                Some(State::Hit(brief)) => {
                    let seen: &mut usize = seen.entry(stage).or_default();
                    *seen += 1;
                    if !self.json && counts[&stage] > MANY && *seen > SHOWN {
                        *more.entry(stage).or_insert(0_usize) += 1;
                        continue;
                    }
                    let Some(record) = store.record(&brief.key) else { continue };
                    if let Some(files) = &files {
                        places.push(Places::of(&plan, &store, files, id, &record, port)?);
                        continue;
                    }
                    let one = Described { plan: &plan, store: &store, outputs, id, record: &record };
                    instances.push((stage, one.shown(port)?));
                }
                _ if store.unread().is_some() => return Err(Failure::Failed(store.unread().unwrap_or_default())),
                _ if selector.is_some() => {
                    let stage = &plan.spec.stages[stage].name;
                    return Err(not_run(&self.pipeline, &resolver, &survey, id, stage));
                }
                _ => {}
            }
        }
        elsewhere::warn(&store);
        if self.places {
            let listing = json!({"pipeline": plan.spec.pipeline, "instances": places});
            print_json(&listing.to_string());
        } else if self.json {
            let listing = Listing { instances: instances.into_iter().map(|(_, shown)| shown).collect() };
            print_json(&serde_json::to_string(&listing).expect("names and finite numbers"));
        } else if instances.is_empty() {
            print("nothing has run yet");
        } else {
            print(&told(&instances, &more, &|stage| {
                let name = &plan.spec.stages[stage].name;
                let one = plan.instances_of(stage).last().map(|id| plan.label(id)).unwrap_or_default();
                format!("more instances of {name}: `turbid show {} '{one}'` shows one", self.pipeline.file.display())
            }));
        }
        Ok(())
    }
}

/// The texts of all, and behind those of a stage how many were left out.
fn told(instances: &[(StageId, Shown)], more: &BTreeMap<StageId, usize>, note: &dyn Fn(StageId) -> String) -> String {
    let mut out = String::new();
    for (i, (stage, shown)) in instances.iter().enumerate() {
        if i > 0 {
            out.push('\n');
        }
        out.push_str(&text::text(shown));
        let is_last = instances.get(i + 1).is_none_or(|(next, _)| next != stage);
        if let Some(count) = more.get(stage).filter(|_| is_last) {
            out.push_str(&format!("\nand {count} {}\n", note(*stage)));
        }
    }
    out
}
