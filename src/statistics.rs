//! What the numbers of layers and columns range over, and how they are written.

use std::collections::BTreeMap;

use serde::Serialize;
use serde_json::Value;
use turbid_contract::payload::MaskReason;
use turbid_contract::{Attributes, Cells, ImageStack, LayerInfo, LayerKind, Table};

/// One layer; numbers over its good pixels, over all for a mask.
#[derive(Serialize)]
pub struct Layer {
    pub name: String,
    pub kind: LayerKind,
    pub unit: String,
    pub f_x_per_mm: Option<f64>,
    pub phase_rad: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub orientation_deg: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wavelength_nm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pair: Option<[u32; 2]>,
    pub mean_se: Option<f64>,
    /// `None` where no pixel is good.
    pub min: Option<f64>,
    pub mean: Option<f64>,
    pub max: Option<f64>,
    pub pixels: u64,
    /// Of a mask of pixels: how many are bad, by the reason.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub masked: Option<BTreeMap<String, u64>>,
}

pub fn layers(stack: &ImageStack) -> Vec<Layer> {
    let mask = stack.layers.iter().find(|l| l.info.is_pixel_mask()).map(|l| l.pixels());
    let one = |layer: &turbid_contract::Layer| {
        let is_good = |i: usize| layer.info.kind == LayerKind::Mask || mask.as_ref().is_none_or(|m| m[i] == 0.0);
        let (mut n, mut sum, mut min, mut max) = (0_u64, 0.0, f64::INFINITY, f64::NEG_INFINITY);
        for (_, &pixel) in layer.pixels().iter().enumerate().filter(|(i, _)| is_good(*i)) {
            let pixel = f64::from(pixel);
            (n, sum, min, max) = (n + 1, sum + pixel, min.min(pixel), max.max(pixel));
        }
        let known = |value: f64| (n > 0).then_some(value);
        let LayerInfo { name, kind, unit, f_x_per_mm, phase_rad, orientation_deg, wavelength_nm, pair, mean_se } =
            layer.info.clone();
        Layer {
            name,
            kind,
            unit,
            f_x_per_mm,
            phase_rad,
            orientation_deg,
            wavelength_nm,
            pair,
            mean_se,
            min: known(min),
            mean: known(sum / n.max(1) as f64),
            max: known(max),
            pixels: n,
            masked: layer.info.is_pixel_mask().then(|| reasons(&layer.pixels())),
        }
    };
    stack.layers.iter().map(one).collect()
}

/// How many pixels of a mask are bad, by the reason.
fn reasons(mask: &[f32]) -> BTreeMap<String, u64> {
    let mut counts: BTreeMap<String, u64> = BTreeMap::new();
    for &code in mask.iter().filter(|&&code| code != 0.0) {
        let known = MaskReason::ALL.iter().find(|reason| reason.code() == code);
        let reason = known.map_or_else(|| format!("for reason {code}"), |reason| reason.text().to_owned());
        *counts.entry(reason).or_default() += 1;
    }
    counts
}

/// Tables of at most so many rows are shown as they are; of longer ones the statistics of their columns.
const SHORT: usize = 40;

/// Of text this many different ones are named.
const NAMED: usize = 12;

/// One column.
#[derive(Serialize)]
pub struct Column {
    pub name: String,
    pub unit: String,
    /// `None` where there is no number.
    pub min: Option<f64>,
    pub mean: Option<f64>,
    pub max: Option<f64>,
    /// Of text and switches: how many different ones there are, and the first of them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub different: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub values: Option<Vec<String>>,
    /// All of a short table.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cells: Option<Vec<Cell>>,
}

#[derive(Clone, Serialize)]
#[serde(untagged)]
pub enum Cell {
    Number(f64),
    Text(String),
    /// A number that is not known.
    Unknown,
}

