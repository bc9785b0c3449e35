//! `studies:` — sweeps over a whole pipeline, which `turbid study` runs.

use std::collections::HashSet;

use serde_json::Value;

use super::axis;
use super::node::{Data, Entry, Node};
use super::overrides;
use super::parse::join;
use super::reader::Reader;
use super::source::Span;
use super::suggest;

/// What a study can report about an estimate.
pub const ERRORS: [&str; 5] = ["rmse_percent", "bias_percent", "masked_percent", "rmse", "bias"];

/// More than this in one study is a mistake.
const MAX_VARIED: usize = 100;
const MAX_POINTS: usize = 10_000;
const MAX_REPEATS: u64 = 1000;

const KEYS: [&str; 8] = ["about", "vary", "repeats", "estimate", "truth", "error", "also", "reference"];

/// `{vary: {stages.frames.with.samples: [16, 64]}, repeats: 4, estimate: maps.mu_a, truth: frames.truth, error: rmse_percent}`
#[derive(Clone, Debug, PartialEq)]
pub struct StudySpec {
    pub name: String,
    pub about: Option<String>,
    /// Paths as `--set` takes them, each with its values.
    pub vary: Vec<(String, Vec<Value>)>,
    /// How often each point is computed, with other random numbers each time.
    pub repeats: u64,
    pub estimate: String,
    pub truth: Option<String>,
    pub error: String,
    /// Other results: each a column with the same error of it, or a measure.
    pub also: Vec<String>,
    /// Points of others to show beside: a CSV file with columns cpu_seconds, error and perhaps label; relative to the pipeline file.
    pub reference: Option<String>,
}

impl StudySpec {
    /// Reads a study; `root` is the pipeline that it varies, `stages` the names of its stages.
    pub fn parse(entry: &Entry, root: &Node, stages: &HashSet<&str>, reader: &mut Reader<'_>) -> Option<Self> {
        let path = join("studies", &entry.key);
        let named = reader.name(&entry.key, entry.at, &path, "a study");
        if !reader.is_map(&entry.value, entry.at, &path, "a map with `vary`, `estimate`, `truth`, `error`") {
            return None;
        }
        let known = reader.known_keys(&entry.value, &path, &KEYS, "a study");
        let mut required = |key: &str, what: &str| {
            let found = entry.value.entry(key);
            if found.is_none() && known {
                reader.error(entry.at, &path, format!("`{key}` is missing: {what}"), None);
            }
            found
        };
        let vary = required("vary", "what the study changes, such as {vars.samples: [16, 64]}");
        let estimate = required("estimate", "what it looks at, such as maps.mu_a");
        let error = required("error", "the error that it reports, such as rmse_percent");
        let vary = vary.and_then(|e| parse_vary(e, root, &join(&path, "vary"), reader));
        let estimate = estimate.and_then(|e| parse_result(e, (root, stages), &join(&path, "estimate"), reader));
        let truth = entry.value.entry("truth").map(|e| parse_result(e, (root, stages), &join(&path, "truth"), reader));
        let error = error.and_then(|e| {
            let path = join(&path, "error");
            let name = reader.text(&e.value, e.at, &path, "the name of an error")?;
            if !ERRORS.contains(&name) {
                let hint = suggest::hint(name, ERRORS);
                reader.error(e.value.span, &path, format!("`{name}` is no error that a study knows"), hint);
                return None;
            }
            Some(name.to_owned())
        });
        let text = |key: &str, what: &str, reader: &mut Reader<'_>| match entry.value.entry(key) {
            Some(e) => reader.text(&e.value, e.at, &join(&path, key), what).map(|text| Some(text.to_owned())),
            None => Some(None),
        };
        let about = text("about", "a text", reader);
        let reference = text("reference", "the name of a CSV file", reader);
        let repeats = match entry.value.entry("repeats") {
            Some(e) => parse_repeats(e, &join(&path, "repeats"), reader),
            None => Some(1),
        };
        let also = match entry.value.entry("also") {
            Some(e) => parse_also(e, (root, stages), &join(&path, "also"), reader),
            None => Some(Vec::new()),
        };
        if !named || !known || matches!(truth, Some(None)) {
            return None;
        }
        let found = Self {
            name: entry.key.clone(),
            about: about?,
            vary: vary?,
            repeats: repeats?,
            estimate: estimate?,
            truth: truth.flatten(),
            error: error?,
            also: also?,
            reference: reference?,
        };
        let points = found.vary.iter().map(|(_, values)| values.len()).try_fold(1_usize, usize::checked_mul);
        let points = points.and_then(|n| n.checked_mul(usize::try_from(found.repeats).ok()?));
        if points.is_none_or(|n| n > MAX_POINTS) {
            let message = format!("the study has more than {MAX_POINTS} points");
            reader.error(entry.at, &path, message, Some("vary fewer values, or repeat them less often".to_owned()));
            return None;
        }
        Some(found)
    }
}

