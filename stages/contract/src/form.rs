//! What an artifact is going to hold, known before anything runs: as shapes and types are inferred through a network.

use std::collections::BTreeMap;
use std::fmt;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::artifact::{Artifact, Attributes, LayerInfo, LayerKind};
use crate::canonical::canonical_text;
use crate::extent::Extent;

/// A column of a table: its name and its unit ("1" for pure numbers, "" for text).
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ColumnInfo {
    pub name: String,
    pub unit: String,
}

impl ColumnInfo {
    pub fn new(name: impl Into<String>, unit: impl Into<String>) -> Self {
        Self { name: name.into(), unit: unit.into() }
    }
}

/// The form of an artifact. What is `None`, and an attribute that is missing, is open: only a run can tell.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Form {
    /// Of images: rows and columns of pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pixels: Option<[u64; 2]>,
    /// Of images: the layers in their order, each without the error of its mean.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub layers: Option<Vec<LayerInfo>>,
    /// Of images: layers that are there or not, as a run finds; flags of unknown errors, for one.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub perhaps: Vec<LayerInfo>,
    /// Of a table: how many rows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rows: Option<u64>,
    /// Of a table: the columns in their order.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub columns: Option<Vec<ColumnInfo>>,
    /// Attributes, or fields of a record, that the artifact will have with these values.
    #[serde(skip_serializing_if = "Attributes::is_empty")]
    pub attributes: Attributes,
}

/// The forms of an instance's outputs, by port.
pub type Forms = BTreeMap<&'static str, Form>;

impl Form {
    /// Of images of `rows` x `columns` pixels.
    pub fn images(rows: u64, columns: u64, layers: Vec<LayerInfo>) -> Self {
        Self { pixels: Some([rows, columns]), layers: Some(layers), ..Self::default() }
    }

    /// Of a table with these columns, name and unit.
    pub fn table(rows: Option<u64>, columns: &[(&str, &str)]) -> Self {
        let columns = columns.iter().map(|(name, unit)| ColumnInfo::new(*name, *unit)).collect();
        Self { rows, columns: Some(columns), ..Self::default() }
    }

    /// Of something of which only attributes are known.
    pub fn said(attributes: Attributes) -> Self {
        Self { attributes, ..Self::default() }
    }

    #[must_use]
    pub fn with(mut self, attributes: Attributes) -> Self {
        self.attributes.extend(attributes);
        self
    }

    /// The form of an artifact that is there: nothing is open.
    pub fn of(artifact: &Artifact) -> Self {
        match artifact {
            Artifact::Images(stack) => Self {
                pixels: Some([stack.rows() as u64, stack.columns() as u64]),
                layers: Some(stack.layers.iter().map(|layer| described(&layer.info)).collect()),
                attributes: stack.attributes.clone(),
                ..Self::default()
            },
            Artifact::Table(table) => Self {
                rows: Some(table.rows() as u64),
                columns: Some(table.columns.iter().map(|c| ColumnInfo::new(&*c.name, &*c.unit)).collect()),
                attributes: table.attributes.clone(),
                ..Self::default()
            },
            Artifact::Record(record) => Self { attributes: record.fields.clone(), ..Self::default() },
        }
    }

    /// The value of an attribute; `None` where it is open.
    pub fn attribute(&self, name: &str) -> Option<&Value> {
        self.attributes.get(name)
    }

    /// The layers and the size of images, where both are known.
    pub fn images_known(&self) -> Option<(&[LayerInfo], [u64; 2])> {
        self.layers.as_deref().zip(self.pixels)
    }

    /// Layers that are there, or that a run may find, of a kind.
    pub fn layers_of(&self, kind: LayerKind) -> impl Iterator<Item = &LayerInfo> {
        self.layers.iter().flatten().chain(&self.perhaps).filter(move |info| info.kind == kind)
    }

    /// How large the artifact is going to be; `None` where that is open.
    pub fn extent(&self) -> Option<Extent> {
        match (self.pixels, &self.layers, self.rows, &self.columns) {
            (Some([rows, columns]), Some(layers), ..) => {
                Some(Extent::images(columns, rows, (layers.len() + self.perhaps.len()) as u64))
            }
            (.., Some(rows), Some(columns)) => Some(Extent::Table { rows, columns: columns.len() as u64 }),
            _ => None,
        }
    }

