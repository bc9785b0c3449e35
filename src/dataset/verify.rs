//! Looking at a folder: every shard is there, whole, and holds what index and manifest say.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use arrow_array::RecordBatch;
use arrow_array::cast::AsArray;
use arrow_array::types::Int64Type;
use bytes::Bytes;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use serde_json::Value;
use turbid_contract::{Artifact, ArtifactKind, Cells, Table};

use super::folder::{self, sha256};
use super::format::Format;
use super::manifest::{Manifest, ShardOf};
use super::rows::checks;
use super::shard::Sample;
use super::webdataset;
use crate::store::decode;

/// What was looked at, and what is wrong, each with file and row.
#[derive(Debug, Default)]
pub struct Verified {
    pub shards: usize,
    pub rows: u64,
    pub findings: Vec<String>,
}

/// Looks at a folder. Error: there is no data set, in words.
pub fn verify(to: &Path) -> Result<Verified, String> {
    let manifest = folder::read(to)?.ok_or_else(|| format!("{} holds no data set (dataset.json)", to.display()))?;
    let mut verified = Verified::default();
    let mut index = None;
    for (name, of) in &manifest.files {
        match fs::read(to.join(name)) {
            Err(e) => verified.findings.push(format!("{name}: {e}")),
            Ok(bytes) if sha256(&bytes) != of.sha256 => {
                verified.findings.push(format!("{name}: its bytes were changed"))
            }
            Ok(bytes) if name == "index.parquet" => index = table(&bytes),
            Ok(_) => {}
        }
    }
    if manifest.files.is_empty() {
        verified.findings.push("the build has not ended: there are no index and no card yet; run it again".to_owned());
    }
    let rows = index.as_ref().map(rows_by_shard).unwrap_or_default();
    for shard in &manifest.shards {
        verified.shards += 1;
        let before = verified.findings.len();
        let found = look(to, shard, &manifest, rows.get(shard.file.as_str()).map(Vec::as_slice));
        verified.findings.extend(found.map(|finding| format!("{}: {finding}", shard.file)));
        if verified.findings.len() == before {
            verified.rows += shard.rows;
        }
    }
    let known = |name: &str| manifest.shards.iter().any(|shard| shard.file == name);
    for entry in fs::read_dir(to.join("data")).into_iter().flatten().flatten() {
        let name = format!("data/{}", entry.file_name().to_string_lossy());
        if Format::is_shard(&name) && !known(&name) {
            verified.findings.push(format!("{name}: no shard of this data set"));
        }
    }
    Ok(verified)
}

/// The rows of `statistics.parquet`, each a map from column to value.
pub fn statistics(to: &Path) -> Result<Vec<Value>, String> {
    whole(to)?;
    let table = table_of(to, "statistics.parquet")?;
    let cell = |cells: &Cells, row: usize| match cells {
        Cells::F64(cells) => Value::from(cells[row]),
        Cells::MaybeF64(cells) => Value::from(cells[row]),
        Cells::I64(cells) => Value::from(cells[row]),
        Cells::Bool(cells) => Value::from(cells[row]),
        Cells::Text(cells) => Value::from(cells[row].clone()),
    };
    let row = |row: usize| table.columns.iter().map(|c| (c.name.clone(), cell(&c.cells, row))).collect();
    Ok((0..table.rows()).map(|at| Value::Object(row(at))).collect())
}

/// Error: the folder holds no data set, or another one than this, or one of another format, in words.
pub fn is_of(to: &Path, pipeline: &str, dataset: &str, format: Option<Format>) -> Result<(), String> {
    let found = folder::read(to)?.ok_or_else(|| format!("{} holds no data set (dataset.json)", to.display()))?;
    found.holds(to, pipeline, dataset)?;
    match format {
        Some(format) if format != found.shard_format => Err(format!(
            "{} holds shards of the format {}, not {}; leave `--format` out",
            to.display(),
            found.shard_format.name(),
            format.name()
        )),
        _ => Ok(()),
    }
}

/// The manifest of a folder that was built to its end. Error: in words.
pub fn whole(to: &Path) -> Result<Manifest, String> {
    let manifest = folder::read(to)?.ok_or_else(|| format!("{} holds no data set (dataset.json)", to.display()))?;
    if manifest.files.is_empty() {
        return Err(format!("the build of {} has not ended; run `turbid dataset build` again", to.display()));
    }
    Ok(manifest)
}

/// A table of the folder. Error: in words.
pub fn table_of(to: &Path, name: &str) -> Result<Table, String> {
    let at = to.join(name);
    let bytes = fs::read(&at).map_err(|e| format!("{}: {e}", at.display()))?;
    table(&bytes).ok_or_else(|| format!("{} cannot be read; `turbid dataset build` writes it anew", at.display()))
}

