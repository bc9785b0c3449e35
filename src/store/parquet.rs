//! Tables and records as Parquet: the unit of a column in its field's metadata, attributes as canonical JSON in the
//! file's key-value metadata under `turbid`.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use arrow_array::{ArrayRef, BooleanArray, Float64Array, Int64Array, RecordBatch, RecordBatchOptions, StringArray};
use arrow_schema::{DataType, Field, Schema};
use parquet::arrow::ArrowWriter;
use parquet::basic::{Compression, ZstdLevel};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use turbid_contract::canonical::{canonical_text, canonical_value};
use turbid_contract::{ArtifactKind, Attributes, Cells, Column, Record, Table};

use crate::store::columns::{Columns, RawColumn};
use crate::store::error::StoreError;

const KEY: &str = "turbid";
const UNIT: &str = "unit";
/// Marks text columns that hold JSON.
const JSON: &str = "json";
const ROW_GROUP: usize = 65_536;

/// What the file says besides its columns.
#[derive(Serialize, Deserialize)]
struct Description {
    kind: ArtifactKind,
    attributes: Attributes,
}

/// Encodes a table. Error: a cell that is not finite.
pub(super) fn encode_table(table: &Table) -> Result<Vec<u8>, StoreError> {
    let description = Description { kind: ArtifactKind::Table, attributes: table.attributes.clone() };
    write(raw_columns(table.columns.clone())?, table.rows(), &description)
}

/// The same of a table that comes in pieces with the same columns; no two of them are held at once. Error: there is no piece.
pub(super) fn encode_pieces(pieces: impl Iterator<Item = Table>) -> Result<Vec<u8>, StoreError> {
    let mut writer = None;
    for piece in pieces {
        let Table { columns, attributes } = piece;
        let rows = columns.first().map_or(0, |column| column.cells.len());
        let batch = batch(raw_columns(columns)?, rows)?;
        let writer = match &mut writer {
            Some(writer) => writer,
            None => writer.insert(begin(&batch, &Description { kind: ArtifactKind::Table, attributes })?),
        };
        // A row group a piece: the writer holds one in memory.
        writer.write(&batch).and_then(|()| writer.flush()).map_err(unwritten)?;
    }
    let writer = writer.ok_or_else(|| StoreError::unfit("a table without a piece"))?;
    writer.into_inner().map_err(unwritten)
}

fn raw_columns(columns: Vec<Column>) -> Result<Vec<RawColumn>, StoreError> {
    let raw = |column: Column| {
        let Column { name, unit, cells } = column;
        if let Cells::F64(cells) = &cells
            && let Some(row) = cells.iter().position(|cell| !cell.is_finite())
        {
            return Err(StoreError::unfit(format!(
                "column `{name}` has the value {} in row {row}; every cell must be finite",
                cells[row]
            )));
        }
        if let Cells::MaybeF64(cells) = &cells
            && let Some((row, cell)) =
                cells.iter().enumerate().find_map(|(row, c)| c.filter(|c| !c.is_finite()).map(|c| (row, c)))
        {
            return Err(StoreError::unfit(format!(
                "column `{name}` has the value {cell} in row {row}; what is not known must be null"
            )));
        }
        Ok(RawColumn { name, metadata: HashMap::from([(UNIT.to_owned(), unit)]), cells })
    };
    columns.into_iter().map(raw).collect()
}

/// Decodes what [`encode_table`] wrote.
pub(super) fn decode_table(bytes: &[u8]) -> Result<Table, StoreError> {
    let (columns, attributes, _) = read(bytes, ArtifactKind::Table)?;
    let columns = columns.into_iter().map(|mut column| Column {
        name: column.name,
        unit: column.metadata.remove(UNIT).unwrap_or_default(),
        cells: column.cells,
    });
    Ok(Table { columns: columns.collect(), attributes })
}

/// Encodes a record as a table of one row, a column a field.
pub(super) fn encode_record(record: &Record) -> Result<Vec<u8>, StoreError> {
    let mut columns = Vec::with_capacity(record.fields.len());
    for (name, value) in &record.fields {
        let value = canonical_value(value).map_err(StoreError::unfit)?;
        let plain = match &value {
            Value::Bool(value) => Some(Cells::Bool(vec![*value])),
            Value::String(text) => Some(Cells::Text(vec![text.clone()])),
            Value::Number(n) if n.is_f64() => n.as_f64().map(|x| Cells::F64(vec![x])),
            Value::Number(n) => n.as_i64().map(|n| Cells::I64(vec![n])),
            Value::Null | Value::Array(_) | Value::Object(_) => None,
        };
        let mut metadata = HashMap::new();
        let cells = plain.unwrap_or_else(|| {
            metadata.insert(JSON.to_owned(), "true".to_owned());
            Cells::Text(vec![canonical_text(&value)])
        });
        columns.push(RawColumn { name: name.clone(), metadata, cells });
    }
    write(columns, 1, &Description { kind: ArtifactKind::Record, attributes: Attributes::new() })
}

