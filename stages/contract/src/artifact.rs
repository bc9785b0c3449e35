//! The three kinds of things that cross between stages: image stacks, tables, records.

use std::collections::BTreeMap;

use ndarray::Array2;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Free facts about an artifact (convention, g, n, ...), keys sorted; finite numbers only.
pub type Attributes = BTreeMap<String, Value>;

/// What the pixels of a layer are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LayerKind {
    /// A quantity.
    Value,
    /// The standard error of the value layer with the same f_x, phase and wavelength.
    StandardError,
    /// The covariance of two quantities named by `pair`.
    Covariance,
    /// Named `mask`: 0 where the pixel is good, else the reason (see [`crate::payload::MaskReason`]).
    /// Named `NAME_se_unknown`: 1 where the standard error of the good value `NAME` is not known, else 0.
    Mask,
    /// How the pixel was lit and looked at (see [`crate::payload::Conditions`]): carried along, never processed.
    Condition,
}

/// The numbers that describe a layer; they travel as JSON and are never read from names.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LayerInfo {
    /// The field's symbol: `radiance`, `m_ac`, `r_d`, `mu_a`, `mu_a_se`, `mask`. Several layers may share it
    /// and differ by f_x, phase, orientation or wavelength.
    pub name: String,
    pub kind: LayerKind,
    /// Unit of the pixels; "1" for pure numbers.
    pub unit: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub f_x_per_mm: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub phase_rad: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub orientation_deg: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wavelength_nm: Option<f64>,
    /// For covariance layers: indices of the two quantities (into the value layers of the same stack, or into
    /// the attribute `quantities` of a `covariance` payload).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pair: Option<[u32; 2]>,
    /// Standard error of the mean over the layer's pixels, where known (pixels may share paths).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mean_se: Option<f64>,
}

impl LayerInfo {
    pub fn new(name: impl Into<String>, kind: LayerKind, unit: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            kind,
            unit: unit.into(),
            f_x_per_mm: None,
            phase_rad: None,
            orientation_deg: None,
            wavelength_nm: None,
            pair: None,
            mean_se: None,
        }
    }

    pub fn value(name: impl Into<String>, unit: impl Into<String>) -> Self {
        Self::new(name, LayerKind::Value, unit)
    }

    #[must_use]
    pub fn with_f_x(mut self, f_x_per_mm: f64) -> Self {
        self.f_x_per_mm = Some(f_x_per_mm);
        self
    }

    /// The description of this layer's standard error: same quantity, `_se` behind the name.
    #[must_use]
    pub fn standard_error(&self) -> Self {
        Self { name: format!("{}_se", self.name), kind: LayerKind::StandardError, mean_se: None, ..self.clone() }
    }

    /// The description of the layer that flags the pixels whose standard error is unknown: same quantity, `_se_unknown` behind the
    /// name. The value there holds; what the standard error's layer holds is a lower bound.
    #[must_use]
    pub fn se_unknown(&self) -> Self {
        let name = format!("{}_se_unknown", self.name);
        Self { name, kind: LayerKind::Mask, unit: "1".to_owned(), mean_se: None, ..self.clone() }
    }

    /// Whether the layer says which pixels are good, as opposed to flags of unknown errors.
    pub fn is_pixel_mask(&self) -> bool {
        self.kind == LayerKind::Mask && !self.name.ends_with("_se_unknown")
    }
}

/// One image: rows from top to bottom, columns from left to right.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    pub info: LayerInfo,
    /// Shape (rows, columns).
    pub data: Array2<f32>,
}

/// Images of one size, with what they mean.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageStack {
    rows: usize,
    columns: usize,
    pub layers: Vec<Layer>,
    pub attributes: Attributes,
}

impl ImageStack {
    pub fn new(rows: usize, columns: usize) -> Self {
        assert!(rows > 0 && columns > 0, "an image of {rows} x {columns} pixels");
        Self { rows, columns, layers: Vec::new(), attributes: Attributes::new() }
    }

    pub fn rows(&self) -> usize {
        self.rows
    }

    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Adds a layer; its size must be the stack's.
    pub fn push(&mut self, info: LayerInfo, data: Array2<f32>) {
        assert_eq!(data.dim(), (self.rows, self.columns), "layer `{}` has another size than its stack", info.name);
        self.layers.push(Layer { info, data });
    }

    /// The first layer of that name (and spatial frequency, where one is given).
    pub fn find(&self, name: &str, f_x_per_mm: Option<f64>) -> Option<&Layer> {
        self.layers.iter().find(|l| l.info.name == name && (f_x_per_mm.is_none() || l.info.f_x_per_mm == f_x_per_mm))
    }
}

/// The cells of a column.
#[derive(Clone, Debug, PartialEq)]
pub enum Cells {
    F64(Vec<f64>),
    /// Numbers of which some are not known: null in files and in JSON, never 0 or NaN in their place.
    MaybeF64(Vec<Option<f64>>),
    I64(Vec<i64>),
    Bool(Vec<bool>),
    Text(Vec<String>),
}

impl Cells {
    pub fn len(&self) -> usize {
        match self {
            Self::F64(v) => v.len(),
            Self::MaybeF64(v) => v.len(),
            Self::I64(v) => v.len(),
            Self::Bool(v) => v.len(),
            Self::Text(v) => v.len(),
        }
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// One column with its unit ("1" for pure numbers, "" for text).
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    pub name: String,
    pub unit: String,
    pub cells: Cells,
}

/// Columns of one length, with what they mean.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Table {
    pub columns: Vec<Column>,
    pub attributes: Attributes,
}

impl Table {
    /// Adds a column; its length must be the table's.
    pub fn push(&mut self, name: impl Into<String>, unit: impl Into<String>, cells: Cells) {
        let name = name.into();
        if let Some(first) = self.columns.first() {
            assert_eq!(first.cells.len(), cells.len(), "column `{name}` has another length than its table");
        }
        self.columns.push(Column { name, unit: unit.into(), cells });
    }

    pub fn rows(&self) -> usize {
        self.columns.first().map_or(0, |c| c.cells.len())
    }

    pub fn f64s(&self, name: &str) -> Option<&[f64]> {
        self.columns.iter().find(|c| c.name == name).and_then(|c| match &c.cells {
            Cells::F64(v) => Some(v.as_slice()),
            _ => None,
        })
    }

    /// The numbers of a column of which some may be unknown; a column of plain numbers reads as one that knows all of its own.
    pub fn maybe_f64s(&self, name: &str) -> Option<Vec<Option<f64>>> {
        self.columns.iter().find(|c| c.name == name).and_then(|c| match &c.cells {
            Cells::F64(v) => Some(v.iter().copied().map(Some).collect()),
            Cells::MaybeF64(v) => Some(v.clone()),
            _ => None,
        })
    }
}

/// One thing with named fields; nested fields are stored as canonical JSON text.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Record {
    pub fields: BTreeMap<String, Value>,
}

/// What a port holds.
#[derive(Clone, Debug, PartialEq)]
pub enum Artifact {
    Images(ImageStack),
    Table(Table),
    Record(Record),
}

/// The three kinds by name; each has its own file format.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ArtifactKind {
    Images,
    Table,
    Record,
}

impl Artifact {
    pub fn kind(&self) -> ArtifactKind {
        match self {
            Self::Images(_) => ArtifactKind::Images,
            Self::Table(_) => ArtifactKind::Table,
            Self::Record(_) => ArtifactKind::Record,
        }
    }
}
