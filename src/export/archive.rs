//! A NumPy archive under construction: `.npy` arrays in an uncompressed zip file without times.

use std::fmt;
use std::io::{self, Seek, Write};

use zip::result::ZipError;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter};

/// What an array holds.
#[derive(Clone, Copy)]
pub enum Kind {
    F16,
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
            Self::F16 => 2,
            Self::F32 => 4,
            Self::F64 | Self::I64 => 8,
            Self::Text(letters) => 4 * letters as u64,
        }
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::F16 => f.write_str("<f2"),
            Self::F32 => f.write_str("<f4"),
            Self::F64 => f.write_str("<f8"),
            Self::I64 => f.write_str("<i8"),
            Self::Bool => f.write_str("|b1"),
            Self::Text(letters) => write!(f, "<U{letters}"),
        }
    }
}

/// An archive under construction.
pub struct Archive<W: Write + Seek> {
    zip: ZipWriter<W>,
}

impl<W: Write + Seek> Archive<W> {
    pub fn new(to: W) -> Self {
        Self { zip: ZipWriter::new(to) }
    }

    /// Writes the list of the arrays; what was written to.
    pub fn finish(self) -> io::Result<W> {
        self.zip.finish().map_err(plain)
    }

    pub fn text(&mut self, name: &str, text: String) -> io::Result<()> {
        self.texts(name, &[], &[text])
    }

    /// UTF-32 text, every item as long as the longest.
    pub fn texts(&mut self, name: &str, shape: &[usize], items: &[String]) -> io::Result<()> {
        let length = items.iter().map(|t| t.chars().count()).max().unwrap_or(0).max(1);
        let letters = items.iter().flat_map(|t| t.chars().chain(std::iter::repeat('\0')).take(length));
        self.add(name, Kind::Text(length), shape, letters.map(|c| u32::from(c).to_le_bytes()))
    }

    /// An array in NumPy's format 1.0, rows first.
    pub fn add<const N: usize>(
        &mut self,
        name: &str,
        kind: Kind,
        shape: &[usize],
        data: impl Iterator<Item = [u8; N]>,
    ) -> io::Result<()> {
        self.begin(name, kind, shape)?;
        self.go_on(data)
    }

    /// The head of an array, whose numbers follow by [`Archive::go_on`].
    pub fn begin(&mut self, name: &str, kind: Kind, shape: &[usize]) -> io::Result<()> {
        let head = head(kind, shape);
        let bytes = head.len() as u64 + kind.bytes() * shape.iter().map(|&n| n as u64).product::<u64>();
        self.zip.start_file(format!("{name}.npy"), options(bytes)).map_err(plain)?;
        self.zip.write_all(&head)
    }

    /// Further numbers of the array that was begun last.
    pub fn go_on<const N: usize>(&mut self, data: impl Iterator<Item = [u8; N]>) -> io::Result<()> {
        // The archive takes a checksum over every piece: pieces are not single numbers.
        let mut block = Vec::with_capacity(BLOCK + N);
        for number in data {
            block.extend_from_slice(&number);
            if block.len() >= BLOCK {
                self.zip.write_all(&block)?;
                block.clear();
            }
        }
        self.zip.write_all(&block)
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
    head.extend(u16::try_from(header.len()).expect("a header of four axes is short").to_le_bytes());
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

fn plain(error: ZipError) -> io::Error {
    match error {
        ZipError::Io(error) => error,
        other => io::Error::other(other),
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
