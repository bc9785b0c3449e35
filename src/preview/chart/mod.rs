//! Charts of tables of metrics: over axes of numbers, over two of them as a heat map, else a row for each region or medium (a forest plot).
//!
//! One model of what is shown, drawn twice: by [`panel`] into PNG files, by [`svg`] into reports.

pub mod panel;
pub mod svg;

use std::collections::{BTreeMap, HashSet};

use turbid_contract::{Cells, Column, Table};

/// A chart of one quantity.
#[derive(Clone, Debug, PartialEq)]
pub struct Chart {
    /// The quantity's name, as layers have it.
    pub quantity: String,
    /// What of it: `bias`, `mean |bias|`, `mean`.
    pub what: &'static str,
    pub unit: String,
    pub content: Content,
    /// What is not in it.
    pub notes: Vec<String>,
}

#[derive(Clone, Debug, PartialEq)]
pub enum Content {
    /// Values over an axis of numbers.
    Lines { axis: String, series: Vec<Series> },
    /// A value for each pair of numbers of two axes, `None` where none is known; rows of `y`, each as long as `x`.
    Heat { x: (String, Vec<f64>), y: (String, Vec<f64>), cells: Vec<Vec<Option<f64>>> },
    /// A value for each name, in the order of the table.
    Forest { rows: Vec<(String, Value)> },
}

/// A line.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Empty where there is one alone.
    pub name: String,
    /// In ascending order of the axis.
    pub points: Vec<(f64, Value)>,
}

/// A number and its standard error, where that is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Value {
    pub value: f64,
    pub se: Option<f64>,
}

/// Charts of one table: of so many quantities,
const MOST: usize = 8;
/// lines,
const MOST_SERIES: usize = 7;
/// names,
const MOST_ROWS: usize = 60;
/// points. Of more the means of bins are shown, with the standard deviation within each.
const MOST_POINTS: usize = 5000;
const BINS: usize = 200;
/// The region of all pixels.
const ALL: &str = "all";
/// Two axes of at least so many values make a heat map.
const HEAT: usize = 3;

impl Value {
    fn of(value: Option<f64>, se: Option<f64>) -> Option<Self> {
        let value = value.filter(|value| value.is_finite())?;
        Some(Self { value, se: se.filter(|se| se.is_finite() && *se >= 0.0) })
    }

    /// [`interval`](Self::interval) as far as it lies between two ends.
    pub fn interval_within(&self, [low, high]: [f64; 2]) -> Option<[f64; 2]> {
        self.interval().map(|bar| bar.map(|end| end.clamp(low, high)))
    }

    /// Ends of the interval of 95 % for normal errors.
    pub fn interval(&self) -> Option<[f64; 2]> {
        self.se.filter(|se| *se > 0.0).map(|se| [self.value - 1.96 * se, self.value + 1.96 * se])
    }
}

/// A row of the table.
struct Row {
    quantity: String,
    region: String,
    what: &'static str,
    unit: String,
    value: Value,
    /// By axis.
    at: Vec<At>,
}

#[derive(Clone, Debug, PartialEq)]
enum At {
    Number(f64),
    Text(String),
}

impl At {
    fn text(&self) -> String {
        match self {
            Self::Number(number) => number.to_string(),
            Self::Text(text) => text.clone(),
        }
    }
}

/// The charts of a table of metrics, one for each quantity; none of other tables, and none where a number says it all.
pub fn charts(table: &Table) -> Vec<Chart> {
    let Some((rows, axes, unknown)) = rows(table) else { return Vec::new() };
    let mut groups: Vec<(String, Vec<&Row>)> = Vec::new();
    for row in &rows {
        let key = format!("{} {} {}", row.quantity, row.what, row.unit);
        match groups.iter_mut().find(|(known, _)| *known == key) {
            Some((_, rows)) => rows.push(row),
            None => groups.push((key, vec![row])),
        }
    }
    let mut found: Vec<Chart> = Vec::new();
    for (_, rows) in groups.into_iter().filter(|(_, rows)| rows.len() > 1).take(MOST) {
        let mut notes = Vec::new();
        if unknown > 0 {
            notes.push(format!("{unknown} rows of the table of which nothing is known"));
        }
        let content = content(&rows, &axes, &mut notes);
        let Row { quantity, what, unit, .. } = rows[0];
        found.push(Chart { quantity: quantity.clone(), what, unit: unit.clone(), content, notes });
    }
    found
}

