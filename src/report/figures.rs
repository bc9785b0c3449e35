//! The figures that a run ends with: what its tables of metrics say, a line for each region and quantity.

use serde_json::{Map, Value, json};
use turbid_contract::{Artifact, Cells, Column, Table};

use crate::plan::{InstanceId, PREVIEW_INSTANCES, Plan};
use crate::run::Summary;
use crate::store::Store;

/// The payload whose tables are read.
const PAYLOAD: &str = "metrics";

/// With more lines than this, tables that have a region of this name show it alone.
const MANY: usize = 60;
const ALL: &str = "all";

/// More lines than this are left to `turbid show`.
const MOST: usize = 120;

/// One row of a table of metrics.
struct Row {
    label: String,
    instance: InstanceId,
    region: String,
    /// Whether the table has a row of the region `all`.
    has_all: bool,
    cells: Map<String, Value>,
}

/// The rows of all stages whose metrics no other stage of the run sums up, and of what is left out the reason.
pub struct Figures {
    rows: Vec<Row>,
    notes: Vec<String>,
    /// Whether a table turned out damaged or gone.
    pub lost: bool,
}

impl Figures {
    /// Reads the tables of what a run made or found. One that cannot be read is left out: a run that needs it says so.
    pub fn read(plan: &Plan, store: &Store, summary: &Summary) -> Self {
        let (mut rows, mut notes, mut lost) = (Vec::new(), Vec::new(), false);
        for &stage in &plan.needed {
            let name = &plan.spec.stages[stage].name;
            let port = plan.outputs(stage).iter().find(|port| port.payload == PAYLOAD);
            let summed_up = plan.consumers(stage).iter().any(|&consumer| plan.needs(consumer));
            let Some(port) = port.filter(|_| !summed_up) else { continue };
            let count = plan.instances_of(stage).len();
            if count > PREVIEW_INSTANCES {
                notes.push(format!(
                    "{name}: {count} instances; `use: summarize` says what they have in common, `turbid show` what each of them says"
                ));
                continue;
            }
            for id in plan.instances_of(stage) {
                let blob = summary.brief(id).and_then(|brief| brief.outputs.get(port.name)).copied();
                let blob = blob.filter(|blob| !store.is_released(blob));
                match blob.map(|blob| store.get(&blob)) {
                    Some(Ok(Artifact::Table(table))) => rows.extend(rows_of(&plan.label(id), id, &table)),
                    Some(Err(error)) => lost |= error.is_lost_blob(),
                    _ => {}
                }
            }
        }
        if rows.len() > MANY {
            let before = rows.len();
            rows.retain(|row| !row.has_all || row.region == ALL);
            if rows.len() < before {
                notes.push(format!("{} more lines: `turbid show FILE STAGE`", before - rows.len()));
            }
        }
        if rows.len() > MOST {
            notes.push(format!("{} more lines: `turbid show FILE STAGE`", rows.len() - MOST));
            rows.truncate(MOST);
        }
        Self { rows, notes, lost }
    }

    /// A block of aligned lines for each kind of table; empty where there is nothing to say.
    pub fn text(&self) -> String {
        let blocks = self.blocks();
        let blocks = blocks.iter().map(|lines| format!("\n{}", aligned(lines)));
        blocks.chain(self.notes.iter().map(|note| format!("{note}\n"))).collect()
    }

    /// For each kind of table its lines, the heads of the columns first.
    pub fn blocks(&self) -> Vec<Vec<Vec<String>>> {
        let mut kinds: Vec<Kind> = Vec::new();
        for kind in self.rows.iter().map(|row| Kind::of(&row.cells)) {
            if !kinds.contains(&kind) {
                kinds.push(kind);
            }
        }
        let block = |kind: Kind| {
            let head = ["figures", "region", "quantity"].into_iter().chain(kind.heads().iter().copied());
            let rows = self.rows.iter().filter(move |row| Kind::of(&row.cells) == kind);
            let line = |row: &Row| {
                let quantity = row.cells.get("quantity").and_then(Value::as_str).unwrap_or_default();
                let start = [row.label.clone(), row.region.clone(), quantity.to_owned()];
                start.into_iter().chain(kind.figures(&row.cells)).collect()
            };
            std::iter::once(head.map(str::to_owned).collect()).chain(rows.map(line)).collect()
        };
        kinds.into_iter().map(block).collect()
    }

