//! NumPy archives: `.npy` arrays in an uncompressed zip file without times.

use serde_json::Value;
use turbid_contract::canonical::canonical_text;
use turbid_contract::pitch::PIXEL_PITCH_MM;
use turbid_contract::{Artifact, Cells, ImageStack};

use super::names::Names;
use super::{TooLarge, json, size_u32};

/// Images: `images` (float32, [layer, row, column]), `layers` (JSON text of each layer), `attributes` (JSON text), `pixel_pitch_mm`
/// (float64, along a row and along a column) where it is known.
/// Tables: an array per column, `units` and `attributes` (JSON text). Records: an array without axes per field.
pub fn encode(artifact: &Artifact) -> Result<Vec<u8>, TooLarge> {
    let mut zip = Zip::default();
    match artifact {
        Artifact::Images(stack) => {
            zip.add("images", &images(stack))?;
            let layers: Vec<String> = stack.layers.iter().map(|l| canonical_text(&json(&l.info))).collect();
            zip.add("layers", &texts(&[layers.len()], &layers))?;
            zip.add("attributes", &texts(&[], &[canonical_text(&json(&stack.attributes))]))?;
            if let Some(pitch) = stack.pixel_pitch_mm() {
                zip.add(PIXEL_PITCH_MM, &npy("<f8", &[2], pitch.iter().flat_map(|v| v.to_le_bytes())))?;
            }
        }
        Artifact::Table(table) => {
            let mut names = Names::default();
            for column in &table.columns {
                zip.add(&names.file(&column.name), &cells(&column.cells))?;
            }
            let units: turbid_contract::Attributes =
                table.columns.iter().map(|c| (c.name.clone(), Value::from(c.unit.clone()))).collect();
            for (name, value) in [("units", &units), ("attributes", &table.attributes)] {
                zip.add(&names.file(name), &texts(&[], &[canonical_text(&json(value))]))?;
            }
        }
        Artifact::Record(record) => {
            let mut names = Names::default();
            for (field, value) in &record.fields {
                zip.add(&names.file(field), &scalar(value))?;
            }
        }
    }
    zip.finish()
}

fn images(stack: &ImageStack) -> Vec<u8> {
    let shape = [stack.layers.len(), stack.rows(), stack.columns()];
    npy("<f4", &shape, stack.layers.iter().flat_map(|l| l.data.iter()).flat_map(|v| v.to_le_bytes()))
}

fn cells(cells: &Cells) -> Vec<u8> {
    let shape = [cells.len()];
    match cells {
        Cells::F64(v) => npy("<f8", &shape, v.iter().flat_map(|x| x.to_le_bytes())),
        // NumPy has no null: NaN is what `nanmean` and pandas read as unknown.
        Cells::MaybeF64(v) => npy("<f8", &shape, v.iter().flat_map(|x| x.unwrap_or(f64::NAN).to_le_bytes())),
        Cells::I64(v) => npy("<i8", &shape, v.iter().flat_map(|x| x.to_le_bytes())),
        Cells::Bool(v) => npy("|b1", &shape, v.iter().map(|&x| u8::from(x))),
        Cells::Text(v) => texts(&shape, v),
    }
}

fn scalar(value: &Value) -> Vec<u8> {
    match value {
        Value::Bool(b) => npy("|b1", &[], [u8::from(*b)].into_iter()),
        Value::Number(n) if n.is_i64() => npy("<i8", &[], n.as_i64().unwrap_or_default().to_le_bytes().into_iter()),
        Value::Number(n) => npy("<f8", &[], n.as_f64().unwrap_or(f64::NAN).to_le_bytes().into_iter()),
        Value::String(text) => texts(&[], std::slice::from_ref(text)),
        nested => texts(&[], &[canonical_text(nested)]),
    }
}

/// UTF-32 text, every item as long as the longest.
fn texts(shape: &[usize], items: &[String]) -> Vec<u8> {
    let length = items.iter().map(|t| t.chars().count()).max().unwrap_or(0).max(1);
    let letters = items.iter().flat_map(|t| t.chars().chain(std::iter::repeat('\0')).take(length));
    npy(&format!("<U{length}"), shape, letters.flat_map(|c| u32::from(c).to_le_bytes()))
}

/// An array in NumPy's format 1.0, rows first.
fn npy(dtype: &str, shape: &[usize], data: impl Iterator<Item = u8>) -> Vec<u8> {
    let axes: String = shape.iter().map(|n| format!("{n}, ")).collect();
    // A tuple of one needs its comma, longer ones must not end in a blank.
    let axes = if shape.len() == 1 { axes.trim_end() } else { axes.trim_end_matches(", ") };
    let mut header = format!("{{'descr': '{dtype}', 'fortran_order': False, 'shape': ({axes}), }}");
    let padding = 63 - (10 + header.len()) % 64;
    header.extend(std::iter::repeat_n(' ', padding));
    header.push('\n');
    let mut out = b"\x93NUMPY\x01\x00".to_vec();
    out.extend(u16::try_from(header.len()).expect("a header of three axes is short").to_le_bytes());
    out.extend(header.bytes());
    out.extend(data);
    out
}

/// A zip archive under construction.
#[derive(Default)]
struct Zip {
    bytes: Vec<u8>,
    directory: Vec<u8>,
    entries: u16,
}

impl Zip {
    fn add(&mut self, array: &str, content: &[u8]) -> Result<(), TooLarge> {
        let name = format!("{array}.npy");
        let offset = size_u32(self.bytes.len())?;
        let mut head = Vec::new();
        // Version 2.0; names in UTF-8; stored; midnight of 1 January 1980, the earliest time that zip knows.
        for half in [20u16, 1 << 11, 0, 0, 0x21] {
            head.extend(half.to_le_bytes());
        }
        head.extend(crc32fast::hash(content).to_le_bytes());
        head.extend(size_u32(content.len())?.to_le_bytes());
        head.extend(size_u32(content.len())?.to_le_bytes());
        head.extend(u16::try_from(name.len()).map_err(|_| TooLarge)?.to_le_bytes());
        head.extend([0; 2]);

        self.bytes.extend(b"PK\x03\x04");
        self.bytes.extend(&head);
        self.bytes.extend(name.bytes());
        self.bytes.extend(content);

        self.directory.extend(b"PK\x01\x02\x14\0");
        self.directory.extend(&head);
        // No comment, disk 0, no attributes.
        self.directory.extend([0; 10]);
        self.directory.extend(offset.to_le_bytes());
        self.directory.extend(name.bytes());
        self.entries = self.entries.checked_add(1).ok_or(TooLarge)?;
        Ok(())
    }

    fn finish(mut self) -> Result<Vec<u8>, TooLarge> {
        let start = size_u32(self.bytes.len())?;
        let length = size_u32(self.directory.len())?;
        self.bytes.append(&mut self.directory);
        self.bytes.extend(b"PK\x05\x06\0\0\0\0");
        self.bytes.extend(self.entries.to_le_bytes());
        self.bytes.extend(self.entries.to_le_bytes());
        self.bytes.extend(length.to_le_bytes());
        self.bytes.extend(start.to_le_bytes());
        self.bytes.extend([0; 2]);
        Ok(self.bytes)
    }
}
