//! Studies over their repeats: error against stated error and against CPU time, and the slope of the one over the other.

use polars::prelude::{DataType, IntoLazy, SortMultipleOptions, col};
use statrs::distribution::{ChiSquared, ContinuousCDF, StudentsT};
use turbid_contract::{Cells, Table};

use crate::Error;
use crate::frame::{frame, needs};

/// One point of a series, over its repeats.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    pub series: String,
    /// Place of the point in the study.
    pub point: i64,
    /// Repeats that have an error.
    pub n: u64,
    /// Root mean square over the repeats, in the unit of the error.
    pub error: Option<f64>,
    /// Root mean square of the errors that the repeats state.
    pub stated: Option<f64>,
    /// Root of the mean of (error / stated)^2, and the interval that holds its true value with 95 %.
    pub ratio: Option<[f64; 3]>,
    /// Mean over the repeats, s.
    pub cpu_seconds: Option<f64>,
    /// 1 / (error^2 cpu_seconds): what does not depend on the number of samples, as long as noise is all there is.
    pub efficiency: Option<f64>,
}

/// The straight line through ln error over ln CPU seconds.
#[derive(Clone, Debug, PartialEq)]
pub struct Slope {
    pub series: String,
    pub slope: f64,
    /// The interval that holds it with 95 %; none for fewer than three points.
    pub interval: Option<[f64; 2]>,
    /// The error falls more slowly than noise does: something stays however long it runs.
    pub floor: bool,
}

/// The slope of an error that is noise.
pub const OF_NOISE: f64 = -0.5;

const LOW: f64 = 0.025;
const HIGH: f64 = 0.975;
const UNSURE: f64 = 0.05;

/// Points in the order of their numbers. Columns of the table: `series`, `point`, `error`, `stated_se`, `error_where_stated`, `cpu_seconds`, a row for each repeat.
///
/// `of_a_mean`: whether the error of a repeat is one number, as that of a mean; else it is a root mean square of many pixels, and how many
/// of these are independent is told by the scatter of the repeats (degrees of freedom by Satterthwaite, Biometrics 2, 110 (1946)).
///
/// Error: a column that is not there.
pub fn points(of: &Table, of_a_mean: bool) -> Result<Vec<Point>, Error> {
    ["series", "point", "error", "stated_se", "error_where_stated", "cpu_seconds"]
        .into_iter()
        .try_for_each(|name| needs(of, name))?;
    let number = |name: &str| col(name).cast(DataType::Float64);
    let square = |name: &str| number(name) * number(name);
    let ratio = || square("error_where_stated") / square("stated_se");
    let grouped = frame(of)?.lazy().group_by([col("point")]).agg([
        col("series").first().alias("of series"),
        col("error").count().cast(DataType::Int64).alias("n"),
        square("error").mean().alias("error squared"),
        square("stated_se").mean().alias("stated squared"),
        ratio().mean().alias("ratio squared"),
        ratio().count().cast(DataType::Int64).alias("ratios"),
        ratio().var(1).alias("spread"),
        number("cpu_seconds").mean().alias("cpu"),
    ]);
    let frame = grouped.sort(["point"], SortMultipleOptions::default()).collect()?;
    let known = |name: &str, row: usize| -> Result<Option<f64>, Error> {
        Ok(frame.column(name)?.f64()?.get(row).filter(|v| v.is_finite()))
    };
    let whole =
        |name: &str, row: usize| -> Result<i64, Error> { Ok(frame.column(name)?.i64()?.get(row).unwrap_or_default()) };
    let row = |row: usize| {
        let error = known("error squared", row)?.map(f64::sqrt);
        let cpu_seconds = known("cpu", row)?;
        let repeats = whole("ratios", row)? as f64;
        let mean = known("ratio squared", row)?.filter(|_| repeats > 0.0);
        let degrees = match (of_a_mean, known("spread", row)?.filter(|v| *v > 0.0), mean) {
            (true, ..) => Some(repeats),
            (false, Some(spread), Some(mean)) => {
                // The spread of few repeats may be small by chance: so many degrees there are with 95 %.
                let sure = ChiSquared::new(repeats - 1.0).map_or(1.0, |law| law.inverse_cdf(UNSURE) / (repeats - 1.0));
                Some((2.0 * repeats * mean * mean / spread * sure).max(repeats))
            }
            (false, ..) => None,
        };
        let interval = mean.zip(degrees).and_then(|(mean, degrees)| {
            let law = ChiSquared::new(degrees).ok()?;
            let end = |p: f64| (mean * degrees / law.inverse_cdf(p)).sqrt();
            Some([mean.sqrt(), end(HIGH), end(LOW)]).filter(|ends| ends.iter().all(|v| v.is_finite()))
        });
        Ok(Point {
            series: frame.column("of series")?.str()?.get(row).unwrap_or_default().to_owned(),
            point: whole("point", row)?,
            n: whole("n", row)? as u64,
            error,
            stated: known("stated squared", row)?.map(f64::sqrt),
            ratio: interval,
            cpu_seconds,
            efficiency: error.zip(cpu_seconds).filter(|(e, c)| *e > 0.0 && *c > 0.0).map(|(e, c)| 1.0 / (e * e * c)),
        })
    };
    (0..frame.height()).map(row).collect()
}

