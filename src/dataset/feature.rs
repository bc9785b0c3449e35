//! What a feature is: which layers of which output, as a tensor (channels, rows, columns), or a cell of a table of one row.

use turbid_contract::{Artifact, ArtifactKind, Cells, Form, LayerInfo, LayerKind};

use crate::plan::{Plan, StageId};
use crate::spec::{Diagnostic, FeatureSpec, Kind, Mistake, nearest};

/// A feature with the port that it is taken from.
#[derive(Clone, Debug)]
pub struct Feature {
    pub spec: FeatureSpec,
    pub stage: StageId,
    pub port: &'static str,
    /// The layer or column that is named; of several layers of a stack the quantities (no errors, no masks) if none is.
    pub part: Option<String>,
}

/// What a feature holds, the same in all samples.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// Channels, rows, columns; `None` for a number.
    pub tensor: Option<[usize; 3]>,
    pub unit: String,
    /// What the channels are, in words.
    pub channels: Vec<String>,
    pub pixel_mm: Option<[f64; 2]>,
}

/// Values of one sample.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// In the order channel, row, column.
    Tensor(Vec<f32>),
    /// `None` where it is not known.
    Number(Option<f64>),
}

impl Feature {
    /// Finds stage and port. Error: a mistake at its place in the file.
    pub fn find(spec: &FeatureSpec, plan: &Plan, at: &[&str]) -> Result<Self, Box<Diagnostic>> {
        let wrong = |message: String, hint: Option<String>| {
            let mistake = Mistake::new(Kind::Graph, message);
            Box::new(plan.spec.at_path(at, mistake, hint.map(|name| format!("did you mean `{name}`?"))))
        };
        let stage = plan.spec.stage(&spec.from[0]).ok_or_else(|| {
            let names = plan.spec.stages.iter().map(|stage| stage.name.as_str());
            wrong(format!("there is no stage `{}`", spec.from[0]), nearest(&spec.from[0], names).map(str::to_owned))
        })?;
        let outputs = plan.outputs(stage);
        let known = |name: &str| outputs.iter().find(|port| port.name == name).map(|port| port.name);
        let first = outputs.first().map(|port| port.name);
        // The second word is a port if the stage has one of that name, else a layer of its first port.
        let (port, part) = match (spec.from.get(1), spec.from.get(2)) {
            (None, _) => (first, None),
            (Some(port), part) if known(port).is_some() => (known(port), part.cloned()),
            (Some(layer), None) => (first, Some(layer.clone())),
            (Some(_), Some(_)) => (None, None),
        };
        let port = port.ok_or_else(|| {
            let names: Vec<&str> = outputs.iter().map(|port| port.name).collect();
            let asked = spec.from.get(1).map(String::as_str).unwrap_or_default();
            let message = format!("`{}` has no output `{asked}`; it has {}", spec.from[0], names.join(", "));
            wrong(message, nearest(asked, names.iter().copied()).map(str::to_owned))
        })?;
        if plan.draw_of(stage).is_none() {
            let message = format!("`{}` is the same for all samples: no `draw` reaches it", spec.from[0]);
            return Err(wrong(message, None));
        }
        Ok(Self { spec: spec.clone(), stage, port, part })
    }

    fn takes(&self, info: &LayerInfo) -> bool {
        let named = match &self.part {
            Some(name) => info.name == *name,
            None => info.kind == LayerKind::Value,
        };
        let numbers = [info.f_x_per_mm, info.phase_rad, info.orientation_deg, info.wavelength_nm];
        named && self.spec.layers.fits(numbers)
    }

    /// What it will hold, as far as the form of its port says before a run. Error: it cannot be a feature, in words.
    pub fn shape_of(&self, form: &Form) -> Result<Option<Shape>, String> {
        match (&form.pixels, &form.layers, &form.columns) {
            (Some([rows, columns]), Some(layers), _) => {
                let infos: Vec<&LayerInfo> = layers.iter().filter(|info| self.takes(info)).collect();
                let pixels = [*rows as usize, *columns as usize];
                let pitch = form
                    .attributes
                    .get(turbid_contract::pitch::PIXEL_PITCH_MM)
                    .and_then(|pitch| serde_json::from_value(pitch.clone()).ok());
                self.shape(&infos, pixels, pitch, &|| layers.iter().collect()).map(Some)
            }
            (_, _, Some(columns)) => {
                let name = self.part.as_deref().ok_or("name a column of the table: STAGE.PORT.COLUMN")?;
                let names = || columns.iter().map(|column| column.name.as_str()).collect::<Vec<_>>().join(", ");
                let column = columns.iter().find(|column| column.name == name);
                let column = column.ok_or_else(|| format!("the table has no column `{name}`; it has {}", names()))?;
                Ok(Some(Shape::number(&column.unit)))
            }
            _ => Ok(None),
        }
    }