pub fn columns(table: &Table) -> Vec<Column> {
    let one = |column: &turbid_contract::Column| {
        let cells = cells(&column.cells);
        let number = |cell: &Cell| if let Cell::Number(number) = cell { Some(*number) } else { None };
        let numbers: Vec<f64> = cells.iter().filter_map(number).collect();
        let stat = |f: &dyn Fn(&[f64]) -> f64| Some(numbers.as_slice()).filter(|v| !v.is_empty()).map(f);
        let is_text = matches!(column.cells, Cells::Bool(_) | Cells::Text(_));
        let mut different: Vec<String> = Vec::new();
        if is_text {
            different.extend(
                cells.iter().filter_map(|cell| if let Cell::Text(text) = cell { Some(text.clone()) } else { None }),
            );
            different.sort();
            different.dedup();
        }
        let count = different.len();
        different.truncate(NAMED);
        Column {
            name: column.name.clone(),
            unit: column.unit.clone(),
            min: stat(&|v| v.iter().copied().fold(f64::INFINITY, f64::min)),
            mean: stat(&|v| v.iter().sum::<f64>() / v.len() as f64),
            max: stat(&|v| v.iter().copied().fold(f64::NEG_INFINITY, f64::max)),
            different: is_text.then_some(count),
            values: is_text.then_some(different),
            cells: (table.rows() <= SHORT).then_some(cells),
        }
    };
    table.columns.iter().map(one).collect()
}

fn cells(cells: &Cells) -> Vec<Cell> {
    match cells {
        Cells::F64(v) => v.iter().map(|&x| Cell::Number(x)).collect(),
        Cells::MaybeF64(v) => v.iter().map(|x| x.map_or(Cell::Unknown, Cell::Number)).collect(),
        Cells::I64(v) => v.iter().map(|&i| Cell::Number(i as f64)).collect(),
        Cells::Bool(v) => v.iter().map(|b| Cell::Text(b.to_string())).collect(),
        Cells::Text(v) => v.iter().cloned().map(Cell::Text).collect(),
    }
}

/// The reasons of a mask, each with the pixels that it has.
pub fn masked(reasons: &BTreeMap<String, u64>) -> String {
    let shares: Vec<String> = reasons.iter().map(|(why, n)| format!("{n} pixels {why}")).collect();
    if shares.is_empty() { "every pixel is good".to_owned() } else { shares.join(", ") }
}

/// A layer by what tells it from others of its name.
pub fn label(layer: &Layer, all: &[Layer], attributes: &Attributes) -> String {
    let mut label = layer.name.clone();
    let numbers = [
        (layer.f_x_per_mm, "/mm"),
        (layer.phase_rad, " rad"),
        (layer.orientation_deg, "°"),
        (layer.wavelength_nm, " nm"),
    ];
    for (value, unit) in numbers {
        if let Some(value) = value {
            label.push_str(&format!(" {}{unit}", trimmed(value)));
        }
    }
    if let Some(pair) = layer.pair.and_then(|pair| paired(pair, all, attributes)) {
        label.push_str(&format!(" ({pair})"));
    }
    label
}

/// The two quantities of a covariance layer: of the attribute `quantities`, or else the value layers of the stack.
fn paired(pair: [u32; 2], all: &[Layer], attributes: &Attributes) -> Option<String> {
    let named = |name: &str, f_x: Option<f64>| {
        format!("{name}{}", f_x.map(|f| format!(" {}/mm", trimmed(f))).unwrap_or_default())
    };
    let one = |index: u32| {
        let index = index as usize;
        match attributes.get("quantities").and_then(Value::as_array) {
            Some(listed) => {
                let quantity = listed.get(index)?;
                let name = quantity["part"].as_str().or(quantity["name"].as_str())?;
                Some(named(name, quantity["f_x_per_mm"].as_f64()))
            }
            None => {
                let layer = all.iter().filter(|layer| layer.kind == LayerKind::Value).nth(index)?;
                Some(named(&layer.name, layer.f_x_per_mm))
            }
        }
    };
    Some(format!("{}, {}", one(pair[0])?, one(pair[1])?))
}

/// The unit of pure numbers is for programs.
pub fn shown_unit(unit: &str) -> &str {
    if unit == "1" { "" } else { unit }
}

/// Five digits that count, without zeros behind them: 0.1, 2.0944.
pub fn trimmed(value: f64) -> String {
    let rounded: f64 = format!("{value:.4e}").parse().unwrap_or(value);
    rounded.to_string()
}

/// Five digits that count, without an exponent where that reads well.
pub fn significant(value: f64) -> String {
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
