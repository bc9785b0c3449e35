//! Pictures from PNG files: grey, 8 or 16 bit.

use std::io::Cursor;

use png::{BitDepth, ColorType, Decoder, Limits, Transformations};
use turbid_contract::guard::guarded;
use turbid_contract::payload::Picture;

/// The most pixels of a picture; its values stand in the scene's record.
const MOST_PIXELS: u64 = 1 << 26;
/// Bytes of chunks that are no pixels; texts and colour profiles are skipped.
const CHUNKS: usize = 8 << 20;
/// What deflate packs at most into one byte.
const DEFLATE: u64 = 1032;

/// Its values as fractions of 65535, as they stand in the file: no gamma is undone.
///
/// Error: what is wrong with it.
pub fn read(bytes: &[u8]) -> Result<Picture, String> {
    guarded(|| decode(bytes))
}

/// Columns and rows, as the header says them.
///
/// Error: there is no header.
pub fn size(bytes: &[u8]) -> Result<[u32; 2], String> {
    guarded(|| {
        let mut decoder = decoder(bytes);
        let info = decoder.read_header_info().map_err(said)?;
        Ok([info.width, info.height])
    })
}

fn said(error: png::DecodingError) -> String {
    format!("it is no PNG that can be read: {error}")
}

fn decoder(bytes: &[u8]) -> Decoder<Cursor<&[u8]>> {
    let mut decoder = Decoder::new_with_limits(Cursor::new(bytes), Limits { bytes: CHUNKS });
    decoder.set_transformations(Transformations::IDENTITY);
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    decoder
}

fn decode(bytes: &[u8]) -> Result<Picture, String> {
    let mut decoder = decoder(bytes);
    // What the header says is bounded before anything is made by it.
    let info = decoder.read_header_info().map_err(said)?;
    let (columns, rows, depth) = (info.width, info.height, info.bit_depth);
    let pixels = u64::from(columns) * u64::from(rows);
    if pixels > MOST_PIXELS {
        return Err(format!("it has {columns} x {rows} pixels, more than {MOST_PIXELS}"));
    }
    if info.color_type != ColorType::Grayscale {
        return Err(format!("its pixels are {:?}, not grey", info.color_type));
    }
    let sample = match depth {
        BitDepth::Eight => 1,
        BitDepth::Sixteen => 2,
        other => return Err(format!("its grey values have {} bit, not 8 or 16", other as u8)),
    };
    if pixels * sample / DEFLATE > bytes.len() as u64 {
        return Err(format!("its {} bytes cannot hold {columns} x {rows} pixels", bytes.len()));
    }
    let interlaced = info.interlaced;
    let mut reader = decoder.read_info().map_err(said)?;
    if reader.info().trns.is_some() {
        return Err("one of its grey values is transparent".to_owned());
    }
    let mut grey = Vec::new();
    grey.try_reserve_exact(pixels as usize).map_err(|_| format!("there is no memory for its {pixels} pixels"))?;
    let mut add = |data: &[u8]| match depth {
        // 65535 = 257 x 255.
        BitDepth::Eight => grey.extend(data.iter().map(|&v| 257 * u16::from(v))),
        _ => grey.extend(data.as_chunks::<2>().0.iter().map(|&v| u16::from_be_bytes(v))),
    };
    if interlaced {
        let mut data = vec![0; (pixels * sample) as usize];
        reader.next_frame(&mut data).map_err(said)?;
        add(&data);
    } else {
        while let Some(row) = reader.next_row().map_err(said)? {
            add(row.data());
        }
    }
    if grey.len() as u64 != pixels {
        return Err(format!("it ends after {} of {pixels} pixels", grey.len()));
    }
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

    /// A header that claims a row of 67 million pixels, in a file of a hundred bytes.
    #[test]
    fn claims_are_asked_before_memory_is() {
        let mut claims = file(ColorType::Grayscale, BitDepth::Sixteen, (1, 1), &[1, 2]);
        claims[16..20].copy_from_slice(&(1_u32 << 26).to_be_bytes());
        let crc = crc32(&claims[12..29]);
        claims[29..33].copy_from_slice(&crc.to_be_bytes());
        let said = read(&claims).unwrap_err();
        assert!(said.contains("bytes cannot hold 67108864 x 1 pixels"), "{said}");
    }

    /// As PNG defines it.
    fn crc32(bytes: &[u8]) -> u32 {
        !bytes.iter().fold(!0_u32, |crc, &byte| {
            (0..8).fold(crc ^ u32::from(byte), |c, _| if c & 1 == 1 { c >> 1 ^ 0xedb8_8320 } else { c >> 1 })
        })
    }
}