    /// What is left out, and why.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// The same for programs: all columns of each line.
    pub fn events(&self, plan: &Plan) -> Vec<Value> {
        let event = |row: &Row| {
            let (stage, axes) = (plan.stage_name(row.instance), plan.axes(row.instance));
            json!({"event": "figures", "stage": stage, "axes": axes, "figures": row.cells})
        };
        self.rows.iter().map(event).collect()
    }
}

fn rows_of(label: &str, instance: InstanceId, table: &Table) -> Vec<Row> {
    let texts = |name: &str| table.columns.iter().find(|c| c.name == name).map(|c| &c.cells);
    let Some(Cells::Text(regions)) = texts("region") else { return Vec::new() };
    let has_all = regions.iter().any(|region| region == ALL);
    let row = |(i, region): (usize, &String)| Row {
        label: label.to_owned(),
        instance,
        region: region.clone(),
        has_all,
        cells: table.columns.iter().map(|column| (column.name.clone(), cell(column, i))).collect(),
    };
    regions.iter().enumerate().map(row).collect()
}

fn cell(column: &Column, row: usize) -> Value {
    match &column.cells {
        Cells::F64(v) => json!(v[row]),
        Cells::MaybeF64(v) => json!(v[row]),
        Cells::I64(v) => json!(v[row]),
        Cells::Bool(v) => json!(v[row]),
        Cells::Text(v) => json!(v[row]),
    }
}

/// Which figures a table has, by its columns.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    /// Over instances.
    Summary,
    /// Of media: with z.
    Fit,
    /// Of regions of maps.
    Regions,
    /// Means of layers, or their differences.
    Levels,
}

impl Kind {
    fn of(cells: &Map<String, Value>) -> Self {
        if cells.contains_key("mean_abs_error") {
            Self::Summary
        } else if cells.contains_key("z") {
            Self::Fit
        } else if cells.contains_key("bias") {
            Self::Regions
        } else {
            Self::Levels
        }
    }

    fn heads(self) -> &'static [&'static str] {
        match self {
            Self::Summary => &["mean |bias|", "noise alone", "bias", "worst", "masked", "instances"],
            Self::Fit => &["bias", "RMSE", "log RMS", "z", "without a fit"],
            Self::Regions => &["bias", "RMSE", "95 %", "masked"],
            Self::Levels => &["mean", "unit", "masked"],
        }
    }

    /// What stands below the heads; `-` where nothing is known.
    fn figures(self, cells: &Map<String, Value>) -> Vec<String> {
        let known = cells.get("n").and_then(Value::as_f64).is_none_or(|n| n > 0.0);
        let value = |name: &str| cells.get(name).and_then(Value::as_f64).filter(|_| known);
        let unit = cells.get("unit").and_then(Value::as_str).unwrap_or_default();
        // What has no percentage (a position, which has no natural zero; a truth of 0) is said in its own unit.
        let either = |percent: &str, own: &str| match value(percent) {
            Some(percent) => (Some(percent), "%"),
            None => (value(own), unit),
        };
        let plain = |(value, unit): (Option<f64>, &str)| value.map_or("-".to_owned(), |v| with_unit(&short(v), unit));
        let signed = |(value, unit): (Option<f64>, &str)| {
            value.map_or("-".to_owned(), |v| {
                with_unit(&format!("{}{}", if v < 0.0 { "-" } else { "+" }, short(v.abs())), unit)
            })
        };
        let masked = cells.get("masked_percent").and_then(Value::as_f64);
        let masked = masked.map_or("-".to_owned(), |share| with_unit(&short(share), "%"));
        match self {
            Self::Summary => {
                let (size, unit) = either("mean_abs_error_percent", "mean_abs_error");
                // An error in the unit of what it is the error of.
                let of = if unit == "%" { "mean_abs_error_se_percent" } else { "mean_abs_error_se" };
                let se = value(of);
                let count = |name: &str| cells.get(name).and_then(Value::as_i64).unwrap_or(0);
                let only = |name: &str| plain((value(name), "%"));
                let turned = |name: &str| signed((value(name), "%"));
                vec![
                    size.map_or("-".to_owned(), |size| with_error(size, se, unit, "")),
                    only("noise_percent"),
                    turned("bias_percent"),
                    turned("worst_percent"),
                    masked,
                    match (count("n"), count("instances")) {
                        (n, all) if n == all => format!("{n}"),
                        (n, all) => format!("{n} of {all}"),
                    },
                ]
            }
            Self::Fit | Self::Regions => {
                let (bias, unit) = either("bias_percent", "bias");
                let relative =
                    |se: f64| if unit == "%" { 100.0 * se / value("truth").unwrap_or(0.0).abs() } else { se };
                let mean_se = value("mean_se").map(relative);
                let bias = bias.map_or("-".to_owned(), |bias| {
                    with_error(bias.abs(), mean_se, unit, if bias < 0.0 { "-" } else { "+" })
                });
                let rmse = plain(either("rmse_percent", "rmse"));
                if self == Self::Fit {
                    let log = plain((value("rms_log").map(|log| 100.0 * log), "%"));
                    return vec![bias, rmse, log, value("z").map_or("-".to_owned(), |z| format!("{z:.2}")), masked];
                }
                // Of other quantities 95 % are in their own unit.
                vec![bias, rmse, plain((value("p95"), unit_of(cells))), masked]
            }
            Self::Levels => {
                let mean = value("mean");
                let sign = if mean.is_some_and(|mean| mean < 0.0) { "-" } else { "" };
                let mean = mean.map_or("-".to_owned(), |mean| with_error(mean.abs(), value("mean_se"), "", sign));
                vec![mean, unit.to_owned(), masked]
            }
        }
    }
}

