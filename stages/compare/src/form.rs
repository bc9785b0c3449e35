//! What tables of metrics will hold.

use turbid_contract::{ColumnInfo, Form, Forms, Known, LayerKind};

use crate::params::Params;
use crate::shared::shared;
use crate::{fit, maps, over_axes, summary, written};

/// The forms of what `compare` makes; rows depend on what is seen.
pub fn describe_compare(params: &Params, known: &Known) -> Forms {
    let Some(estimate) = known.form("estimate") else { return Forms::new() };
    let errors = ("errors", Form { pixels: estimate.pixels, ..Form::default() });
    if estimate.columns.is_some() {
        return Forms::from([("metrics", Form::table(None, &fit::COLUMNS)), errors]);
    }
    let written = estimate.layers.as_deref().filter(|_| !params.concentrations.is_empty());
    let written = written.and_then(|layers| written::quantities(&params.concentrations, layers).ok());
    let truth = known.form("truth").and_then(|form| form.layers.as_deref());
    let truth = if params.concentrations.is_empty() { truth } else { written.as_deref() };
    let units = estimate.layers.as_deref().zip(truth).and_then(|(a, b)| {
        let pairs = shared(a, b).ok()?;
        Some(pairs.into_iter().map(|(k, _)| a[k].unit.clone()).collect::<Vec<_>>())
    });
    // Where units differ, the unit of a column depends on which rows there are.
    let one = units.as_deref().and_then(|units| units.iter().all(|unit| *unit == units[0]).then(|| units[0].clone()));
    let columns = one.map(|unit| maps::COLUMNS.map(|(name, own)| (name, own.unwrap_or(&unit).to_owned())));
    let metrics = columns.map_or_else(Form::default, |columns| {
        let columns: Vec<(&str, &str)> = columns.iter().map(|(name, unit)| (*name, unit.as_str())).collect();
        Form::table(None, &columns)
    });
    Forms::from([("metrics", metrics), errors])
}

/// The form of what `tabulate` makes: rows and columns where the layers of all images are known. `unit`: that which the figures are said to have.
pub fn describe_tabulate(unit: Option<&str>, known: &Known) -> Forms {
    let images = known.forms("values");
    let value = |kind: LayerKind| kind == LayerKind::Value;
    let mut units: Vec<&str> = Vec::new();
    for form in images {
        let Some(layers) = form.layers.as_ref().filter(|_| form.perhaps.iter().all(|info| !value(info.kind))) else {
            return Forms::new();
        };
        units.extend(layers.iter().filter(|info| value(info.kind)).map(|info| info.unit.as_str()));
    }
    let made = match unit {
        // A table without a row has no unit.
        _ if units.is_empty() => "",
        Some(unit) => unit,
        None if known.is_connected("relative_to") => "1",
        None => common(&units),
    };
    let filled = images.iter().zip(known.axes("values")).find(|(form, _)| form.layers_of(LayerKind::Value).count() > 0);
    let axes = filled.into_iter().flat_map(|(_, axes)| axes.keys());
    let columns = tabulated(axes, made).into_iter().map(|(name, unit)| ColumnInfo::new(name, unit)).collect();
    Forms::from([("metrics", Form { rows: Some(units.len() as u64), columns: Some(columns), ..Form::default() })])
}

/// The columns of a table of means with their units, `unit` being that of the means; empty where they have several.
pub fn tabulated<'a>(axes: impl Iterator<Item = &'a String>, unit: &str) -> Vec<(String, String)> {
    // An axis may be called as a column is.
    let axes = axes.map(|name| (format!("axis {name}"), ""));
    let named = |(name, unit): (&str, &'static str)| (name.to_owned(), unit);
    let before = [("region", ""), ("quantity", "")].map(named).into_iter().chain(axes).chain([named(("n", "1"))]);
    let before = before.map(|(name, unit)| (name, unit.to_owned()));
    let means = [("mean", unit), ("mean_se", unit), ("masked_percent", "%"), ("unit", "")];
    before.chain(means.map(|(name, unit)| (name.to_owned(), unit.to_owned()))).collect()
}

/// The form of what `summarize` makes; columns are open where the tables do not say one unit.
pub fn describe_summarize(known: &Known) -> Forms {
    let mut units = Vec::new();
    for form in known.forms("metrics") {
        let Some(columns) = &form.columns else { return Forms::new() };
        units.extend(columns.iter().filter(|column| column.name == "mean").map(|column| column.unit.as_str()));
    }
    let unit = common(&units);
    if unit.is_empty() {
        return Forms::new();
    }
    let columns = summary::MADE.map(|(name, own)| (name, own.unwrap_or(unit)));
    let axes = known.axes("metrics").first().into_iter().flat_map(|axes| axes.keys());
    let axes: Vec<String> = axes.map(|name| over_axes::column_of(name)).collect();
    let axes = axes.iter().map(|name| (name.as_str(), ""));
    let after = over_axes::AFTER.map(|(name, own)| (name, own.unwrap_or(unit)));
    let rows: Vec<_> = over_axes::BEFORE.into_iter().chain(axes).chain(after).collect();
    Forms::from([("metrics", Form::table(None, &columns)), ("over_axes", Form::table(None, &rows))])
}

/// The unit that all have; empty where they differ, or where there are none.
fn common<'a>(units: &[&'a str]) -> &'a str {
    let first = units.first().copied().unwrap_or_default();
    if units.iter().all(|unit| *unit == first) { first } else { "" }
}
