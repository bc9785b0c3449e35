//! Tables and records of many instances in one table: the rows of all, below each other, with axes as columns.

use std::collections::BTreeSet;

use serde_json::Value;
use turbid_contract::canonical::canonical_text;
use turbid_contract::{Artifact, Attributes, Axes, Cells, Column, Record, Table};

use super::ExportError;

/// What stands before the name of an axis that a column has too.
const AXIS: &str = "axis.";
/// What stands before the name of an attribute in which instances differ.
const ATTRIBUTE: &str = "attributes.";

/// The rows of instances that came one after another.
#[derive(Default)]
pub struct Gathered {
    columns: Vec<Column>,
    /// Of each instance the values of its axes, its number of rows, and its attributes where they are not those of the first.
    values: Vec<Axes>,
    rows: Vec<usize>,
    attributes: Vec<Option<Attributes>>,
    first: Attributes,
}

impl Gathered {
    /// Adds the rows of an instance, of a record one. Errors: images; other columns than those before.
    pub fn add(&mut self, label: &str, values: Axes, artifact: Artifact) -> Result<(), ExportError> {
        let table = match artifact {
            Artifact::Table(table) => table,
            Artifact::Record(record) => row(record),
            Artifact::Images(_) => unreachable!("images are stacked"),
        };
        let differs = |what: String| ExportError::Differs { label: label.to_owned(), what };
        let rows = table.rows();
        if self.values.is_empty() {
            self.columns = table.columns;
            self.first.clone_from(&table.attributes);
        } else {
            self.append(table.columns).map_err(differs)?;
        }
        self.rows.push(rows);
        self.attributes.push((table.attributes != self.first).then_some(table.attributes));
        self.values.push(values);
        Ok(())
    }

    fn append(&mut self, columns: Vec<Column>) -> Result<(), String> {
        let names = |columns: &[Column]| columns.iter().map(|c| c.name.as_str()).collect::<Vec<_>>().join(", ");
        if self.columns.len() != columns.len() || self.columns.iter().zip(&columns).any(|(a, b)| a.name != b.name) {
            return Err(format!("the columns {}, not {}", names(&columns), names(&self.columns)));
        }
        for (all, own) in self.columns.iter_mut().zip(columns) {
            if all.unit != own.unit {
                return Err(format!("the column `{}` in {}, not in {}", own.name, shown(&own.unit), shown(&all.unit)));
            }
            extend(&mut all.cells, own.cells).map_err(|what| format!("in column `{}` {what}", own.name))?;
        }
        Ok(())
    }

    /// The table: axes, attributes in which instances differ, columns. Its attributes are those that all have alike.
    pub fn finish(self) -> Table {
        let Self { columns, values, rows, attributes, first } = self;
        let of = |at: usize| attributes[at].as_ref().unwrap_or(&first);
        let all = || (0..attributes.len()).map(of);
        let keys: BTreeSet<&String> =
            attributes.iter().flatten().flat_map(Attributes::keys).chain(first.keys()).collect();
        let different: BTreeSet<&String> = keys
            .into_iter()
            .filter(|key| attributes.iter().flatten().any(|own| own.get(*key) != first.get(*key)))
            .collect();
        let mut table = Table::default();
        for axis in values.first().map(Axes::keys).into_iter().flatten() {
            let is_column = columns.iter().any(|column| column.name == *axis);
            let name = if is_column { format!("{AXIS}{axis}") } else { axis.clone() };
            push(&mut table, name, cells(values.iter().map(|values| values.get(axis))), &rows);
        }
        for key in &different {
            push(&mut table, format!("{ATTRIBUTE}{key}"), cells(all().map(|own| own.get(*key))), &rows);
        }
        table.attributes =
            first.iter().filter(|(key, _)| !different.contains(key)).map(|(k, v)| (k.clone(), v.clone())).collect();
        table.columns.extend(columns);
        table
    }
}

