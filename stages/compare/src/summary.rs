//! What many tables of metrics say together: how far off their means are, in the mean.

use turbid_contract::{Cells, Error, Table};

/// What one instance says of one region and quantity.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    pub region: String,
    pub quantity: String,
    pub unit: String,
    /// Mean and truth over the pixels that count; `None` where nothing is known of the region.
    pub known: Option<Known>,
    pub masked_percent: f64,
}

/// A mean, its standard error where that is known, and the truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Known {
    pub mean: f64,
    pub mean_se: Option<f64>,
    pub truth: f64,
}

/// What all instances say of one region and quantity. `None` is what is not known: figures of no instance, percentages of a position (mm), and
/// standard errors where an instance does not know its own.
#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    pub region: String,
    pub quantity: String,
    pub unit: String,
    pub instances: usize,
    /// Instances of which anything is known: the rest of the figures is over them.
    pub n: usize,
    /// Mean of |mean - truth|, in the quantity's unit, and relative to the truth.
    pub mean_abs_error: Option<f64>,
    pub mean_abs_error_percent: Option<f64>,
    /// sqrt(sum se^2) / n: the standard error of a mean of n errors that are independent.
    pub mean_abs_error_se: Option<f64>,
    pub mean_abs_error_se_percent: Option<f64>,
    /// What `mean_abs_error_percent` would be of instances that are off by normal noise of their standard errors and nothing else.
    pub noise_percent: Option<f64>,
    /// Mean, and root mean square of the errors, and the largest of them, relative to the truth.
    pub bias_percent: Option<f64>,
    pub rmse_percent: Option<f64>,
    pub worst_percent: Option<f64>,
    /// Mean over all instances.
    pub masked_percent: f64,
}

/// Columns that a table of metrics must have.
pub const COLUMNS: [&str; 7] = ["region", "quantity", "unit", "mean", "mean_se", "truth", "masked_percent"];

/// The figures of a table of metrics. Error: it is none of regions and quantities, but a summary already, for example.
pub fn figures(table: &Table) -> Result<Vec<Figure>, Error> {
    let missing = |name: &str| {
        let what = format!("the metrics have no column `{name}`");
        Error::failed_with_hint(what, "connect the metrics of a `compare` stage")
    };
    let cells = |name: &str| table.columns.iter().find(|c| c.name == name).map(|c| &c.cells);
    let texts = |name: &str| match cells(name) {
        Some(Cells::Text(texts)) => Ok(texts),
        _ => Err(missing(name)),
    };
    let numbers = |name: &str| table.maybe_f64s(name).ok_or_else(|| missing(name));
    let (region, quantity, unit) = (texts("region")?, texts("quantity")?, texts("unit")?);
    let (mean, mean_se, truth) = (numbers("mean")?, numbers("mean_se")?, numbers("truth")?);
    let masked_percent = numbers("masked_percent")?;
    let row = |i: usize| Figure {
        region: region[i].clone(),
        quantity: quantity[i].clone(),
        unit: unit[i].clone(),
        known: mean[i].zip(truth[i]).map(|(mean, truth)| Known { mean, mean_se: mean_se[i], truth }),
        masked_percent: masked_percent[i].unwrap_or(100.0),
    };
    Ok((0..table.rows()).map(row).collect())
}

/// One row for each region and quantity, in the order in which they first come.
pub fn summarize(figures: &[Figure]) -> Vec<Summary> {
    let mut groups: Vec<Vec<&Figure>> = Vec::new();
    for figure in figures {
        let same = |group: &&mut Vec<&Figure>| group[0].region == figure.region && group[0].quantity == figure.quantity;
        match groups.iter_mut().find(same) {
            Some(group) => group.push(figure),
            None => groups.push(vec![figure]),
        }
    }
    groups.iter().map(|group| summary(group)).collect()
}

