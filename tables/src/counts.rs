//! How many points there are of each kind.

use polars::prelude::{DataType, IntoLazy, PlSmallStr, SortMultipleOptions, col, len};
use turbid_contract::Table;

use crate::Error;
use crate::frame::{frame, needs, table};

/// A row per combination of values that occurs in these columns, with its count in `n`, in the order of the values.
///
/// Error: a column is not there.
pub fn counts(of: &Table, by: &[&str]) -> Result<Table, Error> {
    by.iter().try_for_each(|name| needs(of, name))?;
    let keys: Vec<_> = by.iter().map(|&name| col(name)).collect();
    let counted = frame(of)?.lazy().group_by(keys).agg([len().cast(DataType::Int64).alias("n")]);
    let sorted =
        counted.sort(by.iter().map(|&name| PlSmallStr::from(name)).collect::<Vec<_>>(), SortMultipleOptions::default());
    table(&sorted.collect()?, |_| "")
}

#[cfg(test)]
mod tests {
    use super::*;
    use turbid_contract::Cells;

    #[test]
    fn every_combination_is_counted() {
        let mut of = Table::default();
        of.push("split", "", Cells::Text(["b", "a", "b", "b"].map(str::to_owned).to_vec()));
        of.push("group", "", Cells::MaybeF64(vec![Some(2.0), None, Some(1.0), Some(2.0)]));
        let found = counts(&of, &["split", "group"]).unwrap();
        assert_eq!(found.columns[0].cells, Cells::Text(["a", "b", "b"].map(str::to_owned).to_vec()));
        assert_eq!(found.columns[1].cells, Cells::MaybeF64(vec![None, Some(1.0), Some(2.0)]));
        assert_eq!(found.columns[2].cells, Cells::I64(vec![1, 1, 2]));
        assert!(counts(&of, &["reject"]).is_err());
    }
}
