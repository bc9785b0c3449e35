//! `foreach:` — the axes that a stage adds, expanded to a grid.

use std::collections::HashSet;
use std::path::Path;

use serde_json::Value;

use super::axis::{self, MAX_AXES, MAX_INSTANCES, MAX_VALUES};
use super::csv;
use super::draw::{self, Draw};
use super::mistake::{Kind, Mistake};
use super::node::{Data, Entry, Node};
use super::parse::join;
use super::reader::Reader;
use super::source::{SourceFile, Span, TextRead};
use super::suggest;

/// Bytes of a CSV file.
const MAX_TABLE: u64 = 64 << 20;

/// Keys of a `foreach` that are not themselves axes.
pub const GRAMMAR: [&str; 3] = ["zip", "csv", "draw"];

/// The axes that a stage adds to those of its inputs.
#[derive(Clone, Debug)]
pub struct Foreach {
    /// Axes in the order in which they are written; of a `draw` the index of its points.
    pub names: Vec<String>,
    /// One row of values (in the order of `names`) per instance, the last axis varying fastest; a stage without
    /// `foreach` has one row without values.
    pub rows: Vec<Vec<Value>>,
    /// What the indices on the axis `draw` stand for.
    pub draw: Option<Draw>,
    /// The CSV files that were read, as texts.
    pub tables: Vec<TextRead>,
}

impl Foreach {
    /// All names that `${}` may use: the axes, and what is drawn.
    pub fn visible(&self) -> impl Iterator<Item = &str> {
        self.names.iter().map(String::as_str).chain(self.draw.iter().flat_map(Draw::names))
    }

    /// Leaves one point of the draw, unless other axes are paired with it.
    pub fn take_first_point(&mut self) {
        let Some(axis) = self.names.iter().position(|name| name == draw::AXIS) else { return };
        let Some(first) = self.rows.first().map(|row| row[axis].clone()) else { return };
        let rest = |row: &Vec<Value>| {
            let mut row = row.clone();
            row.remove(axis);
            row
        };
        let like: Vec<Vec<Value>> = self.rows.iter().filter(|row| row[axis] == first).map(rest).collect();
        // Of more it is not worth the comparing.
        if like.len() <= 32 && self.rows.iter().all(|row| like.contains(&rest(row))) {
            self.rows.retain(|row| row[axis] == first);
            self.rows.shrink_to_fit();
        }
    }

    /// Leaves the rows of these points of the draw (ascending indices); those that [one](Self::take_first_point) point was left of have its values
    /// of the other axes.
    pub fn take_points(&mut self, indices: &[u64]) {
        let Some(axis) = self.names.iter().position(|name| name == draw::AXIS) else { return };
        let index = |row: &Vec<Value>| row[axis].as_u64();
        let there: HashSet<u64> = self.rows.iter().filter_map(index).collect();
        if indices.iter().all(|index| there.contains(index)) {
            self.rows.retain(|row| index(row).is_some_and(|index| indices.binary_search(&index).is_ok()));
            return;
        }
        let first = self.rows.first().and_then(index);
        let like: Vec<Vec<Value>> = self.rows.iter().filter(|row| index(row) == first).cloned().collect();
        let of = |&point: &u64| {
            like.iter().cloned().map(move |mut row| {
                row[axis] = Value::from(point);
                row
            })
        };
        self.rows = indices.iter().flat_map(of).collect();
    }
}

impl Default for Foreach {
    fn default() -> Self {
        Self { names: Vec::new(), rows: vec![Vec::new()], draw: None, tables: Vec::new() }
    }
}

/// Axes that go together: one for a list, several for `zip`, `csv` and `draw`.
struct Group {
    at: Span,
    names: Vec<String>,
    rows: Vec<Vec<Value>>,
}

