//! Image stacks as multi-part EXR: one part a layer, channel `Y`, f32.
//!
//! Everything but the pixels is in one attribute `turbid` of the first part (canonical JSON in ASCII). Names of parts are
//! for people and never read; so are `xDensity` and `pixelAspectRatio`, which tell other programs the pixels' pitch. Scan lines in increasing order and a single custom attribute: with tiles, an unspecified
//! order or two attributes (they sit in a hash map) the same image would give other bytes each time.

use std::borrow::Cow;
use std::collections::HashSet;
use std::io::{Cursor, Read, Seek, SeekFrom, Write};
use std::path::PathBuf;

use exr::block::UncompressedBlock;
use exr::block::lines::LineRefMut;
use exr::block::reader::ChunksReader;
use exr::image::write::samples::{SamplesWriter, WritableSamples};
use exr::math::RoundingMode;
use exr::meta::MetaData;
use exr::meta::attribute::{LevelMode, SampleType};
use exr::meta::header::Header;
use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Blocks, Compression, Encoding, FlatSamples, Image, ImageAttributes,
    IntegerBounds, Layer as Part, LayerAttributes, Layers, LineOrder, ReadChannels, ReadLayers, Text, WritableImage,
};
use serde::{Deserialize, Serialize};
use smallvec::smallvec;
use turbid_contract::canonical::{canonical_text, canonical_value};
use turbid_contract::ndarray::Array2;
use turbid_contract::{Attributes, Extent, Head, ImageStack, LayerInfo, LayerKind};

use crate::store::error::StoreError;

const ATTRIBUTE: &str = "turbid";

/// Layers of the payload `preview`, which is drawn.
const DRAWN: [&str; 4] = ["red", "green", "blue", "grey"];

/// The content of the attribute.
#[derive(Serialize, Deserialize)]
struct Description {
    attributes: Attributes,
    layers: Vec<LayerInfo>,
}

/// Encodes a stack. Errors: no layer; a pixel that is not finite.
pub(super) fn encode(stack: &ImageStack) -> Result<Vec<u8>, StoreError> {
    let mut bytes = Vec::new();
    encode_to(stack, Cursor::new(&mut bytes))?;
    Ok(bytes)
}

/// The same, line by line: no more than a few lines are held beside the stack. Errors also: those of writing.
pub(super) fn encode_to(stack: &ImageStack, to: impl Write + Seek) -> Result<(), StoreError> {
    if stack.layers.is_empty() {
        return Err(StoreError::unfit("an image stack without layers cannot be stored"));
    }
    let description = Description {
        attributes: stack.attributes.clone(),
        layers: stack.layers.iter().map(|layer| layer.info.clone()).collect(),
    };
    let json = ascii(&canonical_text(&canonical_value(&description).map_err(StoreError::unfit)?));
    let size = (stack.columns(), stack.rows());
    let drawn = stack.layers.iter().all(|l| DRAWN.contains(&l.info.name.as_str()));
    let density = density(stack);
    let mut names = HashSet::new();
    let mut parts = Layers::new();
    for (i, layer) in stack.layers.iter().enumerate() {
        // Of the magnitudes' bits: a loop that does not end early is several times faster.
        let largest = layer.data.iter().fold(0, |most, value| value.abs().to_bits().max(most));
        let all_finite = largest < f32::INFINITY.to_bits();
        let odd = || layer.data.indexed_iter().find(|(_, value)| !value.is_finite());
        if let Some(((row, column), value)) = if all_finite { None } else { odd() } {
            return Err(StoreError::unfit(format!(
                "layer {i} `{}` has the value {value} at row {row}, column {column}; every pixel must be finite (mask it)",
                layer.info.name
            )));
        }
        // Masks are long runs of one value, drawings of few; the others hardly shrink, and cost time.
        let compression = match layer.info.kind {
            LayerKind::Mask => Compression::RLE,
            // Runs of bytes see no run in floats other than 0.
            _ if drawn => Compression::ZIP16,
            _ => Compression::Uncompressed,
        };
        let encoding = Encoding { compression, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
        let mut attributes = LayerAttributes::named(part_name(&layer.info, i, &mut names).as_str());
        attributes.horizontal_density = density.map(|[density, _]| density);
        if i == 0 {
            attributes.other.insert(Text::from(ATTRIBUTE), AttributeValue::Text(Text::from(json.as_str())));
        }
        let pixels = Pixels { columns: stack.columns(), values: layer.pixels() };
        parts.push(Part::new(size, attributes, encoding, AnyChannels::sort(smallvec![AnyChannel::new("Y", pixels)])));
    }
    let mut attributes = ImageAttributes::new(IntegerBounds::from_dimensions(size));
    if let Some([_, aspect]) = density {
        attributes.pixel_aspect = aspect;
    }
    let image = Image { attributes, layer_data: parts };
    // Without threads of its own: the store is called from the threads of a run.
    image.write().non_parallel().to_buffered(to).map_err(|e| match e {
        exr::error::Error::Io(source) => {
            StoreError::Io { doing: "write images".to_owned(), path: PathBuf::from("temporary file"), source }
        }
        e => StoreError::unfit(format!("the images cannot be written as EXR: {e}")),
    })
}

/// The pixels of a layer as they are: none is copied before its line is written.
struct Pixels<'a> {
    columns: usize,
    values: Cow<'a, [f32]>,
}