    fn shape<'i>(
        &self,
        infos: &[&LayerInfo],
        [rows, columns]: [usize; 2],
        pixel_mm: Option<[f64; 2]>,
        all: &dyn Fn() -> Vec<&'i LayerInfo>,
    ) -> Result<Shape, String> {
        let Some(first) = infos.first() else {
            let mut names: Vec<String> = all().iter().map(|info| channel(info)).collect();
            names.dedup();
            return Err(format!("no layer is meant by it; there are {}", names.join(", ")));
        };
        if let Some(other) = infos.iter().find(|info| info.unit != first.unit) {
            return Err(format!("its layers have two units, {} and {}; name one layer", first.unit, other.unit));
        }
        let channels = infos.iter().map(|info| channel(info)).collect();
        Ok(Shape { tensor: Some([infos.len(), rows, columns]), unit: first.unit.clone(), channels, pixel_mm })
    }

    /// The values of a sample, and what they are. Error: in words.
    pub fn take(&self, artifact: &Artifact) -> Result<(Shape, Values), String> {
        match artifact {
            Artifact::Images(stack) => {
                let layers: Vec<_> = stack.layers.iter().filter(|layer| self.takes(&layer.info)).collect();
                let infos: Vec<&LayerInfo> = layers.iter().map(|layer| &layer.info).collect();
                let pitch = stack
                    .attributes
                    .get(turbid_contract::pitch::PIXEL_PITCH_MM)
                    .and_then(|p| serde_json::from_value(p.clone()).ok());
                let all = || stack.layers.iter().map(|layer| &layer.info).collect();
                let shape = self.shape(&infos, [stack.rows(), stack.columns()], pitch, &all)?;
                let values = layers.iter().flat_map(|layer| layer.data.iter().copied()).collect();
                Ok((shape, Values::Tensor(values)))
            }
            Artifact::Table(table) => {
                let name = self.part.as_deref().ok_or("name a column of the table: STAGE.PORT.COLUMN")?;
                let column = table.columns.iter().find(|column| column.name == name);
                let column = column.ok_or_else(|| format!("the table has no column `{name}`"))?;
                if column.cells.len() != 1 {
                    return Err(format!("the table has {} rows; a sample takes one", column.cells.len()));
                }
                if matches!(column.cells, Cells::Text(_)) {
                    return Err(format!("the column `{name}` holds text"));
                }
                Ok((Shape::number(&column.unit), Values::Number(number_of(&column.cells))))
            }
            Artifact::Record(_) => Err("a record is no feature".to_owned()),
        }
    }
}

impl Shape {
    fn number(unit: &str) -> Self {
        Self { tensor: None, unit: unit.to_owned(), channels: Vec::new(), pixel_mm: None }
    }

    /// Values of a sample.
    pub fn values(&self) -> usize {
        self.tensor.map_or(1, |shape| shape.iter().product())
    }
}

/// `radiance, f_x 0.1 mm^-1, phase 120 deg`
fn channel(info: &LayerInfo) -> String {
    let mut text = info.name.clone();
    if let Some(f_x) = info.f_x_per_mm {
        text += &format!(", f_x {f_x} mm^-1");
    }
    if let Some(phase) = info.phase_rad {
        text += &format!(", phase {} rad", (phase * 1e6).round() / 1e6);
    }
    if let Some(orientation) = info.orientation_deg {
        text += &format!(", orientation {orientation} deg");
    }
    if let Some(wavelength) = info.wavelength_nm {
        text += &format!(", {wavelength} nm");
    }
    text
}

/// The number in the first cell; none where it is not known, or a text.
pub fn number_of(cells: &Cells) -> Option<f64> {
    match cells {
        Cells::F64(cells) => cells.first().copied(),
        Cells::MaybeF64(cells) => cells.first().copied().flatten(),
        Cells::I64(cells) => cells.first().map(|&cell| cell as f64),
        Cells::Bool(cells) => cells.first().map(|&cell| f64::from(u8::from(cell))),
        Cells::Text(_) => None,
    }
}

/// Whether a port can be a feature at all.
pub fn can_be(kind: ArtifactKind) -> bool {
    kind != ArtifactKind::Record
}
