//! Image stacks as multi-part EXR: one part a layer, channel `Y`, f32.
//!
//! Everything but the pixels is in one attribute `turbid` of the first part (canonical JSON in ASCII). Names of parts are
//! for people and never read; so are `xDensity` and `pixelAspectRatio`, which tell other programs the pixels' pitch. Scan lines in increasing order and a single custom attribute: with tiles, an unspecified
//! order or two attributes (they sit in a hash map) the same image would give other bytes each time.

mod lines;

use std::collections::HashSet;
use std::io::{Cursor, Read, Write};

use exr::meta::attribute::{ChannelDescription, SampleType};
use exr::meta::header::Header;
use exr::meta::{BlockDescription, Headers, MetaData};
use exr::prelude::{
    AttributeValue, Compression, FlatSamples, ImageAttributes, IntegerBounds, LayerAttributes, LineOrder, ReadChannels,
    ReadLayers, Text,
};
use serde::{Deserialize, Serialize};
use smallvec::smallvec;
use turbid_contract::canonical::{canonical_text, canonical_value};
use turbid_contract::ndarray::Array2;
use turbid_contract::{Attributes, Extent, Head, ImageStack, LayerInfo, LayerKind};

use crate::store::error::StoreError;
pub(super) use lines::Layout;

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
    encode_to(stack, &mut bytes)?;
    Ok(bytes)
}

/// The same, front to back and line by line: beside the stack only masks are held, packed. Errors also: those of writing.
pub(super) fn encode_to(stack: &ImageStack, to: &mut impl Write) -> Result<(), StoreError> {
    lines::write(stack, &headers(stack)?, to)
}

/// What the parts of a stack's file say of themselves. Error: no layer.
fn headers(stack: &ImageStack) -> Result<Headers, StoreError> {
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
    let mut shared = ImageAttributes::new(IntegerBounds::from_dimensions(size));
    if let Some([_, aspect]) = density {
        shared.pixel_aspect = aspect;
    }
    let mut names = HashSet::new();
    let mut headers = Headers::new();
    for (i, layer) in stack.layers.iter().enumerate() {
        // Masks are long runs of one value, drawings of few; the others hardly shrink, and cost time.
        let compression = match layer.info.kind {
            LayerKind::Mask => Compression::RLE,
            // Runs of bytes see no run in floats other than 0.
            _ if drawn => Compression::ZIP16,
            _ => Compression::Uncompressed,
        };
        let mut own = LayerAttributes::named(part_name(&layer.info, i, &mut names).as_str());
        own.horizontal_density = density.map(|[density, _]| density);
        if i == 0 {
            own.other.insert(Text::from(ATTRIBUTE), AttributeValue::Text(Text::from(json.as_str())));
        }
        let channel = ChannelDescription::named("Y", SampleType::F32);
        let header = Header::new(channel.name.clone(), size, smallvec![channel]);
        let header = header.with_encoding(compression, BlockDescription::ScanLines, LineOrder::Increasing);
        headers.push(header.with_attributes(own).with_shared_attributes(shared.clone()));
    }
    Ok(headers)
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
    let wrong = |what: &str| StoreError::unfit(format!("not an image stack of this turbid: {what}"));
    let headers = MetaData::read_from_buffered(bytes, false).map_err(|e| wrong(&e.to_string()))?.headers;
    let pixels = headers.iter().try_fold(0u64, |sum, header| sum.checked_add(fewest_bytes(header)?));
    // Asked first: the reader allocates what the headers claim.
    if pixels.is_none_or(|n| n > bytes.len() as u64) {
        return Err(wrong("its headers claim more pixels than its bytes can hold"));
    }
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
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
pub(super) fn head(headers: &[Header]) -> Result<Head, StoreError> {
    let wrong = |what: &str| StoreError::unfit(format!("not an image stack of this turbid: {what}"));
    let first = headers.first().ok_or_else(|| wrong("it has no part"))?;
    let json = match first.own_attributes.other.get(&Text::from(ATTRIBUTE)) {
        Some(AttributeValue::Text(text)) => text.to_string(),
        _ => return Err(wrong("the attribute `turbid` is missing")),
    };
    let Description { attributes, layers } = serde_json::from_str(&json).map_err(|e| wrong(&e.to_string()))?;
    if layers.len() != headers.len() || headers.iter().any(|header| header.layer_size != first.layer_size) {
        return Err(wrong("its parts are not those that it describes"));
    }
    Ok(Head { rows: first.layer_size.1, columns: first.layer_size.0, attributes, layers })
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