/// The slopes of the series, in the order in which they come; of errors and times above 0. Each repeat counts by itself.
///
/// Error: a column that is not there, or is of another type.
pub fn slopes(of: &Table) -> Result<Vec<Slope>, Error> {
    ["series", "error", "cpu_seconds"].into_iter().try_for_each(|name| needs(of, name))?;
    let numbers =
        |name: &str| of.maybe_f64s(name).ok_or_else(|| Error(format!("the column `{name}` holds no numbers")));
    let (errors, seconds) = (numbers("error")?, numbers("cpu_seconds")?);
    let names = of.columns.iter().find(|c| c.name == "series").map(|c| &c.cells);
    let Some(Cells::Text(names)) = names else { return Err(Error("the column `series` holds no texts".to_owned())) };
    let mut series: Vec<(&String, Vec<[f64; 2]>)> = Vec::new();
    for ((name, error), cpu) in names.iter().zip(&errors).zip(&seconds) {
        let point = error.zip(*cpu).filter(|(e, c)| *e != 0.0 && *c > 0.0).map(|(e, c)| [c.ln(), e.abs().ln()]);
        match series.iter_mut().find(|(known, _)| *known == name) {
            Some((_, points)) => points.extend(point),
            None => series.push((name, point.into_iter().collect())),
        }
    }
    Ok(series.into_iter().filter_map(|(name, points)| slope(name, &points)).collect())
}

fn slope(name: &str, points: &[[f64; 2]]) -> Option<Slope> {
    let n = points.len() as f64;
    let mean = |k: usize| points.iter().map(|p| p[k]).sum::<f64>() / n;
    let (x, y) = (mean(0), mean(1));
    let xx: f64 = points.iter().map(|p| (p[0] - x).powi(2)).sum();
    let xy: f64 = points.iter().map(|p| (p[0] - x) * (p[1] - y)).sum();
    // Times of one point differ by a few percent: no slope can be told from them.
    let spread =
        points.iter().map(|p| p[0]).fold(f64::MIN, f64::max) - points.iter().map(|p| p[0]).fold(f64::MAX, f64::min);
    if points.len() < 2 || spread < 0.3 {
        return None;
    }
    let slope = xy / xx;
    let residual: f64 = points.iter().map(|p| (p[1] - y - slope * (p[0] - x)).powi(2)).sum();
    let interval = (points.len() > 2).then(|| {
        let law = StudentsT::new(0.0, 1.0, n - 2.0).expect("one degree of freedom and more");
        let half = law.inverse_cdf(HIGH) * (residual / (n - 2.0) / xx).sqrt();
        [slope - half, slope + half]
    });
    Some(Slope { series: name.to_owned(), slope, interval, floor: interval.is_some_and(|[low, _]| low > OF_NOISE) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(rows: &[(&str, i64, f64, f64, f64)]) -> Table {
        let mut table = Table::default();
        table.push("series", "", Cells::Text(rows.iter().map(|r| r.0.to_owned()).collect()));
        table.push("point", "1", Cells::I64(rows.iter().map(|r| r.1).collect()));
        table.push("error", "%", Cells::MaybeF64(rows.iter().map(|r| Some(r.2)).collect()));
        table.push("stated_se", "%", Cells::MaybeF64(rows.iter().map(|r| Some(r.3)).collect()));
        table.push("error_where_stated", "%", Cells::MaybeF64(rows.iter().map(|r| Some(r.2)).collect()));
        table.push("cpu_seconds", "s", Cells::F64(rows.iter().map(|r| r.4).collect()));
        table
    }

    /// Errors of 3 and 4 that state 5: mean square of the ratios (9 + 16) / 50, chi squared of two degrees.
    #[test]
    fn ratios_and_their_intervals() {
        let of = table(&[("a", 0, 3.0, 5.0, 1.0), ("a", 0, -4.0, 5.0, 3.0), ("b", 1, 2.0, 2.0, 1.0)]);
        let found = points(&of, true).unwrap();
        let near = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-6, "{a} {b}");
        near(found[0].error.unwrap(), 12.5_f64.sqrt());
        near(found[0].cpu_seconds.unwrap(), 2.0);
        near(found[0].efficiency.unwrap(), 1.0 / 25.0);
        // Quantiles of chi squared of two degrees: -2 ln(1 - p).
        let [ratio, low, high] = found[0].ratio.unwrap();
        near(ratio, 0.5_f64.sqrt());
        near(low, (1.0 / (-2.0 * 0.025_f64.ln())).sqrt());
        near(high, (1.0 / (-2.0 * 0.975_f64.ln())).sqrt());
        assert_eq!((found[1].series.as_str(), found[1].n), ("b", 1));
        // One root mean square of many pixels says nothing of its own scatter.
        assert_eq!(points(&of, false).unwrap()[1].ratio, None);
    }

    #[test]
    fn slopes_of_noise_and_of_a_floor() {
        let noise: Vec<_> =
            (0..4).map(|k| ("noise", k, 8.0 / 2.0_f64.powi(k as i32), 1.0, 4.0_f64.powi(k as i32))).collect();
        let floor = (0..4).map(|k| ("floor", 4 + k, 2.0 + 0.01 * k as f64, 1.0, 4.0_f64.powi(k as i32)));
        let all: Vec<_> = noise.into_iter().chain(floor).chain([("one", 9, 1.0, 1.0, 1.0)]).collect();
        let found = slopes(&table(&all)).unwrap();
        assert_eq!(found.len(), 2);
        assert!((found[0].slope + 0.5).abs() < 1e-12 && !found[0].floor, "{found:?}");
        assert!(found[1].slope.abs() < 0.01 && found[1].floor, "{found:?}");
    }
}