fn content(rows: &[&Row], axes: &[String], notes: &mut Vec<String>) -> Content {
    let numbers = |k: usize| -> Option<Vec<f64>> {
        let all = rows.iter().map(|row| if let At::Number(number) = row.at[k] { Some(number) } else { None });
        let mut all = all.collect::<Option<Vec<f64>>>()?;
        all.sort_by(f64::total_cmp);
        all.dedup();
        Some(all).filter(|values| values.len() > 1)
    };
    let mut over: Vec<(usize, Vec<f64>)> = (0..axes.len()).filter_map(|k| Some((k, numbers(k)?))).collect();
    // The axis with the most values first; among equals that of the file.
    over.sort_by_key(|(_, values)| std::cmp::Reverse(values.len()));
    let others = |row: &Row, but: &[usize]| -> Vec<String> {
        let at = axes.iter().zip(&row.at).enumerate().filter(|(k, _)| !but.contains(k));
        let differs = |k: usize| rows.iter().any(|other| other.at[k] != rows[0].at[k]);
        let named = at.filter(|(k, _)| differs(*k)).map(|(_, (name, value))| format!("{name} = {}", value.text()));
        let several = rows.iter().any(|other| other.region != rows[0].region);
        several.then(|| row.region.clone()).into_iter().chain(named).collect()
    };
    if let [(i, x), (j, y), ..] = &over[..]
        && x.len() >= HEAT
        && y.len() >= HEAT
        && rows.iter().all(|row| others(row, &[*i, *j]).is_empty())
        && rows.len() <= x.len() * y.len()
    {
        let mut cells = vec![vec![None; x.len()]; y.len()];
        for row in rows {
            let place = |values: &[f64], k: usize| {
                values.iter().position(|value| row.at[k] == At::Number(*value)).expect("it is one of them")
            };
            cells[place(y, *j)][place(x, *i)] = Some(row.value.value);
        }
        return Content::Heat { x: (axes[*i].clone(), x.clone()), y: (axes[*j].clone(), y.clone()), cells };
    }
    if let Some((k, _)) = over.first() {
        let mut series: Vec<Series> = Vec::new();
        for row in rows {
            let name = others(row, &[*k]).join(", ");
            let At::Number(at) = row.at[*k] else { continue };
            match series.iter_mut().find(|known| known.name == name) {
                Some(known) => known.points.push((at, row.value)),
                None => series.push(Series { name, points: vec![(at, row.value)] }),
            }
        }
        // Axes that vary together leave a point or two of each line: their rows say more.
        if rows.len() < 2 * series.len() {
            return forest(rows, &|row| others(row, &[]), notes);
        }
        series.iter_mut().for_each(|one| one.points.sort_by(|a, b| a.0.total_cmp(&b.0)));
        if series.len() > MOST_SERIES {
            notes.push(format!("{} more lines", series.len() - MOST_SERIES));
            series.truncate(MOST_SERIES);
        }
        if rows.len() > MOST_POINTS {
            notes.push(format!("{} points, as means of bins with the standard deviation within each", rows.len()));
            series.iter_mut().for_each(|one| one.points = binned(&one.points));
        }
        return Content::Lines { axis: axes[*k].clone(), series };
    }
    forest(rows, &|row| others(row, &[]), notes)
}

/// A row for each name.
fn forest(rows: &[&Row], named: &dyn Fn(&Row) -> Vec<String>, notes: &mut Vec<String>) -> Content {
    if rows.len() > MOST_ROWS {
        notes.push(format!("{} more rows", rows.len() - MOST_ROWS));
    }
    let name = |row: &Row| {
        let named = named(row).join(", ");
        if named.is_empty() { row.region.clone() } else { named }
    };
    Content::Forest { rows: rows.iter().take(MOST_ROWS).map(|row| (name(row), row.value)).collect() }
}

