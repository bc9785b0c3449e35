//! What the stages of shipped pipelines are said to make before they run, as examples for the pages of the stages.

use std::collections::BTreeMap;
use std::path::PathBuf;

use turbid::plan::Plan;
use turbid::registry::Registry;
use turbid::resolve::Resolver;
use turbid::spec;
use turbid::store::Store;

/// The section of a page, by the kind of stage: of the first stage of a shipped pipeline of whose outputs something is known, quickstart.yaml first.
pub fn sections() -> BTreeMap<String, String> {
    let mut sections = BTreeMap::new();
    for file in pipelines() {
        let name = file.file_name().expect("a file").to_string_lossy().into_owned();
        let (spec, report) = spec::read(&file, &[]);
        let spec = spec.unwrap_or_else(|| panic!("{name}: {}", report.render(false)));
        let plan = Plan::build(spec, report, &Registry::builtin(), &[]);
        let plan = plan.unwrap_or_else(|report| panic!("{name}: {}", report.render(false)));
        let folder = tempfile::tempdir().expect("a temporary folder");
        let store = Store::open(folder.path()).expect("a new store");
        let resolver = Resolver::new(&plan, &store);
        resolver.survey(&[]);
        for id in plan.needed_instances() {
            let stage = plan.stage_of(id);
            let kind = plan.row(stage).name;
            let (Some(forms), false) = (resolver.made(id), sections.contains_key(kind)) else { continue };
            let wanted = plan.wanted(stage);
            let rows: Vec<String> = forms
                .iter()
                .filter(|(port, form)| wanted.contains(*port) && (form.layers.is_some() || form.columns.is_some()))
                .map(|(port, form)| format!("| `{port}` | {form} |\n"))
                .collect();
            if !rows.is_empty() {
                let stage = &plan.spec.stages[stage].name;
                let head =
                    format!("Before it runs, `turbid plan` says of `{stage}` in [{name}](../../pipelines/{name})");
                let text = format!("{head}:\n\n| port | will hold |\n|---|---|\n{}", rows.concat());
                sections.insert(kind.to_owned(), format!("## What it makes in a pipeline\n\n{text}"));
            }
        }
    }
    sections
}

fn pipelines() -> Vec<PathBuf> {
    let folder = super::root().join("pipelines");
    let entries =
        std::fs::read_dir(folder).expect("pipelines are shipped").map(|entry| entry.expect("an entry").path());
    let mut files: Vec<PathBuf> = entries.filter(|path| path.extension().is_some_and(|e| e == "yaml")).collect();
    files.sort_by_key(|path| (!path.ends_with("quickstart.yaml"), path.clone()));
    files
}