impl Foreach {
    /// Reads the section (vars put in) of the stage of this name; `None` if it is wrong and reported.
    pub fn parse(section: &Entry, path: &str, of: (u64, &str), reader: &mut Reader<'_>) -> Option<Self> {
        let rule = "a map of axes, such as {mu_a: [0.01, 0.1]}";
        if !reader.is_map(&section.value, section.at, path, rule) {
            return None;
        }
        if section.value.entries().len() > MAX_AXES {
            reader.error(section.at, path, format!("more than {MAX_AXES} axes on one stage"), None);
            return None;
        }
        let zip = section.value.entry("zip");
        if let Some(message) = too_many(section, zip) {
            reader.error(section.at, path, Mistake::new(Kind::TooMany, message), FEWER.to_owned());
            return None;
        }
        let mut groups: Vec<Group> = Vec::new();
        let (mut draw, mut tables) = (None, Vec::new());
        let mut complete = true;
        for entry in section.value.entries().iter().filter(|e| e.key != "zip") {
            let path = join(path, &entry.key);
            let group = match csv_of(entry) {
                _ if entry.key == "draw" => {
                    draw = Draw::parse(&entry.value, entry.at, &path, of, reader);
                    draw.as_ref().map(|d: &Draw| {
                        let rows = d.indices.iter().map(|&index| vec![Value::from(index)]).collect();
                        Group { at: entry.at, names: vec![draw::AXIS.to_owned()], rows }
                    })
                }
                Some(file) => csv_group(file, entry.at, &path, reader).map(|(group, table)| {
                    tables.push(table);
                    group
                }),
                None => plain_axis(entry, zip.is_some_and(|zip| pairs(zip, &entry.key)), &path, reader),
            };
            complete &= group.is_some();
            groups.extend(group);
        }
        if let Some(zip) = zip {
            complete &= apply_zip(&mut groups, zip, &join(path, "zip"), complete, reader).is_some();
        }
        complete &= names_are_distinct(&groups, draw.as_ref(), path, reader);
        if !complete {
            return None;
        }
        let count = groups.iter().fold(1_u128, |n, g| n.saturating_mul(g.rows.len() as u128));
        if count > MAX_INSTANCES as u128 {
            let sizes: Vec<String> = groups.iter().map(|g| format!("{} {}", g.rows.len(), g.names.join("+"))).collect();
            let message = format!("{count} instances ({}) are more than {MAX_INSTANCES}", sizes.join(" x "));
            reader.error(section.at, path, Mistake::new(Kind::TooMany, message), FEWER.to_owned());
            return None;
        }
        let names: Vec<String> = groups.iter().flat_map(|g| g.names.clone()).collect();
        if names.len() > MAX_AXES {
            let message = format!("{} axes on one stage are more than {MAX_AXES}", names.len());
            reader.error(section.at, path, message, "leave out what no stage uses".to_owned());
            return None;
        }
        if count.saturating_mul(names.len() as u128) > MAX_VALUES as u128 {
            let message = format!("{count} instances with {} axes have more than {MAX_VALUES} values", names.len());
            reader.error(section.at, path, Mistake::new(Kind::TooMany, message), FEWER.to_owned());
            return None;
        }
        Some(Self { names, rows: grid(&groups), draw, tables })
    }
}

/// The way out where there are too many instances.
const FEWER: &str = "pair axes by `zip`, or give them fewer values";

/// What is wrong with the number of instances, as far as it can be told before any value is made.
fn too_many(section: &Entry, zip: Option<&Entry>) -> Option<String> {
    let axes: Vec<(&str, usize)> = section
        .value
        .entries()
        .iter()
        .filter(|e| !GRAMMAR.contains(&e.key.as_str()))
        .map(|e| (e.key.as_str(), axis::count(&e.value)))
        .filter(|(_, count)| *count > 1)
        .collect();
    let values = axes.iter().fold(0_usize, |sum, (_, count)| sum.saturating_add(*count));
    // Of axes that are paired the first counts: they have equally many values, or are wrong.
    let first = |name: &str| zip.is_none_or(|zip| !pairs(zip, name) || leads(zip, name));
    let alone: Vec<&(&str, usize)> = axes.iter().filter(|(name, _)| first(name)).collect();
    let count = alone.iter().fold(1_u128, |n, (_, count)| n.saturating_mul(*count as u128));
    if count > MAX_INSTANCES as u128 && alone.len() > 1 {
        let sizes: Vec<String> = alone.iter().map(|(name, count)| format!("{count} {name}")).collect();
        let shown = if count == u128::MAX { "far".to_owned() } else { count.to_string() };
        return Some(format!("{shown} instances ({}) are more than {MAX_INSTANCES}", sizes.join(" x ")));
    }
    (values > MAX_VALUES).then(|| format!("the axes have {values} values, more than {MAX_VALUES}"))
}

