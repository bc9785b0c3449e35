//! The stage `summarize`: the metrics of many instances in one table.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use turbid_contract::payload::Metrics;
use turbid_contract::{Ctx, Error, Forms, Known, Problems, Stage, in_ports, out_ports};

use crate::summary::{Summary, figures, summarize, table};
use crate::{form, joints, over_axes};

/// Params of `summarize`: it has none.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SummarizeParams {}

in_ports! {
    pub struct SummarizeIn {
        /// Of `compare`, one table for each instance.
        metrics: many Metrics,
    }
}

out_ports! {
    pub struct SummarizeOut {
        /// One row for each region and quantity.
        metrics: one Metrics,
        /// One row for each instance, region and quantity, with the axes of the instance: what its charts show.
        over_axes: preview Metrics,
    }
}

/// `use: summarize`
pub struct Summarize;

impl Stage for Summarize {
    const NAME: &'static str = "summarize";
    const VERSION: u32 = 2;
    const ABOUT: &'static str = "mean size of the error over the instances of a compare stage, with its standard error";

    type Params = SummarizeParams;
    type In = SummarizeIn<'static>;
    type Out = SummarizeOut;

    fn check(_: &SummarizeParams, known: &Known, problems: &mut Problems) {
        joints::check_summarize(known, problems);
    }

    fn describe(_: &SummarizeParams, known: &Known) -> Forms {
        form::describe_summarize(known)
    }

    fn run(_: &SummarizeParams, inputs: SummarizeIn<'_>, ctx: Ctx<'_>) -> Result<SummarizeOut, Error> {
        let mut instances = Vec::new();
        for (index, axes) in inputs.metrics.axes().iter().enumerate() {
            let Metrics(table) = inputs.metrics.load(index)?;
            instances.push((axes.clone(), figures(&table)?));
        }
        let over_axes = ctx.wants("over_axes").then(|| Metrics(over_axes::table(&instances)));
        let found: Vec<_> = instances.into_iter().flat_map(|(_, figures)| figures).collect();
        let rows = summarize(&found);
        for row in rows.iter().filter(|row| row.n < row.instances) {
            let Summary { region, quantity, n, instances, .. } = row;
            ctx.warn(format!(
                "region `{region}`: nothing is known of {quantity} in {} of {instances} instances",
                instances - n
            ));
        }
        let without = rows.iter().filter(|row| row.n == 0).count();
        if without > 0 {
            ctx.measure("unknown: rows of which no instance knows anything", without as f64, "1");
        }
        let worst = |of: fn(&Summary) -> Option<f64>| rows.iter().filter_map(of).reduce(f64::max);
        if let Some(worst) = worst(|row| row.mean_abs_error_percent) {
            ctx.measure("error: mean |bias| over instances, worst region", worst, "%");
        }
        if let Some(worst) = worst(|row| row.mean_abs_error.filter(|_| row.unit == "mm")) {
            ctx.measure("error: mean |bias| of positions over instances, worst region", worst, "mm");
        }
        Ok(SummarizeOut { metrics: Metrics(table(&rows)), over_axes })
    }
}
