//! `turbid export`: an output as .npz, .mat, .tiff, .csv or .parquet.

mod together;

use std::collections::HashSet;
use std::path::PathBuf;

use clap::Args;

use crate::export::{export, export_frames};
use crate::key::value_text;
use crate::plan::{InstanceId, Plan};
use crate::registry::Registry;
use crate::resolve::{Resolver, State};
use crate::run::latest::file_name;
use crate::store::Blob;

use super::elsewhere::{self, Elsewhere};
use super::not_run::not_run;
use super::released::make_again;
use super::select::Selector;
use super::{Done, Failure, Pipeline, print, report_of};
use together::Together;

/// What `--bits` replaces in the name of a file by what a frame shows.
const FRAMES: [&str; 3] = ["f_x", "phase", "wavelength"];

#[derive(Args)]
pub struct Export {
    #[command(flatten)]
    pipeline: Pipeline,
    /// STAGE[axis=value,…].PORT
    #[arg(value_name = "STAGE.PORT")]
    selector: String,
    /// The file to write: .npz, .mat, .tiff or .csv; of several instances with {axis} for the values of each axis
    #[arg(long, value_name = "FILE")]
    to: PathBuf,
    /// All instances in one FILE: image stacks in an .npz or .mat, tables in a .parquet, .npz, .mat or .csv with the axes as columns; in
    /// FOLDER/ each in a file as the store has it
    #[arg(long, conflicts_with = "bits")]
    all: bool,
    /// A .tiff of whole numbers (8 or 16 bit) for each frame, {f_x}, {phase} and {wavelength} in FILE replaced
    #[arg(long, value_name = "BITS")]
    bits: Option<u32>,
    #[command(flatten)]
    elsewhere: Elsewhere,
}

impl Export {
    pub fn run(&self, registry: &Registry) -> Done {
        let selector = Selector::parse(&self.selector)?;
        let port = self.port(registry, &selector)?;
        let plan = self.pipeline.plan(registry, &[format!("{}.{port}", selector.stage)])?;
        let ids = selector.instances(&plan)?;
        let files = if self.all { Vec::new() } else { self.files(&plan, &ids)? };
        make_again(&self.pipeline, registry, &plan, &ids, Some(&port))?;
        let store = self.elsewhere.store_to_read(&self.pipeline.outputs)?;
        let resolver = Resolver::new(&plan, &store);
        elsewhere::bring(&resolver)?;
        let survey = resolver.survey(&[]);
        let report = report_of(&plan, &survey);
        if report.has_errors() {
            return Err(report.into());
        }
        // All of them are looked for before one is written.
        let found = ids.iter().map(|&id| match &survey.states[id] {
            // A record may be of a run that was not asked for this output.
            Some(State::Hit(brief)) if brief.outputs.has(&port) => Ok((id, brief.outputs[port.as_str()])),
            _ => Err(not_run(&self.pipeline, &resolver, &survey, id, &self.selector)),
        });
        let found = found.collect::<Result<Vec<(InstanceId, Blob)>, Failure>>()?;
        if self.all {
            let together = Together { plan: &plan, store: &store, port: &port, found };
            together.write(&self.to)?;
            elsewhere::warn(&store);
            return Ok(());
        }
        for ((_, blob), to) in found.iter().zip(files) {
            let artifact = store.get(blob).map_err(|e| Failure::Failed(e.to_string()))?;
            let written = match self.bits {
                Some(bits) => export_frames(&artifact, &to, bits),
                None => export(&artifact, &to).map(|()| vec![to]),
            };
            for file in written.map_err(|e| Failure::Input(e.to_string()))? {
                print(&format!("wrote {}", file.display()));
            }
        }
        elsewhere::warn(&store);
        Ok(())
    }

    /// The output that is meant: with --all that of a stage alone is its first.
    fn port(&self, registry: &Registry, selector: &Selector) -> Result<String, Failure> {
        if let Some(port) = &selector.port {
            return Ok(port.clone());
        }
        if !self.all {
            return Err(Failure::Input(format!("`{}` names no output; write {}.PORT", self.selector, selector.stage)));
        }
        let plan = self.pipeline.plan(registry, std::slice::from_ref(&selector.stage))?;
        let stage = selector.stage(&plan)?;
        let first = plan.outputs(stage).first().expect("every stage has an output");
        Ok(first.name.to_owned())
    }

    /// The file of each instance: of several the name with the values of their axes.
    fn files(&self, plan: &Plan, ids: &[InstanceId]) -> Result<Vec<PathBuf>, Failure> {
        if ids.len() == 1 {
            return Ok(vec![self.to.clone()]);
        }
        let named =
            |&id: &InstanceId| {
                let of_frames = |name: &str| self.bits.is_some() && FRAMES.contains(&name);
                let values = plan.values(id);
                let axes = values.iter().filter(|(name, _)| !of_frames(name));
                let name = self.to.to_string_lossy().into_owned();
                PathBuf::from(axes.fold(name, |name, (axis, value)| {
                    name.replace(&format!("{{{axis}}}"), &file_name(&value_text(value)))
                }))
            };
        let files: Vec<PathBuf> = ids.iter().map(named).collect();
        let mut different = HashSet::new();
        if files.iter().all(|file| different.insert(file)) {
            return Ok(files);
        }
        let some: Vec<String> = ids.iter().take(3).map(|&id| plan.label(id)).collect();
        let axes = plan.axis_names(plan.stage_of(ids[0])).map(|axis| format!("{{{axis}}}")).collect::<Vec<_>>();
        Err(Failure::Input(format!(
            "`{}` names {} instances ({}, …); pick one with [axis=value], write {} into the name of the file, or --all",
            self.selector,
            ids.len(),
            some.join(", "),
            axes.join(", ")
        )))
    }
}
