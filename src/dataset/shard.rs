//! A shard: samples of one split as a Parquet file that Hugging Face datasets, polars and pyarrow read without code.
//!
//! A tensor is a nested list of fixed sizes (channels, rows, columns) whose levels are all nullable; the field says with
//! which extension type of `datasets` it is an Array3D, and the schema which features there are.

use std::collections::HashMap;
use std::sync::Arc;

use arrow_array::cast::AsArray;
use arrow_array::types::{Float16Type, Float32Type, Float64Type};
use arrow_array::{
    ArrayRef, FixedSizeListArray, Float16Array, Float32Array, Float64Array, Int64Array, RecordBatch, StringArray,
};
use arrow_schema::{DataType, Field, FieldRef, Schema};
use bytes::Bytes;
use half::f16;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use parquet::arrow::{ArrowWriter, ProjectionMask};
use parquet::basic::{Compression, Encoding, ZstdLevel};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::schema::types::ColumnPath;
use serde_json::{Value, json};
use turbid_draw::Type;

use super::feature::Values;
use super::manifest::ColumnOf;
use super::rows;
use crate::key::value_text;

/// One sample.
#[derive(Clone, Debug)]
pub struct Sample {
    pub index: u64,
    pub group: Option<i64>,
    /// In the order of the draw's names.
    pub draws: Vec<Value>,
    /// In the order of the features.
    pub values: Vec<Values>,
}

impl Sample {
    /// The name of the sample of a raw index.
    pub fn id(index: u64) -> String {
        format!("{index:08}")
    }
}

/// Bytes of a row group: what a reader must hold at once.
const ROW_GROUP: usize = 32 << 20;

/// The file of these samples, and the checksums of its rows. `columns` are `id`, `draw`, `group`, the draws (of these types), the features.
///
/// Error: a value that the type of its column does not hold, in words.
pub fn encode(columns: &[ColumnOf], types: &[Type], samples: &[Sample]) -> Result<(Vec<u8>, String), String> {
    let mut fields = Vec::new();
    let mut arrays: Vec<ArrayRef> = Vec::new();
    let mut properties = WriterProperties::builder()
        .set_created_by(format!("turbid {}", env!("CARGO_PKG_VERSION")))
        .set_compression(Compression::ZSTD(ZstdLevel::try_new(3).expect("3 is a level of zstd")));
    let mut row_bytes = 1;
    for (place, column) in columns.iter().enumerate() {
        let array: ArrayRef = match place {
            0 => Arc::new(StringArray::from_iter_values(samples.iter().map(|sample| Sample::id(sample.index)))),
            1 => Arc::new(Int64Array::from_iter_values(samples.iter().map(|sample| sample.index as i64))),
            2 => Arc::new(samples.iter().map(|sample| sample.group).collect::<Int64Array>()),
            _ if place < 3 + types.len() => drawn(types[place - 3], samples.iter().map(|s| &s.draws[place - 3])),
            _ => {
                let feature = place - 3 - types.len();
                let of = samples.iter().map(|sample| &sample.values[feature]);
                match column.shape {
                    None => Arc::new(of.map(number).collect::<Float64Array>()),
                    Some(shape) => {
                        row_bytes += shape.iter().product::<usize>() * 4;
                        let path = ColumnPath::new(path_of(&column.name));
                        // No reader looks for samples by their least pixel, and halves would be compared one by one.
                        properties = properties
                            .set_column_dictionary_enabled(path.clone(), false)
                            .set_column_statistics_enabled(path.clone(), EnabledStatistics::None)
                            .set_column_encoding(path, Encoding::BYTE_STREAM_SPLIT);
                        tensor(column, shape, of)?
                    }
                }
            }
        };
        fields.push(field(column, array.data_type().clone()));
        arrays.push(array);
    }
    let huggingface = json!({"info": {"features": features(columns)}}).to_string();
    let metadata: HashMap<String, String> = [("huggingface".to_owned(), huggingface.clone())].into();
    let schema = Arc::new(Schema::new(fields).with_metadata(metadata));
    let batch = RecordBatch::try_new(schema.clone(), arrays).map_err(|e| e.to_string())?;
    let properties = properties
        .set_max_row_group_row_count(Some((ROW_GROUP / row_bytes).max(1)))
        .set_key_value_metadata(Some(vec![KeyValue::new("huggingface".to_owned(), huggingface)]))
        .build();
    let mut bytes = Vec::new();
    let mut writer = ArrowWriter::try_new(&mut bytes, schema, Some(properties)).map_err(|e| e.to_string())?;
    writer.write(&batch).map_err(|e| e.to_string())?;
    writer.close().map_err(|e| e.to_string())?;
    Ok((bytes, rows::checks(&batch)))
}