/// Means of equal parts of the axis.
fn binned(points: &[(f64, Value)]) -> Vec<(f64, Value)> {
    let (Some(first), Some(last)) = (points.first(), points.last()) else { return Vec::new() };
    let step = (last.0 - first.0) / BINS as f64;
    let mut bins: BTreeMap<usize, Vec<(f64, f64)>> = BTreeMap::new();
    for (x, value) in points {
        let bin = if step > 0.0 { (((x - first.0) / step) as usize).min(BINS - 1) } else { 0 };
        bins.entry(bin).or_default().push((*x, value.value));
    }
    let mean = |bin: Vec<(f64, f64)>| {
        let n = bin.len() as f64;
        let [x, y] = [bin.iter().map(|p| p.0).sum::<f64>() / n, bin.iter().map(|p| p.1).sum::<f64>() / n];
        let spread = bin.iter().map(|p| (p.1 - y).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
        (x, Value { value: y, se: Some(libm::sqrt(spread)) })
    };
    bins.into_values().map(mean).collect()
}

/// The rows of which a value is known, the names of the axes, and how many rows are left out; `None` for other tables.
fn rows(table: &Table) -> Option<(Vec<Row>, Vec<String>, usize)> {
    let column = |name: &str| table.columns.iter().find(|column| column.name == name);
    let (Cells::Text(regions), Cells::Text(quantities)) = (&column("region")?.cells, &column("quantity")?.cells) else {
        return None;
    };
    let number = |name: &str, row: usize| match &column(name)?.cells {
        Cells::F64(v) => v.get(row).copied(),
        Cells::MaybeF64(v) => v.get(row).copied().flatten(),
        Cells::I64(v) => v.get(row).map(|n| *n as f64),
        Cells::Bool(_) | Cells::Text(_) => None,
    };
    let axes: Vec<(&str, &Column)> =
        table.columns.iter().filter_map(|column| Some((column.name.strip_prefix("axis ")?, column))).collect();
    let own = |row: usize| match column("unit").map(|column| &column.cells) {
        Some(Cells::Text(units)) => units[row].clone(),
        _ => String::new(),
    };
    let at = |column: &Column, row: usize| match &column.cells {
        Cells::F64(v) => At::Number(v[row]),
        Cells::I64(v) => At::Number(v[row] as f64),
        Cells::MaybeF64(v) => v[row].map_or_else(|| At::Text("-".to_owned()), At::Number),
        Cells::Bool(v) => At::Text(v[row].to_string()),
        Cells::Text(v) => At::Text(v[row].clone()),
    };
    let percent = || "%".to_owned();
    let mut found = Vec::new();
    for row in 0..table.rows() {
        let value = |name: &str, se: &str| Value::of(number(name, row), number(se, row));
        let relative = || {
            let truth = number("truth", row)?.abs();
            let se = number("mean_se", row).map(|se| 100.0 * se / truth);
            Value::of(number("bias_percent", row), se)
        };
        let (what, unit, value) = if let Some(v) = value("mean_abs_error_percent", "mean_abs_error_se_percent") {
            ("mean |bias|", percent(), v)
        } else if let Some(v) = value("mean_abs_error", "mean_abs_error_se") {
            ("mean |bias|", own(row), v)
        } else if let Some(v) = relative() {
            ("bias", percent(), v)
        } else if let Some(v) = value("bias", "mean_se") {
            ("bias", own(row), v)
        } else if let Some(v) = value("mean", "mean_se").filter(|_| column("bias").is_none()) {
            ("mean", own(row), v)
        } else {
            continue;
        };
        found.push(Row {
            quantity: quantities[row].clone(),
            region: regions[row].clone(),
            what,
            unit,
            value,
            at: axes.iter().map(|(_, column)| at(column, row)).collect(),
        });
    }
    let unknown = table.rows() - found.len();
    // Where one object fills the image, `all` says the same a second time.
    let said = |row: &Row| {
        let at: Vec<String> = row.at.iter().map(At::text).collect();
        format!("{} {} {:?} {}", row.quantity, at.join(" "), row.value, row.unit)
    };
    let others: HashSet<String> = found.iter().filter(|row| row.region != ALL).map(said).collect();
    found.retain(|row| row.region != ALL || !others.contains(&said(row)));
    Some((found, axes.into_iter().map(|(name, _)| name.to_owned()).collect(), unknown))
}

impl Content {
    /// Least and largest number that is shown, 0 among them where values are differences or a row stands for each name.
    pub fn range(&self, with_zero: bool) -> Option<[f64; 2]> {
        let all: Vec<Value> = match self {
            Self::Lines { series, .. } => series.iter().flat_map(|s| &s.points).map(|(_, v)| *v).collect(),
            Self::Forest { rows } => rows.iter().map(|(_, v)| *v).collect(),
            Self::Heat { cells, .. } => {
                cells.iter().flatten().flatten().map(|value| Value { value: *value, se: None }).collect()
            }
        };
        let values = || all.iter().map(|v| v.value).chain(with_zero.then_some(0.0));
        let (low, high) = (values().reduce(f64::min)?, values().reduce(f64::max)?);
        // Bars far longer than values differ would leave of these a line: they are cut at the frame.
        let most =
            if high > low { [low - (high - low), high + (high - low)] } else { [f64::NEG_INFINITY, f64::INFINITY] };
        let bars = || all.iter().filter_map(Value::interval);
        let low = bars().map(|bar| bar[0]).fold(low, f64::min).max(most[0]);
        let high = bars().map(|bar| bar[1]).fold(high, f64::max).min(most[1]);
        // Equal values stand in the middle.
        let room = if high > low { 0.05 * (high - low) } else { (0.1 * high.abs()).max(1e-12) };
        Some([low - room, high + room])
    }

    /// Least and largest number of the axis.
    pub fn axis_range(&self) -> Option<[f64; 2]> {
        let Self::Lines { series, .. } = self else { return None };
        let all = || series.iter().flat_map(|s| &s.points).map(|(x, _)| *x);
        Some([all().reduce(f64::min)?, all().reduce(f64::max)?])
    }
}

#[cfg(test)]
pub mod tests {
    use super::*;

    /// A table of one quantity with axes, a bias in percent and a standard error of 1 %.
    pub fn table(rows: &[(&str, &[f64], f64)], axes: &[&str]) -> Table {
        let mut table = Table::default();
        table.push("region", "", Cells::Text(rows.iter().map(|r| r.0.to_owned()).collect()));
        table.push("quantity", "", Cells::Text(vec!["mu_a".to_owned(); rows.len()]));
        for (k, axis) in axes.iter().enumerate() {
            table.push(format!("axis {axis}"), "1", Cells::F64(rows.iter().map(|r| r.1[k]).collect()));
        }
        table.push("mean_se", "mm^-1", Cells::F64(vec![0.001; rows.len()]));
        table.push("truth", "mm^-1", Cells::F64(vec![0.1; rows.len()]));
        table.push("bias_percent", "%", Cells::MaybeF64(rows.iter().map(|r| Some(r.2)).collect()));
        table.push("unit", "", Cells::Text(vec!["mm^-1".to_owned(); rows.len()]));
        table
    }

    /// Without axes a row for each region; with one of numbers a line for each region; with two a heat map.
    #[test]
    fn axes_choose_the_chart() {
        let found = charts(&table(&[("lesion", &[], 2.0), ("healthy", &[], -1.0)], &[]));
        let Content::Forest { rows } = &found[0].content else { panic!("{found:?}") };
        assert_eq!((rows[0].0.as_str(), rows[0].1.value), ("lesion", 2.0));
        assert!((rows[0].1.se.unwrap() - 1.0).abs() < 1e-12, "0.001 of 0.1 is 1 %");
        let over: [(&str, &[f64], f64); 4] =
            [("a", &[2.0], 1.0), ("b", &[1.0], 2.0), ("a", &[1.0], 3.0), ("b", &[2.0], 4.0)];
        let found = charts(&table(&over, &["n"]));
        let Content::Lines { axis, series } = &found[0].content else { panic!("{found:?}") };
        assert_eq!((axis.as_str(), series.len(), series[0].name.as_str()), ("n", 2, "a"));
        assert_eq!(series[0].points.iter().map(|p| (p.0, p.1.value)).collect::<Vec<_>>(), [(1.0, 3.0), (2.0, 1.0)]);
        let grid: Vec<([f64; 2], f64)> = (0..9).map(|i| ([f64::from(i % 3), f64::from(i / 3)], f64::from(i))).collect();
        let rows: Vec<(&str, &[f64], f64)> = grid.iter().take(8).map(|(at, v)| ("all", &at[..], *v)).collect();
        let Content::Heat { x, cells, .. } = &charts(&table(&rows, &["p", "q"]))[0].content else {
            panic!("no heat map")
        };
        assert_eq!((x.0.as_str(), cells[1][2], cells[2][2]), ("p", Some(5.0), None));
    }

    /// One number, other tables, and rows of which nothing is known.
    #[test]
    fn what_says_nothing_is_no_chart() {
        assert!(charts(&table(&[("all", &[], 2.0)], &[])).is_empty());
        assert!(charts(&Table::default()).is_empty());
        let mut unknown = table(&[("a", &[], 1.0), ("b", &[], f64::NAN), ("c", &[], 3.0)], &[]);
        let last = unknown.columns.iter().position(|c| c.name == "bias_percent").unwrap();
        unknown.columns[last].cells = Cells::MaybeF64(vec![Some(1.0), None, Some(3.0)]);
        let found = charts(&unknown);
        assert_eq!(found[0].notes, ["1 rows of the table of which nothing is known"]);
    }

    /// Ten thousand points become bins that hold the same mean.
    #[test]
    fn many_points_are_binned() {
        let at: Vec<[f64; 1]> = (0..10_000).map(|i| [f64::from(i)]).collect();
        let rows: Vec<(&str, &[f64], f64)> = at.iter().map(|at| ("all", &at[..], at[0] % 2.0)).collect();
        let found = charts(&table(&rows, &["i"]));
        let Content::Lines { series, .. } = &found[0].content else { panic!("{found:?}") };
        assert_eq!(series[0].points.len(), BINS);
        assert!(
            series[0].points.iter().all(|(_, v)| (v.value - 0.5).abs() < 1e-9 && (v.se.unwrap() - 0.505).abs() < 0.01)
        );
        assert!(found[0].notes[0].starts_with("10000 points"), "{:?}", found[0].notes);
    }
}
