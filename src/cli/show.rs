//! `turbid show`: what the stored outputs hold: digest, path, layers, units, statistics, cost.

use std::collections::BTreeMap;
use std::path::Path;

use clap::Args;
use serde_json::{Map, Value, json};
use turbid_contract::payload::MaskReason;
use turbid_contract::{Artifact, Cells, ImageStack, LayerKind, Table};

use crate::plan::{InstanceId, Plan};
use crate::registry::Registry;
use crate::resolve::{Resolver, State};
use crate::run::latest::copy_of;
use crate::store::{Blob, InstanceRecord, Store};

use super::select::Selector;
use super::{Done, Failure, Pipeline, print, print_json, report_of};

#[derive(Args)]
pub struct Show {
    #[command(flatten)]
    pipeline: Pipeline,
    /// STAGE[axis=value,…][.PORT]; everything by default
    #[arg(value_name = "STAGE")]
    selector: Option<String>,
    #[arg(long)]
    json: bool,
}

impl Show {
    pub fn run(&self, registry: &Registry) -> Done {
        let selector = self.selector.as_deref().map(Selector::parse).transpose()?;
        let targets: Vec<String> = selector.iter().map(|s| s.stage.clone()).collect();
        let plan = self.pipeline.plan(registry, &targets)?;
        let ids = match &selector {
            Some(selector) => selector.instances(&plan)?,
            None => plan.needed_instances().collect(),
        };
        let store = self.pipeline.store_to_read()?;
        let resolver = Resolver::new(&plan, &store);
        let survey = resolver.survey(&[]);
        let report = report_of(&plan, &survey);
        if report.has_errors() {
            return Err(report.into());
        }
        let port = selector.as_ref().and_then(|s| s.port.as_deref());
        let mut instances = Vec::new();
        for id in ids {
            match &survey.states[id] {
                Some(State::Hit(record)) => {
                    instances.push(instance(&plan, &store, id, record, port, self.pipeline.outputs.path())?)
                }
                _ if store.unread().is_some() => return Err(Failure::Failed(store.unread().unwrap_or_default())),
                _ if selector.is_some() => {
                    let hint = format!(
                        "turbid run {} {}",
                        self.pipeline.file.display(),
                        plan.spec.stages[plan.instances[id].stage].name
                    );
                    return Err(Failure::Failed(format!(
                        "{} has not run yet with these parameters; try `{hint}`",
                        plan.label(id)
                    )));
                }
                _ => {}
            }
        }
        if self.json {
            print_json(&json!({ "instances": instances }).to_string());
        } else if instances.is_empty() {
            print("nothing has run yet");
        } else {
            print(&instances.iter().map(text).collect::<Vec<_>>().join("\n"));
        }
        Ok(())
    }
}

fn instance(
    plan: &Plan,
    store: &Store,
    id: InstanceId,
    record: &InstanceRecord,
    port: Option<&str>,
    outputs: &Path,
) -> Result<Value, Failure> {
    let mut ports = Map::new();
    // A blob in a pack has no file of its own, but people have a copy by name.
    let path = |blob: &Blob, port: &str| store.file_of(blob).or_else(|| copy_of(plan, id, port, blob, outputs));
    for (name, described) in record.ports.iter().filter(|(name, _)| port.is_none_or(|p| p == *name)) {
        let artifact = store
            .get(&described.blob)
            .map_err(|e| Failure::Failed(format!("{}.{name}: {e}; a run makes it again", plan.label(id))))?;
        let mut entry = json!({
            "payload": described.payload, "digest": described.blob.digest.to_string(), "bytes": described.blob.bytes,
            "path": path(&described.blob, name).map(|p| p.display().to_string()),
        });
        match &artifact {
            Artifact::Images(stack) => {
                entry["rows"] = json!(stack.rows());
                entry["columns"] = json!(stack.columns());
                entry["layers"] = layers(stack);
                entry["attributes"] = json!(stack.attributes);
            }
            Artifact::Table(table) => {
                entry["rows"] = json!(table.rows());
                entry["columns"] = columns(table);
                entry["attributes"] = json!(table.attributes);
            }
            Artifact::Record(record) => {
                entry["rows"] = json!(1);
                entry["fields"] = json!(record.fields);
                let column = |(name, value): (&String, &Value)| {
                    let number = value.as_f64();
                    json!({"name": name, "unit": "", "min": number, "mean": number, "max": number})
                };
                entry["columns"] = record.fields.iter().map(column).collect();
            }
        }
        ports.insert(name.clone(), entry);
    }
    if let Some(port) = port
        && ports.is_empty()
    {
        return Err(Failure::Failed(format!(
            "{} has no output `{port}` stored; ask for it with `run FILE {}.{port}`",
            plan.label(id),
            record.provenance.stage
        )));
    }
    let instance = &plan.instances[id];
    let measures: Map<String, Value> = record
        .measures
        .iter()
        .map(|(name, value, unit)| (name.clone(), json!({"value": value, "unit": unit})))
        .collect();
    Ok(json!({
        "stage": plan.spec.stages[instance.stage].name, "use": record.use_name, "axes": instance.axes,
        "key": record.key.to_string(), "seconds": record.cost.wall_s, "cpu_seconds": record.cost.cpu_s,
        "peak_bytes": record.cost.peak_bytes, "alone": record.cost.alone, "measures": measures,
        "warnings": record.warnings, "kernel": record.kernel, "refused": record.refused, "ports": ports,
    }))
}

