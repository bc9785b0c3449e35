//! `stages:` — one step of the pipeline each.

use std::collections::BTreeSet;

use super::foreach::Foreach;
use super::input::InputSpec;
use super::mistake::{Kind, Mistake};
use super::node::{Data, Entry, Node};
use super::parse::join;
use super::reader::{Meant, Reader};
use super::seed::{self, SeedSpec};
use super::suggest;
use super::template::Template;
use super::vars::Vars;

/// The keys of a stage.
pub const KEYS: [&str; 6] = ["use", "in", "with", "foreach", "product", "seed"];

/// A stage as it stands in the file.
#[derive(Clone, Debug)]
pub struct StageSpec {
    pub name: String,
    /// What `use:` names; empty if that is missing and reported.
    pub use_name: String,
    pub inputs: Vec<InputSpec>,
    pub foreach: Foreach,
    /// Whether inputs with different axes may be combined to a grid.
    pub product: bool,
    /// Explicit seed: common random numbers between designs.
    pub seed: Option<SeedSpec>,
    /// Part of the stage is wrong and reported; what follows from that need not be.
    pub broken: bool,
    /// Sections that are misspelt or could not be read whole: what they lack is not reported.
    pub(super) unread: Vec<&'static str>,
    /// Place among the entries of `stages:`.
    pub(super) entry: usize,
    pub(super) with: Template,
}

/// What `${}` may name: vars, and the axes of the whole pipeline.
pub struct Sections<'a> {
    pub vars: &'a Vars,
    pub axes: &'a BTreeSet<String>,
}

/// Reads the `foreach` of a stage.
pub fn parse_foreach(entry: &Entry, vars: &Vars, seed: u64, reader: &mut Reader<'_>) -> Option<Foreach> {
    let path = join(&join("stages", &entry.key), "foreach");
    let Some(section) = entry.value.entry("foreach") else { return Some(Foreach::default()) };
    if matches!(section.value.data, Data::Null) {
        return Some(Foreach::default());
    }
    let expanded = Entry { value: vars.expand(&section.value, &path, reader), ..section.clone() };
    Foreach::parse(&expanded, &path, (seed, &entry.key), reader)
}

/// Reads the rest of a stage.
pub fn parse(
    index: usize,
    entry: &Entry,
    foreach: Option<Foreach>,
    sections: &Sections<'_>,
    reader: &mut Reader<'_>,
) -> StageSpec {
    let path = join("stages", &entry.key);
    let named = reader.name(&entry.key, entry.at, &path, "a stage");
    let mut stage = StageSpec {
        name: entry.key.clone(),
        use_name: String::new(),
        inputs: Vec::new(),
        broken: foreach.is_none() || !named,
        foreach: foreach.unwrap_or_default(),
        product: false,
        seed: None,
        unread: Vec::new(),
        entry: index,
        with: Template::default(),
    };
    if !reader.is_map(&entry.value, entry.at, &path, "a map with `use`, and with `in` and `with` where needed") {
        stage.broken = true;
        return stage;
    }
    if !reader.known_keys(&entry.value, &path, &KEYS, "a stage") {
        stage.broken = true;
        let unknown = entry.value.entries().iter().map(|e| e.key.as_str()).filter(|k| !KEYS.contains(k));
        let meant = unknown.filter_map(|key| suggest::nearest(key, KEYS));
        stage.unread.extend(meant.filter(|key| entry.value.entry(key).is_none()));
    }
    match entry.value.entry("use") {
        Some(e) => {
            match reader.text(&e.value, e.at, &join(&path, "use"), "the name of a stage (see `turbid stages`)") {
                Some(name) => stage.use_name = name.to_owned(),
                None => stage.broken = true,
            }
        }
        None => {
            if !stage.unread.contains(&"use") {
                reader.error(
                    entry.at,
                    &path,
                    Mistake::new(Kind::Missing, format!("stage `{}` has no `use`", entry.key)),
                    "`turbid stages` lists what it can name".to_owned(),
                );
            }
            stage.broken = true;
        }
    }
    if let Some(section) = filled(&entry.value, "in") {
        let (inputs, complete) = InputSpec::parse_all(section, &join(&path, "in"), sections.vars, reader);
        stage.inputs = inputs;
        if !complete {
            stage.broken = true;
            stage.unread.push("in");
        }
    }
    if let Some(section) = filled(&entry.value, "with") {
        let path = join(&path, "with");
        if reader.is_map(&section.value, section.at, &path, "a map of parameters") {
            stage.with = Template::compile(&section.value, &path, sections.vars, sections.axes, reader);
        } else {
            stage.broken = true;
            stage.unread.push("with");
        }
    }
    if let Some(e) = filled(&entry.value, "product") {
        match e.value.data {
            Data::Bool(b) => stage.product = b,
            _ => reader.wrong_as(&e.value, e.at, &join(&path, "product"), "true or false", Meant::Bool),
        }
    }
    if let Some(e) = filled(&entry.value, "seed") {
        let path = join(&path, "seed");
        let expanded = Entry { value: sections.vars.expand(&e.value, &path, reader), ..e.clone() };
        stage.seed = seed::parse(&expanded, &path, reader);
    }
    stage
}

/// A section that is there and not empty.
fn filled<'n>(node: &'n Node, key: &str) -> Option<&'n Entry> {
    node.entry(key).filter(|e| !matches!(e.value.data, Data::Null))
}
