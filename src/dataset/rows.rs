//! A checksum of each row of a shard, by which `verify` names the row that somebody edited.

use arrow_array::cast::AsArray;
use arrow_array::types::{Float16Type, Float32Type, Float64Type, Int64Type};
use arrow_array::{Array, ArrayRef, RecordBatch};
use arrow_schema::DataType;
use crc32fast::Hasher;

/// CRC-32 of what each row holds, as eight hexadecimal digits a row.
pub fn checks(batch: &RecordBatch) -> String {
    let mut rows = vec![Hasher::new(); batch.num_rows()];
    for column in batch.columns() {
        let (leaf, values) = leaf(column);
        let bytes = bytes(&leaf);
        for (row, hasher) in rows.iter_mut().enumerate() {
            hasher.update(&[u8::from(column.is_valid(row))]);
            match bytes {
                Some((bytes, size)) => hasher.update(&bytes[row * values * size..(row + 1) * values * size]),
                None => hasher.update(leaf.as_string_opt::<i32>().map_or("", |texts| texts.value(row)).as_bytes()),
            }
        }
    }
    rows.into_iter().map(|hasher| format!("{:08x}", hasher.finalize())).collect()
}

/// The numbers or texts of a column, and how many of them a row has.
pub fn leaf(column: &ArrayRef) -> (ArrayRef, usize) {
    let (mut leaf, mut values) = (column.clone(), 1);
    while let DataType::FixedSizeList(_, length) = leaf.data_type() {
        values *= usize::try_from(*length).unwrap_or_default();
        let below = leaf.as_fixed_size_list().values().clone();
        leaf = below;
    }
    (leaf, values)
}

/// The bytes of numbers, and of how many one is made; none of texts.
fn bytes(leaf: &ArrayRef) -> Option<(&[u8], usize)> {
    match leaf.data_type() {
        DataType::Float16 => Some((leaf.as_primitive::<Float16Type>().values().inner().as_slice(), 2)),
        DataType::Float32 => Some((leaf.as_primitive::<Float32Type>().values().inner().as_slice(), 4)),
        DataType::Float64 => Some((leaf.as_primitive::<Float64Type>().values().inner().as_slice(), 8)),
        DataType::Int64 => Some((leaf.as_primitive::<Int64Type>().values().inner().as_slice(), 8)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use arrow_array::{FixedSizeListArray, Float32Array, StringArray};
    use arrow_schema::{Field, Schema};

    use super::*;

    fn batch(values: [f32; 6], names: [Option<&str>; 3]) -> RecordBatch {
        let item = Arc::new(Field::new("item", DataType::Float32, true));
        let values = Arc::new(Float32Array::from(values.to_vec()));
        let pairs: ArrayRef = Arc::new(FixedSizeListArray::new(item, 2, values, None));
        let names: ArrayRef = Arc::new(StringArray::from(names.to_vec()));
        let fields =
            vec![Field::new("pairs", pairs.data_type().clone(), true), Field::new("names", DataType::Utf8, true)];
        RecordBatch::try_new(Arc::new(Schema::new(fields)), vec![pairs, names]).unwrap()
    }

    /// Rows have the checksum that they have alone, and another one where a bit, a text or what is known differs.
    #[test]
    fn each_row_has_its_own() {
        let names = [Some("a"), Some("b"), None];
        let values = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        let of = batch(values, names);
        let all = checks(&of);
        let alone: String = (0..3).map(|row| checks(&of.slice(row, 1))).collect();
        assert_eq!(all, alone);
        let changed = |other: RecordBatch| {
            let other = checks(&other);
            (0..3).filter(|row| all[8 * row..8 * row + 8] != other[8 * row..8 * row + 8]).collect::<Vec<_>>()
        };
        assert_eq!(changed(batch([1.0, 2.0, 3.0, -4.0, 5.0, 6.0], names)), [1]);
        assert_eq!(changed(batch(values, [Some("a"), Some("c"), Some("")])), [1, 2]);
    }
}
