//! `turbid diff`: what two runs, pipelines or instances differ in.

use std::path::{Path, PathBuf};

use clap::Args;

use crate::digest::Digest;
use crate::key::axes_text;
use crate::plan::InstanceId;
use crate::registry::Registry;
use crate::report::diff::{Comparison, Side, compare};
use crate::report::figures::aligned;
use crate::report::history::{self, time_text};
use crate::report::html::diff_html;
use crate::report::page::{Cell, Grid};
use crate::resolve::{Resolver, State};
use crate::spec::nearest;
use crate::store::{Provenance, Store};
use crate::whole_file::{self, Synced};

use super::select::Selector;
use super::{Done, Failure, OutputsDir, Pipeline, print, report_of};

#[derive(Args)]
pub struct Diff {
    /// A run (its name in `turbid runs` or the beginning of it; `last`, `last~1`), or a pipeline file; either with :STAGE[axis=value] for one instance
    #[arg(value_name = "A")]
    a: String,
    #[arg(value_name = "B")]
    b: String,
    /// Override a value of the pipeline file A
    #[arg(long = "set-a", value_name = "KEY=VALUE")]
    set_a: Vec<String>,
    /// Override a value of the pipeline file B
    #[arg(long = "set-b", value_name = "KEY=VALUE")]
    set_b: Vec<String>,
    /// An HTML file to write, with pictures side by side
    #[arg(long, value_name = "FILE")]
    to: Option<PathBuf>,
    #[command(flatten)]
    outputs: OutputsDir,
}

impl Diff {
    pub fn run(&self, registry: &Registry) -> Done {
        let store = self.outputs.store_to_read()?;
        let a = self.side(&self.a, &self.set_a, registry, &store)?;
        let b = self.side(&self.b, &self.set_b, registry, &store)?;
        if let Some(unread) = store.unread() {
            return Err(Failure::Failed(unread));
        }
        let found = compare(&store, &a, &b, self.to.is_some());
        print(&text(&found));
        if let Some(to) = &self.to {
            let page = diff_html(&found);
            let written = whole_file::write(to, ".new-", page.as_bytes(), Synced::No);
            written.map_err(|error| Failure::Failed(format!("{}: {error}", to.display())))?;
            print(&format!("{} ({:.0} kB)", to.display(), page.len() as f64 / 1e3));
        }
        Ok(())
    }

    fn side(&self, name: &str, set: &[String], registry: &Registry, store: &Store) -> Result<Side, Failure> {
        let (whole, selector) = match name.split_once(':') {
            Some((whole, selected)) if !Path::new(name).exists() => (whole, Some(Selector::parse(selected)?)),
            _ => (name, None),
        };
        if Path::new(whole).is_file() {
            return self
                .pipeline(whole, set, selector.as_ref(), registry, store)
                .map(|side| Side { name: name.to_owned(), ..side });
        }
        if !set.is_empty() {
            return Err(Failure::Input(format!("`{whole}` is no pipeline file, and overrides are for those")));
        }
        let id = self.named(whole)?;
        let folder = self.outputs.path().join("runs");
        let run = history::run(&folder, &id);
        let mut about = vec![format!("{} of {}", run.file.unwrap_or(run.pipeline), time_text(&run.time))];
        about.extend(run.overrides.iter().map(|given| format!("--set {given}")));
        let wanted = |label: &str| {
            selector.as_ref().is_none_or(|s| match s.label.is_empty() {
                true => label.split('[').next() == Some(s.stage.as_str()),
                false => label == format!("{}[{}]", s.stage, s.label),
            })
        };
        let (mut instances, mut missing) = (Vec::new(), Vec::new());
        for (label, key) in history::instances(&folder, &id) {
            let found = key.parse::<Digest>().ok().and_then(|key| store.record_and_recipe(&key));
            // A run of an older turbid noted keys alone; records know where they came from.
            let label = label.or_else(|| Some(label_of(&found.as_ref()?.0.provenance))).unwrap_or(key);
            match found.filter(|_| wanted(&label)) {
                Some(found) => instances.push((label, found)),
                None if wanted(&label) => missing.push(label),
                None => {}
            }
        }
        if instances.is_empty() && missing.is_empty() {
            let what = selector.map_or_else(String::new, |s| format!(" of {}", s.stage));
            return Err(Failure::Failed(format!("run {id} left no list of results{what}: it did not end")));
        }
        Ok(Side {
            name: if whole == id { name.to_owned() } else { format!("{name} = {id}") },
            about,
            instances,
            missing,
        })
    }

