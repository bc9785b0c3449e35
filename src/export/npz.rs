//! Artifacts as NumPy archives.

use std::io::{self, Seek, Write};
use std::iter::once;

use serde_json::Value;
use turbid_contract::canonical::canonical_text;
use turbid_contract::pitch::PIXEL_PITCH_MM;
use turbid_contract::{Artifact, Cells, ImageStack};

use super::archive::{Archive, Kind};
use super::json;
use super::names::Names;

/// Images: `images` (float32, [layer, row, column]), `layers` (JSON text of each layer), `attributes` (JSON text), `pixel_pitch_mm`
/// (float64, along a row and along a column) where it is known.
/// Tables: an array per column, `units` and `attributes` (JSON text). Records: an array without axes per field.
///
/// Errors: those of writing.
pub fn encode(artifact: &Artifact, to: impl Write + Seek) -> io::Result<()> {
    let mut archive = Archive::new(to);
    match artifact {
        Artifact::Images(stack) => {
            archive.images(stack)?;
            let layers: Vec<String> = stack.layers.iter().map(|l| canonical_text(&json(&l.info))).collect();
            archive.texts("layers", &[layers.len()], &layers)?;
            archive.text("attributes", canonical_text(&json(&stack.attributes)))?;
            if let Some(pitch) = stack.pixel_pitch_mm() {
                archive.add(PIXEL_PITCH_MM, Kind::F64, &[2], pitch.iter().map(|v| v.to_le_bytes()))?;
            }
        }
        Artifact::Table(table) => {
            let mut names = Names::default();
            for column in &table.columns {
                archive.column(&names.file(&column.name), &column.cells)?;
            }
            let units: turbid_contract::Attributes =
                table.columns.iter().map(|c| (c.name.clone(), Value::from(c.unit.clone()))).collect();
            for (name, value) in [("units", &units), ("attributes", &table.attributes)] {
                archive.text(&names.file(name), canonical_text(&json(value)))?;
            }
        }
        Artifact::Record(record) => {
            let mut names = Names::default();
            for (field, value) in &record.fields {
                archive.scalar(&names.file(field), value)?;
            }
        }
    }
    archive.finish().map(drop)
}

impl<W: Write + Seek> Archive<W> {
    fn images(&mut self, stack: &ImageStack) -> io::Result<()> {
        let shape = [stack.layers.len(), stack.rows(), stack.columns()];
        let pixels = stack.layers.iter().flat_map(|l| l.data.iter());
        self.add("images", Kind::F32, &shape, pixels.map(|v| v.to_le_bytes()))
    }

    pub(super) fn column(&mut self, name: &str, cells: &Cells) -> io::Result<()> {
        let shape = [cells.len()];
        match cells {
            Cells::F64(v) => self.add(name, Kind::F64, &shape, v.iter().map(|x| x.to_le_bytes())),
            Cells::MaybeF64(v) => {
                // NumPy has no null: NaN is what `nanmean` and pandas read as unknown.
                self.add(name, Kind::F64, &shape, v.iter().map(|x| x.unwrap_or(f64::NAN).to_le_bytes()))
            }
            Cells::I64(v) => self.add(name, Kind::I64, &shape, v.iter().map(|x| x.to_le_bytes())),
            Cells::Bool(v) => self.add(name, Kind::Bool, &shape, v.iter().map(|&x| [u8::from(x)])),
            Cells::Text(v) => self.texts(name, &shape, v),
        }
    }

    fn scalar(&mut self, name: &str, value: &Value) -> io::Result<()> {
        match value {
            Value::Bool(b) => self.add(name, Kind::Bool, &[], once([u8::from(*b)])),
            Value::Number(n) => match n.as_i64() {
                Some(whole) => self.add(name, Kind::I64, &[], once(whole.to_le_bytes())),
                None => self.add(name, Kind::F64, &[], once(n.as_f64().unwrap_or(f64::NAN).to_le_bytes())),
            },
            Value::String(text) => self.text(name, text.clone()),
            nested => self.text(name, canonical_text(nested)),
        }
    }
}
