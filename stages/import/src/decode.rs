//! Pictures from the bytes of PNG, TIFF, EXR, BMP, PGM, NumPy and MATLAB files, of numbers in text, and of files without a header.
//!
//! Sizes are read and bounded before memory is asked for; one channel is kept, in the numbers of the file.

mod array;
mod bmp;
mod csv;
mod exr;
mod exr_header;
mod mat;
mod npy;
mod npz;
mod numbers;
mod pgm;
mod png;
mod raw;
mod tiff;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use turbid_contract::guard::guarded;

pub use numbers::Numbers;
pub use raw::{Raw, RawType};

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
    /// The same with the highest number that a camera of so many bits writes; of floating-point numbers these are counts.
    ///
    /// Error: the file has too few or too many bits for it.
    pub fn of_bits(self, bits: Option<u32>) -> Result<Self, String> {
        let Some(bits) = bits else { return Ok(self) };
        let own = ((1_u64 << bits) - 1) as f64;
        let largest = self.values.iter().filter(|v| v.is_finite()).fold(0.0, f64::max);
        let highest = self.highest.unwrap_or(f64::INFINITY);
        if own > highest || largest > own {
            let of = if highest.is_finite() { format!(" of at most {highest}") } else { String::new() };
            return Err(format!("it holds numbers up to {largest}{of}, a camera of {bits} bits writes up to {own}"));
        }
        Ok(Self { highest: Some(own), ..self })
    }

    /// The part of so many columns and rows, from the column `left` and the row `top` on.
    ///
    /// Error: it reaches beyond the picture.
    pub fn cropped(self, crop: Option<[u32; 4]>) -> Result<Self, String> {
        let Some([left, top, width, height]) = crop.map(|crop| crop.map(|n| n as usize)) else { return Ok(self) };
        let Self { rows, columns, .. } = self;
        if left + width > columns || top + height > rows {
            return Err(format!(
                "it has {columns} x {rows} pixels, and crop = [{left}, {top}, {width}, {height}] ends at {} x {}",
                left + width,
                top + height
            ));
        }
        let places = (top..top + height).flat_map(|r| (left..left + width).map(move |c| r * columns + c));
        Ok(Self { rows: height, columns: width, values: self.values.pick(places), highest: self.highest })
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

/// Which picture of a file is wanted, and how it is to be read.
#[derive(Clone, Copy, Debug, Default)]
pub struct Wanted<'a> {
    /// Of coloured pictures.
    pub channel: Option<Channel>,
    /// Of several in a file, from 0.
    pub page: Option<usize>,
    /// Of several arrays in a file of NumPy or MATLAB.
    pub variable: Option<&'a str>,
    /// Of files without a header.
    pub raw: Option<Raw>,
}

/// Reads a file by its first bytes. At most two times the picture as it is kept, and one row or block of all its channels, stand in
/// memory beside the bytes.
///
/// Error: what is wrong with it.
pub fn decode(bytes: &[u8], wanted: Wanted<'_>) -> Result<Picture, String> {
    let Wanted { channel, page, variable, raw } = wanted;
    guarded(|| {
        if let Some(raw) = raw {
            grey(channel)?;
            return raw.read(bytes, page.unwrap_or(0));
        }
        let kind = Kind::of(bytes)?;
        if kind.is_one_picture() && page.is_some_and(|page| page > 0) {
            return Err(no_page(page.unwrap_or(0), 1));
        }
        if !kind.has_variables() && variable.is_some() {
            return Err("its picture has no name: leave `variable` out".to_owned());
        }
        if !kind.has_colours() {
            grey(channel)?;
        }
        match kind {
            Kind::Png => png::read(bytes, channel),
            Kind::Tiff => tiff::read(bytes, channel, page),
            Kind::Exr => exr::read(bytes, channel),
            Kind::Bmp => bmp::read(bytes, channel),
            Kind::Pgm => pgm::read(bytes),
            Kind::Npy => npy::read(bytes, page),
            Kind::Npz => npy::read(&npz::entry(bytes, variable)?, page),
            Kind::Mat => mat::array(bytes, variable)?.picture(page),
            Kind::Csv => csv::read(bytes),
        }
    })
}

