//! `datasets:` — which outputs of a drawn pipeline make the samples of a data set, and how they are split.

use turbid_contract::suggest;
use turbid_draw::Condition;

use super::mistake::{Kind, Mistake};
use super::node::{Data, Entry, Node};
use super::parse::join;
use super::reader::{Meant, Reader};
use super::source::Span;
use super::vars::Vars;

const KEYS: [&str; 10] =
    ["sample", "splits", "far", "keep", "about", "license", "cite", "published", "shards", "store"];

/// A data set as it stands in the file.
#[derive(Clone, Debug, PartialEq)]
pub struct DatasetSpec {
    pub name: String,
    pub sample: Vec<FeatureSpec>,
    /// Splits with their shares, in the order of the file.
    pub splits: Vec<(String, f64)>,
    /// The group that no two splits share.
    pub by: Option<String>,
    /// Further splits: samples that meet all conditions stand there and in no other.
    pub far: Vec<(String, Vec<Condition>)>,
    pub keep: Vec<KeepSpec>,
    pub about: Option<String>,
    pub license: Option<String>,
    pub cite: Option<String>,
    /// A day, YYYY-MM-DD.
    pub published: Option<String>,
    /// Rows of a shard.
    pub rows: usize,
    /// Whether the store gives back what its samples held once it is in a shard.
    pub shards_only: bool,
}

/// A column of a sample: `frames: {from: shots.frames, f_x: 0.1, phase: 0}` or `mu_a: frames.truth.mu_a`.
#[derive(Clone, Debug, PartialEq)]
pub struct FeatureSpec {
    pub name: String,
    /// STAGE, STAGE.PORT, STAGE.LAYER or STAGE.PORT.LAYER, cut at the points.
    pub from: Vec<String>,
    pub layers: LayerFilter,
    /// Of a tensor; numbers are float64.
    pub dtype: Dtype,
}

/// Which layers of a stack are meant; empty lists mean any.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LayerFilter {
    pub f_x_per_mm: Vec<f64>,
    pub phase_rad: Vec<f64>,
    pub orientation_deg: Vec<f64>,
    pub wavelength_nm: Vec<f64>,
}

/// `"frames.error: m_ac per pixel": {below: 2}`: a sample whose measure, or column of a table of one row, lies elsewhere is rejected.
#[derive(Clone, Debug, PartialEq)]
pub struct KeepSpec {
    /// As it is written; the reason of a reject.
    pub text: String,
    pub stage: String,
    /// A measure, or PORT.COLUMN.
    pub what: String,
    pub above: Option<f64>,
    pub below: Option<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dtype {
    Float32,
    Float16,
}

impl Dtype {
    pub fn name(self) -> &'static str {
        match self {
            Self::Float32 => "float32",
            Self::Float16 => "float16",
        }
    }

    pub fn bytes(self) -> usize {
        match self {
            Self::Float32 => 4,
            Self::Float16 => 2,
        }
    }

    /// What stands under `dtype`, if anything does.
    fn read(map: &Node, path: &str, reader: &mut Reader<'_>) -> Option<Self> {
        let of = [Self::Float32, Self::Float16];
        choice(map, "dtype", of.map(Self::name), path, reader).map(|place| of[place])
    }
}

/// Rows of a shard where the file says nothing.
const ROWS: u64 = 512;

/// Reads all data sets (vars put in).
pub fn parse_all(section: Option<&Entry>, vars: &Vars, reader: &mut Reader<'_>) -> Vec<DatasetSpec> {
    let Some(section) = section.filter(|s| !matches!(s.value.data, Data::Null)) else { return Vec::new() };
    reader.is_map(&section.value, section.at, "datasets", "a map of data sets");
    let entries = section.value.entries().iter();
    let expanded =
        entries.map(|e| Entry { value: vars.expand(&e.value, &join("datasets", &e.key), reader), ..e.clone() });
    let expanded: Vec<Entry> = expanded.collect();
    expanded.iter().filter_map(|entry| DatasetSpec::parse(entry, reader)).collect()
}

