//! TIFF 6.0: one uncompressed page of 32-bit floats per layer, its description as JSON in `ImageDescription`; or one page of whole
//! numbers, as cameras write them.

use serde_json::Value;
use turbid_contract::canonical::canonical_text;
use turbid_contract::{ImageStack, Layer};

use super::{TooLarge, json, size_u32};

const SHORT: u16 = 3;
const LONG: u16 = 4;
const ASCII: u16 = 2;
const RATIONAL: u16 = 5;
/// Unit of a resolution.
const CENTIMETRES: u32 = 3;
const ENTRY: usize = 12;

/// Little-endian file; the first page's description also holds the stack's `attributes`, each page the resolution where the pixels'
/// pitch is known.
pub fn encode(stack: &ImageStack) -> Result<Vec<u8>, TooLarge> {
    let mut file = File::default();
    for (index, layer) in stack.layers.iter().enumerate() {
        let mut about = json(&layer.info);
        if index == 0 {
            about["attributes"] = json(&stack.attributes);
        }
        // Row by row whatever the memory order of the array.
        let pixels = layer.data.iter().flat_map(|v| v.to_le_bytes());
        file.page([stack.rows(), stack.columns()], Numbers::Float32, pixels, &about, stack.pixel_pitch_mm())?;
    }
    Ok(file.bytes)
}

/// One page of whole numbers of 8 or 16 bit.
pub fn encode_numbers(
    layer: &Layer,
    numbers: &[u16],
    eight: bool,
    pitch_mm: Option<[f64; 2]>,
) -> Result<Vec<u8>, TooLarge> {
    let mut file = File::default();
    let (size, about) = ([layer.data.nrows(), layer.data.ncols()], json(&layer.info));
    if eight {
        file.page(size, Numbers::Unsigned8, numbers.iter().map(|&v| v as u8), &about, pitch_mm)?;
    } else {
        file.page(size, Numbers::Unsigned16, numbers.iter().flat_map(|v| v.to_le_bytes()), &about, pitch_mm)?;
    }
    Ok(file.bytes)
}

/// What a pixel is.
#[derive(Clone, Copy)]
enum Numbers {
    Unsigned8,
    Unsigned16,
    Float32,
}

impl Numbers {
    /// BitsPerSample and SampleFormat.
    fn tags(self) -> [u32; 2] {
        match self {
            Self::Unsigned8 => [8, 1],
            Self::Unsigned16 => [16, 1],
            Self::Float32 => [32, 3],
        }
    }
}

struct File {
    bytes: Vec<u8>,
    /// Where the offset of the next page's directory goes.
    link: usize,
}

impl Default for File {
    fn default() -> Self {
        Self { bytes: b"II\x2a\0\0\0\0\0".to_vec(), link: 4 }
    }
}

impl File {
    fn page(
        &mut self,
        [rows, columns]: [usize; 2],
        numbers: Numbers,
        data: impl Iterator<Item = u8>,
        about: &Value,
        pitch_mm: Option<[f64; 2]>,
    ) -> Result<(), TooLarge> {
        let out = &mut self.bytes;
        let pixels = size_u32(out.len())?;
        out.extend(data);
        let bytes = size_u32(out.len())? - pixels;
        let text = size_u32(out.len())?;
        out.extend(ascii(&canonical_text(about)).bytes());
        out.push(0);
        let letters = size_u32(out.len())? - text;
        // Directories start at even offsets, and a value of up to 4 bytes would stand in its entry: JSON is longer.
        out.resize(out.len().next_multiple_of(4), 0);

        let (rows, columns) = (size_u32(rows)?, size_u32(columns)?);
        let [bits, format] = numbers.tags();
        let mut entries: Vec<(u16, u16, u32, u32)> = vec![
            (256, LONG, 1, columns),
            (257, LONG, 1, rows),
            // Then no compression, black is zero.
            (258, SHORT, 1, bits),
            (259, SHORT, 1, 1),
            (262, SHORT, 1, 1),
            (270, ASCII, letters, text),
            // One strip, one sample per pixel.
            (273, LONG, 1, pixels),
            (277, SHORT, 1, 1),
            (278, LONG, 1, rows),
            (279, LONG, 1, bytes),
            (284, SHORT, 1, 1),
            (339, SHORT, 1, format),
        ];
        if let Some(resolutions) = pitch_mm.and_then(|pitch| Some([per_cm(pitch[0])?, per_cm(pitch[1])?])) {
            for (tag, resolution) in [282, 283].into_iter().zip(resolutions) {
                let at = size_u32(out.len())?;
                out.extend(resolution.iter().flat_map(|v| v.to_le_bytes()));
                entries.push((tag, RATIONAL, 1, at));
            }
            entries.push((296, SHORT, 1, CENTIMETRES));
            entries.sort_unstable();
        }
        let directory = size_u32(out.len())?;
        out[self.link..self.link + 4].copy_from_slice(&directory.to_le_bytes());
        out.extend((entries.len() as u16).to_le_bytes());
        for &(tag, kind, count, value) in &entries {
            out.extend(tag.to_le_bytes());
            out.extend(kind.to_le_bytes());
            out.extend(count.to_le_bytes());
            out.extend(value.to_le_bytes());
        }
        self.link = directory as usize + 2 + ENTRY * entries.len();
        out.extend([0; 4]);
        out.resize(out.len().next_multiple_of(4), 0);
        size_u32(out.len())?;
        Ok(())
    }
}

/// Pixels per cm as numerator and denominator, with as many digits as 32 bits hold; `None` where they hold none.
pub(super) fn per_cm(pitch_mm: f64) -> Option<[u32; 2]> {
    let holds = |v: &f64| (1.0..=f64::from(u32::MAX)).contains(v);
    let denominators = (0..=9).rev().map(|power| 10_u32.pow(power));
    denominators
        .map(|denominator| ((10.0 / pitch_mm * f64::from(denominator)).round(), denominator))
        .find_map(|(numerator, denominator)| holds(&numerator).then_some([numerator as u32, denominator]))
}

/// JSON in the 7 bits that TIFF's text has.
fn ascii(json: &str) -> String {
    let mut out = String::with_capacity(json.len());
    for c in json.chars() {
        if c.is_ascii() {
            out.push(c);
        } else {
            out.extend(c.encode_utf16(&mut [0; 2]).iter().map(|unit| format!("\\u{unit:04x}")));
        }
    }
    out
}
