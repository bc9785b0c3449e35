//! Pictures from the bytes of PNG, TIFF and EXR files.
//!
//! Sizes are read and bounded before memory is asked for; one channel is kept, in the numbers of the file.

mod exr;
mod exr_header;
mod numbers;
mod png;
mod tiff;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use turbid_contract::guard::guarded;

pub use numbers::Numbers;

/// The most pixels of a picture.
pub const MOST_PIXELS: u64 = 1 << 28;

/// Which channel of a coloured picture is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Channel {
    Red,
    Green,
    Blue,
}

/// One channel of a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    pub rows: usize,
    pub columns: usize,
    /// As in the file, row by row from the top.
    pub values: Numbers,
    /// The highest number that a pixel can have; none for pictures of floating-point numbers.
    pub highest: Option<f64>,
}

impl Picture {
    /// The same with the highest number that a camera of so many bits writes.
    ///
    /// Error: the file has no whole numbers, or too few or too many bits for it.
    pub fn of_bits(self, bits: Option<u32>) -> Result<Self, String> {
        let Some(bits) = bits else { return Ok(self) };
        let Some(highest) = self.highest else {
            return Err(format!("its numbers are floating-point, not of {bits} bits: leave `bits` out"));
        };
        let own = ((1_u64 << bits) - 1) as f64;
        let largest = self.values.iter().fold(0.0, f64::max);
        if own > highest || largest > own {
            return Err(format!(
                "it holds numbers up to {largest} of at most {highest}, a camera of {bits} bits writes up to {own}"
            ));
        }
        Ok(Self { highest: Some(own), ..self })
    }

    /// A picture of all that was read.
    fn whole((columns, rows): (usize, usize), values: Numbers) -> Result<Self, String> {
        if values.len() != rows * columns {
            return Err(format!("it ends after {} of {} pixels", values.len(), rows * columns));
        }
        let highest = values.highest();
        Ok(Self { rows, columns, values, highest })
    }
}

/// Reads a file by its first bytes. At most two times the picture as it is kept, and one row or block of all its channels, stand in
/// memory beside the bytes.
///
/// Error: what is wrong with it.
pub fn decode(bytes: &[u8], channel: Option<Channel>) -> Result<Picture, String> {
    guarded(|| match bytes {
        [0x89, b'P', b'N', b'G', ..] => png::read(bytes, channel),
        [b'I', b'I', 42, 0, ..] | [b'M', b'M', 0, 42, ..] => tiff::read(bytes, channel),
        [0x76, 0x2f, 0x31, 0x01, ..] => exr::read(bytes, channel),
        _ => Err("it is neither PNG, TIFF nor EXR".to_owned()),
    })
}

/// Columns and rows of a file, as its header says them.
///
/// Error: what is wrong with the header.
pub fn size(bytes: &[u8]) -> Result<(usize, usize), String> {
    guarded(|| match bytes {
        [0x89, b'P', b'N', b'G', ..] => png::size(bytes),
        [b'I', b'I', 42, 0, ..] | [b'M', b'M', 0, 42, ..] => tiff::size(bytes),
        [0x76, 0x2f, 0x31, 0x01, ..] => exr_header::read(bytes).map(|header| (header.columns, header.rows)),
        _ => Err("it is neither PNG, TIFF nor EXR".to_owned()),
    })
}

/// Which of `count` interleaved channels to take.
fn place(count: usize, channel: Option<Channel>) -> Result<usize, String> {
    match (count, channel) {
        (1 | 2, None) => Ok(0),
        (1 | 2, Some(_)) => Err("it is grey, and has no channel to choose: leave `channel` out".to_owned()),
        (_, Some(channel)) => Ok(channel as usize),
        (_, None) => Err("it is coloured: say `channel: red`, `green` or `blue`".to_owned()),
    }
}

fn bounded(columns: u64, rows: u64) -> Result<(usize, usize), String> {
    let pixels = columns.checked_mul(rows).filter(|&pixels| pixels > 0 && pixels <= MOST_PIXELS);
    let size = pixels.map(|_| (columns as usize, rows as usize));
    size.ok_or_else(|| format!("it has {columns} x {rows} pixels; from 1 to {MOST_PIXELS} in all are read"))
}

/// No file of so many bytes packs that many: `ratio` is the highest that its kind of packing reaches.
fn can_hold(packed: usize, unpacked: u64, ratio: u64) -> Result<(), String> {
    if unpacked / ratio > packed as u64 {
        return Err(format!("its {packed} bytes cannot hold the {unpacked} of its pixels: it is cut off or damaged"));
    }
    Ok(())
}