impl DatasetSpec {
    fn parse(entry: &Entry, reader: &mut Reader<'_>) -> Option<Self> {
        let path = join("datasets", &entry.key);
        let named = reader.name(&entry.key, entry.at, &path, "a data set");
        if !reader.is_map(&entry.value, entry.at, &path, "a map with `sample` and `splits`") {
            return None;
        }
        let before = reader.report.errors();
        reader.known_keys(&entry.value, &path, &KEYS, "a data set");
        let text = |key: &str, reader: &mut Reader<'_>| {
            let found = entry.value.entry(key)?;
            reader.text(&found.value, found.at, &join(&path, key), "a text").map(str::to_owned)
        };
        let (about, license, cite) = (text("about", reader), text("license", reader), text("cite", reader));
        let published = text("published", reader);
        if let (Some(day), Some(found)) = (&published, entry.value.entry("published"))
            && !is_day(day)
        {
            reader.wrong(&found.value, found.at, &join(&path, "published"), "a day, such as \"2026-03-31\"");
        }
        let (splits, by) = parse_splits(entry.value.entry("splits"), &join(&path, "splits"), reader);
        let far = parse_far(entry.value.entry("far"), &join(&path, "far"), &splits, reader);
        let keep = parse_keep(entry.value.entry("keep"), &join(&path, "keep"), reader);
        let (rows, dtype) = parse_shards(entry.value.entry("shards"), &join(&path, "shards"), reader);
        let sample = parse_sample(entry, &path, dtype, reader);
        let mut shards_only = false;
        if let Some(store) = entry.value.entry("store") {
            let path = join(&path, "store");
            match reader.text(&store.value, store.at, &path, "keep or shards_only") {
                None | Some("keep") => {}
                Some("shards_only") => shards_only = true,
                Some(_) => reader.wrong(&store.value, store.at, &path, "keep or shards_only"),
            }
        }
        if !named || reader.report.errors() > before {
            return None;
        }
        let name = entry.key.clone();
        Some(Self { name, sample, splits, by, far, keep, about, license, cite, published, rows, shards_only })
    }
}

/// YYYY-MM-DD.
fn is_day(text: &str) -> bool {
    let parts: Vec<&str> = text.split('-').collect();
    let number = |part: &str| part.bytes().all(|b| b.is_ascii_digit()).then(|| part.parse::<u32>().ok()).flatten();
    match parts.as_slice() {
        [year, month, day] if [year.len(), month.len(), day.len()] == [4, 2, 2] => {
            let within = |part, most| number(part).is_some_and(|n| (1..=most).contains(&n));
            number(year).is_some() && within(month, 12) && within(day, 31)
        }
        _ => false,
    }
}

fn parse_sample(dataset: &Entry, path: &str, usual: Dtype, reader: &mut Reader<'_>) -> Vec<FeatureSpec> {
    let Some(section) = dataset.value.entry("sample") else {
        let hint = "add `sample: {frames: frames.frames, mu_a: frames.truth.mu_a}`".to_owned();
        reader.error(dataset.at, path, Mistake::new(Kind::Missing, "the data set has no `sample`"), hint);
        return Vec::new();
    };
    let path = join(path, "sample");
    if !reader.is_map(&section.value, section.at, &path, "a map of features, such as {mu_a: frames.truth.mu_a}") {
        return Vec::new();
    }
    if section.value.entries().is_empty() {
        reader.error(section.at, &path, "a sample needs a feature", None);
    }
    section
        .value
        .entries()
        .iter()
        .filter_map(|entry| parse_feature(entry, &join(&path, &entry.key), usual, reader))
        .collect()
}

fn parse_feature(entry: &Entry, path: &str, usual: Dtype, reader: &mut Reader<'_>) -> Option<FeatureSpec> {
    const KEYS: [&str; 6] = ["from", "f_x", "phase", "orientation_deg", "wavelength_nm", "dtype"];
    let named = reader.name(&entry.key, entry.at, path, "a feature");
    let rule = "STAGE.PORT, STAGE.PORT.LAYER, or {from: STAGE.PORT, f_x: 0.1, phase: 0}";
    let (mut layers, mut dtype) = (LayerFilter::default(), usual);
    let (from, at) = match &entry.value.data {
        Data::Map(_) => {
            reader.known_keys(&entry.value, path, &KEYS, "a feature");
            let Some(from) = entry.value.entry("from") else {
                reader.error(entry.at, path, Mistake::new(Kind::Missing, "the feature has no `from`"), None);
                return None;
            };
            let mut numbers = |key: &str| match entry.value.entry(key) {
                None => Some(Vec::new()),
                Some(found) => numbers(&found.value, found.at, &join(path, key), reader),
            };
            layers = LayerFilter {
                f_x_per_mm: numbers("f_x")?,
                phase_rad: numbers("phase")?,
                orientation_deg: numbers("orientation_deg")?,
                wavelength_nm: numbers("wavelength_nm")?,
            };
            dtype = Dtype::read(&entry.value, path, reader).unwrap_or(usual);
            (&from.value, from.at)
        }
        _ => (&entry.value, entry.at),
    };
    let text = reader.text(from, at, path, rule)?;
    let from: Vec<String> = text.split('.').map(str::to_owned).collect();
    if from.len() > 3 || from.iter().any(String::is_empty) {
        reader.wrong(&entry.value, entry.at, path, rule);
        return None;
    }
    named.then(|| FeatureSpec { name: entry.key.clone(), from, layers, dtype })
}

