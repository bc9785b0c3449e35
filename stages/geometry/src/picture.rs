//! Pictures from PNG files: grey, 8 or 16 bit.

use std::io::Cursor;

use png::{BitDepth, ColorType, Decoder, Limits, Transformations};
use turbid_contract::payload::Picture;

/// The most pixels of a picture; its values stand in the scene's record.
const MOST_PIXELS: u64 = 1 << 26;

/// Its values as fractions of 65535, as they stand in the file: no gamma is undone.
///
/// Error: what is wrong with it.
pub fn read(bytes: &[u8]) -> Result<Picture, String> {
    let said = |error: png::DecodingError| format!("it is no PNG that can be read: {error}");
    let limits = Limits { bytes: 8 * MOST_PIXELS as usize };
    let mut decoder = Decoder::new_with_limits(Cursor::new(bytes), limits);
    decoder.set_transformations(Transformations::IDENTITY);
    let mut reader = decoder.read_info().map_err(said)?;
    let info = reader.info();
    let (columns, rows) = (info.width, info.height);
    if u64::from(columns) * u64::from(rows) > MOST_PIXELS {
        return Err(format!("it has {columns} x {rows} pixels, more than {MOST_PIXELS}"));
    }
    if info.color_type != ColorType::Grayscale {
        return Err(format!("its pixels are {:?}, not grey", info.color_type));
    }
    if info.trns.is_some() {
        return Err("one of its grey values is transparent".to_owned());
    }
    let depth = info.bit_depth;
    let size = reader.output_buffer_size().ok_or("it is too large")?;
    let mut data = vec![0; size];
    reader.next_frame(&mut data).map_err(said)?;
    let grey = match depth {
        // 65535 = 257 x 255.
        BitDepth::Eight => data.iter().map(|&v| 257 * u16::from(v)).collect(),
        BitDepth::Sixteen => data.as_chunks::<2>().0.iter().map(|&v| u16::from_be_bytes(v)).collect(),
        other => return Err(format!("its grey values have {} bit, not 8 or 16", other as u8)),
    };
    Ok(Picture { columns, rows, grey })
}

#[cfg(test)]
mod tests {
    use super::*;
    use png::Encoder;

    fn file(color: ColorType, depth: BitDepth, (columns, rows): (u32, u32), data: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = Encoder::new(&mut bytes, columns, rows);
        encoder.set_color(color);
        encoder.set_depth(depth);
        let mut writer = encoder.write_header().unwrap();
        writer.write_image_data(data).unwrap();
        writer.finish().unwrap();
        bytes
    }

    #[test]
    fn grey_pictures_keep_their_values_and_others_are_named() {
        let eight = read(&file(ColorType::Grayscale, BitDepth::Eight, (3, 1), &[0, 1, 255])).unwrap();
        assert_eq!(eight, Picture { columns: 3, rows: 1, grey: vec![0, 257, 65535] });
        let sixteen = read(&file(ColorType::Grayscale, BitDepth::Sixteen, (1, 2), &[1, 2, 255, 254])).unwrap();
        assert_eq!(sixteen, Picture { columns: 1, rows: 2, grey: vec![258, 65534] });
        let colour = read(&file(ColorType::Rgb, BitDepth::Eight, (1, 1), &[1, 2, 3]));
        assert_eq!(colour.unwrap_err(), "its pixels are Rgb, not grey");
        let bits = read(&file(ColorType::Grayscale, BitDepth::One, (8, 1), &[170]));
        assert_eq!(bits.unwrap_err(), "its grey values have 1 bit, not 8 or 16");
        let whole = file(ColorType::Grayscale, BitDepth::Eight, (64, 64), &[7; 4096]);
        for bytes in [&[][..], b"solid", &whole[..whole.len() / 2]] {
            assert!(read(bytes).unwrap_err().starts_with("it is no PNG"), "{} bytes", bytes.len());
        }
    }
}
