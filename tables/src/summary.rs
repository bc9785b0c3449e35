//! Statistics of numeric columns by split.

use polars::prelude::{DataFrame, DataType, IntoLazy, QuantileMethod, SortMultipleOptions, col, lit};
use turbid_contract::Table;

use crate::Error;
use crate::frame::{frame, needs, numbers};

/// Quantiles with their names. Between two values they are linear (type 7 of Hyndman and Fan, Am. Stat. 50, 361 (1996)).
pub const QUANTILES: [(&str, f64); 5] = [("q05", 0.05), ("q25", 0.25), ("q50", 0.5), ("q75", 0.75), ("q95", 0.95)];

/// One column within one split. Cells that are not known count nowhere; where none is known, nothing but `n` is.
#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    pub split: String,
    pub column: String,
    pub n: u64,
    pub mean: Option<f64>,
    /// With the divisor n - 1: none for fewer than two.
    pub sd: Option<f64>,
    pub min: Option<f64>,
    pub max: Option<f64>,
    /// In the order of [`QUANTILES`].
    pub quantiles: [Option<f64>; QUANTILES.len()],
}

/// Statistics of every numeric column within each value of the column `by`, in the order of its values, then of the columns; of
/// those rows alone in which the text of the column `only.0` is `only.1`.
///
/// Error: there is no such column.
pub fn summary(of: &Table, by: &str, only: (&str, &str)) -> Result<Vec<Summary>, Error> {
    needs(of, by)?;
    needs(of, only.0)?;
    let lazy = frame(of)?.lazy().filter(col(only.0).eq(lit(only.1)));
    let mut found: Vec<Vec<Summary>> = Vec::new();
    for name in numbers(of).filter(|name| *name != by) {
        let column = || col(name).cast(DataType::Float64);
        let mut asked = vec![
            col(name).count().cast(DataType::Int64).alias("n"),
            column().mean().alias("mean"),
            column().std(1).alias("sd"),
            column().min().alias("min"),
            column().max().alias("max"),
        ];
        asked.extend(QUANTILES.map(|(name, q)| column().quantile(lit(q), QuantileMethod::Linear).alias(name)));
        // A name that no column of the statistics has.
        let by_split = lazy.clone().group_by([col(by).alias("of split")]).agg(asked);
        found.push(rows(&by_split.sort(["of split"], SortMultipleOptions::default()).collect()?, name)?);
    }
    let splits = found.first().map_or(0, Vec::len);
    Ok((0..splits).flat_map(|split| found.iter().map(move |column| column[split].clone())).collect())
}

fn rows(frame: &DataFrame, column: &str) -> Result<Vec<Summary>, Error> {
    let (splits, n) = (frame.column("of split")?.str()?, frame.column("n")?.i64()?);
    let number = |name: &str, row: usize| Ok::<_, Error>(frame.column(name)?.f64()?.get(row));
    let row = |row: usize| {
        let mut quantiles = [None; QUANTILES.len()];
        for (quantile, (name, _)) in quantiles.iter_mut().zip(QUANTILES) {
            *quantile = number(name, row)?;
        }
        Ok(Summary {
            split: splits.get(row).unwrap_or_default().to_owned(),
            column: column.to_owned(),
            n: n.get(row).unwrap_or_default() as u64,
            mean: number("mean", row)?,
            sd: number("sd", row)?,
            min: number("min", row)?,
            max: number("max", row)?,
            quantiles,
        })
    };
    (0..frame.height()).map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use turbid_contract::Cells;

    /// Of 0, 1, .., 100 every quantile is its percentage; what is not known counts nowhere.
    #[test]
    fn statistics_of_known_values() {
        let mut of = Table::default();
        let splits = (0..202).map(|i| if i % 2 == 0 { "train" } else { "test" }.to_owned()).collect();
        of.push("split", "", Cells::Text(splits));
        // Not in their order.
        let value = |i: i64| (i % 2 == 0).then_some((i / 2 * 37 % 101) as f64);
        of.push("x", "", Cells::MaybeF64((0..202).map(value).collect()));
        of.push("k", "", Cells::I64((0..202).rev().collect()));
        of.push("reject", "", Cells::Text(vec![String::new(); 202]));
        let found = summary(&of, "split", ("reject", "")).unwrap();
        let names: Vec<(&str, &str)> = found.iter().map(|s| (s.split.as_str(), s.column.as_str())).collect();
        assert_eq!(names, [("test", "x"), ("test", "k"), ("train", "x"), ("train", "k")]);
        let nothing = &found[0];
        assert_eq!((nothing.n, nothing.mean, nothing.sd, nothing.max), (0, None, None, None));
        assert_eq!(nothing.quantiles, [None; 5]);
        let x = &found[2];
        assert_eq!((x.n, x.min, x.max, x.mean), (101, Some(0.0), Some(100.0), Some(50.0)));
        assert!(x.quantiles.iter().zip([5.0, 25.0, 50.0, 75.0, 95.0]).all(|(q, p)| (q.unwrap() - p).abs() < 1e-12));
        // The variance of 0..=100 with the divisor 100 is 101 * 102 / 12.
        assert!((x.sd.unwrap() - (101.0_f64 * 102.0 / 12.0).sqrt()).abs() < 1e-12);
        assert_eq!((found[3].n, found[3].min, found[3].max), (101, Some(1.0), Some(201.0)));
        assert!(summary(&of, "splits", ("reject", "")).unwrap_err().0.contains("`splits`"));
        let rejects = (0..202).map(|i| if i < 200 { "noise" } else { "" }.to_owned()).collect();
        of.columns[3].cells = Cells::Text(rejects);
        assert!(
            summary(&of, "split", ("reject", "")).unwrap().iter().all(|s| s.n <= 1),
            "rows left out are not counted"
        );
    }
}
