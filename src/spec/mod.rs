//! YAML text to a [`Spec`]: stages, vars, axes, studies, each with its place in the file.
//!
//! The engine's floor of grammar: it knows neither stages nor physics. The text becomes a tree whose keys and values
//! know their places ([`parse`]), included files and `--set` overrides are merged into it, vars are put in, and each
//! section is read into plain types. Mistakes are collected in a [`Report`]; reading goes on after each of them.

mod aliases;
mod axis;
pub mod csv;
mod dataset;
pub mod diagnostic;
mod draw;
mod excerpt;
mod foreach;
mod input;
mod merge;
mod mistake;
mod node;
mod overrides;
mod parse;
mod reader;
mod recover;
mod relevant;
mod report;
mod scalar;
mod schema;
mod seed;
mod source;
mod stage;
mod study;
mod substitute;
mod template;
mod vars;

#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::path::{Path, PathBuf};

use serde_json::Value;
use turbid_contract::{At, Axes, Problem, suggest};

pub use crate::ids::{Id, IdVec, StageId};
pub use dataset::{DatasetSpec, Dtype, FeatureSpec, KeepSpec, LayerFilter};
pub use diagnostic::{Diagnostic, Severity};
pub use draw::{AXIS as DRAW_AXIS, Draw};
pub use foreach::Foreach;
pub use input::{InputSpec, SourceRef};
pub use mistake::{Kind, Mistake};
pub use recover::{ParamProblem, read_params};
pub use report::Report;
pub use schema::schema;
pub use seed::SeedSpec;
pub use source::{SourceFile, Span, TextRead};
pub use stage::StageSpec;
pub use study::StudySpec;
pub use turbid_contract::suggest::{hint as known_or_nearest, nearest};

use node::{Data, Entry, Node};
use parse::join;
use reader::Reader;
use vars::Vars;

/// The keys of a pipeline file.
const ROOT_KEYS: [&str; 8] = ["pipeline", "about", "seed", "vars", "include", "stages", "studies", "datasets"];

/// More stages than this are a mistake (instances are made by `foreach`).
const MAX_STAGES: usize = 10_000;

/// A pipeline as it stands in its files.
#[derive(Clone, Debug)]
pub struct Spec {
    /// The name; that of the file where `pipeline:` is left out.
    pub pipeline: String,
    pub about: Option<String>,
    /// 0 where it is left out.
    pub seed: u64,
    /// With references to other vars put in.
    pub vars: BTreeMap<String, Value>,
    /// In the order of the file.
    pub stages: IdVec<StageId, StageSpec>,
    pub studies: Vec<StudySpec>,
    pub datasets: Vec<DatasetSpec>,
    /// The file, what it includes, and the overrides.
    pub sources: Vec<SourceFile>,
    /// So many of them are files; overrides follow.
    files: usize,
    /// As given: `stages.frames.with.samples=64`.
    pub overrides: Vec<String>,
    /// Places in `stages` by name.
    places: HashMap<String, StageId>,
    /// Where each axis stands that has a key of its own below a `foreach`: its key, its values. The first of a name.
    written_axes: HashMap<String, (Span, Span)>,
    /// All axes, also columns of tables and what is drawn.
    axes: HashSet<String>,
    /// What is legal in the file and its overrides, but probably not meant.
    pub warnings: Vec<Diagnostic>,
    root: Node,
}

/// A part of a stage that a mistake can be in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Section {
    /// The stage as a whole.
    Stage,
    Use,
    In,
    With,
    Foreach,
    Product,
    Seed,
}

impl Section {
    fn key(self) -> Option<&'static str> {
        match self {
            Self::Stage => None,
            Self::Use => Some("use"),
            Self::In => Some("in"),
            Self::With => Some("with"),
            Self::Foreach => Some("foreach"),
            Self::Product => Some("product"),
            Self::Seed => Some("seed"),
        }
    }
}

/// Reads a pipeline file, what it includes, and the overrides; on any mistake, all of them.
pub fn load(path: &Path, overrides: &[String]) -> Result<Spec, Report> {
    match read(path, overrides) {
        (Some(spec), report) if !report.has_errors() => Ok(spec),
        (_, report) => Err(report),
    }
}