fn parse_repeats(entry: &Entry, path: &str, reader: &mut Reader<'_>) -> Option<u64> {
    let repeats = reader.whole_number(&entry.value, entry.at, path)?;
    if (1..=MAX_REPEATS).contains(&repeats) {
        return Some(repeats);
    }
    let message = format!("repeats = {repeats} must lie in [1, {MAX_REPEATS}]");
    reader.error(entry.value.span, path, message, None);
    None
}

fn parse_also(
    entry: &Entry,
    known: (&Node, &HashSet<&str>),
    path: &str,
    reader: &mut Reader<'_>,
) -> Option<Vec<String>> {
    let Data::List(items) = &entry.value.data else {
        reader.wrong(&entry.value, entry.at, path, "a list of results such as [maps.mu_s_prime]");
        return None;
    };
    let item = |(i, item): (usize, &Node)| {
        let entry = Entry { key: i.to_string(), at: item.span, value: item.clone() };
        parse_result(&entry, known, &format!("{path}.{i}"), reader)
    };
    items.iter().enumerate().map(item).collect()
}

fn parse_vary(section: &Entry, root: &Node, path: &str, reader: &mut Reader<'_>) -> Option<Vec<(String, Vec<Value>)>> {
    if !reader.is_map(&section.value, section.at, path, "a map such as {vars.samples: [16, 64]}") {
        return None;
    }
    if section.value.entries().len() > MAX_VARIED {
        reader.error(section.at, path, format!("a study varies at most {MAX_VARIED} things"), None);
        return None;
    }
    let mut found = Vec::new();
    for entry in section.value.entries() {
        let path = format!("{path}.{}", entry.key);
        if let Err((message, hint)) = overrides::check_path(root, &entry.key) {
            reader.error(entry.at, &path, message, hint);
            continue;
        }
        let values = axis::values(&entry.value, entry.at, &path, reader)
            .filter(|values| axis::distinct(values, &entry.value, entry.at, &path, reader));
        found.extend(values.map(|v| (entry.key.clone(), v)));
    }
    (found.len() == section.value.entries().len()).then_some(found)
}

/// `stage.port`: the stage must be there.
fn parse_result(
    entry: &Entry,
    (root, stages): (&Node, &HashSet<&str>),
    path: &str,
    reader: &mut Reader<'_>,
) -> Option<String> {
    let text = reader.text(&entry.value, entry.at, path, "a result such as maps.mu_a")?;
    let stage = text.split('.').next().unwrap_or(text);
    if stages.contains(stage) {
        return Some(text.to_owned());
    }
    let names = root.get("stages").map(Node::entries).unwrap_or_default().iter().map(|s| s.key.as_str());
    let hint = suggest::hint(stage, names);
    let place: Span = entry.value.span;
    reader.error(place, path, format!("there is no stage `{stage}`"), hint);
    None
}

/// Reads all studies.
pub fn parse_all(section: Option<&Entry>, root: &Node, reader: &mut Reader<'_>) -> Vec<StudySpec> {
    let Some(section) = section.filter(|s| !matches!(s.value.data, Data::Null)) else { return Vec::new() };
    reader.is_map(&section.value, section.at, "studies", "a map of studies");
    let stages = root.get("stages").map(Node::entries).unwrap_or_default().iter().map(|s| s.key.as_str()).collect();
    section.value.entries().iter().filter_map(|e| StudySpec::parse(e, root, &stages, reader)).collect()
}