    /// What an artifact of the form `made` has otherwise than this form says, in words; `None` where it is as was said.
    pub fn broken_by(&self, made: &Self) -> Option<String> {
        let sizes = |[rows, columns]: [u64; 2]| format!("{columns} x {rows} pixels");
        if let (Some(said), Some(is)) = (self.pixels, made.pixels)
            && said != is
        {
            return Some(format!("{} instead of {}", sizes(is), sizes(said)));
        }
        if let (Some(said), Some(is)) = (&self.layers, &made.layers)
            && let Some(text) = other_layers(said, &self.perhaps, is)
        {
            return Some(text);
        }
        if let (Some(said), Some(is)) = (self.rows, made.rows)
            && said != is
        {
            return Some(format!("{is} rows instead of {said}"));
        }
        if let (Some(said), Some(is)) = (&self.columns, &made.columns)
            && said != is
        {
            let names = |columns: &[ColumnInfo]| {
                columns.iter().map(|c| format!("{} ({})", c.name, c.unit)).collect::<Vec<_>>().join(", ")
            };
            return Some(format!("the columns {} instead of {}", names(is), names(said)));
        }
        self.attributes.iter().find_map(|(name, said)| {
            let is = made.attributes.get(name).map_or_else(|| "nothing".to_owned(), canonical_text);
            let said = canonical_text(said);
            (is != said).then(|| format!("{name} is {is} instead of {said}"))
        })
    }
}

impl fmt::Display for Form {
    /// In one line: `64 x 64 pixels; m_dc, m_ac (1), mask; f_x 0, 0.1 mm^-1`. What is open is left out.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut parts = Vec::new();
        parts.extend(self.pixels.map(|[rows, columns]| format!("{columns} x {rows} pixels")));
        if let Some(layers) = &self.layers {
            parts.push(by_unit(layers.iter().map(|info| (info.name.as_str(), info.unit.as_str()))));
            parts.extend(listed("f_x ", layers.iter().filter_map(|info| info.f_x_per_mm), " mm^-1"));
            parts.extend(listed("", layers.iter().filter_map(|info| info.wavelength_nm), " nm"));
        }
        parts.extend(self.rows.map(|rows| format!("{rows} rows")));
        if let Some(columns) = &self.columns {
            parts.push(by_unit(columns.iter().map(|column| (column.name.as_str(), column.unit.as_str()))));
        }
        for name in ["convention", "g", "n"] {
            let value = self.attributes.get(name).map(|value| value.to_string().replace('"', ""));
            parts.extend(value.map(|value| format!("{name} {value}")));
        }
        f.write_str(&if parts.is_empty() { "open until it is made".to_owned() } else { parts.join("; ") })
    }
}

/// Names, each once, those of one unit together: `m_dc, m_ac (W), mask (1)`.
fn by_unit<'a>(all: impl Iterator<Item = (&'a str, &'a str)>) -> String {
    let mut groups: Vec<(&str, Vec<&str>)> = Vec::new();
    for (name, unit) in all {
        if groups.iter().any(|(_, names)| names.contains(&name)) {
            continue;
        }
        match groups.iter_mut().find(|(known, _)| *known == unit) {
            Some((_, names)) => names.push(name),
            None => groups.push((unit, vec![name])),
        }
    }
    let group = |(unit, names): (&str, Vec<&str>)| {
        let names = names.join(", ");
        if unit.is_empty() { names } else { format!("{names} ({unit})") }
    };
    groups.into_iter().map(group).collect::<Vec<_>>().join(", ")
}

/// Values that occur, each once, in their order; `None` where there are none.
fn listed(name: &str, values: impl Iterator<Item = f64>, unit: &str) -> Option<String> {
    let mut all: Vec<f64> = Vec::new();
    values.for_each(|value| all.extend((!all.contains(&value)).then_some(value)));
    let text = all.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
    (!all.is_empty()).then(|| format!("{name}{text}{unit}"))
}

/// A layer as a form describes it: the error of its mean shows only when it is there.
fn described(info: &LayerInfo) -> LayerInfo {
    LayerInfo { mean_se: None, ..info.clone() }
}

fn other_layers(said: &[LayerInfo], perhaps: &[LayerInfo], is: &[LayerInfo]) -> Option<String> {
    let mut certain = said.iter();
    for layer in is {
        if perhaps.contains(layer) {
            continue;
        }
        match certain.next() {
            Some(expected) if expected == layer => {}
            Some(expected) => return Some(format!("the layer {} instead of {}", named(layer), named(expected))),
            None => return Some(format!("a layer more: {}", named(layer))),
        }
    }
    certain.next().map(|missing| format!("no layer {}", named(missing)))
}