fn summary(group: &[&Figure]) -> Summary {
    let known: Vec<Known> = group.iter().filter_map(|f| f.known).collect();
    let n = known.len() as f64;
    let position = group[0].unit == "mm";
    let percent = |f: &Known, x: f64| (!position && f.truth != 0.0).then_some(100.0 * x / f.truth);
    // Known where it is of every instance that is.
    let mean = |of: &dyn Fn(&Known) -> Option<f64>| {
        let sum: Option<f64> = known.iter().map(of).sum();
        sum.filter(|_| n > 0.0).map(|sum| sum / n)
    };
    let error = |f: &Known| percent(f, f.mean - f.truth);
    let se = |f: &Known| percent(f, f.mean_se?);
    let square = |x: f64| x * x;
    let worst = known.iter().filter_map(error).fold(None, |worst: Option<f64>, e| match worst {
        Some(worst) if worst.abs() >= e.abs() => Some(worst),
        _ => Some(e),
    });
    Summary {
        region: group[0].region.clone(),
        quantity: group[0].quantity.clone(),
        unit: group[0].unit.clone(),
        instances: group.len(),
        n: known.len(),
        mean_abs_error: mean(&|f| Some((f.mean - f.truth).abs())),
        mean_abs_error_percent: mean(&|f| error(f).map(f64::abs)),
        // Of a mean of n: the root of a mean of squares, over sqrt(n).
        mean_abs_error_se: mean(&|f| f.mean_se.map(square)).map(|x| (x / n).sqrt()),
        mean_abs_error_se_percent: mean(&|f| se(f).map(square)).map(|x| (x / n).sqrt()),
        // E|x| of a normal x of mean 0 is sqrt(2 / pi) of its deviation.
        noise_percent: mean(&|f| se(f).map(f64::abs)).map(|x| std::f64::consts::FRAC_2_PI.sqrt() * x),
        bias_percent: mean(&error),
        rmse_percent: mean(&|f| error(f).map(square)).map(f64::sqrt),
        worst_percent: if mean(&error).is_some() { worst } else { None },
        masked_percent: group.iter().map(|f| f.masked_percent).sum::<f64>() / group.len() as f64,
    }
}

/// The columns that a summary makes; without a unit of their own they are in that of the quantities, where these have one.
pub const MADE: [(&str, Option<&str>); 14] = [
    ("region", Some("")),
    ("quantity", Some("")),
    ("instances", Some("1")),
    ("n", Some("1")),
    ("mean_abs_error_percent", Some("%")),
    ("mean_abs_error_se_percent", Some("%")),
    ("noise_percent", Some("%")),
    ("bias_percent", Some("%")),
    ("rmse_percent", Some("%")),
    ("worst_percent", Some("%")),
    ("masked_percent", Some("%")),
    ("mean_abs_error", None),
    ("mean_abs_error_se", None),
    ("unit", Some("")),
];

