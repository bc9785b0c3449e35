//! What polars says of a data set, by its index and its costs; only with the feature `tables`.

use std::path::Path;

use turbid_contract::{Cells, Table};
use turbid_tables::costs::costs;
use turbid_tables::counts::counts;
use turbid_tables::summary::{Summary, summary};

use super::verify::{table_of, whole};

/// The tables of `turbid dataset stats`.
pub struct Tables {
    /// Drawn quantities and measures of the samples that are kept, by split.
    pub summary: Vec<Summary>,
    /// CPU seconds by split and reason of a reject.
    pub costs: Table,
    /// Points by split, group and reason of a reject.
    pub counts: Table,
}

/// Reads the tables of a folder. Error: in words.
pub fn tables(to: &Path) -> Result<Tables, String> {
    whole(to)?;
    let (index, spent) = (table_of(to, "index.parquet")?, table_of(to, "costs.parquet")?);
    let told = |e: turbid_tables::Error| e.to_string();
    Ok(Tables {
        summary: of_kept(&index)?,
        costs: costs(&index, &spent).map_err(told)?,
        counts: counts(&index, &["split", "group", "reject"]).map_err(told)?,
    })
}

/// 5, 25, 50, 75 and 95 % of these values; what is not known counts nowhere.
pub fn quantiles(name: &str, values: Vec<Option<f64>>) -> Result<[Option<f64>; 5], String> {
    let mut table = Table::default();
    table.push("split", "", Cells::Text(vec![String::new(); values.len()]));
    table.push(name, "", Cells::MaybeF64(values));
    let of = summary(&table, "split", ("split", "")).map_err(|e| e.to_string())?;
    Ok(of.first().map(|of| of.quantiles).unwrap_or_default())
}

/// Statistics of the numeric columns of an index but for those that number samples; of the samples that are kept.
pub fn of_kept(index: &Table) -> Result<Vec<Summary>, String> {
    let mut numbers = Table::default();
    for column in index.columns.iter().filter(|column| !["draw", "group", "row"].contains(&column.name.as_str())) {
        numbers.push(&column.name, &column.unit, column.cells.clone());
    }
    summary(&numbers, "split", ("reject", "")).map_err(|e| e.to_string())
}
