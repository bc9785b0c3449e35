//! What tables of metrics will hold.

use turbid_contract::{Form, Forms, Known};

use crate::shared::shared;
use crate::{fit, maps};

/// The forms of what `compare` makes; rows depend on what is seen.
pub fn describe_compare(known: &Known) -> Forms {
    let Some(estimate) = known.form("estimate") else { return Forms::new() };
    let errors = ("errors", Form { pixels: estimate.pixels, ..Form::default() });
    if estimate.columns.is_some() {
        return Forms::from([("metrics", Form::table(None, &fit::COLUMNS)), errors]);
    }
    let truth = known.form("truth").and_then(|form| form.layers.as_deref());
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