/// Whether the axis `name` is the first of those that it is paired with.
fn leads(zip: &Entry, name: &str) -> bool {
    let named = |node: &Node| matches!(&node.data, Data::Text { text, .. } if text == name);
    let first = |list: &Node| matches!(&list.data, Data::List(names) if names.first().is_some_and(named));
    matches!(&zip.value.data, Data::List(lists) if lists.iter().any(first))
}

/// All combinations, the last group varying fastest.
fn grid(groups: &[Group]) -> Vec<Vec<Value>> {
    groups.iter().fold(vec![Vec::new()], |rows, group| {
        let mut longer = Vec::with_capacity(rows.len() * group.rows.len());
        for row in &rows {
            for more in &group.rows {
                longer.push(row.iter().chain(more).cloned().collect());
            }
        }
        longer
    })
}

/// Whether `zip` pairs the axis `name` with others.
fn pairs(zip: &Entry, name: &str) -> bool {
    let named = |node: &Node| matches!(&node.data, Data::Text { text, .. } if text == name);
    matches!(&zip.value.data, Data::List(lists)
        if lists.iter().any(|list| matches!(&list.data, Data::List(names) if names.iter().any(named))))
}

/// An axis of its own; where it is paired with others its values may repeat, for then only the pairs must differ.
fn plain_axis(entry: &Entry, paired: bool, path: &str, reader: &mut Reader<'_>) -> Option<Group> {
    let named = reader.name(&entry.key, entry.at, path, "an axis");
    let values = axis::values(&entry.value, entry.at, path, reader)?;
    if !paired && !axis::distinct(&values, &entry.value, entry.at, path, reader) {
        return None;
    }
    let rows = values.into_iter().map(|v| vec![v]).collect();
    named.then(|| Group { at: entry.at, names: vec![entry.key.clone()], rows })
}

/// `csv: file`, or `name: {csv: file}`.
fn csv_of(entry: &Entry) -> Option<&Node> {
    match entry.value.entries() {
        _ if entry.key == "csv" => Some(&entry.value),
        [one] if one.key == "csv" => Some(&one.value),
        _ => None,
    }
}

fn csv_group(file: &Node, at: Span, path: &str, reader: &mut Reader<'_>) -> Option<(Group, TextRead)> {
    let name = reader.text(file, at, path, "the path of a CSV file")?;
    let base = reader.sources.get(file.span.file as usize).map(|s| s.base.clone()).unwrap_or_default();
    let full = base.join(name);
    match read_table(&full) {
        Ok((csv::Table { names, rows }, table)) => Some((Group { at, names, rows }, table)),
        Err(why) => {
            reader.error(file.span, path, format!("`{}`: {why}", full.display()), None);
            None
        }
    }
}

fn read_table(path: &Path) -> Result<(csv::Table, TextRead), String> {
    let file = SourceFile::read(path, "a CSV file", MAX_TABLE)?;
    let table = csv::parse(&file.text)?;
    match repeated(&table.rows) {
        Some(twice) => Err(format!("row {} repeats an earlier one", twice + 1)),
        None => Ok((table, TextRead::of(path, &file.text, MAX_TABLE))),
    }
}

/// The first row that an earlier one equals.
fn repeated(rows: &[Vec<Value>]) -> Option<usize> {
    let mut seen = HashSet::new();
    rows.iter().position(|row| !seen.insert(Value::from(row.clone()).to_string()))
}