/// `m_ac (1, f_x = 0.1 mm^-1, 30 deg)`: a layer in words.
pub fn named(info: &LayerInfo) -> String {
    let mut parts = vec![info.unit.clone()];
    parts.extend(info.f_x_per_mm.map(|f_x| format!("f_x = {f_x} mm^-1")));
    parts.extend(info.phase_rad.map(|phase| format!("phase {phase} rad")));
    parts.extend(info.orientation_deg.map(|angle| format!("{angle} deg")));
    parts.extend(info.wavelength_nm.map(|wavelength| format!("{wavelength} nm")));
    parts.extend(info.pair.map(|[a, b]| format!("pair {a}, {b}")));
    format!("{} ({})", info.name, parts.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::artifact::{Cells, ImageStack, Table};
    use ndarray::Array2;

    fn stack() -> ImageStack {
        let mut stack = ImageStack::new(2, 3);
        let mut info = LayerInfo::value("r_d", "1").with_f_x(0.1);
        info.mean_se = Some(0.5);
        stack.push(info, Array2::zeros((2, 3)));
        stack.attributes.insert("g".to_owned(), 0.8.into());
        stack
    }

    #[test]
    fn what_was_said_holds_or_is_named() {
        let made = Form::of(&Artifact::Images(stack()));
        let layer = LayerInfo::value("r_d", "1").with_f_x(0.1);
        let said = Form::images(2, 3, vec![layer.clone()]).with([("g".to_owned(), 0.8.into())].into());
        assert_eq!((said.broken_by(&made), Form::default().broken_by(&made)), (None, None));
        let broken = |form: Form| form.broken_by(&made).expect("it differs");
        assert_eq!(broken(Form { pixels: Some([3, 2]), ..said.clone() }), "3 x 2 pixels instead of 2 x 3 pixels");
        assert_eq!(
            broken(Form { layers: Some(vec![layer.clone().with_f_x(0.2)]), ..said.clone() }),
            "the layer r_d (1, f_x = 0.1 mm^-1) instead of r_d (1, f_x = 0.2 mm^-1)"
        );
        let two = vec![layer.clone(), layer.standard_error()];
        assert_eq!(broken(Form { layers: Some(two), ..said.clone() }), "no layer r_d_se (1, f_x = 0.1 mm^-1)");
        assert_eq!(broken(Form { layers: Some(vec![]), ..said.clone() }), "a layer more: r_d (1, f_x = 0.1 mm^-1)");
        assert_eq!(broken(Form::said([("g".to_owned(), 0.9.into())].into())), "g is 0.8 instead of 0.9");
        assert_eq!(broken(Form::said([("n".to_owned(), 1.4.into())].into())), "n is nothing instead of 1.4");
        assert_eq!(said.to_string(), "3 x 2 pixels; r_d (1); f_x 0.1 mm^-1; g 0.8");
        // What a run may find or not is no difference.
        let perhaps = Form { layers: Some(vec![]), perhaps: vec![layer], ..said };
        assert_eq!(perhaps.broken_by(&made), None);
    }

    #[test]
    fn tables_are_told_by_rows_and_columns() {
        let mut table = Table::default();
        table.push("mu_a", "mm^-1", Cells::F64(vec![0.1, 0.2]));
        let made = Form::of(&Artifact::Table(table));
        let said = Form::table(Some(2), &[("mu_a", "mm^-1")]);
        assert_eq!(said.broken_by(&made), None);
        assert_eq!(said.extent(), Some(Extent::Table { rows: 2, columns: 1 }));
        assert_eq!(Form { rows: Some(3), ..said.clone() }.broken_by(&made).unwrap(), "2 rows instead of 3");
        let other = Form::table(None, &[("mu_a", "cm^-1")]);
        assert_eq!(other.broken_by(&made).unwrap(), "the columns mu_a (mm^-1) instead of mu_a (cm^-1)");
        assert_eq!((other.extent(), Form::default().extent()), (None, None));
        assert_eq!(said.to_string(), "2 rows; mu_a (mm^-1)");
        assert_eq!(Form::default().to_string(), "open until it is made");
    }
}