/// Adds a column in which the cell of an instance stands in each of its rows.
fn push(table: &mut Table, name: String, cells: Cells, rows: &[usize]) {
    fn repeated<T: Clone>(cells: &[T], rows: &[usize]) -> Vec<T> {
        cells.iter().zip(rows).flat_map(|(cell, &n)| std::iter::repeat_n(cell.clone(), n)).collect()
    }
    let unit = if matches!(cells, Cells::Text(_)) { "" } else { "1" };
    let cells = match &cells {
        Cells::F64(v) => Cells::F64(repeated(v, rows)),
        Cells::MaybeF64(v) => Cells::MaybeF64(repeated(v, rows)),
        Cells::I64(v) => Cells::I64(repeated(v, rows)),
        Cells::Bool(v) => Cells::Bool(repeated(v, rows)),
        Cells::Text(v) => Cells::Text(repeated(v, rows)),
    };
    table.push(name, unit, cells);
}

/// Values as the cells of a column: whole numbers, numbers, of which some may be missing, truth values, or text.
pub(super) fn cells<'a>(values: impl Iterator<Item = Option<&'a Value>> + Clone) -> Cells {
    fn all<'a, T>(values: impl Iterator<Item = Option<&'a Value>>, of: impl Fn(&Value) -> Option<T>) -> Option<Vec<T>> {
        values.map(|value| value.and_then(&of)).collect()
    }
    if let Some(cells) = all(values.clone(), Value::as_i64) {
        return Cells::I64(cells);
    }
    if let Some(cells) = all(values.clone(), Value::as_f64) {
        return Cells::F64(cells);
    }
    if let Some(cells) = all(values.clone(), Value::as_bool) {
        return Cells::Bool(cells);
    }
    let known = |value: &Option<&Value>| value.is_some_and(|value| !value.is_null());
    if values.clone().filter(known).flatten().all(Value::is_number) {
        return Cells::MaybeF64(values.map(|value| value.and_then(Value::as_f64)).collect());
    }
    Cells::Text(values.map(|value| value.map_or_else(String::new, text)).collect())
}

fn text(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        other => canonical_text(other),
    }
}

/// A record as a table of one row; nested fields are JSON text.
fn row(record: Record) -> Table {
    let mut table = Table::default();
    for (name, value) in record.fields {
        let cells = match value {
            Value::Array(_) | Value::Object(_) => Cells::Text(vec![text(&value)]),
            plain => cells(std::iter::once(Some(&plain))),
        };
        table.push(name, "", cells);
    }
    table
}

/// Adds cells to those of the same column. Error: they are of another kind.
fn extend(all: &mut Cells, own: Cells) -> Result<(), String> {
    let maybe = |cells: &Cells| match cells {
        Cells::MaybeF64(v) => Some(v.clone()),
        Cells::F64(v) => Some(v.iter().copied().map(Some).collect()),
        Cells::I64(v) => Some(v.iter().map(|&n| Some(n as f64)).collect()),
        Cells::Bool(_) | Cells::Text(_) => None,
    };
    match (&mut *all, own) {
        (Cells::F64(a), Cells::F64(b)) => a.extend(b),
        (Cells::MaybeF64(a), Cells::MaybeF64(b)) => a.extend(b),
        (Cells::I64(a), Cells::I64(b)) => a.extend(b),
        (Cells::Bool(a), Cells::Bool(b)) => a.extend(b),
        (Cells::Text(a), Cells::Text(b)) => a.extend(b),
        (a, b) => {
            let (Some(mut numbers), Some(more)) = (maybe(a), maybe(&b)) else {
                return Err(format!("{}, not {}", kind(&b), kind(a)));
            };
            numbers.extend(more);
            *a = match numbers.iter().copied().collect::<Option<Vec<f64>>>() {
                Some(numbers) => Cells::F64(numbers),
                None => Cells::MaybeF64(numbers),
            };
        }
    }
    Ok(())
}

fn kind(cells: &Cells) -> &'static str {
    match cells {
        Cells::F64(_) | Cells::MaybeF64(_) | Cells::I64(_) => "numbers",
        Cells::Bool(_) => "truth values",
        Cells::Text(_) => "text",
    }
}