/// What a row holds of these features. Error: the bytes are no such shard, in words.
pub fn values(bytes: Vec<u8>, features: &[ColumnOf], row: usize) -> Result<Vec<Values>, String> {
    let batches = read(bytes, features.iter().map(|column| column.name.as_str()), Some(row))?;
    let batch = batches.first().ok_or_else(|| format!("there is no row {row}"))?;
    let value = |(place, column): (usize, &ColumnOf)| match column.shape {
        None => Ok(Values::Number(numbers_of(batch.column(place)).next().filter(|number| !number.is_nan()))),
        Some(_) => {
            let (leaf, _) = rows::leaf(batch.column(place));
            Ok(Values::Tensor(numbers_of(&leaf).map(|number| number as f32).collect()))
        }
    };
    let order = batch.schema();
    let places = features.iter().map(|column| Ok((order.index_of(&column.name).map_err(|e| e.to_string())?, column)));
    places.collect::<Result<Vec<_>, String>>()?.into_iter().map(value).collect()
}

/// The values of a feature that is a number; NaN where one is not known. Error: the bytes are no such shard, in words.
pub fn numbers(bytes: Vec<u8>, feature: &ColumnOf) -> Result<Vec<f64>, String> {
    let batches = read(bytes, std::iter::once(feature.name.as_str()), None)?;
    Ok(batches.iter().flat_map(|batch| batch.columns()).flat_map(numbers_of).collect())
}

/// Columns of all rows, or of one.
fn read<'n>(
    bytes: Vec<u8>,
    names: impl Iterator<Item = &'n str>,
    row: Option<usize>,
) -> Result<Vec<RecordBatch>, String> {
    let builder = ParquetRecordBatchReaderBuilder::try_new(Bytes::from(bytes)).map_err(|e| e.to_string())?;
    let names: Vec<&str> = names.collect();
    let columns = ProjectionMask::columns(builder.parquet_schema(), names.iter().copied());
    let reader = builder.with_projection(columns);
    let reader = match row {
        Some(row) => reader.with_offset(row).with_limit(1),
        None => reader,
    };
    let reader = reader.build().map_err(|e| e.to_string())?;
    reader.collect::<Result<Vec<_>, _>>().map_err(|e| e.to_string())
}

/// NaN where one is not known.
fn numbers_of(array: &ArrayRef) -> Box<dyn Iterator<Item = f64> + '_> {
    match array.data_type() {
        DataType::Float16 => {
            Box::new(array.as_primitive::<Float16Type>().iter().map(|x| x.map_or(f64::NAN, f64::from)))
        }
        DataType::Float32 => {
            Box::new(array.as_primitive::<Float32Type>().iter().map(|x| x.map_or(f64::NAN, f64::from)))
        }
        DataType::Float64 => Box::new(array.as_primitive::<Float64Type>().iter().map(|x| x.unwrap_or(f64::NAN))),
        _ => Box::new(std::iter::empty()),
    }
}

fn number(values: &Values) -> Option<f64> {
    match values {
        Values::Number(number) => *number,
        Values::Tensor(_) => None,
    }
}