/// `zip: [[a, b]]`: the named axes become one group at the place of the first.
fn apply_zip(groups: &mut Vec<Group>, zip: &Entry, path: &str, complete: bool, reader: &mut Reader<'_>) -> Option<()> {
    let rule = "a list of lists of axes, such as [[a, b]]";
    let Data::List(lists) = &zip.value.data else {
        let names: Vec<&str> = zip.value.entries().iter().map(|e| e.key.as_str()).collect();
        let axes: Vec<String> = names.iter().map(|name| format!("{name}: [..]")).collect();
        let way_out = format!("write the axes beside it: `{}, zip: [[{}]]`", axes.join(", "), names.join(", "));
        let message = format!("`zip` is {}, but must be {rule}", zip.value.described());
        let place = if zip.value.span.len == 0 { zip.at } else { zip.value.span };
        let mistake = Mistake::new(Kind::WrongType, message).hint((!names.is_empty()).then_some(way_out));
        reader.error(place, path, mistake, None);
        return None;
    };
    // `zip: [a, b]`: one mistake, not one for each name.
    let names: Option<Vec<&str>> =
        lists.iter().map(|n| if let Data::Text { text, .. } = &n.data { Some(text.as_str()) } else { None }).collect();
    if let Some(names) = names.filter(|names| !names.is_empty()) {
        let names = names.join(", ");
        let message = "`zip` is a list of names, but must be a list of lists of axes that go together";
        reader.error(zip.value.span, path, message, format!("write `zip: [[{names}]]`"));
        return None;
    }
    let mut holds = Some(());
    for (i, list) in lists.iter().enumerate() {
        let path = join(path, &i.to_string());
        if zip_one(groups, list, zip.at, &path, complete, reader).is_none() {
            holds = None;
        }
    }
    holds
}

fn zip_one(
    groups: &mut Vec<Group>,
    list: &Node,
    key: Span,
    path: &str,
    complete: bool,
    reader: &mut Reader<'_>,
) -> Option<()> {
    let Data::List(names) = &list.data else {
        reader.wrong(list, key, path, "a list of axes that go together, such as [a, b]");
        return None;
    };
    let mut places = Vec::new();
    for (i, name) in names.iter().enumerate() {
        let path = join(path, &i.to_string());
        let text = reader.text(name, list.span, &path, "the name of an axis")?;
        match groups.iter().position(|g| g.names == [text]) {
            Some(place) if places.contains(&place) => {
                reader.error(name.span, &path, format!("`{text}` is paired with itself"), None);
                return None;
            }
            Some(place) => places.push(place),
            // An axis that is wrong itself is not in `groups`; say nothing of what follows from that.
            None if !complete => return None,
            None => {
                let known = groups.iter().filter(|g| g.names.len() == 1).map(|g| g.names[0].as_str());
                let hint = suggest::hint(text, known).unwrap_or_else(|| {
                    "`zip` pairs axes that stand beside it in this `foreach`; those of inputs cannot be paired again".to_owned()
                });
                reader.error(name.span, &path, format!("`{text}` is no axis of this stage that could be paired"), hint);
                return None;
            }
        }
    }
    let &[first, ref others @ ..] = places.as_slice() else {
        reader.error(list.span, path, "zip needs the names of two or more axes", None);
        return None;
    };
    for &other in others {
        let (a, b) = (&groups[first], &groups[other]);
        if a.rows.len() != b.rows.len() {
            let (a, n, b, m) = (&a.names[0], a.rows.len(), &b.names[0], b.rows.len());
            reader.error(
                list.span,
                path,
                format!("`{a}` has {n} values and `{b}` has {m}; paired axes need equally many"),
                None,
            );
            return None;
        }
    }
    for &other in others {
        let paired = std::mem::take(&mut groups[other].rows);
        let names = std::mem::take(&mut groups[other].names);
        groups[first].names.extend(names);
        groups[first].rows.iter_mut().zip(paired).for_each(|(row, more)| row.extend(more));
    }
    if let Some(twice) = repeated(&groups[first].rows) {
        let group = &groups[first];
        let values = group.names.iter().zip(&group.rows[twice]).map(|(name, value)| format!("{name} = {value}"));
        let message = format!("{} stands twice among the pairs", values.collect::<Vec<_>>().join(", "));
        reader.error(list.span, path, message, None);
        return None;
    }
    groups.retain(|g| !g.names.is_empty());
    Some(())
}

fn names_are_distinct(groups: &[Group], draw: Option<&Draw>, path: &str, reader: &mut Reader<'_>) -> bool {
    let mut seen: HashSet<&str> = draw.into_iter().flat_map(Draw::names).collect();
    let mut distinct = true;
    for group in groups {
        for name in &group.names {
            if !seen.insert(name.as_str()) {
                reader.error(group.at, path, format!("the axis `{name}` is given twice"), None);
                distinct = false;
            }
        }
    }
    distinct
}