impl<'a> WritableSamples<'a> for Pixels<'_> {
    type Writer = Lines<'a>;

    fn sample_type(&self) -> SampleType {
        SampleType::F32
    }

    fn infer_level_modes(&self) -> (LevelMode, RoundingMode) {
        (LevelMode::Singular, RoundingMode::Down)
    }

    fn create_samples_writer(&'a self, _: &Header) -> Lines<'a> {
        Lines { columns: self.columns, values: &self.values }
    }
}

struct Lines<'a> {
    columns: usize,
    values: &'a [f32],
}

impl SamplesWriter for Lines<'_> {
    fn extract_line(&self, line: LineRefMut<'_>) {
        let start = line.location.position.y() * self.columns + line.location.position.x();
        let values = &self.values[start..start + line.location.sample_count];
        line.write_samples_from_slice(values).expect("a line of memory takes its samples");
    }
}

/// Pixels of a layer and how many layers a stack has, as the head of its file says.
pub(super) fn extent(head: impl Read) -> Option<Extent> {
    let meta = MetaData::read_from_buffered(head, false).ok()?;
    let size = meta.headers.first()?.layer_size;
    Some(Extent::images(size.0 as u64, size.1 as u64, meta.headers.len() as u64))
}

/// `xDensity` (pixels per inch along a row) and `pixelAspectRatio` (width over height of a pixel) of a stack that knows its pitch.
fn density(stack: &ImageStack) -> Option<[f32; 2]> {
    let [x, y] = stack.pixel_pitch_mm()?;
    let numbers = [(25.4 / x) as f32, (x / y) as f32];
    // A reader refuses other aspects.
    (numbers[0].is_normal() && (1e-6..=1e6).contains(&numbers[1])).then_some(numbers)
}

/// Decodes what [`encode`] wrote.
pub(super) fn decode(bytes: &[u8]) -> Result<ImageStack, StoreError> {
    decode_from(Cursor::new(bytes))
}

/// The same, line by line: no more than a few lines are held beside the stack.
pub(super) fn decode_from(mut from: impl Read + Seek) -> Result<ImageStack, StoreError> {
    let wrong = |what: &str| StoreError::unfit(format!("not an image stack of this turbid: {what}"));
    let unreadable = |e: std::io::Error| wrong(&e.to_string());
    let length = from.seek(SeekFrom::End(0)).map_err(unreadable)?;
    from.rewind().map_err(unreadable)?;
    let headers = MetaData::read_from_buffered(&mut from, false).map_err(|e| wrong(&e.to_string()))?.headers;
    let pixels = headers.iter().try_fold(0u64, |sum, header| sum.checked_add(fewest_bytes(header)?));
    // Asked first: the reader allocates what the headers claim.
    if pixels.is_none_or(|n| n > length) {
        return Err(wrong("its headers claim more pixels than its bytes can hold"));
    }
    from.rewind().map_err(unreadable)?;
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .non_parallel()
        .from_buffered(from)
        .map_err(|e| wrong(&e.to_string()))?;
    let parts = image.layer_data;
    let first = parts.first().ok_or_else(|| wrong("it has no part"))?;
    let json = match first.attributes.other.get(&Text::from(ATTRIBUTE)) {
        Some(AttributeValue::Text(text)) => text.to_string(),
        _ => return Err(wrong("the attribute `turbid` is missing")),
    };
    let description: Description = serde_json::from_str(&json).map_err(|e| wrong(&e.to_string()))?;
    let (columns, rows) = (first.size.0, first.size.1);
    if description.layers.len() != parts.len() || rows == 0 || columns == 0 {
        return Err(wrong("its parts are not those that it describes"));
    }
    let mut stack = ImageStack::new(rows, columns);
    stack.attributes = description.attributes;
    for (info, part) in description.layers.into_iter().zip(parts) {
        let pixels = match part.channel_data.list.into_iter().next().map(|channel| channel.sample_data) {
            Some(FlatSamples::F32(pixels)) => pixels,
            _ => return Err(wrong("a part has no channel of 32-bit floats")),
        };
        let data = Array2::from_shape_vec((rows, columns), pixels).map_err(|e| wrong(&e.to_string()))?;
        stack.push(info, data);
    }
    Ok(stack)
}

