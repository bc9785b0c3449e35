//! Metrics of many instances one below the other, with the axes that tell them apart: what a chart over an axis shows.

use serde_json::Value;
use turbid_contract::{Axes, Cells, Table};

use crate::summary::{Figure, Known};

/// Columns before those of the axes: name and unit.
pub const BEFORE: [(&str, &str); 2] = [("region", ""), ("quantity", "")];

/// Columns after those of the axes; no unit: that of the means.
pub const AFTER: [(&str, Option<&str>); 7] = [
    ("mean", None),
    ("mean_se", None),
    ("truth", None),
    ("bias", None),
    ("bias_percent", Some("%")),
    ("masked_percent", Some("%")),
    ("unit", Some("")),
];

/// The column with the values of an axis.
pub fn column_of(axis: &str) -> String {
    format!("axis {axis}")
}

/// A row for each figure of each instance: `region`, `quantity`, `axis NAME`, `mean`, `mean_se`, `truth`, `bias`, `bias_percent`, `masked_percent`, `unit`.
///
/// `bias_percent` is null where the truth is 0 and of positions (mm), as in the summary; all that is known of nothing is null.
pub fn table(instances: &[(Axes, Vec<Figure>)]) -> Table {
    let rows: Vec<(&Axes, &Figure)> =
        instances.iter().flat_map(|(axes, figures)| figures.iter().map(move |figure| (axes, figure))).collect();
    let unit = rows.first().map_or("", |(_, figure)| figure.unit.as_str());
    let unit = if rows.iter().all(|(_, figure)| figure.unit == unit) { unit } else { "" };
    let texts = |of: &dyn Fn(&Figure) -> String| Cells::Text(rows.iter().map(|(_, figure)| of(figure)).collect());
    let known = |of: &dyn Fn(&Figure, &Known) -> Option<f64>| {
        Cells::MaybeF64(rows.iter().map(|(_, figure)| of(figure, figure.known.as_ref()?)).collect())
    };
    let mut table = Table::default();
    table.push("region", "", texts(&|figure| figure.region.clone()));
    table.push("quantity", "", texts(&|figure| figure.quantity.clone()));
    for name in instances.first().into_iter().flat_map(|(axes, _)| axes.keys()) {
        let values = || rows.iter().map(|(axes, _)| axes.get(name));
        let numbers: Option<Vec<f64>> = values().map(|value| value.and_then(Value::as_f64)).collect();
        let text = |value: Option<&Value>| match value {
            Some(Value::String(text)) => text.clone(),
            Some(other) => other.to_string(),
            None => String::new(),
        };
        let cells = numbers.map_or_else(|| Cells::Text(values().map(text).collect()), Cells::F64);
        table.push(column_of(name), "", cells);
    }
    table.push("mean", unit, known(&|_, known| Some(known.mean)));
    table.push("mean_se", unit, known(&|_, known| known.mean_se));
    table.push("truth", unit, known(&|_, known| Some(known.truth)));
    table.push("bias", unit, known(&|_, known| Some(known.mean - known.truth)));
    let relative = |figure: &Figure, known: &Known| {
        let has_percent = figure.unit != "mm" && known.truth != 0.0;
        has_percent.then(|| 100.0 * (known.mean - known.truth) / known.truth)
    };
    table.push("bias_percent", "%", known(&relative));
    table.push("masked_percent", "%", Cells::F64(rows.iter().map(|(_, figure)| figure.masked_percent).collect()));
    table.push("unit", "", texts(&|figure| figure.unit.clone()));
    table
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    /// Axes of numbers stay numbers; a truth of 0 has no percentage; nothing known is null.
    #[test]
    fn rows_know_their_axes() {
        let figure = |known: Option<[f64; 2]>| Figure {
            region: "all".into(),
            quantity: "mu_a".into(),
            unit: "mm^-1".into(),
            known: known.map(|[mean, truth]| Known { mean, mean_se: Some(0.01), truth }),
            masked_percent: 0.0,
        };
        let axes = |n: f64, kind: &str| -> Axes {
            [("n".to_owned(), json!(n)), ("kind".to_owned(), json!(kind))].into_iter().collect()
        };
        let table = table(&[
            (axes(1.0, "a"), vec![figure(Some([0.3, 0.2]))]),
            (axes(2.0, "b"), vec![figure(Some([0.1, 0.0])), figure(None)]),
        ]);
        let names: Vec<&str> = table.columns.iter().map(|c| c.name.as_str()).collect();
        let before = BEFORE.iter().map(|(name, _)| *name);
        let told: Vec<&str> =
            before.chain(["axis kind", "axis n"]).chain(AFTER.iter().map(|(name, _)| *name)).collect();
        assert_eq!(names, told, "the form says otherwise");
        let column = |name: &str| &table.columns.iter().find(|c| c.name == name).expect("a column").cells;
        assert!(matches!(column("axis n"), Cells::F64(v) if v[..] == [1.0, 2.0, 2.0]));
        assert!(matches!(column("axis kind"), Cells::Text(v) if v[..] == ["a", "b", "b"]));
        let Cells::MaybeF64(bias) = column("bias_percent") else { panic!("numbers") };
        assert!((bias[0].unwrap() - 50.0).abs() < 1e-9 && bias[1].is_none() && bias[2].is_none(), "{bias:?}");
    }
}