/// How many pictures are in a file.
///
/// Error: what is wrong with it.
pub fn pages(bytes: &[u8], variable: Option<&str>, raw: Option<Raw>) -> Result<usize, String> {
    guarded(|| match raw {
        Some(raw) => raw.pages(bytes),
        None => match Kind::of(bytes)? {
            Kind::Tiff => tiff::count(bytes),
            Kind::Npy => npy::pages(bytes),
            Kind::Npz => npy::pages(&npz::entry(bytes, variable)?),
            Kind::Mat => mat::array(bytes, variable).map(|array| array.pages),
            _ => Ok(1),
        },
    })
}

/// Columns and rows of a file, as its header says them.
///
/// Error: what is wrong with the header.
pub fn size(bytes: &[u8], variable: Option<&str>, raw: Option<Raw>) -> Result<(usize, usize), String> {
    guarded(|| match raw {
        Some(raw) => Ok((raw.size[0] as usize, raw.size[1] as usize)),
        None => match Kind::of(bytes)? {
            Kind::Png => png::size(bytes),
            Kind::Tiff => tiff::size(bytes),
            Kind::Exr => exr_header::read(bytes).map(|header| (header.columns, header.rows)),
            Kind::Bmp => bmp::size(bytes),
            Kind::Pgm => pgm::size(bytes),
            Kind::Npy => npy::size(bytes),
            Kind::Npz => npy::size(&npz::entry(bytes, variable)?),
            Kind::Mat => mat::array(bytes, variable).map(|array| (array.columns, array.rows)),
            Kind::Csv => csv::size(bytes),
        },
    })
}

/// What a file is by its first bytes.
enum Kind {
    Png,
    Tiff,
    Exr,
    Bmp,
    Pgm,
    Npy,
    Npz,
    Mat,
    Csv,
}

impl Kind {
    fn is_one_picture(&self) -> bool {
        matches!(self, Self::Png | Self::Exr | Self::Bmp | Self::Pgm | Self::Csv)
    }

    fn has_variables(&self) -> bool {
        matches!(self, Self::Npz | Self::Mat)
    }

    fn has_colours(&self) -> bool {
        matches!(self, Self::Png | Self::Tiff | Self::Exr | Self::Bmp)
    }

    fn of(bytes: &[u8]) -> Result<Self, String> {
        Ok(match bytes {
            [0x89, b'P', b'N', b'G', ..] => Self::Png,
            [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..] => Self::Tiff,
            [0x76, 0x2f, 0x31, 0x01, ..] => Self::Exr,
            [b'B', b'M', ..] => Self::Bmp,
            [b'P', b'5', ..] => Self::Pgm,
            [0x93, b'N', b'U', b'M', b'P', b'Y', ..] => Self::Npy,
            [b'P', b'K', 3, 4, ..] => Self::Npz,
            [b'M', b'A', b'T', b'L', b'A', b'B', b' ', b'5', ..] => Self::Mat,
            [0x89, b'H', b'D', b'F', ..] | [b'M', b'A', b'T', b'L', b'A', b'B', b' ', b'7', ..] => {
                return Err(
                    "it is HDF5 (MATLAB 7.3), which is not read: write it by `save(name, 'frame', '-v7')`".to_owned()
                );
            }
            [0xff, 0xd8, ..] => return Err("it is a JPEG, whose packing changes numbers: save PNG or TIFF".to_owned()),
            _ if csv::is(bytes) => Self::Csv,
            _ => {
                let known =
                    "neither PNG, TIFF, EXR, BMP, PGM (P5), NumPy (.npy, .npz), MATLAB (.mat) nor numbers in text";
                return Err(format!("it is {known}; for numbers without a header say `raw`"));
            }
        })
    }
}

fn no_page(page: usize, pages: usize) -> String {
    let s = if pages == 1 { "" } else { "s" };
    format!("it has {pages} page{s}, and page {} is asked for", page + 1)
}

/// Error: a channel of a kind of file that has none.
fn grey(channel: Option<Channel>) -> Result<(), String> {
    place(1, channel).map(|_| ())
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