fn shown(unit: &str) -> String {
    if unit.is_empty() { "no unit".to_owned() } else { format!("`{unit}`") }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn axes(value: Value) -> Axes {
        Axes::from([("mu_a".to_owned(), value), ("site".to_owned(), json!("µ, \"x\""))])
    }

    fn table(rows: usize, g: f64) -> Artifact {
        let mut table = Table::default();
        table.push("mu_a", "mm^-1", Cells::F64((0..rows).map(|i| i as f64).collect()));
        table.push("n", "1", if rows > 1 { Cells::I64(vec![3; rows]) } else { Cells::MaybeF64(vec![None; rows]) });
        table.attributes = Attributes::from([("g".to_owned(), json!(g)), ("n".to_owned(), json!(1.4))]);
        Artifact::Table(table)
    }

    /// Rows of all with axes beside them; an axis that a column has too has another name, attributes that differ are columns.
    #[test]
    fn rows_have_their_axes() {
        let mut all = Gathered::default();
        all.add("a", axes(json!(0.1)), table(2, 0.8)).unwrap();
        all.add("b", axes(json!(1)), table(0, 0.9)).unwrap();
        all.add("c", axes(json!(2)), table(1, 0.7)).unwrap();
        let table = all.finish();
        let names: Vec<&str> = table.columns.iter().map(|c| c.name.as_str()).collect();
        assert_eq!(names, ["axis.mu_a", "site", "attributes.g", "mu_a", "n"]);
        assert_eq!(table.columns[0].cells, Cells::F64(vec![0.1, 0.1, 2.0]));
        assert_eq!(table.columns[1].cells, Cells::Text(vec!["µ, \"x\"".to_owned(); 3]));
        assert_eq!(table.columns[2].cells, Cells::F64(vec![0.8, 0.8, 0.7]));
        assert_eq!(table.columns[3].cells, Cells::F64(vec![0.0, 1.0, 0.0]));
        assert_eq!(table.columns[4].cells, Cells::MaybeF64(vec![Some(3.0), Some(3.0), None]));
        assert_eq!(
            (table.columns[3].unit.as_str(), &table.attributes),
            ("mm^-1", &Attributes::from([("n".to_owned(), json!(1.4))]))
        );
    }

    #[test]
    fn records_are_rows_and_what_does_not_fit_is_named() {
        let record = |height: Value, name: Value| {
            let fields = [("height", height), ("name", name), ("lens", json!({"f": 2}))];
            Artifact::Record(Record { fields: fields.map(|(k, v)| (k.to_owned(), v)).into() })
        };
        let mut all = Gathered::default();
        all.add("a", axes(json!(1)), record(json!(null), json!("x"))).unwrap();
        all.add("b", axes(json!(2)), record(json!(2.5), json!("y"))).unwrap();
        let table = all.finish();
        let of = |name: &str| table.columns.iter().find(|c| c.name == name).unwrap().cells.clone();
        assert_eq!(of("mu_a"), Cells::I64(vec![1, 2]));
        assert_eq!(of("lens"), Cells::Text(vec!["{\"f\":2}".to_owned(); 2]));
        let mut other = Gathered::default();
        other.add("a", axes(json!(1)), record(json!(1), json!("x"))).unwrap();
        let error = other.add("c", axes(json!(3)), record(json!(1), json!(true))).unwrap_err().to_string();
        assert!(error.contains("c has in column `name` truth values, not text"), "{error}");
        let mut other = Gathered::default();
        other.add("a", axes(json!(1)), table_of("x", "mm")).unwrap();
        for (artifact, says) in
            [(table_of("y", "mm"), "b has the columns y, not x"), (table_of("x", ""), "in no unit, not in `mm`")]
        {
            let error = other.add("b", axes(json!(1)), artifact).unwrap_err().to_string();
            assert!(error.contains(says), "{error}");
        }
    }

    fn table_of(column: &str, unit: &str) -> Artifact {
        let mut table = Table::default();
        table.push(column, unit, Cells::F64(vec![1.0]));
        Artifact::Table(table)
    }
}
