//! What samples cost, by split and by what became of them.

use polars::prelude::{DataType, IntoLazy, JoinArgs, JoinType, SortMultipleOptions, col, len};
use turbid_contract::Table;

use crate::Error;
use crate::frame::{frame, needs, table};

/// Joins an index (`id`, `split`, `reject`) with costs (`id`, `cpu_s`, `wall_s`) and sums them: a row per split and reason of a
/// reject (empty: kept), with `samples`, `cpu_s` in all and `cpu_s_per_sample`. Points without a cost, such as those that a
/// condition of the draw skips, are left out.
pub fn costs(index: &Table, costs: &Table) -> Result<Table, Error> {
    ["id", "split", "reject"].iter().try_for_each(|name| needs(index, name))?;
    ["id", "cpu_s"].iter().try_for_each(|name| needs(costs, name))?;
    let keys = ["split", "reject"];
    let index = frame(index)?.lazy().select([col("id"), col("split"), col("reject")]);
    let costs = frame(costs)?.lazy().select([col("id"), col("cpu_s")]);
    let joined = index.join(costs, [col("id")], [col("id")], JoinArgs::new(JoinType::Inner));
    let sums = joined.group_by(keys.map(col)).agg([
        len().cast(DataType::Int64).alias("samples"),
        col("cpu_s").sum(),
        col("cpu_s").mean().alias("cpu_s_per_sample"),
    ]);
    let unit = |name: &str| if name.starts_with("cpu_s") { "s" } else { "" };
    table(&sums.sort(keys, SortMultipleOptions::default()).collect()?, unit)
}

#[cfg(test)]
mod tests {
    use super::*;
    use turbid_contract::Cells;

    #[test]
    fn costs_are_summed_by_what_became_of_samples() {
        let texts = |texts: &[&str]| Cells::Text(texts.iter().map(|&text| text.to_owned()).collect());
        let mut index = Table::default();
        index.push("id", "", texts(&["0", "1", "2", "3", "4"]));
        index.push("split", "", texts(&["train", "train", "", "test", "train"]));
        index.push("reject", "", texts(&["", "keep: noise", "only: a", "", ""]));
        let mut of = Table::default();
        // In another order, and without the point that was skipped.
        of.push("id", "", texts(&["4", "3", "1", "0"]));
        of.push("cpu_s", "s", Cells::F64(vec![4.0, 3.0, 1.0, 0.5]));
        let sums = costs(&index, &of).unwrap();
        let cells = |name: &str| &sums.columns.iter().find(|column| column.name == name).unwrap().cells;
        assert_eq!(cells("split"), &texts(&["test", "train", "train"]));
        assert_eq!(cells("reject"), &texts(&["", "", "keep: noise"]));
        assert_eq!(cells("samples"), &Cells::I64(vec![1, 2, 1]));
        assert_eq!(sums.maybe_f64s("cpu_s").unwrap(), [Some(3.0), Some(4.5), Some(1.0)]);
        assert_eq!(sums.maybe_f64s("cpu_s_per_sample").unwrap(), [Some(3.0), Some(2.25), Some(1.0)]);
        assert!(costs(&of, &of).unwrap_err().0.contains("`split`"));
    }
}
