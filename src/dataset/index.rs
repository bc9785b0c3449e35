//! `index.parquet`: a row per raw index, with its split, its place in a shard or why it has none; `costs.parquet` beside it.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::Value;
use turbid_contract::{Cells, Table};
use turbid_draw::Type;

use super::shard::Sample;
use crate::key::value_text;
use crate::spec::Draw;

/// What became of a point.
#[derive(Clone, Debug, Default)]
pub struct Entry {
    pub split: String,
    pub group: Option<i64>,
    pub seed: Option<u64>,
    /// Measures of the stages behind the sample, STAGE.MEASURE.
    pub measures: BTreeMap<String, f64>,
    pub shard: String,
    pub row: Option<u64>,
    /// Empty where the sample is in a shard.
    pub reject: String,
    pub cpu_s: f64,
    pub wall_s: f64,
}

/// The table of all raw indices; those without a point have the condition that left them out, and no values.
pub fn table(draw: &Draw, entries: &BTreeMap<u64, Entry>) -> Table {
    let left_out = Entry::default();
    let rows: Vec<(u64, Option<Vec<Value>>, &Entry, String)> = (0..draw.n())
        .map(|index| match (draw.point(index), entries.get(&index)) {
            (Ok(values), Some(entry)) => (index, Some(values), entry, entry.reject.clone()),
            (Ok(values), None) => (index, Some(values), &left_out, "not built".to_owned()),
            (Err(reason), _) => (index, None, &left_out, format!("only: {reason}")),
        })
        .collect();
    let mut table = Table::default();
    table.push("id", "", Cells::Text(rows.iter().map(|row| Sample::id(row.0)).collect()));
    table.push("draw", "", Cells::I64(rows.iter().map(|row| row.0 as i64).collect()));
    table.push("split", "", Cells::Text(rows.iter().map(|row| row.2.split.clone()).collect()));
    table.push("group", "", Cells::MaybeF64(rows.iter().map(|row| row.2.group.map(|group| group as f64)).collect()));
    for (place, (name, of)) in draw.names().zip(draw.types()).enumerate() {
        let value =
            |row: &(u64, Option<Vec<Value>>, &Entry, String)| row.1.as_ref().map(|values| values[place].clone());
        let cells = match of {
            Type::Text => {
                Cells::Text(rows.iter().map(|row| value(row).as_ref().map(value_text).unwrap_or_default()).collect())
            }
            Type::Float | Type::Integer => {
                Cells::MaybeF64(rows.iter().map(|row| value(row).as_ref().and_then(Value::as_f64)).collect())
            }
        };
        table.push(name.to_owned(), "", cells);
    }
    let seed = |entry: &Entry| entry.seed.map(|seed| seed.to_string()).unwrap_or_default();
    table.push("seed", "", Cells::Text(rows.iter().map(|row| seed(row.2)).collect()));
    let measures: BTreeSet<&String> = entries.values().flat_map(|entry| entry.measures.keys()).collect();
    for measure in measures {
        let cells = rows.iter().map(|row| row.2.measures.get(measure).copied()).collect();
        table.push(measure.clone(), "", Cells::MaybeF64(cells));
    }
    table.push("shard", "", Cells::Text(rows.iter().map(|row| row.2.shard.clone()).collect()));
    table.push("row", "", Cells::MaybeF64(rows.iter().map(|row| row.2.row.map(|row| row as f64)).collect()));
    table.push("reject", "", Cells::Text(rows.into_iter().map(|row| row.3).collect()));
    table
}

/// CPU and wall seconds of each sample; no digest covers it.
pub fn costs(entries: &BTreeMap<u64, Entry>) -> Table {
    let mut table = Table::default();
    table.push("id", "", Cells::Text(entries.keys().map(|&index| Sample::id(index)).collect()));
    table.push("cpu_s", "s", Cells::F64(entries.values().map(|entry| entry.cpu_s).collect()));
    table.push("wall_s", "s", Cells::F64(entries.values().map(|entry| entry.wall_s).collect()));
    table
}