fn unit_of(cells: &Map<String, Value>) -> &str {
    cells.get("unit").and_then(Value::as_str).unwrap_or_default()
}

pub fn with_unit(number: &str, unit: &str) -> String {
    if matches!(unit, "" | "1") { number.to_owned() } else { format!("{number} {unit}") }
}

/// Two digits that count, without an exponent where that reads well.
pub fn short(value: f64) -> String {
    rounded(value, two_digits(value))
}

/// The power of ten of the second digit that counts of a magnitude.
fn two_digits(value: f64) -> i32 {
    // By way of the text: 0.0996 has its digits at 0.10.
    let text = format!("{:.1e}", value.abs());
    let exponent: i32 = text.split_once('e').and_then(|(_, e)| e.parse().ok()).unwrap_or(0);
    exponent - 1
}

/// A value rounded to a power of ten.
fn rounded(value: f64, power: i32) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    if power < -6 {
        return format!("{value:.1e}");
    }
    if power <= 0 {
        return format!("{value:.*}", power.unsigned_abs() as usize);
    }
    let step = 10.0_f64.powi(power);
    format!("{:.0}", (value / step).round() * step)
}

/// `1.5 (0.3) %`: a magnitude behind its sign, to the digits that its standard error leaves: one of the error's, two where they begin with 1.
/// An error of 0 is none; one that is not known is said to be so.
fn with_error(size: f64, se: Option<f64>, unit: &str, sign: &str) -> String {
    let number = match se {
        Some(se) if se > 0.0 && se.is_finite() => {
            let digits = format!("{se:.1e}");
            let power = two_digits(se) + i32::from(!digits.starts_with('1'));
            // A value far below its error is 0 to the digits that count.
            format!(
                "{sign}{} ({})",
                if size == 0.0 { "0".to_owned() } else { rounded(size, power) },
                rounded(se, power)
            )
        }
        Some(_) => format!("{sign}{}", short(size)),
        None => format!("{sign}{} (unknown)", short(size)),
    };
    with_unit(&number, unit)
}