/// Statistics skip masked pixels, except those of the mask itself.
fn layers(stack: &ImageStack) -> Value {
    let mask = stack.layers.iter().find(|l| l.info.is_pixel_mask());
    let rows: Vec<Value> = stack
        .layers
        .iter()
        .map(|layer| {
            let good = |i: usize| {
                layer.info.kind == LayerKind::Mask || mask.is_none_or(|m| m.data.as_slice().is_none_or(|m| m[i] == 0.0))
            };
            let (mut n, mut sum, mut min, mut max) = (0u64, 0.0, f64::INFINITY, f64::NEG_INFINITY);
            for (_, &pixel) in layer.data.iter().enumerate().filter(|(i, _)| good(*i)) {
                let pixel = f64::from(pixel);
                (n, sum, min, max) = (n + 1, sum + pixel, min.min(pixel), max.max(pixel));
            }
            let mut entry = serde_json::to_value(&layer.info).expect("layer infos are plain data");
            let some = |v: f64| if n > 0 { json!(v) } else { Value::Null };
            entry["min"] = some(min);
            entry["mean"] = some(sum / n.max(1) as f64);
            entry["max"] = some(max);
            entry["pixels"] = json!(n);
            if layer.info.is_pixel_mask() {
                entry["masked"] = reasons(layer.data.iter().copied());
            }
            for name in ["f_x_per_mm", "phase_rad", "mean_se"] {
                if entry.get(name).is_none() {
                    entry[name] = Value::Null;
                }
            }
            entry
        })
        .collect();
    rows.into()
}

/// How many pixels of a mask are bad, by the reason.
fn reasons(mask: impl Iterator<Item = f32>) -> Value {
    let mut counts: BTreeMap<String, u64> = BTreeMap::new();
    for code in mask.filter(|&code| code != 0.0) {
        let known = MaskReason::ALL.iter().find(|reason| reason.code() == code);
        let reason = known.map_or_else(|| format!("for reason {code}"), |reason| reason.text().to_owned());
        *counts.entry(reason).or_default() += 1;
    }
    json!(counts)
}

/// The two quantities of a covariance layer: of the attribute `quantities`, or else the value layers of the stack.
fn paired(port: &Value, layer: &Value) -> Option<String> {
    let pair = layer["pair"].as_array()?;
    let listed = port["attributes"]["quantities"].as_array().cloned();
    let quantities = listed.unwrap_or_else(|| {
        let layers = port["layers"].as_array().into_iter().flatten();
        layers.filter(|l| l["kind"] == "value").cloned().collect()
    });
    let name = |index: &Value| {
        let quantity = quantities.get(usize::try_from(index.as_u64()?).ok()?)?;
        let name = quantity["part"].as_str().or(quantity["name"].as_str())?;
        let f_x = quantity["f_x_per_mm"].as_f64().map(|f| format!(" {}/mm", trimmed(f))).unwrap_or_default();
        Some(format!("{name}{f_x}"))
    };
    Some(format!("{}, {}", name(pair.first()?)?, name(pair.get(1)?)?))
}

/// Five digits that count, without zeros behind them: 0.1, 2.0944.
fn trimmed(value: f64) -> String {
    let rounded: f64 = format!("{value:.4e}").parse().unwrap_or(value);
    rounded.to_string()
}

/// Tables of at most so many rows are shown as they are; of longer ones the statistics of their columns.
const SHORT: usize = 40;

/// Of text this many different ones are named.
const NAMED: usize = 12;