fn drawn<'s>(of: Type, values: impl Iterator<Item = &'s Value>) -> ArrayRef {
    match of {
        Type::Float => Arc::new(values.map(Value::as_f64).collect::<Float64Array>()),
        Type::Integer => Arc::new(values.map(Value::as_i64).collect::<Int64Array>()),
        Type::Text => Arc::new(StringArray::from_iter_values(values.map(value_text))),
    }
}

/// Where the leaves of a tensor stand in the file.
fn path_of(name: &str) -> Vec<String> {
    let below = ["list", "item"].repeat(3);
    std::iter::once(name).chain(below).map(str::to_owned).collect()
}

fn tensor<'s>(
    column: &ColumnOf,
    shape: [usize; 3],
    samples: impl Iterator<Item = &'s Values>,
) -> Result<ArrayRef, String> {
    let mut flat: Vec<f32> = Vec::new();
    for values in samples {
        match values {
            Values::Tensor(tensor) if tensor.len() == shape.iter().product::<usize>() => flat.extend(tensor),
            _ => return Err(format!("`{}` is no tensor of {shape:?}", column.name)),
        }
    }
    let mut array: ArrayRef = if column.dtype == "float16" {
        Arc::new(Float16Array::from_iter_values(halves(&column.name, &flat)?))
    } else {
        Arc::new(Float32Array::from(flat))
    };
    for length in shape.into_iter().rev() {
        let length = i32::try_from(length).map_err(|_| format!("`{}` has {length} values in a row", column.name))?;
        let item: FieldRef = Arc::new(Field::new("item", array.data_type().clone(), true));
        array = Arc::new(FixedSizeListArray::try_new(item, length, array, None).map_err(|e| e.to_string())?);
    }
    Ok(array)
}

/// What is not known (NaN) stays so. Error: a value beyond what half precision holds with all of its digits.
pub(super) fn halves(name: &str, values: &[f32]) -> Result<Vec<f16>, String> {
    let (least, most) = (f16::MIN_POSITIVE.to_f32(), f16::MAX.to_f32());
    match values.iter().find(|value| !value.is_nan() && **value != 0.0 && !(least..=most).contains(&value.abs())) {
        Some(value) => Err(format!(
            "`{name}` holds {value:e}, outside of what float16 holds with all digits ({least:e} to {most}); write `dtype: float32`"
        )),
        None => Ok(values.iter().map(|&value| f16::from_f32(value)).collect()),
    }
}

fn field(column: &ColumnOf, data_type: DataType) -> Field {
    let mut metadata: HashMap<String, String> = HashMap::new();
    if !column.unit.is_empty() {
        metadata.insert("unit".to_owned(), column.unit.clone());
    }
    if let Some([x, y]) = column.pixel_mm {
        metadata.insert("pixel_mm".to_owned(), format!("[{x}, {y}]"));
    }
    if let Some(shape) = column.shape {
        metadata.insert("channels".to_owned(), json!(column.channels).to_string());
        let name = "datasets.features.features.Array3DExtensionType";
        metadata.insert("ARROW:extension:name".to_owned(), name.to_owned());
        metadata.insert("ARROW:extension:metadata".to_owned(), json!([shape, column.dtype]).to_string());
    }
    Field::new(&column.name, data_type, true).with_metadata(metadata)
}

/// What Hugging Face datasets calls the columns.
pub fn features(columns: &[ColumnOf]) -> Value {
    let feature = |column: &ColumnOf| match column.shape {
        Some(shape) => json!({"shape": shape, "dtype": column.dtype, "_type": "Array3D"}),
        None => json!({"dtype": column.dtype, "_type": "Value"}),
    };
    Value::Object(columns.iter().map(|column| (column.name.clone(), feature(column))).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_precision_takes_what_it_holds() {
        let held = halves("x", &[0.0, -0.25, 65504.0, 6.1035156e-5, f32::NAN]).unwrap();
        assert!(held[1].to_f32() == -0.25 && held[4].is_nan());
        for lost in [1e-5, -70000.0, f32::INFINITY] {
            let said = halves("x", &[1.0, lost]).unwrap_err();
            assert!(said.contains("`x`") && said.contains("dtype: float32"), "{said}");
        }
    }
}
