//! TIFF: one uncompressed page of 32-bit floats per layer, its description as JSON in `ImageDescription`; or one page of whole numbers, as
//! cameras write them. Files of 4 GiB and more are BigTIFF.

use std::io::{Seek, Write};

use serde_json::Value;
use tiff::TiffError;
use tiff::encoder::colortype::{ColorType, Gray8, Gray16, Gray32Float};
use tiff::encoder::{Rational, TiffEncoder, TiffKind, TiffValue};
use tiff::tags::{ResolutionUnit, Tag};
use turbid_contract::canonical::canonical_text;
use turbid_contract::{ImageStack, Layer};

use super::{Unwritten, json};

/// More than the entries of a page's directory take, and what stands around its pixels, bytes.
const AROUND: u64 = 1024;
/// Bytes of pixels in a strip, at least, but for the last; a strip has an offset and a length of 8 bytes in the directory at most.
const STRIP: u64 = 1_000_000;

/// The first page's description also holds the stack's `attributes`, each page the resolution where the pixels' pitch is known.
///
/// Errors: those of writing; more than 2^32 rows or columns.
pub fn encode(stack: &ImageStack, to: impl Write + Seek) -> Result<(), Unwritten> {
    let about = |(index, layer): (usize, &Layer)| {
        let mut about = json(&layer.info);
        if index == 0 {
            about["attributes"] = json(&stack.attributes);
        }
        text(&about)
    };
    let abouts: Vec<String> = stack.layers.iter().enumerate().map(about).collect();
    let bytes = abouts.iter().map(|about| page_bytes([stack.rows(), stack.columns()], 4, about)).sum();
    if is_big(bytes) {
        pages(TiffEncoder::new_big(to)?, stack, &abouts)
    } else {
        pages(TiffEncoder::new(to)?, stack, &abouts)
    }
}

fn pages<W: Write + Seek, K: TiffKind>(
    mut file: TiffEncoder<W, K>,
    stack: &ImageStack,
    abouts: &[String],
) -> Result<(), Unwritten> {
    let (size, pitch) = ([stack.rows(), stack.columns()], stack.pixel_pitch_mm());
    let mut layers = stack.layers.iter().zip(abouts);
    layers.try_for_each(|(layer, about)| page::<Gray32Float, _, _>(&mut file, size, &layer.pixels(), about, pitch))
}

/// One page of whole numbers of 8 or 16 bit.
///
/// Errors as [`encode`].
pub fn encode_numbers(
    layer: &Layer,
    numbers: &[u16],
    eight: bool,
    pitch_mm: Option<[f64; 2]>,
    to: impl Write + Seek,
) -> Result<(), Unwritten> {
    let (size, about) = ([layer.data.nrows(), layer.data.ncols()], text(&json(&layer.info)));
    if is_big(page_bytes(size, 2, &about)) {
        page_of_numbers(TiffEncoder::new_big(to)?, size, numbers, eight, &about, pitch_mm)
    } else {
        page_of_numbers(TiffEncoder::new(to)?, size, numbers, eight, &about, pitch_mm)
    }
}

fn page_of_numbers<W: Write + Seek, K: TiffKind>(
    mut file: TiffEncoder<W, K>,
    size: [usize; 2],
    numbers: &[u16],
    eight: bool,
    about: &str,
    pitch_mm: Option<[f64; 2]>,
) -> Result<(), Unwritten> {
    if eight {
        let bytes: Vec<u8> = numbers.iter().map(|&v| v as u8).collect();
        page::<Gray8, _, _>(&mut file, size, &bytes, about, pitch_mm)
    } else {
        page::<Gray16, _, _>(&mut file, size, numbers, about, pitch_mm)
    }
}

fn page<C: ColorType, W: Write + Seek, K: TiffKind>(
    file: &mut TiffEncoder<W, K>,
    [rows, columns]: [usize; 2],
    pixels: &[C::Inner],
    about: &str,
    pitch_mm: Option<[f64; 2]>,
) -> Result<(), Unwritten>
where
    [C::Inner]: TiffValue,
{
    let side = |n: usize| u32::try_from(n).map_err(|_| Unwritten::TooLarge);
    let mut image = file.new_image::<C>(side(columns)?, side(rows)?)?;
    image.encoder().write_tag(Tag::ImageDescription, about)?;
    if let Some([x, y]) = pitch_mm.and_then(|pitch| Some([per_cm(pitch[0])?, per_cm(pitch[1])?])) {
        image.resolution_unit(ResolutionUnit::Centimeter);
        image.x_resolution(rational(x));
        image.y_resolution(rational(y));
    }
    Ok(image.write_data(pixels)?)
}