/// Summaries as a table.
pub fn table(rows: &[Summary]) -> Table {
    let text = |f: &dyn Fn(&Summary) -> String| Cells::Text(rows.iter().map(f).collect());
    let count = |f: &dyn Fn(&Summary) -> usize| Cells::I64(rows.iter().map(|row| f(row) as i64).collect());
    let unit = rows.first().map_or("", |r| r.unit.as_str());
    let unit = if rows.iter().all(|r| r.unit == unit) { unit } else { "" };
    let number = |f: fn(&Summary) -> Option<f64>| Cells::MaybeF64(rows.iter().map(f).collect());
    let cells = [
        text(&|r| r.region.clone()),
        text(&|r| r.quantity.clone()),
        count(&|r| r.instances),
        count(&|r| r.n),
        number(|r| r.mean_abs_error_percent),
        number(|r| r.mean_abs_error_se_percent),
        number(|r| r.noise_percent),
        number(|r| r.bias_percent),
        number(|r| r.rmse_percent),
        number(|r| r.worst_percent),
        number(|r| Some(r.masked_percent)),
        number(|r| r.mean_abs_error),
        number(|r| r.mean_abs_error_se),
        text(&|r| r.unit.clone()),
    ];
    let mut table = Table::default();
    for ((name, own), cells) in MADE.into_iter().zip(cells) {
        table.push(name, own.unwrap_or(unit), cells);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figure(region: &str, known: Option<[f64; 3]>) -> Figure {
        let (region, quantity, unit) = (region.to_owned(), "mu_a".to_owned(), "mm^-1".to_owned());
        let masked_percent = if known.is_some() { 10.0 } else { 100.0 };
        let known = known.map(|[mean, mean_se, truth]| Known { mean, mean_se: Some(mean_se), truth });
        Figure { region, quantity, unit, known, masked_percent }
    }

    /// Two instances off by +50 and -25 % with standard errors of 30 and 40 %, a third of which nothing is known; and a region of one: by hand.
    #[test]
    fn three_instances() {
        let all = [
            figure("wall", Some([0.75, 0.15, 0.5])),
            figure("end", Some([2.0, 0.1, 2.0])),
            figure("wall", Some([1.5, 0.8, 2.0])),
            figure("wall", None),
            figure("nowhere", None),
        ];
        let [wall, end, nowhere] = &summarize(&all)[..] else { panic!("three regions") };
        let close = |a: Option<f64>, b: f64| assert!((a.unwrap() - b).abs() < 1e-12, "{a:?} for {b}");
        assert_eq!((wall.instances, wall.n, end.instances, end.n), (3, 2, 1, 1));
        close(wall.mean_abs_error_percent, 37.5);
        close(wall.mean_abs_error_se_percent, 25.0);
        close(wall.noise_percent, 35.0 * (2.0 / std::f64::consts::PI).sqrt());
        close(wall.bias_percent, 12.5);
        close(wall.rmse_percent, (0.5 * (2500.0_f64 + 625.0)).sqrt());
        close(wall.worst_percent, 50.0);
        close(wall.mean_abs_error, 0.375);
        close(wall.mean_abs_error_se, 0.5 * (0.15_f64 * 0.15 + 0.8 * 0.8).sqrt());
        close(Some(wall.masked_percent), 40.0);
        close(end.mean_abs_error_percent, 0.0);
        close(end.mean_abs_error_se_percent, 5.0);
        // Nothing is known where no instance knows anything: neither an error of 0 nor one of anything else.
        assert_eq!((nowhere.n, nowhere.mean_abs_error, nowhere.worst_percent), (0, None, None));
        assert_eq!((nowhere.mean_abs_error_se, nowhere.noise_percent, nowhere.masked_percent), (None, None, 100.0));
    }

    /// An instance that does not know its standard error leaves that of the mean unknown, and nothing else; a position has no percentages.
    #[test]
    fn unknown_errors_stay_unknown() {
        let mut all = [figure("wall", Some([0.75, 0.15, 0.5])), figure("wall", Some([1.5, 0.8, 2.0]))];
        all[1].known.as_mut().unwrap().mean_se = None;
        let one = &summarize(&all)[0];
        assert_eq!((one.mean_abs_error_se, one.mean_abs_error_se_percent, one.noise_percent), (None, None, None));
        assert!((one.mean_abs_error_percent.unwrap() - 37.5).abs() < 1e-12);
        all.iter_mut().for_each(|f| f.unit = "mm".to_owned());
        let place = &summarize(&all)[0];
        assert_eq!((place.mean_abs_error, place.bias_percent, place.worst_percent), (Some(0.375), None, None));
    }

    /// Instances whose errors are nothing but their noise: the mean |error| is what `noise_percent` says, and the mean error 0, to 4.5 standard errors.
    #[test]
    fn noise_alone_makes_the_error_that_is_said() {
        let (n, se) = (20_000, 0.07);
        let mut rng = normals(3);
        let normal: Vec<f64> = (0..n).map(|_| rng()).collect();
        let all: Vec<Figure> = normal.iter().map(|x| figure("a", Some([1.0 + se * x, se, 1.0]))).collect();
        let [row] = &summarize(&all)[..] else { panic!("one region") };
        let allowed = 4.5 * 100.0 * se / f64::from(n).sqrt();
        let noise = row.noise_percent.unwrap();
        assert!((row.mean_abs_error_percent.unwrap() - noise).abs() < allowed, "{row:?}");
        assert!(row.bias_percent.unwrap().abs() < allowed, "{row:?}");
        assert!((row.mean_abs_error_se_percent.unwrap() - allowed / 4.5).abs() < 1e-9, "{row:?}");
    }

    /// Normal numbers: sums of twelve uniform ones of a linear congruential generator.
    fn normals(seed: u64) -> impl FnMut() -> f64 {
        let mut state = seed;
        let mut uniform = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        move || (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }

    /// A table of metrics comes back as figures; a summary is none.
    #[test]
    fn only_metrics_are_summarized() {
        let error = figures(&table(&summarize(&[figure("a", Some([1.0, 0.1, 1.0]))]))).unwrap_err();
        assert!(error.to_string().contains("no column `mean`"), "{error}");
    }
}
