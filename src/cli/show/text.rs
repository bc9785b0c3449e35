//! What an instance left in the store, for people.

use turbid_contract::Attributes;

use crate::key::{axes_text, value_text};
use crate::statistics::{Cell, Column, Layer, label, masked, shown_unit, significant};

use super::describe::{Content, Port, Shown};

pub fn text(instance: &Shown) -> String {
    let axes = axes_text(&instance.axes);
    let axes = if axes.is_empty() { axes } else { format!("[{axes}]") };
    let mut out = format!(
        "{}{axes} ({})  {:.2} s, {:.2} CPU s, peak {:.0} MB\n",
        instance.stage,
        instance.use_name,
        instance.seconds,
        instance.cpu_seconds,
        instance.peak_bytes as f64 / 1e6
    );
    if let Some(kernel) = &instance.kernel {
        out.push_str(&format!("  kernel: {kernel}\n"));
    }
    for refused in &instance.refused {
        out.push_str(&format!("  slower because: {refused}\n"));
    }
    for (name, measure) in &instance.measures {
        out.push_str(&format!("  {name} = {} {}\n", significant(measure.value), shown_unit(&measure.unit)));
    }
    for (name, port) in &instance.ports {
        out.push_str(&port_text(name, port));
    }
    out
}

fn port_text(name: &str, port: &Port) -> String {
    let mut out = format!("  {name}: {}  {}\n", port.payload, &port.digest[..16]);
    if let Some(path) = &port.path {
        out.push_str(&format!("    {path}\n"));
    }
    match &port.content {
        Content::Released { .. } => {
            out.push_str("    released: a data set holds what it held; shown by its own name it is made again\n");
        }
        Content::Images { layers, attributes, .. } => {
            layers.iter().for_each(|layer| out.push_str(&layer_text(layer, layers, attributes)));
        }
        Content::Record { fields, .. } => {
            let line = |(name, value)| format!("    {name:<24} {}\n", shortened(&value_text(value)));
            out.extend(fields.iter().map(line));
        }
        Content::Table { columns, .. } => match cells_text(columns) {
            Some(cells) => out.push_str(&cells),
            None => out.extend(columns.iter().map(column_text)),
        },
    }
    out
}

fn layer_text(layer: &Layer, all: &[Layer], attributes: &Attributes) -> String {
    let label = label(layer, all, attributes);
    if let Some(reasons) = &layer.masked {
        return format!("    {label:<32} {}\n", masked(reasons));
    }
    let [Some(min), Some(mean), Some(max)] = [layer.min, layer.mean, layer.max] else {
        let why = all.iter().find_map(|layer| layer.masked.as_ref()).map(masked).unwrap_or_default();
        return format!("    {label:<32} every pixel is masked: {why}\n");
    };
    let mean_se = layer.mean_se.map(|se| format!(" ± {}", significant(se))).unwrap_or_default();
    let [min, mean, max] = [min, mean, max].map(significant);
    format!("    {label:<32} min {min} mean {mean}{mean_se} max {max} {}\n", shown_unit(&layer.unit))
}

fn column_text(column: &Column) -> String {
    let name = &column.name;
    if let (Some(values), Some(different)) = (&column.values, column.different) {
        let more = if different > values.len() { ", …" } else { "" };
        return format!("    {name:<24} {different}: {}\n", shortened(&format!("{}{more}", values.join(", "))));
    }
    let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), significant);
    let [min, mean, max] = [column.min, column.mean, column.max].map(number);
    format!("    {name:<24} min {min} mean {mean} max {max} {}\n", shown_unit(&column.unit))
}

