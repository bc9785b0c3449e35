//! TIFF 6.0: one uncompressed page of 32-bit floats per layer, its description as JSON in `ImageDescription`.

use turbid_contract::ImageStack;
use turbid_contract::canonical::canonical_text;

use super::{TooLarge, json, size_u32};

const SHORT: u16 = 3;
const LONG: u16 = 4;
const ASCII: u16 = 2;
const ENTRY: usize = 12;

/// Little-endian file; the first page's description also holds the stack's `attributes`.
pub fn encode(stack: &ImageStack) -> Result<Vec<u8>, TooLarge> {
    let mut out = b"II\x2a\0\0\0\0\0".to_vec();
    // Where the offset of the next page's directory goes.
    let mut link = 4;
    for (index, layer) in stack.layers.iter().enumerate() {
        let pixels = size_u32(out.len())?;
        // Row by row whatever the memory order of the array.
        out.extend(layer.data.iter().flat_map(|v| v.to_le_bytes()));
        let bytes = size_u32(out.len())? - pixels;

        let mut about = json(&layer.info);
        if index == 0 {
            about["attributes"] = json(&stack.attributes);
        }
        let text = size_u32(out.len())?;
        out.extend(ascii(&canonical_text(&about)).bytes());
        out.push(0);
        let letters = size_u32(out.len())? - text;
        // Directories start at even offsets, and a value of up to 4 bytes would stand in its entry: JSON is longer.
        out.resize(out.len().next_multiple_of(4), 0);

        let (rows, columns) = (size_u32(stack.rows())?, size_u32(stack.columns())?);
        let entries: [(u16, u16, u32, u32); 12] = [
            (256, LONG, 1, columns),
            (257, LONG, 1, rows),
            // BitsPerSample; then no compression, black is zero.
            (258, SHORT, 1, 32),
            (259, SHORT, 1, 1),
            (262, SHORT, 1, 1),
            (270, ASCII, letters, text),
            // One strip, one sample per pixel.
            (273, LONG, 1, pixels),
            (277, SHORT, 1, 1),
            (278, LONG, 1, rows),
            (279, LONG, 1, bytes),
            (284, SHORT, 1, 1),
            // SampleFormat: IEEE floating point.
            (339, SHORT, 1, 3),
        ];
        let directory = size_u32(out.len())?;
        out[link..link + 4].copy_from_slice(&directory.to_le_bytes());
        out.extend((entries.len() as u16).to_le_bytes());
        for (tag, kind, count, value) in entries {
            out.extend(tag.to_le_bytes());
            out.extend(kind.to_le_bytes());
            out.extend(count.to_le_bytes());
            out.extend(value.to_le_bytes());
        }
        link = directory as usize + 2 + ENTRY * entries.len();
        out.extend([0; 4]);
        out.resize(out.len().next_multiple_of(4), 0);
    }
    size_u32(out.len())?;
    Ok(out)
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