/// What a stack is, by the head of its file.
pub(super) fn head(from: impl Read) -> Result<Head, StoreError> {
    let wrong = |what: &str| StoreError::unfit(format!("not an image stack of this turbid: {what}"));
    let headers = MetaData::read_from_buffered(from, false).map_err(|e| wrong(&e.to_string()))?.headers;
    let first = headers.first().ok_or_else(|| wrong("it has no part"))?;
    let json = match first.own_attributes.other.get(&Text::from(ATTRIBUTE)) {
        Some(AttributeValue::Text(text)) => text.to_string(),
        _ => return Err(wrong("the attribute `turbid` is missing")),
    };
    let Description { attributes, layers } = serde_json::from_str(&json).map_err(|e| wrong(&e.to_string()))?;
    if layers.len() != headers.len() {
        return Err(wrong("its parts are not those that it describes"));
    }
    Ok(Head { rows: first.layer_size.1, columns: first.layer_size.0, attributes, layers })
}

/// Decodes the layers that are wanted, block by block; the others are not read. `head` is that of the file, which was compared with its digest.
pub(super) fn decode_part(
    from: impl Read + Seek,
    head: &Head,
    wanted: &dyn Fn(usize, &LayerInfo) -> bool,
) -> Result<ImageStack, StoreError> {
    let wrong = |e: exr::error::Error| StoreError::unfit(format!("not an image stack of this turbid: {e}"));
    let (rows, columns) = (head.rows, head.columns);
    let mut stack = ImageStack::new(rows, columns);
    stack.attributes = head.attributes.clone();
    let mut places: Vec<Option<usize>> = vec![None; head.layers.len()];
    for (k, info) in head.layers.iter().enumerate().filter(|(k, info)| wanted(*k, info)) {
        places[k] = Some(stack.layers.len());
        stack.push(info.clone(), Array2::zeros((rows, columns)));
    }
    if stack.layers.is_empty() {
        return Ok(stack);
    }
    let blocks = exr::block::read(from, false).map_err(wrong)?;
    let chunks = blocks.filter_chunks(false, |_, _, block| places[block.layer].is_some()).map_err(wrong)?;
    for block in chunks.sequential_decompressor(false) {
        let UncompressedBlock { index, data } = block.map_err(wrong)?;
        let place = places[index.layer].expect("no other block was asked for");
        let pixels = stack.layers[place].data.as_slice_mut().expect("row-major");
        let (start, count) = (index.pixel_position.y() * columns, index.pixel_size.area());
        let floats = data.chunks_exact(4).map(|b| f32::from_ne_bytes([b[0], b[1], b[2], b[3]]));
        pixels[start..start + count].iter_mut().zip(floats).for_each(|(pixel, value)| *pixel = value);
    }
    Ok(stack)
}

/// The least that the pixels of a part take in the file; `None` for sizes that no file has.
fn fewest_bytes(header: &Header) -> Option<u64> {
    let pixels = (header.layer_size.0 as u64).checked_mul(header.layer_size.1 as u64)?;
    let bytes = pixels.checked_mul(header.channels.bytes_per_pixel as u64)?;
    // Two bytes of a run stand for 128, three of a deflated stream for 3 x 1032 (RFC 1951: a bit for 258 bytes at best, with overhead).
    Some(match header.compression {
        Compression::Uncompressed => bytes,
        Compression::RLE => bytes / 64,
        _ => bytes / 1100,
    })
}

