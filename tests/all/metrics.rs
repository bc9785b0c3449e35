//! Tables of `compare`, read as a user would: exported.

use std::collections::BTreeMap;

use crate::space::Space;

/// A row of a table of metrics, as exported; NaN where nothing is known.
pub struct Row {
    pub region: String,
    pub quantity: String,
    pub n: f64,
    pub mean: f64,
    pub se: f64,
    pub truth: f64,
    /// Share of the region, %.
    pub masked: f64,
}

/// A table as exported: the cells of each row by the name of their column.
pub fn rows(space: &Space, file: &str, port: &str, settings: &[&str]) -> Vec<BTreeMap<String, String>> {
    let csv = space.path().join(format!("{port}.csv"));
    let mut arguments = vec!["export", file, port, "--to", csv.to_str().expect("a temporary folder of UTF-8")];
    arguments.extend(settings);
    space.turbid(&arguments).ok();
    let text = std::fs::read_to_string(&csv).expect("the export");
    let mut lines = text.lines().filter(|line| !line.starts_with('#'));
    let name = |header: &str| header.split(['[', ' ']).next().unwrap_or_default().to_owned();
    let header: Vec<String> = lines.next().expect("a header").split(',').map(name).collect();
    lines.map(|line| header.iter().cloned().zip(line.split(',').map(str::to_owned)).collect()).collect()
}

/// A number of a row.
pub fn number(row: &BTreeMap<String, String>, column: &str) -> f64 {
    let cell = row.get(column).unwrap_or_else(|| panic!("no column {column}: {row:?}"));
    cell.parse().unwrap_or_else(|e| panic!("{column}: {e}: {row:?}"))
}

/// The metrics of a stage, one row for each region or medium and quantity, without the row of all.
pub fn metrics(space: &Space, file: &str, stage: &str, settings: &[&str]) -> Vec<Row> {
    let rows = rows(space, file, &format!("{stage}.metrics"), settings);
    let known = |row: &BTreeMap<String, String>, column: &str| match row.get(column).map(String::as_str) {
        Some("") => f64::NAN,
        _ => number(row, column),
    };
    let row = |row: &BTreeMap<String, String>| Row {
        region: row["region"].clone(),
        quantity: row["quantity"].clone(),
        n: number(row, "n"),
        mean: known(row, "mean"),
        se: known(row, "mean_se"),
        truth: known(row, "truth"),
        masked: number(row, "masked_percent"),
    };
    rows.iter().map(row).filter(|row| row.region != "all").collect()
}
