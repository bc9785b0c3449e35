//! PNG: grey and colour, 8 or 16 bit, row by row.

use std::io::Cursor;

use png::{BitDepth, ColorType, Decoder, Limits, Reader, Transformations};

use super::numbers::{Numbers, room};
use super::{Channel, Picture, bounded, can_hold, place};

/// Bytes of chunks that are no pixels (tables, what cameras note); texts and colour profiles are skipped.
const CHUNKS: usize = 8 << 20;
/// What deflate packs at most into one byte.
const DEFLATE: u64 = 1032;

type File<'a> = Reader<Cursor<&'a [u8]>>;

pub fn size(bytes: &[u8]) -> Result<(usize, usize), String> {
    let mut decoder = Decoder::new_with_limits(Cursor::new(bytes), Limits { bytes: CHUNKS });
    let info = decoder.read_header_info().map_err(said)?;
    bounded(u64::from(info.width), u64::from(info.height))
}

pub fn read(bytes: &[u8], channel: Option<Channel>) -> Result<Picture, String> {
    let mut decoder = Decoder::new_with_limits(Cursor::new(bytes), Limits { bytes: CHUNKS });
    decoder.set_transformations(Transformations::IDENTITY);
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    let info = decoder.read_header_info().map_err(said)?;
    let size = bounded(u64::from(info.width), u64::from(info.height))?;
    let count = match info.color_type {
        ColorType::Grayscale => 1,
        ColorType::GrayscaleAlpha => 2,
        ColorType::Rgb => 3,
        ColorType::Rgba => 4,
        ColorType::Indexed => return Err("its colours stand in a palette: save it as grey or RGB".to_owned()),
    };
    let (depth, interlaced) = (info.bit_depth, info.interlaced);
    let sample = match depth {
        BitDepth::Eight => 1,
        BitDepth::Sixteen => 2,
        other => return Err(format!("its pixels have {} bit, not 8 or 16", other as u8)),
    };
    let at = place(count, channel)?;
    can_hold(bytes.len(), (size.0 * size.1 * count * sample) as u64, DEFLATE)?;
    let mut reader = decoder.read_info().map_err(said)?;
    let step = count * sample;
    let values = if sample == 1 {
        Numbers::U8(channel_of(&mut reader, size, step, interlaced, |pixel| pixel[at])?)
    } else {
        let word = |pixel: &[u8]| u16::from_be_bytes([pixel[2 * at], pixel[2 * at + 1]]);
        Numbers::U16(channel_of(&mut reader, size, step, interlaced, word)?)
    };
    Picture::whole(size, values)
}

/// One number of each pixel of `step` bytes.
fn channel_of<T>(
    reader: &mut File<'_>,
    (columns, rows): (usize, usize),
    step: usize,
    interlaced: bool,
    number: impl Fn(&[u8]) -> T,
) -> Result<Vec<T>, String> {
    let mut values = room(columns * rows)?;
    if interlaced {
        // Its rows come in seven passes: all of them are needed for the first.
        let mut data = super::numbers::zeros(columns * rows * step)?;
        reader.next_frame(&mut data).map_err(said)?;
        values.extend(data.chunks_exact(step).map(number));
        return Ok(values);
    }
    while let Some(row) = reader.next_row().map_err(said)? {
        values.extend(row.data().chunks_exact(step).take(columns * rows - values.len()).map(&number));
    }
    Ok(values)
}

fn said(error: png::DecodingError) -> String {
    format!("it is no PNG that can be read: {error}")
}