fn columns(table: &Table) -> Value {
    let rows: Vec<Value> = table
        .columns
        .iter()
        .map(|column| {
            let (numbers, words): (Option<Vec<f64>>, Vec<String>) = match &column.cells {
                Cells::F64(v) => (Some(v.clone()), Vec::new()),
                Cells::MaybeF64(v) => (Some(v.iter().copied().flatten().collect()), Vec::new()),
                Cells::I64(v) => (Some(v.iter().map(|&i| i as f64).collect()), Vec::new()),
                Cells::Bool(v) => (None, v.iter().map(bool::to_string).collect()),
                Cells::Text(v) => (None, v.clone()),
            };
            let stat = |f: &dyn Fn(&[f64]) -> f64| numbers.as_deref().filter(|v| !v.is_empty()).map(f);
            let mut entry = json!({
                "name": column.name, "unit": column.unit,
                "min": stat(&|v| v.iter().copied().fold(f64::INFINITY, f64::min)),
                "mean": stat(&|v| v.iter().sum::<f64>() / v.len() as f64),
                "max": stat(&|v| v.iter().copied().fold(f64::NEG_INFINITY, f64::max)),
            });
            if numbers.is_none() {
                let mut different = words.clone();
                different.sort();
                different.dedup();
                entry["different"] = json!(different.len());
                different.truncate(NAMED);
                entry["values"] = json!(different);
            }
            if table.rows() <= SHORT {
                entry["cells"] = match (&column.cells, numbers) {
                    (Cells::MaybeF64(cells), _) => json!(cells),
                    (_, Some(numbers)) => json!(numbers),
                    (_, None) => json!(words),
                };
            }
            entry
        })
        .collect();
    rows.into()
}

/// The cells of a short table under their names and units, a line each; text to the left, numbers to the right.
fn cells(columns: &[Value]) -> Option<String> {
    let mut lines: Vec<String> = Vec::new();
    for column in columns {
        let name = column["name"].as_str().unwrap_or_default();
        let named = match column["unit"].as_str() {
            None | Some("" | "1") => name.to_owned(),
            Some(unit) => format!("{name} ({unit})"),
        };
        let text = |cell: &Value| match cell {
            Value::String(text) => text.clone(),
            cell => cell.as_f64().map_or_else(|| "-".to_owned(), significant),
        };
        let own: Vec<String> = [named].into_iter().chain(column["cells"].as_array()?.iter().map(text)).collect();
        let width = own.iter().map(|cell| cell.chars().count()).max().unwrap_or(0);
        lines.resize(own.len(), String::new());
        for (line, cell) in lines.iter_mut().zip(own) {
            let cell = if column["values"].is_array() { format!("{cell:<width$}") } else { format!("{cell:>width$}") };
            line.push_str(&format!("  {cell}"));
        }
    }
    Some(lines.iter().map(|line| format!("  {}\n", line.trim_end())).collect())
}

/// Five digits that count, without an exponent where that reads well.
fn significant(value: f64) -> String {
    let size = value.abs();
    if value == 0.0 || value.fract() == 0.0 && size < 1e9 {
        format!("{value}")
    } else if (1e-3..1e6).contains(&size) {
        let digits = (4 - size.log10().floor() as i32).clamp(0, 8) as usize;
        format!("{value:.digits$}")
    } else {
        format!("{value:.4e}")
    }
}

/// A description in one line of the screen.
fn shortened(text: &str) -> String {
    const MOST: usize = 100;
    if text.chars().count() <= MOST {
        return text.to_owned();
    }
    text.chars().take(MOST - 1).chain(['…']).collect()
}

