//! NumPy archives: `.npy` arrays in an uncompressed zip file without times.

use std::fmt;
use std::io::{Seek, Write};
use std::iter::once;

use serde_json::Value;
use turbid_contract::canonical::canonical_text;
use turbid_contract::pitch::PIXEL_PITCH_MM;
use turbid_contract::{Artifact, Cells, ImageStack};
use zip::result::ZipError;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter};

use super::names::Names;
use super::{Unwritten, json};

/// Images: `images` (float32, [layer, row, column]), `layers` (JSON text of each layer), `attributes` (JSON text), `pixel_pitch_mm`
/// (float64, along a row and along a column) where it is known.
/// Tables: an array per column, `units` and `attributes` (JSON text). Records: an array without axes per field.
///
/// Errors: those of writing.
pub fn encode(artifact: &Artifact, to: impl Write + Seek) -> Result<(), Unwritten> {
    let mut archive = Archive { zip: ZipWriter::new(to) };
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
    archive.zip.finish()?;
    Ok(())
}

/// What an array holds.
#[derive(Clone, Copy)]
enum Kind {
    F32,
    F64,
    I64,
    Bool,
    /// So many letters of UTF-32.
    Text(usize),
}

impl Kind {
    fn bytes(self) -> u64 {
        match self {
            Self::Bool => 1,
            Self::F32 => 4,
            Self::F64 | Self::I64 => 8,
            Self::Text(letters) => 4 * letters as u64,
        }
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::F32 => f.write_str("<f4"),
            Self::F64 => f.write_str("<f8"),
            Self::I64 => f.write_str("<i8"),
            Self::Bool => f.write_str("|b1"),
            Self::Text(letters) => write!(f, "<U{letters}"),
        }
    }
}

/// An archive under construction.
struct Archive<W: Write + Seek> {
    zip: ZipWriter<W>,
}

impl<W: Write + Seek> Archive<W> {
    fn images(&mut self, stack: &ImageStack) -> Result<(), Unwritten> {
        let shape = [stack.layers.len(), stack.rows(), stack.columns()];
        let pixels = stack.layers.iter().flat_map(|l| l.data.iter());
        self.add("images", Kind::F32, &shape, pixels.map(|v| v.to_le_bytes()))
    }

    fn column(&mut self, name: &str, cells: &Cells) -> Result<(), Unwritten> {
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

    fn scalar(&mut self, name: &str, value: &Value) -> Result<(), Unwritten> {
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

    fn text(&mut self, name: &str, text: String) -> Result<(), Unwritten> {
        self.texts(name, &[], &[text])
    }

    /// UTF-32 text, every item as long as the longest.
    fn texts(&mut self, name: &str, shape: &[usize], items: &[String]) -> Result<(), Unwritten> {
        let length = items.iter().map(|t| t.chars().count()).max().unwrap_or(0).max(1);
        let letters = items.iter().flat_map(|t| t.chars().chain(std::iter::repeat('\0')).take(length));
        self.add(name, Kind::Text(length), shape, letters.map(|c| u32::from(c).to_le_bytes()))
    }

    /// An array in NumPy's format 1.0, rows first.
    fn add<const N: usize>(
        &mut self,
        name: &str,
        kind: Kind,
        shape: &[usize],
        data: impl Iterator<Item = [u8; N]>,
    ) -> Result<(), Unwritten> {
        let head = head(kind, shape);
        let bytes = head.len() as u64 + kind.bytes() * shape.iter().map(|&n| n as u64).product::<u64>();
        self.zip.start_file(format!("{name}.npy"), options(bytes))?;
        self.zip.write_all(&head)?;
        // The archive takes a checksum over every piece: pieces are not single numbers.
        let mut block = Vec::with_capacity(BLOCK + N);
        for number in data {
            block.extend_from_slice(&number);
            if block.len() >= BLOCK {
                self.zip.write_all(&block)?;
                block.clear();
            }
        }
        Ok(self.zip.write_all(&block)?)
    }
}

/// Bytes that are written at a time.
const BLOCK: usize = 1 << 16;

/// Magic number, version and description of an array, up to its data.
fn head(kind: Kind, shape: &[usize]) -> Vec<u8> {
    let axes: String = shape.iter().map(|n| format!("{n}, ")).collect();
    // A tuple of one needs its comma, longer ones must not end in a blank.
    let axes = if shape.len() == 1 { axes.trim_end() } else { axes.trim_end_matches(", ") };
    let mut header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({axes}), }}");
    let padding = 63 - (10 + header.len()) % 64;
    header.extend(std::iter::repeat_n(' ', padding));
    header.push('\n');
    let mut head = b"\x93NUMPY\x01\x00".to_vec();
    head.extend(u16::try_from(header.len()).expect("a header of three axes is short").to_le_bytes());
    head.extend(header.bytes());
    head
}

/// Stored, at midnight of 1 January 1980, the earliest time that zip knows; sizes of 64 bits where 32 are too few.
fn options(bytes: u64) -> SimpleFileOptions {
    let options = SimpleFileOptions::DEFAULT.compression_method(CompressionMethod::Stored);
    options.last_modified_time(DateTime::DEFAULT).unix_permissions(0o644).large_file(is_large(bytes))
}

/// Whether an entry of so many bytes is one of zip64.
fn is_large(bytes: u64) -> bool {
    bytes >= u64::from(u32::MAX)
}

impl From<ZipError> for Unwritten {
    fn from(error: ZipError) -> Self {
        match error {
            ZipError::Io(error) => Self::Io(error),
            other => Self::Io(std::io::Error::other(other)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{Cursor, Read};

    /// The size of an array is known before it is written, and from 4 GiB on its entry is one of zip64 that a reader finds.
    #[test]
    fn large_arrays_are_entries_of_zip64() {
        assert!(!is_large(u64::from(u32::MAX) - 1) && is_large(u64::from(u32::MAX)) && is_large(1 << 32));
        let mut bytes = Vec::new();
        let mut zip = ZipWriter::new(Cursor::new(&mut bytes));
        for (name, size) in [("small", 3), ("large", 5 << 30)] {
            zip.start_file(name, options(size)).unwrap();
            zip.write_all(name.as_bytes()).unwrap();
        }
        zip.finish().unwrap();
        let at = |name: &str| bytes.windows(name.len()).position(|w| w == name.as_bytes()).unwrap();
        // Behind the name the extra field of sizes of 64 bits: its number and its length.
        assert_eq!(bytes[at("large") + 5..][..4], [1, 0, 16, 0]);
        assert_eq!(bytes[at("small") + 5..][..5], *b"small");
        let mut archive = zip::ZipArchive::new(Cursor::new(&bytes)).unwrap();
        let mut text = String::new();
        archive.by_name("large").unwrap().read_to_string(&mut text).unwrap();
        assert_eq!(text, "large");
    }
}