/// Decodes what [`encode_record`] wrote.
pub(super) fn decode_record(bytes: &[u8]) -> Result<Record, StoreError> {
    let (columns, _, rows) = read(bytes, ArtifactKind::Record)?;
    // Without a column there is no row either: the record without fields.
    if rows != 1 && !columns.is_empty() {
        return Err(wrong(format!("a record has one row, not {rows}")));
    }
    let mut fields = BTreeMap::new();
    for column in columns {
        let is_json = column.metadata.contains_key(JSON);
        let value = match column.cells {
            Cells::Bool(cells) => Value::from(cells[0]),
            Cells::I64(cells) => Value::from(cells[0]),
            Cells::F64(cells) => Value::from(cells[0]),
            Cells::MaybeF64(cells) => Value::from(cells[0]),
            Cells::Text(cells) if is_json => serde_json::from_str(&cells[0]).map_err(wrong)?,
            Cells::Text(mut cells) => Value::String(cells.swap_remove(0)),
        };
        fields.insert(column.name, value);
    }
    Ok(Record { fields })
}

fn wrong(what: impl std::fmt::Display) -> StoreError {
    StoreError::unfit(format!("not a table or record of this turbid: {what}"))
}

fn unwritten(error: impl std::fmt::Display) -> StoreError {
    StoreError::unfit(format!("the table cannot be written as Parquet: {error}"))
}

fn write(columns: Vec<RawColumn>, rows: usize, description: &Description) -> Result<Vec<u8>, StoreError> {
    let batch = batch(columns, rows)?;
    let mut writer = begin(&batch, description)?;
    writer.write(&batch).map_err(unwritten)?;
    writer.into_inner().map_err(unwritten)
}

fn batch(columns: Vec<RawColumn>, rows: usize) -> Result<RecordBatch, StoreError> {
    let mut fields = Vec::with_capacity(columns.len());
    let mut arrays: Vec<ArrayRef> = Vec::with_capacity(columns.len());
    for RawColumn { name, metadata, cells } in columns {
        let nullable = matches!(cells, Cells::MaybeF64(_));
        let (data_type, array): (_, ArrayRef) = match cells {
            Cells::F64(cells) => (DataType::Float64, Arc::new(Float64Array::from(cells))),
            Cells::MaybeF64(cells) => (DataType::Float64, Arc::new(Float64Array::from(cells))),
            Cells::I64(cells) => (DataType::Int64, Arc::new(Int64Array::from(cells))),
            Cells::Bool(cells) => (DataType::Boolean, Arc::new(BooleanArray::from(cells))),
            Cells::Text(cells) => (DataType::Utf8, Arc::new(StringArray::from(cells))),
        };
        fields.push(Field::new(name, data_type, nullable).with_metadata(metadata));
        arrays.push(array);
    }
    let schema = Arc::new(Schema::new(fields));
    let options = RecordBatchOptions::new().with_row_count(Some(rows));
    RecordBatch::try_new_with_options(schema, arrays, &options).map_err(unwritten)
}

/// A file for rows like these.
fn begin(batch: &RecordBatch, description: &Description) -> Result<ArrowWriter<Vec<u8>>, StoreError> {
    let text = canonical_text(&canonical_value(description).map_err(StoreError::unfit)?);
    // Of a single row nothing is to be gained, and setting up zstd for each column costs more than all the rest.
    let compression = match description.kind {
        ArtifactKind::Record => Compression::UNCOMPRESSED,
        _ => Compression::ZSTD(ZstdLevel::try_new(3).expect("zstd knows level 3")),
    };
    let properties = WriterProperties::builder()
        .set_compression(compression)
        .set_max_row_group_row_count(Some(ROW_GROUP))
        // Without a version: a new turbid must not change the bytes of an old result.
        .set_created_by("turbid".to_owned())
        .set_key_value_metadata(Some(vec![KeyValue::new(KEY.to_owned(), text)]))
        .build();
    ArrowWriter::try_new(Vec::new(), batch.schema(), Some(properties)).map_err(unwritten)
}

fn read(bytes: &[u8], kind: ArtifactKind) -> Result<(Vec<RawColumn>, Attributes, usize), StoreError> {
    let file = Columns::open(bytes).map_err(wrong)?;
    let text = file.said(KEY).ok_or_else(|| wrong("its metadata are missing"))?;
    let description: Description = serde_json::from_str(text).map_err(wrong)?;
    if description.kind != kind {
        return Err(wrong(format!("it is a {:?}, not a {kind:?}", description.kind)));
    }
    Ok((file.read().map_err(wrong)?, description.attributes, file.rows().map_err(wrong)?))
}