/// A number, or a list of numbers.
fn numbers(node: &Node, key: Span, path: &str, reader: &mut Reader<'_>) -> Option<Vec<f64>> {
    let items = match &node.data {
        Data::List(items) => items.iter().collect(),
        _ => vec![node],
    };
    let read = items.into_iter().map(|item| number(item, key, path, reader));
    read.collect::<Vec<_>>().into_iter().collect()
}

fn number(node: &Node, key: Span, path: &str, reader: &mut Reader<'_>) -> Option<f64> {
    if let Data::Number(n) = &node.data {
        return n.as_f64();
    }
    reader.wrong_as(node, key, path, "a number", Meant::Number);
    None
}

fn parse_splits(section: Option<&Entry>, path: &str, reader: &mut Reader<'_>) -> (Vec<(String, f64)>, Option<String>) {
    let Some(section) = section else { return (vec![("train".to_owned(), 1.0)], None) };
    if !reader.is_map(&section.value, section.at, path, "a map of shares, such as {train: 0.8, test: 0.2}") {
        return (Vec::new(), None);
    }
    let (mut splits, mut by) = (Vec::new(), None);
    for entry in section.value.entries() {
        let path = join(path, &entry.key);
        if entry.key == "by" {
            by = reader.text(&entry.value, entry.at, &path, "the name of a group").map(str::to_owned);
            continue;
        }
        if !is_split(&entry.key) {
            let message = format!("`{}` cannot name a split: letters, digits and _ can", entry.key);
            reader.error(entry.at, &path, message, None);
        }
        match number(&entry.value, entry.at, &path, reader) {
            Some(share) if share > 0.0 && share <= 1.0 => splits.push((entry.key.clone(), share)),
            Some(share) => {
                reader.error(entry.value.span, &path, format!("the share {share} must lie in (0, 1]"), None);
            }
            None => {}
        }
    }
    let sum: f64 = splits.iter().map(|(_, share)| share).sum();
    if splits.is_empty() || (sum - 1.0).abs() > 1e-9 {
        let shares: Vec<String> = splits.iter().map(|(name, share)| format!("{name} {share}")).collect();
        let message = format!("the shares of the splits ({}) sum to {sum}, but must sum to 1", shares.join(", "));
        reader.error(section.at, path, message, None);
    }
    (splits, by)
}

/// Names of splits are parts of names of files, `NAME-00000-of-00040.parquet`.
fn is_split(name: &str) -> bool {
    !name.is_empty() && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_')
}

fn parse_far(
    section: Option<&Entry>,
    path: &str,
    splits: &[(String, f64)],
    reader: &mut Reader<'_>,
) -> Vec<(String, Vec<Condition>)> {
    let Some(section) = section else { return Vec::new() };
    if !reader.is_map(
        &section.value,
        section.at,
        path,
        "a map of splits with conditions, such as {test_far: [[mu_a, above, 0.1]]}",
    ) {
        return Vec::new();
    }
    let mut far = Vec::new();
    for entry in section.value.entries() {
        let path = join(path, &entry.key);
        if !is_split(&entry.key) || splits.iter().any(|(name, _)| *name == entry.key) {
            let message = format!("`{}` cannot name a further split: it has another use, or other signs", entry.key);
            reader.error(entry.at, &path, message, None);
        }
        let list = entry.value.to_json();
        // Which names are drawn is known with the pipeline; here their form is read.
        let names: Vec<String> =
            list.as_array().into_iter().flatten().filter_map(|c| c[0].as_str()).map(str::to_owned).collect();
        let others = list.as_array().into_iter().flatten().filter_map(|c| c[2].as_str()).map(str::to_owned);
        let names: Vec<String> = names.iter().cloned().chain(others).collect();
        match Condition::read_list(&list, &names.iter().map(String::as_str).collect::<Vec<_>>()) {
            Ok(conditions) if !conditions.is_empty() => far.push((entry.key.clone(), conditions)),
            Ok(_) => reader.error(entry.at, &path, "a further split needs a condition", None),
            Err(mistakes) => {
                for mistake in mistakes {
                    let place = if entry.value.span.len == 0 { entry.at } else { entry.value.span };
                    reader.error(place, &path, mistake.message, mistake.hint);
                }
            }
        }
    }
    far
}

