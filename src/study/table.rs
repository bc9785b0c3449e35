//! The table of a study: a row for each point and repeat.

use serde_json::Value;
use turbid_contract::{Cells, Table};

use crate::spec::StudySpec;

use super::points::{Point, plain, series};
use super::studied::Row;

/// Unit of an error of this name.
pub fn unit_of<'a>(error: &str, own: &'a str) -> &'a str {
    if error.ends_with("_percent") { "%" } else { own }
}

/// Columns: `series`, `point`, the varied paths, `repeat`, `error`, `stated_se`, `error_where_stated`, `pixels`, `cpu_seconds` (of what the point does not share with the others of its
/// repeat), `shared_cpu_seconds`, `seconds`, `flights`, `peak_bytes`, one for each of `also`, `failed`.
///
/// What is not known is null; of a point that failed all is, but the reason.
pub fn table(study: &StudySpec, rows: &[Row]) -> Table {
    let points: Vec<Point> = rows.iter().map(|row| row.point.clone()).collect();
    let mut names = vec![String::new(); rows.len()];
    for (name, places) in series(study, &points) {
        places.into_iter().for_each(|i| names[i].clone_from(&name));
    }
    let unit = rows.iter().find_map(|row| row.found.as_ref().ok()).map_or("", |found| found.unit.as_str());
    let unit = unit_of(&study.error, unit);
    let mut table = Table::default();
    table.push("series", "", Cells::Text(names));
    let number = |i: usize| (i / study.repeats.max(1) as usize) as i64;
    table.push("point", "1", Cells::I64((0..rows.len()).map(number).collect()));
    for (k, (path, values)) in study.vary.iter().enumerate() {
        let cells = if values.iter().all(Value::is_number) {
            Cells::F64(points.iter().map(|p| p.values[k].as_f64().unwrap_or(f64::NAN)).collect())
        } else {
            Cells::Text(points.iter().map(|p| plain(&p.values[k])).collect())
        };
        table.push(path.as_str(), "1", cells);
    }
    table.push("repeat", "1", Cells::I64(points.iter().map(|p| p.repeat as i64).collect()));
    let known = |of: &dyn Fn(&Row) -> Option<f64>| Cells::MaybeF64(rows.iter().map(of).collect());
    let errors = |row: &Row| row.found.as_ref().ok().map(|found| found.errors);
    table.push("error", unit, known(&|row| errors(row)?.error));
    table.push("stated_se", unit, known(&|row| errors(row)?.stated));
    table.push("error_where_stated", unit, known(&|row| errors(row)?.where_stated));
    table.push("pixels", "1", known(&|row| Some(errors(row)?.n as f64)));
    let cost = |of: fn(&Row) -> f64| known(&move |row: &Row| row.found.is_ok().then(|| of(row)));
    table.push("cpu_seconds", "s", cost(|row| row.own.cpu_s));
    table.push("shared_cpu_seconds", "s", cost(|row| row.shared.cpu_s));
    table.push("seconds", "s", cost(|row| row.own.wall_s));
    table.push("flights", "1", cost(|row| row.own.flights));
    table.push("peak_bytes", "1", cost(|row| row.own.peak_bytes as f64));
    for (k, name) in study.also.iter().enumerate() {
        table.push(name.as_str(), "1", known(&|row| *row.found.as_ref().ok()?.also.get(k)?));
    }
    let failed = |row: &Row| row.found.as_ref().err().cloned().unwrap_or_default();
    table.push("failed", "", Cells::Text(rows.iter().map(failed).collect()));
    table
}

/// The table as comma-separated values; units stand behind the names in brackets.
pub fn csv(table: &Table) -> String {
    let quoted = |text: &str| {
        if text.contains([',', '"', '\n', '\r']) {
            format!("\"{}\"", text.replace('"', "\"\""))
        } else {
            text.to_owned()
        }
    };
    let head = table.columns.iter().map(|column| match column.unit.as_str() {
        "" | "1" => quoted(&column.name),
        unit => quoted(&format!("{} ({unit})", column.name)),
    });
    let mut text = head.collect::<Vec<_>>().join(",") + "\n";
    for row in 0..table.rows() {
        let cell = |cells: &Cells| match cells {
            Cells::F64(all) => all[row].to_string(),
            Cells::MaybeF64(all) => all[row].map(|v| v.to_string()).unwrap_or_default(),
            Cells::I64(all) => all[row].to_string(),
            Cells::Bool(all) => all[row].to_string(),
            Cells::Text(all) => quoted(&all[row]),
        };
        text += &table.columns.iter().map(|column| cell(&column.cells)).collect::<Vec<_>>().join(",");
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_with_commas_are_quoted() {
        let mut table = Table::default();
        table.push("a, b", "", Cells::Text(vec!["x \"y\"".to_owned(), "z".to_owned()]));
        table.push("error", "%", Cells::MaybeF64(vec![Some(0.5), None]));
        assert_eq!(csv(&table), "\"a, b\",error (%)\n\"x \"\"y\"\"\",0.5\nz,\n");
    }
}