/// JSON in ASCII: other characters as `\uXXXX`, which no reader of EXR headers can get wrong.
fn ascii(json: &str) -> String {
    let mut text = String::with_capacity(json.len());
    for c in json.chars() {
        if c.is_ascii() {
            text.push(c);
        } else {
            let mut units = [0; 2];
            c.encode_utf16(&mut units).iter().for_each(|unit| text.push_str(&format!("\\u{unit:04x}")));
        }
    }
    text
}

/// A name such as `m_ac.fx0.1.phase120` that no other part has.
fn part_name(info: &LayerInfo, index: usize, taken: &mut HashSet<String>) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() || "_-".contains(c) { c } else { '_' };
    let mut name: String = info.name.chars().take(40).map(plain).collect();
    if name.is_empty() {
        name.push_str("layer");
    }
    let mut add = |tag: &str, value: Option<f64>| {
        if let Some(value) = value {
            // Rounded: the true number is in the attribute.
            name.push_str(&format!(".{tag}{}", (value * 1e4).round() / 1e4));
        }
    };
    add("fx", info.f_x_per_mm);
    add("phase", info.phase_rad.map(f64::to_degrees));
    add("orientation", info.orientation_deg);
    add("nm", info.wavelength_nm);
    if let Some([i, j]) = info.pair {
        name.push_str(&format!(".{i}-{j}"));
    }
    // Numbers of absurd size are long when written out, and EXR's names are short.
    name.truncate(180);
    if !taken.insert(name.clone()) {
        name.push_str(&format!(".part{index}"));
        taken.insert(name.clone());
    }
    name
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn stack(name: &str, pixel: impl Fn((usize, usize)) -> f32) -> ImageStack {
        let mut stack = ImageStack::new(40, 300);
        stack.push(LayerInfo::value(name, "1"), Array2::from_shape_fn((40, 300), pixel));
        stack
    }

    /// Other programs read the pitch from the standard attributes: pixels per inch, and width over height.
    #[test]
    fn the_pitch_is_in_the_header() {
        let header = |stack: &ImageStack| {
            let bytes = encode(stack).unwrap();
            let meta = MetaData::read_from_buffered(bytes.as_slice(), false).unwrap();
            assert_eq!(decode(&bytes).unwrap(), *stack);
            (meta.headers[0].own_attributes.horizontal_density, meta.headers[0].shared_attributes.pixel_aspect)
        };
        let mut stack = stack("mu_a", |(r, c)| (r + c) as f32);
        assert_eq!(header(&stack), (None, 1.0));
        stack.attributes.insert("pixel_pitch_mm".into(), json!([0.5, 0.25]));
        assert_eq!(header(&stack), (Some(50.8), 2.0));
        // No f32 holds the density, and no reader takes the aspect.
        for senseless in [[1e-60, 1e-60], [1e-9, 1.0]] {
            stack.attributes.insert("pixel_pitch_mm".into(), json!(senseless));
            assert_eq!(header(&stack), (None, 1.0));
        }
    }

    /// A header alone makes no memory: what it claims must be in the file.
    #[test]
    fn claimed_pixels_must_be_there() {
        let whole = encode(&stack("mu_a", |(r, c)| (r + c) as f32)).unwrap();
        let window = b"dataWindow\0box2i\0";
        let at =
            whole.windows(window.len()).position(|w| w == window).expect("every part has a window") + window.len() + 4;
        for (right, bottom) in [(299i32, 1i32 << 20), (1 << 29, 1 << 29), (i32::MAX - 1, 39)] {
            let mut claimed = whole.clone();
            claimed[at + 8..at + 12].copy_from_slice(&right.to_le_bytes());
            claimed[at + 12..at + 16].copy_from_slice(&bottom.to_le_bytes());
            let message = decode(&claimed).unwrap_err().to_string();
            assert!(
                message.contains("claim more pixels") || message.contains("invalid"),
                "{right} {bottom}: {message}"
            );
        }
    }

    /// A drawing of few colours takes a small part of its 4 bytes a pixel; a quantity stays as it is.
    #[test]
    fn drawings_are_small() {
        let size = |name| encode(&stack(name, |(_, c)| (c / 60) as f32)).unwrap().len();
        assert!(size("red") < 40 * 300 * 4 / 10, "{}", size("red"));
        assert!(size("mu_a") > 40 * 300 * 4);
    }
}
