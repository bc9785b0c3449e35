//! `turbid dataset stats`: statistics of columns, costs and counts of a folder.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde_json::{Map, Value, json};
use turbid_contract::{Cells, Table};

use crate::cli::{Done, Failure, print, print_json};
use crate::dataset::tables::{Tables, tables};
use crate::dataset::verify;

pub fn run(to: &Path, as_json: bool) -> Done {
    let columns = verify::statistics(to).map_err(Failure::Input)?;
    let tables = tables(to).map_err(Failure::Input)?;
    if as_json {
        let known = json!({
            "columns": columns, "index": summary(&tables), "costs": rows(&tables.costs), "counts": rows(&tables.counts),
        });
        print_json(&known.to_string());
    } else {
        print(&text(&columns, &tables));
    }
    Ok(())
}

fn text(columns: &[Value], tables: &Tables) -> String {
    let mut text = String::from("columns of the samples\n");
    let tensors: Vec<Vec<String>> = columns
        .iter()
        .map(|row| {
            let name = match row["channel"].as_str().unwrap_or_default() {
                "" => word(&row["column"]),
                channel => format!("{} ({channel})", word(&row["column"])),
            };
            let numbers = ["n", "mean", "sd", "min", "max"].map(|key| word(&row[key]));
            [word(&row["split"]), name].into_iter().chain(numbers).chain([word(&row["unit"])]).collect()
        })
        .collect();
    text += &aligned(&["split", "column", "n", "mean", "sd", "min", "max", "unit"], tensors);
    text += "\ndrawn quantities and measures of samples\n";
    let keys = ["split", "column", "n", "mean", "sd", "min", "q05", "q25", "q50", "q75", "q95", "max"];
    text += &aligned(&keys, summary(tables).iter().map(|row| keys.map(|key| word(&row[key])).to_vec()).collect());
    text += "\ncosts\n";
    let keys = ["split", "reject", "samples", "cpu_s", "cpu_s_per_sample"];
    text += &aligned(&keys, rows(&tables.costs).iter().map(|row| keys.map(|key| word(&row[key])).to_vec()).collect());
    text += "\npoints\n";
    text += &aligned(&["split", "reject", "points", "groups"], points(&rows(&tables.counts)));
    text
}

/// Points and groups of each split and reason.
fn points(counts: &[Value]) -> Vec<Vec<String>> {
    let mut by: BTreeMap<(String, String), (i64, BTreeSet<String>)> = BTreeMap::new();
    for row in counts {
        let (points, groups) = by.entry((word(&row["split"]), word(&row["reject"]))).or_default();
        *points += row["n"].as_i64().unwrap_or_default();
        if !row["group"].is_null() {
            groups.insert(row["group"].to_string());
        }
    }
    let line = |((split, reject), (points, groups)): ((String, String), (i64, BTreeSet<String>))| {
        let groups = if groups.is_empty() { "-".to_owned() } else { groups.len().to_string() };
        vec![split, reject, points.to_string(), groups]
    };
    by.into_iter().map(line).collect()
}

fn summary(tables: &Tables) -> Vec<Value> {
    let row = |of: &turbid_tables::summary::Summary| {
        let mut row = json!({
            "split": of.split, "column": of.column, "n": of.n, "mean": of.mean, "sd": of.sd, "min": of.min, "max": of.max,
        });
        for ((name, _), quantile) in turbid_tables::summary::QUANTILES.iter().zip(of.quantiles) {
            row[*name] = json!(quantile);
        }
        row
    };
    tables.summary.iter().map(row).collect()
}

/// Rows of a table, each a map from column to value.
fn rows(table: &Table) -> Vec<Value> {
    let cell = |cells: &Cells, row: usize| match cells {
        Cells::F64(cells) => json!(cells[row]),
        Cells::MaybeF64(cells) => json!(cells[row]),
        Cells::I64(cells) => json!(cells[row]),
        Cells::Bool(cells) => json!(cells[row]),
        Cells::Text(cells) => json!(cells[row]),
    };
    let row = |row: usize| table.columns.iter().map(|c| (c.name.clone(), cell(&c.cells, row))).collect::<Map<_, _>>();
    (0..table.rows()).map(|at| Value::Object(row(at))).collect()
}

/// `-` for what is not known or not said.
fn word(value: &Value) -> String {
    match value {
        Value::String(text) if !text.is_empty() => text.clone(),
        Value::Number(number) if number.is_f64() => digits(number.as_f64().unwrap_or_default()),
        Value::Number(number) => number.to_string(),
        _ => "-".to_owned(),
    }
}

/// Five digits.
fn digits(number: f64) -> String {
    let size = number.abs();
    if size == 0.0 {
        "0".to_owned()
    } else if (1e-3..1e5).contains(&size) {
        let before = size.log10().floor() as i32;
        format!("{number:.0$}", usize::try_from(4 - before).unwrap_or(0))
    } else {
        format!("{number:.4e}")
    }
}

/// Lines whose cells stand below each other: the first two to the left, numbers to the right.
fn aligned(names: &[&str], rows: Vec<Vec<String>>) -> String {
    let mut lines = vec![names.iter().map(|&name| name.to_owned()).collect::<Vec<_>>()];
    lines.extend(rows);
    let width = |place: usize| lines.iter().map(|line| line[place].chars().count()).max().unwrap_or_default();
    let widths: Vec<usize> = (0..names.len()).map(width).collect();
    let cell = |(place, cell): (usize, &String)| match place {
        0 | 1 => format!("{cell:<0$}", widths[place]),
        _ => format!("{cell:>0$}", widths[place]),
    };
    let line = |line: &Vec<String>| {
        format!("  {}\n", line.iter().enumerate().map(cell).collect::<Vec<_>>().join("  ").trim_end())
    };
    lines.iter().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_five_digits() {
        let shown = [0.0, 0.023344, -1.5, 99.9996, 12345.6, 2.3e-4, 1e7].map(digits);
        assert_eq!(shown, ["0", "0.023344", "-1.5000", "100.000", "12346", "2.3000e-4", "1.0000e7"]);
        assert_eq!([json!(null), json!(""), json!(3), json!("a")].map(|value| word(&value)), ["-", "-", "3", "a"]);
    }
}