/// What can be read of a pipeline file, and its mistakes: lets the caller add those that it finds in what was read,
/// so that the user sees all at once. Stages with [`StageSpec::broken`] set are reported already.
pub fn read(path: &Path, overrides: &[String]) -> (Option<Spec>, Report) {
    read_from(merge::read_source(path), path, overrides)
}

/// The same from the bytes of a file that would stand at `path`.
pub fn read_bytes(path: &Path, bytes: &[u8], overrides: &[String]) -> (Option<Spec>, Report) {
    read_from(SourceFile::of_bytes(path, bytes), path, overrides)
}

fn read_from(file: Result<SourceFile, String>, path: &Path, overrides: &[String]) -> (Option<Spec>, Report) {
    let mut report = Report::default();
    let mut sources = Vec::new();
    let Some(mut root) = merge::read_all(file, path, &mut sources, &mut report) else { return (None, report) };
    let files = sources.len();
    overrides::apply(&mut root, overrides, &mut sources, &mut report);
    let mut reader = Reader { sources: &sources, report: &mut report };
    reader.known_keys(&root, "", &ROOT_KEYS, "a pipeline");
    let vars = Vars::resolve(root.entry("vars"), &mut reader);
    let pipeline = read_name(&root, path, &mut reader);
    let about = root.entry("about").and_then(|e| reader.text(&e.value, e.at, "about", "a text")).map(str::to_owned);
    let seed = root.entry("seed").and_then(|e| {
        let value = vars.expand(&e.value, "seed", &mut reader);
        reader.whole_number(&value, e.at, "seed")
    });
    // The stages may be in an included file that could not be read.
    let stages = match root.entry("stages") {
        None if reader.report.mentions("include") => Vec::new(),
        _ => read_stages(&root, &vars, seed.unwrap_or(0), &mut reader),
    };
    let datasets = dataset::parse_all(root.entry("datasets"), &vars, &mut reader);
    let studies = study::parse_all(root.entry("studies"), &root, &mut reader);
    let stages: IdVec<StageId, StageSpec> = stages.into();
    let places = stages.iter_ids().map(|(id, stage)| (stage.name.clone(), id)).collect();
    let mut written_axes = HashMap::new();
    let foreach =
        root.get("stages").map(Node::entries).unwrap_or_default().iter().filter_map(|e| e.value.get("foreach"));
    for axis in foreach.flat_map(written_in) {
        written_axes.entry(axis.key.clone()).or_insert((axis.at, axis.value.span));
    }
    let axes = stages.iter().flat_map(|stage| stage.foreach.visible().map(str::to_owned)).collect();
    let spec = Spec {
        files,
        written_axes,
        axes,
        pipeline,
        about,
        seed: seed.unwrap_or(0),
        vars: vars.values,
        stages,
        studies,
        datasets,
        sources,
        overrides: overrides.to_vec(),
        places,
        warnings: report.warnings(),
        root,
    };
    (Some(spec), report)
}

fn read_name(root: &Node, path: &Path, reader: &mut Reader<'_>) -> String {
    let stem = || path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    let Some(entry) = root.entry("pipeline") else {
        let name = stem();
        if !reader::is_name(&name) {
            let hint = "add `pipeline: NAME`".to_owned();
            reader.error(root.span, "pipeline", "the pipeline has no name, and that of the file cannot be one", hint);
        }
        return name;
    };
    let name = reader.text(&entry.value, entry.at, "pipeline", "the name of the pipeline").map(str::to_owned);
    if let Some(name) = &name {
        reader.name(name, entry.value.span, "pipeline", "a pipeline");
    }
    name.unwrap_or_else(stem)
}