fn parse_keep(section: Option<&Entry>, path: &str, reader: &mut Reader<'_>) -> Vec<KeepSpec> {
    let Some(section) = section else { return Vec::new() };
    let rule = "a map of limits, such as {maps.masked: {below: 25}}";
    if !reader.is_map(&section.value, section.at, path, rule) {
        return Vec::new();
    }
    let mut keep = Vec::new();
    for entry in section.value.entries() {
        let path = format!("{path}.{}", entry.key);
        if !reader.is_map(&entry.value, entry.at, &path, "{below: NUMBER}, {above: NUMBER} or both") {
            continue;
        }
        let known = reader.known_keys(&entry.value, &path, &["above", "below"], "a limit");
        let limit = |key: &str, reader: &mut Reader<'_>| {
            entry.value.entry(key).and_then(|found| number(&found.value, found.at, &path, reader))
        };
        let (above, below) = (limit("above", reader), limit("below", reader));
        let Some((stage, what)) = entry.key.split_once('.') else {
            let message = "a limit is on STAGE.MEASURE or on STAGE.PORT.COLUMN";
            reader.error(entry.at, &path, message, None);
            continue;
        };
        if known && above.is_none() && below.is_none() {
            reader.error(entry.at, &path, "a limit needs `above` or `below`", None);
        }
        let (stage, what) = (stage.to_owned(), what.trim().to_owned());
        keep.push(KeepSpec { text: entry.key.clone(), stage, what, above, below });
    }
    keep
}

fn parse_shards(section: Option<&Entry>, path: &str, reader: &mut Reader<'_>) -> (usize, Dtype) {
    let usual = (ROWS as usize, Dtype::Float32);
    let Some(section) = section else { return usual };
    if !reader.is_map(&section.value, section.at, path, "a map such as {rows: 512, compression: zstd, dtype: float32}")
    {
        return usual;
    }
    reader.known_keys(&section.value, path, &["rows", "compression", "dtype"], "shards");
    let rows = match section.value.entry("rows") {
        None => ROWS,
        Some(entry) => {
            let path = join(path, "rows");
            let rows = reader.whole_number(&entry.value, entry.at, &path).unwrap_or(ROWS);
            if !(1..=1_000_000).contains(&rows) {
                reader.error(entry.value.span, &path, format!("rows = {rows} must lie in 1..1000000"), None);
            }
            rows
        }
    };
    if choice(&section.value, "compression", ["zstd", "none"], path, reader) == Some(1) {
        let path = join(path, "compression");
        reader.error(section.at, &path, "shards are compressed by zstd", "leave `compression` out".to_owned());
    }
    let dtype = Dtype::read(&section.value, path, reader).unwrap_or(usual.1);
    (usize::try_from(rows).unwrap_or(usual.0), dtype)
}

/// Which of two names stands under a key.
fn choice(map: &Node, key: &str, names: [&str; 2], path: &str, reader: &mut Reader<'_>) -> Option<usize> {
    let entry = map.entry(key)?;
    let path = join(path, key);
    let rule = format!("{} or {}", names[0], names[1]);
    let name = reader.text(&entry.value, entry.at, &path, &rule)?;
    let found = names.iter().position(|known| *known == name);
    if found.is_none() {
        reader.error(entry.value.span, &path, format!("`{name}` must be {rule}"), suggest::hint(name, names));
    }
    found
}

impl KeepSpec {
    /// Whether a value lies within the limits.
    pub fn holds(&self, value: f64) -> bool {
        self.above.is_none_or(|above| value > above) && self.below.is_none_or(|below| value < below)
    }
}

impl LayerFilter {
    /// Whether a layer of these numbers is meant; those that it does not have cannot be asked for.
    pub fn fits(&self, numbers: [Option<f64>; 4]) -> bool {
        let lists = [&self.f_x_per_mm, &self.phase_rad, &self.orientation_deg, &self.wavelength_nm];
        let near = |a: f64, b: f64| (a - b).abs() <= 1e-9 * a.abs().max(b.abs()).max(1.0);
        lists.iter().zip(numbers).all(|(list, number)| {
            list.is_empty() || number.is_some_and(|number| list.iter().any(|&wanted| near(wanted, number)))
        })
    }
}