    fn pipeline(
        &self,
        file: &str,
        set: &[String],
        selector: Option<&Selector>,
        registry: &Registry,
        store: &Store,
    ) -> Result<Side, Failure> {
        let pipeline = Pipeline { file: file.into(), set: set.to_vec(), outputs: self.outputs.clone() };
        let targets: Vec<String> = selector.iter().map(|s| s.stage.clone()).collect();
        let plan = pipeline.plan(registry, &targets)?;
        let resolver = Resolver::new(&plan, store);
        let survey = resolver.survey(&[]);
        let report = report_of(&plan, &survey);
        if report.has_errors() {
            return Err(report.into());
        }
        let ids: Vec<InstanceId> = match selector {
            Some(selector) => selector.instances(&plan)?,
            None => plan.needed_instances().collect(),
        };
        let (mut instances, mut missing) = (Vec::new(), Vec::new());
        for id in ids {
            let found = match &survey.states[id] {
                Some(State::Hit(brief)) => store.record_and_recipe(&brief.key),
                _ => None,
            };
            match found {
                Some(found) => instances.push((plan.label(id), found)),
                None => missing.push(plan.label(id)),
            }
        }
        let about = [format!("pipeline {}", plan.spec.pipeline)];
        let about = about.into_iter().chain(set.iter().map(|given| format!("--set {given}"))).collect();
        Ok(Side { name: file.to_owned(), about, instances, missing })
    }

    /// The name of a run's folder.
    fn named(&self, name: &str) -> Result<String, Failure> {
        let all = history::names(self.outputs.path());
        let none = |hint: String| Failure::Input(format!("`{name}` is neither a file nor a run{hint}"));
        let last = match name.strip_prefix("last") {
            Some("") => Some(0),
            Some(rest) => rest.strip_prefix('~').and_then(|n| n.parse::<usize>().ok()),
            None => None,
        };
        if let Some(back) = last {
            let found = all.len().checked_sub(back + 1).map(|at| all[at].clone());
            return found.ok_or_else(|| none(format!(": there are {} runs", all.len())));
        }
        let fits: Vec<&String> = all.iter().filter(|id| !name.is_empty() && id.starts_with(name)).collect();
        match fits[..] {
            [one] => Ok(one.clone()),
            [] => {
                let near = nearest(name, all.iter().map(String::as_str));
                Err(none(near.map_or_else(
                    || "; `turbid runs` lists them".to_owned(),
                    |near| format!("; did you mean `{near}`?"),
                )))
            }
            _ => Err(none(format!(": {} runs begin so", fits.len()))),
        }
    }
}

fn label_of(from: &Provenance) -> String {
    let axes = axes_text(&from.axes);
    if axes.is_empty() { from.stage.clone() } else { format!("{}[{axes}]", from.stage) }
}

fn text(found: &Comparison) -> String {
    let mut text = String::new();
    for (letter, (name, about)) in ["A", "B"].iter().zip(found.names.iter().zip(&found.about)) {
        text += &format!("{letter}: {name}\n");
        about.iter().for_each(|line| text += &format!("   {line}\n"));
    }
    found.summary.iter().for_each(|line| text += &format!("{line}\n"));
    for one in &found.instances {
        text += &format!("\n{}\n", one.label);
        one.notes.iter().for_each(|note| text += &format!("  {note}\n"));
        for grid in [&one.origin, &one.costs].into_iter().chain(&one.numbers) {
            text += &grid_text(grid);
        }
    }
    text
}

/// A table as aligned lines, set in.
fn grid_text(grid: &Grid) -> String {
    if grid.rows.is_empty() {
        return String::new();
    }
    let cell = |cell: &Cell| match cell {
        Cell::Text(text) | Cell::Run(text) | Cell::Link { text, .. } => text.clone(),
    };
    let rows = grid.rows.iter().map(|row| row.iter().map(cell).collect());
    let lines: Vec<Vec<String>> = std::iter::once(grid.head.clone()).chain(rows).collect();
    let caption = if grid.caption.is_empty() { String::new() } else { format!("  {}\n", grid.caption) };
    let more = grid.more.as_ref().map_or_else(String::new, |more| format!("    {more}\n"));
    let body: String = aligned(&lines).lines().map(|line| format!("    {line}\n")).collect();
    caption + &body + &more
}