fn read_stages(root: &Node, vars: &Vars, seed: u64, reader: &mut Reader<'_>) -> Vec<StageSpec> {
    let Some(section) = root.entry("stages") else {
        let hint = "add `stages:` with one entry per step; `turbid new` writes an example".to_owned();
        reader.error(Span { column: 1, line: 1, len: 1, ..root.span }, "stages", "the pipeline has no stages", hint);
        return Vec::new();
    };
    if !reader.is_map(&section.value, section.at, "stages", "a map of stages, such as `tissue: {use: scene}`") {
        return Vec::new();
    }
    let entries = section.value.entries();
    if entries.len() > MAX_STAGES {
        let message = format!("{} stages are more than {MAX_STAGES}", entries.len());
        reader.error(section.at, "stages", message, "`foreach` makes many instances of one stage".to_owned());
        return Vec::new();
    }
    if entries.is_empty() {
        reader.error(section.at, "stages", "the pipeline has no stages", None);
    }
    let mut foreach: Vec<Option<Foreach>> = Vec::with_capacity(entries.len());
    let mut values = 0;
    for entry in entries {
        let read = stage::parse_foreach(entry, vars, seed, reader);
        values += read.as_ref().map_or(0, |f| f.rows.len() * f.names.len());
        if values > axis::MAX_VALUES {
            let message = format!("the axes of all stages make more than {} values", axis::MAX_VALUES);
            reader.error(entry.at, &join("stages", &entry.key), message, "give them fewer values".to_owned());
            return Vec::new();
        }
        foreach.push(read);
    }
    // A stage may use the axes of any stage before it, so all must be known before `with` is read.
    let mut axes: BTreeSet<String> = foreach.iter().flatten().flat_map(Foreach::visible).map(str::to_owned).collect();
    if foreach.iter().any(Option::is_none) {
        axes.extend(written_axes(entries));
    }
    let sections = stage::Sections { vars, axes: &axes };
    let read = entries.iter().zip(foreach).enumerate();
    read.map(|(i, (entry, foreach))| stage::parse(i, entry, foreach, &sections, reader)).collect()
}

/// Names below `foreach` as written: where axes are wrong, what uses them is not wrong too. The names in a CSV file that
/// cannot be read are not known, so any name in the stages may be one of them.
fn written_axes(stages: &[Entry]) -> Vec<String> {
    let sections = stages.iter().filter_map(|e| e.value.get("foreach")).flat_map(Node::entries);
    let mut names = Vec::new();
    let mut any = false;
    for entry in sections {
        match entry.key.as_str() {
            "csv" => any = true,
            "draw" | "zip" => names.extend(entry.value.entries().iter().map(|e| e.key.clone())),
            key if !foreach::GRAMMAR.contains(&key) => {
                names.push(entry.key.clone());
                any |= entry.value.get("csv").is_some();
            }
            _ => {}
        }
    }
    if any {
        names.extend(stages.iter().flat_map(|e| vars::names_in(&e.value)));
    }
    names
}

impl Spec {
    /// Place in `stages` of the stage of this name.
    pub fn stage(&self, name: &str) -> Option<StageId> {
        self.places.get(name).copied()
    }

    /// The pipeline file and what it includes.
    pub fn files(&self) -> &[SourceFile] {
        &self.sources[..self.files]
    }

    /// The pipeline file, what it includes, and the tables of its axes.
    pub fn texts(&self) -> impl Iterator<Item = TextRead> {
        let files =
            self.files().iter().map(|source| TextRead::of(Path::new(&source.name), &source.text, source::MAX_PIPELINE));
        files.chain(self.stages.iter().flat_map(|stage| stage.foreach.tables.iter().cloned()))
    }

    /// The params of an instance of a stage: `with`, with vars and the axes of the instance put in.
    pub fn params(&self, stage: StageId, axes: &Axes) -> Result<Value, Vec<Diagnostic>> {
        let with = &self.stages[stage].with;
        with.params(axes, &self.vars).map_err(|wrong| self.unfilled(stage, axes, wrong))
    }

    fn unfilled(&self, stage: StageId, axes: &Axes, wrong: Vec<template::Unfilled>) -> Vec<Diagnostic> {
        let diagnostic = |u: template::Unfilled| {
            let known = axes.keys().map(String::as_str);
            let hint = u.name.and_then(|name| suggest::hint(&name, known));
            self.diagnostic(stage, Section::With, &u.path, u.message, hint)
        };
        wrong.into_iter().map(diagnostic).collect()
    }