/// Columns to the left, two blanks between them.
pub fn aligned(lines: &[Vec<String>]) -> String {
    let columns = lines.iter().map(Vec::len).max().unwrap_or(0);
    let width = |column: usize| lines.iter().filter_map(|l| l.get(column)).map(|c| c.chars().count()).max();
    let widths: Vec<usize> = (0..columns).map(|column| width(column).unwrap_or(0)).collect();
    let line = |cells: &Vec<String>| {
        let padded: Vec<String> = cells.iter().zip(&widths).map(|(cell, width)| format!("{cell:<width$}")).collect();
        format!("{}\n", padded.join("  ").trim_end())
    };
    lines.iter().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::Id;

    /// A value keeps the digits that its error leaves, whatever the size of both.
    #[test]
    fn errors_choose_the_digits() {
        let bias = |value: f64, se: f64| with_error(value.abs(), Some(se), "%", if value < 0.0 { "-" } else { "+" });
        assert_eq!(bias(-1.127, 0.38), "-1.1 (0.4) %");
        assert_eq!(bias(1.127, 0.12), "+1.13 (0.12) %");
        assert_eq!(bias(163.0, 148.0), "+160 (150) %");
        assert_eq!(bias(-13.2, 5.4), "-13 (5) %");
        assert_eq!(bias(0.0, 0.0), "+0 %");
        assert_eq!(bias(0.001, 0.2), "+0.0 (0.2) %");
        assert_eq!(bias(5.0, 0.0996), "+5.00 (0.10) %");
        assert_eq!(with_error(1.25, None, "mm", ""), "1.2 (unknown) mm");
        assert_eq!(
            [0.0, 0.0213, 1.48, 14.6, 176.0, 9.96, 3.2e-9].map(short),
            ["0", "0.021", "1.5", "15", "180", "10", "3.2e-9"]
        );
    }

    fn table(columns: &[(&str, Cells)]) -> Table {
        let columns = columns.iter().map(|(name, cells)| {
            let (name, unit) = ((*name).to_owned(), String::new());
            Column { name, unit, cells: cells.clone() }
        });
        Table { columns: columns.collect(), attributes: Default::default() }
    }

    fn text(tables: &[(&str, Table)]) -> String {
        let rows = tables.iter().flat_map(|(label, table)| rows_of(label, InstanceId::new(0), table)).collect();
        Figures { rows, notes: Vec::new(), lost: false }.text()
    }

    /// A region of which nothing is known says so, an unknown standard error too; a height is in mm.
    #[test]
    fn what_is_not_known_is_not_a_number() {
        let texts = |cells: &[&str]| Cells::Text(cells.iter().map(|&c| c.to_owned()).collect());
        let maybe = |cells: &[Option<f64>]| Cells::MaybeF64(cells.to_vec());
        let regions = table(&[
            ("region", texts(&["lesion", "shade", "lesion"])),
            ("quantity", texts(&["mu_a", "mu_a", "height"])),
            ("n", Cells::I64(vec![9, 0, 4])),
            ("mean_se", maybe(&[None, None, Some(0.02)])),
            ("truth", maybe(&[Some(0.1), None, Some(20.0)])),
            ("bias_percent", maybe(&[Some(-2.5), None, None])),
            ("rmse_percent", maybe(&[Some(3.0), None, None])),
            ("masked_percent", maybe(&[Some(12.5), Some(100.0), Some(0.0)])),
            ("bias", maybe(&[Some(-0.0025), None, Some(0.05)])),
            ("rmse", maybe(&[Some(0.003), None, Some(1.87)])),
            ("p95", maybe(&[Some(0.006), None, Some(3.53)])),
            ("unit", texts(&["mm^-1", "mm^-1", "mm"])),
        ]);
        let expected = "
figures  region  quantity  bias              RMSE    95 %          masked
metrics  lesion  mu_a      -2.5 (unknown) %  3.0 %   0.0060 mm^-1  12 %
metrics  shade   mu_a      -                 -       -             100 %
metrics  lesion  height    +0.05 (0.02) mm   1.9 mm  3.5 mm        0 %
";
        assert_eq!(text(&[("metrics", regions)]), expected);
    }

    /// Each medium of a fit has its line: one without a fit says so, and one whose truth is 0 has its error in the unit of the quantity.
    #[test]
    fn a_fit_says_what_it_knows_of_each_medium() {
        let texts = |cells: &[&str]| Cells::Text(cells.iter().map(|&c| c.to_owned()).collect());
        let maybe = |cells: &[Option<f64>]| Cells::MaybeF64(cells.to_vec());
        let media = table(&[
            ("region", texts(&["milk", "black", "water"])),
            ("quantity", texts(&["mu_a"; 3])),
            ("n", Cells::I64(vec![1, 0, 1])),
            ("mean_se", maybe(&[Some(0.001), None, Some(0.0004)])),
            ("truth", maybe(&[Some(0.1), None, Some(0.0)])),
            ("bias_percent", maybe(&[Some(2.0), None, None])),
            ("rmse_percent", maybe(&[Some(2.0), None, None])),
            ("masked_percent", maybe(&[Some(0.0), Some(100.0), Some(0.0)])),
            ("bias", maybe(&[Some(0.002), None, Some(0.0031)])),
            ("rmse", maybe(&[Some(0.002), None, Some(0.0031)])),
            ("z", maybe(&[Some(2.0), None, Some(7.75)])),
            ("rms_log", maybe(&[Some(0.0198), None, None])),
            ("unit", texts(&["mm^-1"; 3])),
        ]);
        let expected = "
figures  region  quantity  bias                    RMSE          log RMS  z     without a fit
fit      milk    mu_a      +2.0 (1.0) %            2.0 %         2.0 %    2.00  0 %
fit      black   mu_a      -                       -             -        -     100 %
fit      water   mu_a      +0.0031 (0.0004) mm^-1  0.0031 mm^-1  -        7.75  0 %
";
        assert_eq!(text(&[("fit", media)]), expected);
    }
}