/// The cells of a short table under their names and units, a line each; text to the left, numbers to the right.
fn cells_text(columns: &[Column]) -> Option<String> {
    let mut lines: Vec<String> = Vec::new();
    for column in columns {
        let named = match shown_unit(&column.unit) {
            "" => column.name.clone(),
            unit => format!("{} ({unit})", column.name),
        };
        let text = |cell: &Cell| match cell {
            Cell::Text(text) => text.clone(),
            Cell::Number(number) => significant(*number),
            Cell::Unknown => "-".to_owned(),
        };
        let own: Vec<String> = [named].into_iter().chain(column.cells.as_ref()?.iter().map(text)).collect();
        let width = own.iter().map(|cell| cell.chars().count()).max().unwrap_or(0);
        lines.resize(own.len(), String::new());
        for (line, cell) in lines.iter_mut().zip(own) {
            let cell = if column.values.is_some() { format!("{cell:<width$}") } else { format!("{cell:>width$}") };
            line.push_str(&format!("  {cell}"));
        }
    }
    Some(lines.iter().map(|line| format!("  {}\n", line.trim_end())).collect())
}

/// A description in one line of the screen.
fn shortened(text: &str) -> String {
    const MOST: usize = 100;
    if text.chars().count() <= MOST {
        return text.to_owned();
    }
    text.chars().take(MOST - 1).chain(['…']).collect()
}

#[cfg(test)]
mod tests {
    use turbid_contract::ndarray::Array2;
    use turbid_contract::{Artifact, Cells, Column, ImageStack, LayerInfo, LayerKind, Table};

    use super::*;

    fn shown(artifact: Artifact) -> String {
        let content = Content::of(artifact);
        port_text("p", &Port { payload: "x".into(), digest: "0".repeat(32), bytes: 1, path: None, content })
    }

    /// A table of `rows` rows with text, whole numbers, numbers and switches.
    fn table(rows: usize) -> Artifact {
        let column = |name: &str, unit: &str, cells| Column { name: name.into(), unit: unit.into(), cells };
        let columns = vec![
            column("region", "", Cells::Text((0..rows).map(|i| format!("region {}", i % 15)).collect())),
            column("n", "1", Cells::I64((0..rows as i64).collect())),
            column("mean", "mm^-1", Cells::F64((0..rows).map(|i| 0.25 * i as f64).collect())),
            column("good", "1", Cells::Bool((0..rows).map(|i| i == 1).collect())),
        ];
        Artifact::Table(Table { columns, attributes: Default::default() })
    }

    /// Text stands to the left under its name, numbers to the right under theirs with their unit.
    #[test]
    fn short_tables_are_shown_as_they_are() {
        let lines = "\n    region    n  mean (mm^-1)  good\n    region 0  0             0  false\n    region 1  1       0.25000  true\n";
        assert!(shown(table(2)).ends_with(lines), "{}", shown(table(2)));
    }

    /// Long tables: what numbers range over, and what the texts are, the first of them by name.
    #[test]
    fn long_tables_are_summed_up() {
        let found = shown(table(60));
        let has = |line: &str| assert!(found.contains(line), "{line}: {found}");
        has("mean                     min 0 mean 7.3750 max 14.750 mm^-1");
        has("good                     2: false, true");
        has("region                   15: region 0, region 1, region 10,");
    }

    /// A map that is masked everywhere says why; what programs read has no number for it.
    #[test]
    fn a_masked_map_says_why() {
        let mut stack = ImageStack::new(2, 3);
        stack.push(LayerInfo::value("mu_a", "mm^-1"), Array2::zeros((2, 3)));
        stack.push(LayerInfo::new("mask", LayerKind::Mask, "1"), Array2::from_elem((2, 3), 2.0));
        let content = Content::of(Artifact::Images(stack.clone()));
        let json = serde_json::to_value(&content).unwrap();
        assert!(json["layers"][0]["mean"].is_null() && json["layers"][0]["f_x_per_mm"].is_null(), "{json}");
        assert!(json["layers"][0].get("wavelength_nm").is_none() && json["rows"] == 2, "{json}");
        let reasons = json["layers"][1]["masked"].as_object().expect("reasons").clone();
        let (why, pixels) = reasons.iter().next().expect("one");
        let found = shown(Artifact::Images(stack));
        assert!(pixels == 6 && found.contains(&format!("every pixel is masked: 6 pixels {why}")), "{found}");
    }
}