/// The same for people.
fn text(instance: &Value) -> String {
    let word = |v: &Value| v.as_str().unwrap_or_default().to_owned();
    // The unit of pure numbers is for programs.
    let unit = |v: &Value| if v == "1" { String::new() } else { word(v) };
    let number = |v: &Value| v.as_f64().map_or_else(|| "-".to_owned(), significant);
    let axes: Vec<String> = instance["axes"]
        .as_object()
        .into_iter()
        .flatten()
        .map(|(n, v)| format!("{n}={}", crate::key::value_text(v)))
        .collect();
    let axes = if axes.is_empty() { String::new() } else { format!("[{}]", axes.join(",")) };
    let mut out = format!(
        "{}{axes} ({})  {:.2} s, {:.2} CPU s, peak {:.0} MB\n",
        word(&instance["stage"]),
        word(&instance["use"]),
        instance["seconds"].as_f64().unwrap_or(0.0),
        instance["cpu_seconds"].as_f64().unwrap_or(0.0),
        instance["peak_bytes"].as_f64().unwrap_or(0.0) / 1e6
    );
    if let Some(kernel) = instance["kernel"].as_str() {
        out.push_str(&format!("  kernel: {kernel}\n"));
    }
    for refused in instance["refused"].as_array().into_iter().flatten() {
        out.push_str(&format!("  slower because: {}\n", word(refused)));
    }
    for (name, measure) in instance["measures"].as_object().into_iter().flatten() {
        out.push_str(&format!("  {name} = {} {}\n", number(&measure["value"]), unit(&measure["unit"])));
    }
    for (name, port) in instance["ports"].as_object().into_iter().flatten() {
        out.push_str(&format!("  {name}: {}  {}\n", word(&port["payload"]), &word(&port["digest"])[..16]));
        if let Some(path) = port["path"].as_str() {
            out.push_str(&format!("    {path}\n"));
        }
        for layer in port["layers"].as_array().into_iter().flatten() {
            let mut label = word(&layer["name"]);
            for (key, unit) in [("f_x_per_mm", "/mm"), ("phase_rad", "rad"), ("wavelength_nm", "nm")] {
                if let Some(value) = layer[key].as_f64() {
                    label.push_str(&format!(" {}{unit}", trimmed(value)));
                }
            }
            if let Some(pair) = paired(port, layer) {
                label.push_str(&format!(" ({pair})"));
            }
            if let Some(reasons) = layer["masked"].as_object() {
                let share = |(why, n): (&String, &Value)| format!("{} pixels {why}", n.as_u64().unwrap_or(0));
                let shares: Vec<String> = reasons.iter().map(share).collect();
                let all = if shares.is_empty() { "every pixel is good".to_owned() } else { shares.join(", ") };
                out.push_str(&format!("    {label:<32} {all}\n"));
                continue;
            }
            let mean_se = layer["mean_se"].as_f64().map(|se| format!(" ± {}", significant(se))).unwrap_or_default();
            if layer["mean"].is_null() {
                out.push_str(&format!("    {label:<32} every pixel is masked (see the mask)\n"));
                continue;
            }
            out.push_str(&format!(
                "    {label:<32} min {} mean {}{mean_se} max {} {}\n",
                number(&layer["min"]),
                number(&layer["mean"]),
                number(&layer["max"]),
                unit(&layer["unit"])
            ));
        }
        for (name, value) in port["fields"].as_object().into_iter().flatten() {
            out.push_str(&format!("    {name:<24} {}\n", shortened(&crate::key::value_text(value))));
        }
        let columns = port["columns"].as_array().filter(|_| port["fields"].is_null());
        if let Some(cells) = columns.and_then(|columns| cells(columns)) {
            out.push_str(&cells);
            continue;
        }
        for column in columns.into_iter().flatten() {
            let name = word(&column["name"]);
            if let Some(values) = column["values"].as_array() {
                let more = column["different"].as_u64().unwrap_or(0) > values.len() as u64;
                let values: Vec<String> = values.iter().map(word).collect();
                let named = format!("{}{}", values.join(", "), if more { ", …" } else { "" });
                out.push_str(&format!("    {name:<24} {}: {}\n", column["different"], shortened(&named)));
                continue;
            }
            out.push_str(&format!(
                "    {name:<24} min {} mean {} max {} {}\n",
                number(&column["min"]),
                number(&column["mean"]),
                number(&column["max"]),
                unit(&column["unit"])
            ));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use turbid_contract::Column;

    /// A table of `rows` rows with text, whole numbers, numbers and switches.
    fn table(rows: usize) -> Table {
        let column = |name: &str, unit: &str, cells| Column { name: name.into(), unit: unit.into(), cells };
        let columns = vec![
            column("region", "", Cells::Text((0..rows).map(|i| format!("region {}", i % 15)).collect())),
            column("n", "1", Cells::I64((0..rows as i64).collect())),
            column("mean", "mm^-1", Cells::F64((0..rows).map(|i| 0.25 * i as f64).collect())),
            column("good", "1", Cells::Bool((0..rows).map(|i| i == 1).collect())),
        ];
        Table { columns, attributes: Default::default() }
    }

    fn shown(rows: usize) -> String {
        let table = table(rows);
        text(
            &json!({"ports": {"metrics": {"payload": "metrics", "digest": "0".repeat(32), "columns": columns(&table)}}}),
        )
    }

    /// Text stands to the left under its name, numbers to the right under theirs with their unit.
    #[test]
    fn short_tables_are_shown_as_they_are() {
        let lines = "  \n    region    n  mean (mm^-1)  good\n    region 0  0             0  false\n    region 1  1       0.25000  true\n";
        assert!(shown(2).ends_with(&lines[3..]), "{}", shown(2));
    }

    /// Long tables: what numbers range over, and what the texts are, the first of them by name.
    #[test]
    fn long_tables_are_summed_up() {
        let found = shown(60);
        let has = |line: &str| assert!(found.contains(line), "{line}: {found}");
        has("mean                     min 0 mean 7.3750 max 14.750 mm^-1");
        has("good                     2: false, true");
        has("region                   15: region 0, region 1, region 10,");
        assert!(columns(&table(60))[0]["cells"].is_null() && columns(&table(60))[0]["min"].is_null());
    }
}
