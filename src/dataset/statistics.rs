//! Mean, spread and range of what samples hold, gathered shard by shard in the order of the shards.

use turbid_contract::{Cells, Table};

/// Moments of one quantity.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moments {
    pub n: u64,
    pub mean: f64,
    /// Sum of squared deviations from the mean.
    pub m2: f64,
    pub least: f64,
    pub most: f64,
}

impl Moments {
    /// Of those values that are known (no NaN). Source: B. P. Welford, Technometrics 4, 419 (1962).
    pub fn of(values: impl IntoIterator<Item = f64>) -> Self {
        let mut moments = Self { least: f64::INFINITY, most: f64::NEG_INFINITY, ..Self::default() };
        for value in values.into_iter().filter(|value| !value.is_nan()) {
            moments.n += 1;
            let away = value - moments.mean;
            moments.mean += away / moments.n as f64;
            moments.m2 += away * (value - moments.mean);
            moments.least = moments.least.min(value);
            moments.most = moments.most.max(value);
        }
        moments
    }

    /// Of both. Source: Chan, Golub and LeVeque, Am. Stat. 37, 242 (1983), equation 1.5.
    pub fn and(self, other: Self) -> Self {
        if self.n == 0 || other.n == 0 {
            return if self.n == 0 { other } else { self };
        }
        let n = self.n + other.n;
        let away = other.mean - self.mean;
        let share = other.n as f64 / n as f64;
        Self {
            n,
            mean: self.mean + away * share,
            m2: self.m2 + other.m2 + away * away * self.n as f64 * share,
            least: self.least.min(other.least),
            most: self.most.max(other.most),
        }
    }

    /// Standard deviation over the values, none for fewer than two.
    pub fn sd(&self) -> Option<f64> {
        (self.n > 1).then(|| (self.m2 / (self.n - 1) as f64).sqrt())
    }
}

/// Quantiles with the names of their columns.
pub const QUANTILES: [&str; 5] = ["q05", "q25", "q50", "q75", "q95"];

/// A row of the table `statistics.parquet`.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    pub split: String,
    pub column: String,
    /// Of a tensor.
    pub channel: String,
    pub unit: String,
    pub moments: Moments,
    /// 5, 25, 50, 75 and 95 % of what is drawn.
    pub quantiles: [Option<f64>; QUANTILES.len()],
}

/// The table `statistics.parquet`.
pub fn table(rows: &[Row]) -> Table {
    let mut table = Table::default();
    let text = |pick: &dyn Fn(&Row) -> &String| Cells::Text(rows.iter().map(|row| pick(row).clone()).collect());
    let known =
        |pick: &dyn Fn(&Moments) -> Option<f64>| Cells::MaybeF64(rows.iter().map(|row| pick(&row.moments)).collect());
    table.push("split", "", text(&|row| &row.split));
    table.push("column", "", text(&|row| &row.column));
    table.push("channel", "", text(&|row| &row.channel));
    table.push("unit", "", text(&|row| &row.unit));
    table.push("n", "", Cells::I64(rows.iter().map(|row| row.moments.n as i64).collect()));
    table.push("mean", "", known(&|m| (m.n > 0).then_some(m.mean)));
    table.push("sd", "", known(&Moments::sd));
    table.push("min", "", known(&|m| (m.n > 0).then_some(m.least)));
    table.push("max", "", known(&|m| (m.n > 0).then_some(m.most)));
    for (place, name) in QUANTILES.into_iter().enumerate() {
        table.push(name, "", Cells::MaybeF64(rows.iter().map(|row| row.quantiles[place]).collect()));
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Moments of parts are those of the whole, far from 0 too; 1e-12 of the spread.
    #[test]
    fn moments_join() {
        let values: Vec<f64> = (0..1000).map(|i| 1e6 + f64::from(i * i % 997)).collect();
        let whole = Moments::of(values.iter().copied());
        let joined =
            values.chunks(37).map(|part| Moments::of(part.iter().copied())).fold(Moments::default(), Moments::and);
        let (a, b) = (whole.sd().unwrap(), joined.sd().unwrap());
        assert!((a - b).abs() < 1e-9 * a && (whole.mean - joined.mean).abs() < 1e-9 * a, "{whole:?} {joined:?}");
        assert_eq!((joined.n, joined.least, joined.most), (whole.n, whole.least, whole.most));
        assert_eq!(Moments::of([]).sd(), None);
        assert_eq!(Moments::of([1.0, f64::NAN, 3.0]), Moments::of([1.0, 3.0]));
    }
}