    /// The directory that the file name at this field path below `with` is relative to: that of the YAML file in which
    /// it (or the var or axis that it is made of) stands; for an override, the working directory.
    pub fn input_file_base(&self, stage: StageId, at: &str) -> PathBuf {
        let with = self.stage_node(stage).get("with");
        let steps = at.split('.').filter(|s| !s.is_empty());
        let node = steps.fold(with, |node, step| node.and_then(|n| n.step(step)).map(|(_, n)| n).or(node));
        let file = node.map_or(0, |n| self.origin(n, 0));
        self.sources.get(file as usize).map(|s| s.base.clone()).unwrap_or_default()
    }

    /// The file in which the value of `node` stands, through `${name}` alone.
    fn origin(&self, node: &Node, depth: usize) -> u32 {
        if let Some(name) = sole_name(node).filter(|_| depth < parse::MAX_DEPTH) {
            let axis = self.written_axes.get(&name).map(|(_, values)| values.file);
            let var = self.root.get("vars").and_then(|v| v.get(&name)).map(|n| self.origin(n, depth + 1));
            return axis.or(var).unwrap_or(node.span.file);
        }
        node.span.file
    }

    /// Key and value of the var that a text names, where it names one alone; else what is given. An axis hides a var of its name.
    fn through_vars<'n>(&'n self, at: (Span, &'n Node), depth: usize) -> (Span, &'n Node) {
        let Some(name) = sole_name(at.1) else { return at };
        let is_axis = self.axes.contains(&name);
        match self.root.get("vars").and_then(|vars| vars.entry(&name)) {
            Some(var) if !is_axis && depth < parse::MAX_DEPTH => self.through_vars((var.at, &var.value), depth + 1),
            _ => at,
        }
    }

    /// The whole file with includes and overrides, as data.
    pub fn resolved(&self) -> Value {
        self.root.to_json()
    }

    /// A mistake at the deepest part of a path from the root of the file that stands in it.
    pub fn at_path(&self, path: &[&str], mistake: impl Into<Mistake>, hint: Option<String>) -> Diagnostic {
        let mut place = Span { column: 1, line: 1, len: 1, ..self.root.span };
        let mut at = Some(&self.root);
        for step in path {
            at = at.and_then(|node| node.step(step)).map(|(key, next)| {
                place = if next.span.len == 0 { key } else { next.span };
                next
            });
        }
        Diagnostic::at(&self.sources, place, path.join("."), mistake.into().and_hint(hint))
    }

    /// The same pipeline with those points of the stage's draw alone that have these indices (ascending).
    pub fn with_points(&self, stage: StageId, indices: &[u64]) -> Self {
        let mut spec = self.clone();
        spec.stages[stage].foreach.take_points(indices);
        spec
    }

    /// The same pipeline with one point of each draw: of a large one no list of instances is held.
    /// [`with_points`](Self::with_points) brings in the others.
    pub fn with_first_points(mut self) -> Self {
        for stage in self.stages.ids() {
            self.stages[stage].foreach.take_first_point();
        }
        self
    }

    /// What a stage found wrong, at its place.
    pub fn problem(&self, stage: StageId, problem: Problem) -> Diagnostic {
        let section = match problem.at {
            At::With => Section::With,
            At::In => Section::In,
        };
        let path: Vec<&str> = problem.path.split('.').filter(|p| !p.is_empty()).collect();
        self.diagnostic(stage, section, &path, problem.message, problem.hint)
    }

    /// Where the axis stands that a text names alone.
    fn axis_of(&self, node: &Node) -> Option<Span> {
        self.written_axes.get(&sole_name(node)?).map(|(key, _)| *key)
    }

