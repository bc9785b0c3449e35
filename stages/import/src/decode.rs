//! Pictures from the bytes of PNG, TIFF and EXR files.

use std::io::Cursor;

use exr::prelude::{FlatSamples, ReadChannels, ReadLayers, read};
use png::{BitDepth, ColorType, Transformations};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::Tag;

/// The most pixels of a picture.
const MOST_PIXELS: u64 = 1 << 28;

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
    pub values: Vec<f64>,
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
        let largest = self.values.iter().copied().fold(0.0, f64::max);
        if own > highest || largest > own {
            return Err(format!(
                "it holds numbers up to {largest} of at most {highest}, a camera of {bits} bits writes up to {own}"
            ));
        }
        Ok(Self { highest: Some(own), ..self })
    }
}

/// Reads a file by its first bytes.
///
/// Error: what is wrong with it.
pub fn decode(bytes: &[u8], channel: Option<Channel>) -> Result<Picture, String> {
    match bytes {
        [0x89, b'P', b'N', b'G', ..] => from_png(bytes, channel),
        [b'I', b'I', 42, 0, ..] | [b'M', b'M', 0, 42, ..] => from_tiff(bytes, channel),
        [0x76, 0x2f, 0x31, 0x01, ..] => from_exr(bytes, channel),
        _ => Err("it is neither PNG, TIFF nor EXR".to_owned()),
    }
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

fn picture(
    (columns, rows): (usize, usize),
    count: usize,
    channel: Option<Channel>,
    highest: Option<f64>,
    values: impl Iterator<Item = f64>,
) -> Result<Picture, String> {
    let values: Vec<f64> = values.skip(place(count, channel)?).step_by(count).collect();
    if values.len() != rows * columns {
        return Err(format!("it ends after {} of {} pixels", values.len(), rows * columns));
    }
    Ok(Picture { rows, columns, values, highest })
}

fn bounded(columns: u64, rows: u64) -> Result<(usize, usize), String> {
    let fits = columns * rows <= MOST_PIXELS && columns > 0 && rows > 0;
    fits.then_some((columns as usize, rows as usize)).ok_or_else(|| format!("it has {columns} x {rows} pixels"))
}

fn from_png(bytes: &[u8], channel: Option<Channel>) -> Result<Picture, String> {
    let said = |error: png::DecodingError| format!("it is no PNG that can be read: {error}");
    let limits = png::Limits { bytes: 8 * MOST_PIXELS as usize };
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(bytes), limits);
    decoder.set_transformations(Transformations::IDENTITY);
    let mut reader = decoder.read_info().map_err(said)?;
    let info = reader.info();
    let size = bounded(u64::from(info.width), u64::from(info.height))?;
    let count = match info.color_type {
        ColorType::Grayscale => 1,
        ColorType::GrayscaleAlpha => 2,
        ColorType::Rgb => 3,
        ColorType::Rgba => 4,
        ColorType::Indexed => return Err("its colours stand in a palette: save it as grey or RGB".to_owned()),
    };
    let depth = info.bit_depth;
    let mut data = vec![0; reader.output_buffer_size().ok_or("it is too large")?];
    reader.next_frame(&mut data).map_err(said)?;
    match depth {
        BitDepth::Eight => picture(size, count, channel, Some(255.0), data.iter().map(|&v| f64::from(v))),
        BitDepth::Sixteen => {
            let values = data.as_chunks::<2>().0.iter().map(|&v| f64::from(u16::from_be_bytes(v)));
            picture(size, count, channel, Some(65535.0), values)
        }
        other => Err(format!("its pixels have {} bit, not 8 or 16", other as u8)),
    }
}

fn from_tiff(bytes: &[u8], channel: Option<Channel>) -> Result<Picture, String> {
    let said = |error: tiff::TiffError| format!("it is no TIFF that can be read: {error}");
    let mut decoder = Decoder::new(Cursor::new(bytes)).map_err(said)?.with_limits(Limits::default());
    let (columns, rows) = decoder.dimensions().map_err(said)?;
    let size = bounded(u64::from(columns), u64::from(rows))?;
    let count = match decoder.colortype().map_err(said)? {
        tiff::ColorType::Gray(_) => 1,
        tiff::ColorType::GrayA(_) => 2,
        tiff::ColorType::RGB(_) => 3,
        tiff::ColorType::RGBA(_) => 4,
        other => return Err(format!("its pixels are {other:?}, not grey or RGB")),
    };
    let pixels = decoder.read_image().map_err(said)?;
    let mut pages = 1;
    while decoder.more_images() {
        decoder.next_image().map_err(said)?;
        // A smaller copy of the picture, for file browsers, is no page of its own.
        let copy =
            decoder.find_tag_unsigned::<u32>(Tag::NewSubfileType).map_err(said)?.is_some_and(|kind| kind & 1 == 1);
        pages += usize::from(!copy);
    }
    if pages > 1 {
        return Err(format!("it has {pages} pages, and a frame is one picture: save each page as a file of its own"));
    }
    match pixels {
        DecodingResult::U8(v) => picture(size, count, channel, Some(255.0), v.into_iter().map(f64::from)),
        DecodingResult::U16(v) => picture(size, count, channel, Some(65535.0), v.into_iter().map(f64::from)),
        DecodingResult::U32(v) => {
            picture(size, count, channel, Some(f64::from(u32::MAX)), v.into_iter().map(f64::from))
        }
        DecodingResult::F32(v) => picture(size, count, channel, None, v.into_iter().map(f64::from)),
        DecodingResult::F64(v) => picture(size, count, channel, None, v.into_iter()),
        _ => Err("its numbers are neither unsigned of 8, 16 or 32 bit nor floating-point".to_owned()),
    }
}

fn from_exr(bytes: &[u8], channel: Option<Channel>) -> Result<Picture, String> {
    let said = |error: exr::error::Error| format!("it is no EXR that can be read: {error}");
    let parts = exr::meta::MetaData::read_from_buffered(bytes, false).map_err(said)?.headers.len();
    if parts > 1 {
        return Err(format!("it has {parts} parts, and a frame is one picture: save each part as a file of its own"));
    }
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_buffered(Cursor::new(bytes))
        .map_err(said)?;
    let size = bounded(image.layer_data.size.0 as u64, image.layer_data.size.1 as u64)?;
    let channels = &image.layer_data.channel_data.list;
    let wanted = match channel {
        Some(channel) => ["R", "G", "B"][channel as usize],
        None if channels.len() == 1 => &channels[0].name.to_string(),
        None => "Y",
    };
    let found = channels.iter().find(|c| c.name.eq(wanted)).ok_or_else(|| {
        let has: Vec<String> = channels.iter().map(|c| c.name.to_string()).collect();
        format!("it has the channels {}, not `{wanted}`: say `channel: red`, `green` or `blue`", has.join(", "))
    })?;
    match &found.sample_data {
        FlatSamples::F16(v) => picture(size, 1, None, None, v.iter().map(|v| f64::from(v.to_f32()))),
        FlatSamples::F32(v) => picture(size, 1, None, None, v.iter().map(|&v| f64::from(v))),
        FlatSamples::U32(v) => picture(size, 1, None, Some(f64::from(u32::MAX)), v.iter().map(|&v| f64::from(v))),
    }
}
