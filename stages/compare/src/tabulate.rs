//! The stage `tabulate`: means of images along axes in one table.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use turbid_contract::payload::{Metrics, Stack};
use turbid_contract::serde_json::Value;
use turbid_contract::{Axes, Cells, Ctx, Error, Forms, Known, Many, Problems, Stage, Table, in_ports, out_ports};

use crate::levels::{Level, levels, point, same_unit, text};
use crate::{form, joints};

/// Params of `tabulate`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TabulateParams {
    /// What every figure is multiplied with: 255 for the grey levels of 8 bits.
    #[serde(default = "one")]
    pub scale: f64,
    /// Unit of the figures; left out, that of the images, or 1 where they are `relative_to` others.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
}

fn one() -> f64 {
    1.0
}

impl Default for TabulateParams {
    fn default() -> Self {
        Self { scale: one(), unit: None }
    }
}

in_ports! {
    pub struct TabulateIn {
        /// The images: one line of the table for each instance and quantity.
        values: some Stack,
        /// What is subtracted: images with the same axes, or one for all.
        minus: many Stack,
        /// What the means are divided by: an image whose layers are the same quantities.
        relative_to: optional Stack,
    }
}

out_ports! {
    pub struct TabulateOut {
        /// One row for each instance and quantity: axes, mean over the pixels that are not masked, its standard error.
        metrics: one Metrics,
    }
}

/// `use: tabulate`
pub struct Tabulate;

impl Stage for Tabulate {
    const NAME: &'static str = "tabulate";
    const VERSION: u32 = 2;
    const ABOUT: &'static str = "means of images along axes, their differences and ratios, with standard errors";

    type Params = TabulateParams;
    type In = TabulateIn<'static>;
    type Out = TabulateOut;

    fn check(params: &TabulateParams, known: &Known, problems: &mut Problems) {
        joints::check_tabulate(known, problems);
        problems.require(params.scale != 0.0, "scale", params.scale, "", "not be 0");
    }

    fn describe(params: &TabulateParams, known: &Known) -> Forms {
        form::describe_tabulate(params.unit.as_deref(), known)
    }

    fn run(params: &TabulateParams, inputs: TabulateIn<'_>, ctx: Ctx<'_>) -> Result<TabulateOut, Error> {
        let divisors = inputs.relative_to.as_ref().map(|Stack(stack)| levels(stack));
        let mut rows = Vec::new();
        for (index, axes) in inputs.values.axes().iter().enumerate() {
            ctx.checked()?;
            let Stack(values) = inputs.values.load(index)?;
            let base = base(&inputs.minus, axes)?.map(|base| levels(&base));
            for level in levels(&values) {
                let mut level = level;
                if let Some(base) = &base {
                    level = level.minus(find(base, &level, "minus")?);
                }
                if let Some(divisors) = &divisors {
                    let divisor = find(divisors, &level, "relative_to")?;
                    let nothing = || Error::failed(format!("relative_to: the mean of {} is 0", level.label()));
                    level = level.over(divisor).ok_or_else(nothing)?;
                }
                level.mean = level.mean.map(|mean| mean * params.scale);
                level.mean_se = level.mean_se.map(|se| se * params.scale.abs());
                if let Some(unit) = &params.unit {
                    level.info.unit.clone_from(unit);
                }
                rows.push(Row { axes, level });
            }
        }
        for row in rows.iter().filter(|row| row.level.n == 0) {
            let (at, label) = (point(row.axes), row.level.label());
            ctx.warn(format!("{at}: every pixel is masked, nothing is known of {label}"));
        }
        let without = rows.iter().filter(|row| row.level.n == 0).count();
        if without > 0 {
            ctx.measure("unknown: rows with every pixel masked", without as f64, "1");
        }
        Ok(TabulateOut { metrics: Metrics(table(&rows)) })
    }
}

/// A row of the table.
struct Row<'a> {
    axes: &'a Axes,
    level: Level,
}

/// The images to subtract at a point: those with its axes, or the only ones.
fn base(minus: &Many<'_, Stack>, axes: &Axes) -> Result<Option<turbid_contract::ImageStack>, Error> {
    let count = minus.axes().len();
    if count == 0 {
        return Ok(None);
    }
    let within = |own: &Axes| own.iter().all(|(name, value)| axes.get(name) == Some(value));
    let found = minus.axes().iter().position(within);
    let missing = || Error::failed(format!("minus: there is nothing at {}", point(axes)));
    minus.load(found.ok_or_else(missing)?).map(|Stack(stack)| Some(stack))
}

fn find<'a>(among: &'a [Level], level: &Level, port: &str) -> Result<&'a Level, Error> {
    let found = among.iter().find(|other| other.matches(level)).ok_or_else(|| {
        let names: Vec<String> = among.iter().map(Level::label).collect();
        Error::failed(format!("{port}: the images have no {}; they have {}", level.label(), names.join(", ")))
    })?;
    same_unit(&level.info, &found.info)?;
    Ok(found)
}

fn table(rows: &[Row<'_>]) -> Table {
    let texts = |f: &dyn Fn(&Row<'_>) -> String| Cells::Text(rows.iter().map(f).collect());
    let mut cells = vec![texts(&|r| point(r.axes)), texts(&|r| r.level.label())];
    for name in rows.first().into_iter().flat_map(|row| row.axes.keys()) {
        let values = || rows.iter().map(|row| row.axes.get(name));
        cells.push(match values().map(|value| value.and_then(Value::as_f64)).collect::<Option<Vec<f64>>>() {
            Some(numbers) => Cells::F64(numbers),
            None => Cells::Text(values().map(|value| value.map(text).unwrap_or_default()).collect()),
        });
    }
    let unit = rows.first().map_or("", |r| r.level.info.unit.as_str());
    let unit = if rows.iter().all(|r| r.level.info.unit == unit) { unit } else { "" };
    let masked = |r: &Row<'_>| 100.0 * (r.level.pixels - r.level.n) as f64 / r.level.pixels as f64;
    cells.extend([
        Cells::I64(rows.iter().map(|r| r.level.n as i64).collect()),
        Cells::MaybeF64(rows.iter().map(|r| r.level.mean).collect()),
        Cells::MaybeF64(rows.iter().map(|r| r.level.mean_se).collect()),
        Cells::F64(rows.iter().map(masked).collect()),
        texts(&|r| r.level.info.unit.clone()),
    ]);
    let axes = rows.first().into_iter().flat_map(|row| row.axes.keys());
    let mut table = Table::default();
    for ((name, unit), cells) in form::tabulated(axes, unit).into_iter().zip(cells) {
        table.push(name, unit, cells);
    }
    table
}