    /// An error at the deepest part of `path` (below the section) that stands in the file.
    pub fn diagnostic<S: AsRef<str>>(
        &self,
        stage: StageId,
        section: Section,
        path: &[S],
        mistake: impl Into<Mistake>,
        hint: Option<String>,
    ) -> Diagnostic {
        let spec = &self.stages[stage];
        let mut mistake = mistake.into().and_hint(hint);
        if section == Section::In && mistake.kind == Kind::WrongValue {
            mistake.kind = Kind::Graph;
        }
        let mut full = join("stages", &spec.name);
        let mut at = self.root.get("stages").and_then(|s| s.entries().get(spec.entry)).map(|e| (e.at, &e.value));
        let mut complete = true;
        let mut used = None;
        for step in section.key().into_iter().chain(path.iter().map(AsRef::as_ref)) {
            full = join(&full, step);
            let Some((from, through)) = at.map(|at| (at, self.through_vars(at, 0))) else { break };
            match through.1.step(step) {
                Some(next) if complete => {
                    // What stands in a var is also shown where the var is used.
                    if !std::ptr::eq(from.1, through.1) {
                        used = used.or(Some(from.1.span));
                    }
                    at = Some(next);
                }
                _ => complete = false,
            }
        }
        let Some((key, written)) = at else { return Diagnostic::nowhere(mistake) };
        // What is wrong with `"${samples}"` is wrong where the var stands.
        let (key, node) = if complete { self.through_vars((key, written), 0) } else { (key, written) };
        if !std::ptr::eq(node, written) {
            used = used.or(Some(written.span));
        }
        // What is missing is missing below a key; what is unknown is the key; what is wrong is the value.
        let about_key = !complete || node.span.len == 0 || mistake.kind == Kind::UnknownKey;
        let place = if about_key { key } else { node.span };
        let mut diagnostic = Diagnostic::at(&self.sources, place, full, mistake);
        diagnostic = match (used, self.axis_of(node).filter(|_| complete)) {
            (Some(used), _) => diagnostic.also(&self.sources, used, "used here"),
            (None, Some(axis)) => diagnostic.also(&self.sources, axis, "the axis"),
            (None, None) => diagnostic,
        };
        let unread = section.key().is_some_and(|key| spec.unread.contains(&key));
        let lacks = section == Section::With || path.is_empty();
        diagnostic.follow_up = complete && (node.holds_broken() || written.holds_broken())
            || unread && lacks
            || section == Section::With && spec.with.is_broken(path);
        diagnostic
    }

    /// A mistake in a key of a study.
    pub fn at_study(&self, study: &str, key: &str, message: impl Into<String>) -> Diagnostic {
        let node = self.root.get("studies").and_then(|studies| studies.get(study));
        let entry = node.and_then(|node| node.entry(key));
        let span = entry.map_or(self.root.span, |entry| entry.value.span);
        let path = format!("studies.{study}.{key}");
        Diagnostic::at(&self.sources, span, &path, Mistake::new(Kind::WrongValue, message))
    }

    /// The same experiment with other random numbers, explicit and common seeds included; 0 is the file itself. What is drawn stays: scenes are the same.
    #[must_use]
    pub fn repeated(mut self, repeat: u64) -> Self {
        if repeat > 0 {
            self.seed = seed::of_repeat(self.seed, repeat);
            for stage in self.stages.ids() {
                self.stages[stage].seed = self.stages[stage].seed.map(|seed| seed.repeated(repeat));
            }
        }
        self
    }

    fn stage_node(&self, stage: StageId) -> &Node {
        let stages = self.root.get("stages").expect("a spec with a stage has a section of stages");
        &stages.entries()[self.stages[stage].entry].value
    }
}

/// Axes, and what is drawn: it is known by name as an axis is.
fn written_in(foreach: &Node) -> impl Iterator<Item = &Entry> {
    let drawn = foreach.get("draw").map(Node::entries).unwrap_or_default();
    foreach.entries().iter().chain(drawn)
}

/// The name in a text that is `${name}` alone.
fn sole_name(node: &Node) -> Option<String> {
    let Data::Text { text, .. } = &node.data else { return None };
    match substitute::pieces(text).ok()?.as_mut_slice() {
        [substitute::Piece::Name(name)] => Some(std::mem::take(name)),
        _ => None,
    }
}
