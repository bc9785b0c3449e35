//! `turbid export`: an output as .npz, .mat, .tiff or .csv.

use std::path::PathBuf;

use clap::Args;

use crate::export::{export, export_frames};
use crate::registry::Registry;
use crate::resolve::{Resolver, State};

use super::select::Selector;
use super::{Done, Failure, Pipeline, print, report_of};

#[derive(Args)]
pub struct Export {
    #[command(flatten)]
    pipeline: Pipeline,
    /// STAGE[axis=value,…].PORT
    #[arg(value_name = "STAGE.PORT")]
    selector: String,
    /// The file to write: .npz, .mat, .tiff or .csv
    #[arg(long, value_name = "FILE")]
    to: PathBuf,
    /// A .tiff of whole numbers (8 or 16 bit) for each frame, {f_x}, {phase} and {wavelength} in FILE replaced
    #[arg(long, value_name = "BITS")]
    bits: Option<u32>,
}

impl Export {
    pub fn run(&self, registry: &Registry) -> Done {
        let selector = Selector::parse(&self.selector)?;
        let Some(port) = &selector.port else {
            return Err(Failure::Input(format!("`{}` names no output; write {}.PORT", self.selector, selector.stage)));
        };
        let plan = self.pipeline.plan(registry, &[format!("{}.{port}", selector.stage)])?;
        let ids = selector.instances(&plan)?;
        let [id] = ids.as_slice() else {
            let some: Vec<String> = ids.iter().take(3).map(|&id| plan.label(id)).collect();
            return Err(Failure::Input(format!(
                "`{}` names {} instances ({}, …); pick one with [axis=value]",
                self.selector,
                ids.len(),
                some.join(", ")
            )));
        };
        let store = self.pipeline.store_to_read()?;
        let resolver = Resolver::new(&plan, &store);
        let survey = resolver.survey(&[]);
        let report = report_of(&plan, &survey);
        if report.has_errors() {
            return Err(report.into());
        }
        let Some(State::Hit(record)) = &survey.states[*id] else {
            if let Some(error) = store.unread() {
                return Err(Failure::Failed(error));
            }
            return Err(Failure::Failed(format!(
                "{} has not run yet with these parameters; try `turbid run {} {}`",
                plan.label(*id),
                self.pipeline.file.display(),
                self.selector
            )));
        };
        let artifact = store.get(&record.ports[port].blob).map_err(|e| Failure::Failed(e.to_string()))?;
        let written = match self.bits {
            Some(bits) => export_frames(&artifact, &self.to, bits),
            None => export(&artifact, &self.to).map(|()| vec![self.to.clone()]),
        };
        for file in written.map_err(|e| Failure::Input(e.to_string()))? {
            print(&format!("wrote {}", file.display()));
        }
        Ok(())
    }
}