fn table(bytes: &[u8]) -> Option<Table> {
    match decode(ArtifactKind::Table, bytes) {
        Ok(Artifact::Table(table)) => Some(table),
        _ => None,
    }
}

/// Raw indices of each shard in the order of its rows, as the index has them.
fn rows_by_shard(index: &Table) -> BTreeMap<String, Vec<u64>> {
    let column = |name: &str| index.columns.iter().find(|column| column.name == name).map(|column| &column.cells);
    let (Some(Cells::Text(shards)), Some(Cells::I64(draws)), Some(Cells::MaybeF64(rows))) =
        (column("shard"), column("draw"), column("row"))
    else {
        return BTreeMap::new();
    };
    let mut found: BTreeMap<String, Vec<(u64, u64)>> = BTreeMap::new();
    for ((shard, draw), row) in shards.iter().zip(draws).zip(rows) {
        if let Some(row) = row.filter(|_| !shard.is_empty()) {
            found.entry(shard.clone()).or_default().push((row as u64, *draw as u64));
        }
    }
    let sorted = |mut rows: Vec<(u64, u64)>| {
        rows.sort_unstable();
        rows.into_iter().map(|(_, draw)| draw).collect()
    };
    found.into_iter().map(|(shard, rows)| (shard, sorted(rows))).collect()
}

/// What is wrong with a shard: the first thing that explains the others.
fn look(to: &Path, shard: &ShardOf, manifest: &Manifest, indices: Option<&[u64]>) -> Option<String> {
    let bytes = match fs::read(to.join(&shard.file)) {
        Ok(bytes) => bytes,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Some("the shard is missing".to_owned()),
        Err(e) => return Some(e.to_string()),
    };
    let changed = sha256(&bytes) != shard.sha256;
    let of_its_own = |finding: Option<String>| finding.or_else(|| changed.then(|| "its bytes were changed".to_owned()));
    if manifest.shard_format == Format::WebDataset {
        return of_its_own(webdataset::look(&bytes, shard, &manifest.columns, indices));
    }
    let batches = match read(bytes) {
        Ok(batches) => batches,
        Err(e) => return Some(format!("it cannot be read: {e}")),
    };
    let Some(first) = batches.first() else {
        return of_its_own((shard.rows > 0).then(|| format!("it has no rows, and should have {}", shard.rows)));
    };
    let schema = first.schema();
    let names: Vec<&str> = schema.fields().iter().map(|field| field.name().as_str()).collect();
    let wanted: Vec<&str> = manifest.columns.iter().map(|column| column.name.as_str()).collect();
    if let Some(missing) = wanted.iter().find(|name| !names.contains(name)) {
        return Some(format!("the column `{missing}` is missing; it has {}", names.join(", ")));
    }
    if names != wanted {
        return Some(format!("its columns are {}, and should be {}", names.join(", "), wanted.join(", ")));
    }
    let rows: usize = batches.iter().map(RecordBatch::num_rows).sum();
    if rows as u64 != shard.rows {
        return Some(format!("it has {rows} rows, and should have {}", shard.rows));
    }
    let mut row = 0;
    for batch in &batches {
        let checks = checks(batch);
        let ids = batch.column(0).as_string_opt::<i32>();
        let draws = batch.column(1).as_primitive_opt::<Int64Type>();
        let (Some(ids), Some(draws)) = (ids, draws) else {
            return Some("its columns `id` and `draw` have other types".to_owned());
        };
        for at in 0..batch.num_rows() {
            let draw = draws.value(at) as u64;
            let listed = indices.and_then(|indices| indices.get(row)).copied();
            if ids.value(at) != Sample::id(draw) || listed.is_some_and(|listed| listed != draw) {
                return Some(format!(
                    "row {row}: it is sample {}, and should be {}",
                    ids.value(at),
                    Sample::id(listed.unwrap_or(draw))
                ));
            }
            if checks.get(8 * at..8 * at + 8) != shard.checks.get(8 * row..8 * row + 8) {
                return Some(format!("row {row} (sample {}): its values were changed", ids.value(at)));
            }
            row += 1;
        }
    }
    of_its_own(None)
}

fn read(bytes: Vec<u8>) -> Result<Vec<RecordBatch>, String> {
    let told = |e: &dyn std::fmt::Display| e.to_string();
    let builder = ParquetRecordBatchReaderBuilder::try_new(Bytes::from(bytes)).map_err(|e| told(&e))?;
    let reader = builder.build().map_err(|e| told(&e))?;
    reader.collect::<Result<_, _>>().map_err(|e| told(&e))
}