fn rational([n, d]: [u32; 2]) -> Rational {
    Rational { n, d }
}

/// The most bytes that a page takes.
fn page_bytes([rows, columns]: [usize; 2], pixel_bytes: u64, about: &str) -> u64 {
    let pixels = pixel_bytes * rows as u64 * columns as u64;
    // A row of more than a strip is a strip of its own.
    let strips = (pixels / STRIP + 1).min(rows as u64);
    pixels + 16 * strips + about.len() as u64 + AROUND
}

/// Whether a file of so many bytes has places that 32 bits do not count.
pub(super) fn is_big(bytes: u64) -> bool {
    bytes > u64::from(u32::MAX)
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
fn text(about: &Value) -> String {
    let mut out = String::new();
    for c in canonical_text(about).chars() {
        if c.is_ascii() {
            out.push(c);
        } else {
            out.extend(c.encode_utf16(&mut [0; 2]).iter().map(|unit| format!("\\u{unit:04x}")));
        }
    }
    out
}

impl From<TiffError> for Unwritten {
    fn from(error: TiffError) -> Self {
        match error {
            TiffError::IoError(error) => Self::Io(error),
            TiffError::IntSizeError => Self::TooLarge,
            other => Self::Io(std::io::Error::other(other)),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use ndarray::Array2;
    use tiff::decoder::{Decoder, DecodingResult};
    use turbid_contract::LayerInfo;

    use super::*;

    /// 4 GiB and more is BigTIFF, also where only what stands around the pixels makes it so: 16 pages of 8192 x 8192 pixels are 4 GiB to the byte.
    #[test]
    fn large_files_are_big_tiff() {
        let whole = |pages: u64, rows| pages * page_bytes([rows, 8192], 4, "{}");
        assert!(
            is_big(whole(16, 8192))
                && is_big(whole(1, 131_072))
                && is_big(16 * page_bytes([8191, 8192], 4, "{}") + (2 << 20))
        );
        assert!(!is_big(whole(15, 8192)) && !is_big(whole(16, 8100)));
        assert!(!is_big(u64::from(u32::MAX)) && is_big(1 << 32));
        // What is foreseen is never less than what is written.
        let mut stack = ImageStack::new(1200, 700);
        (0..3)
            .for_each(|k| stack.push(LayerInfo::value("m_dc", "1").with_f_x(f64::from(k)), Array2::zeros((1200, 700))));
        let abouts: Vec<String> = stack.layers.iter().map(|l| text(&json(&l.info))).collect();
        let foreseen: u64 = abouts.iter().map(|about| page_bytes([1200, 700], 4, about)).sum();
        for big in [false, true] {
            let mut bytes = Vec::new();
            let to = Cursor::new(&mut bytes);
            match big {
                true => pages(TiffEncoder::new_big(to).unwrap(), &stack, &abouts).unwrap(),
                false => pages(TiffEncoder::new(to).unwrap(), &stack, &abouts).unwrap(),
            }
            assert_eq!(bytes[..4], if big { *b"II+\0" } else { *b"II*\0" });
            assert!(bytes.len() as u64 <= foreseen, "{} of {foreseen}", bytes.len());
        }
    }

    /// Both kinds come back through a reader: pixels, page by page.
    #[test]
    fn big_tiff_comes_back() {
        let mut stack = ImageStack::new(2, 3);
        (0..2).for_each(|k| stack.push(LayerInfo::value("m_dc", "1"), Array2::from_elem((2, 3), k as f32 + 0.5)));
        let abouts = ["{}".to_owned(), "{}".to_owned()];
        let mut bytes = Vec::new();
        pages(TiffEncoder::new_big(Cursor::new(&mut bytes)).unwrap(), &stack, &abouts).unwrap();
        let mut file = Decoder::new(Cursor::new(bytes)).unwrap();
        for layer in &stack.layers {
            let DecodingResult::F32(pixels) = file.read_image().unwrap() else { panic!("32-bit floats") };
            assert_eq!(pixels, layer.pixels().as_ref());
            if file.more_images() {
                file.next_image().unwrap();
            }
        }
    }
}
