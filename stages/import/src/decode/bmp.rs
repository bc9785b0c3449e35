//! BMP without compression: 8 bit with a palette, 24 and 32 bit.

use super::numbers::{Numbers, zeros};
use super::{Channel, Picture, bounded, place};

/// What the header says.
struct Header {
    columns: usize,
    rows: usize,
    /// Rows from the top; as a rule they go from the bottom.
    falls: bool,
    bits: usize,
    /// Where palette and pixels begin.
    palette: usize,
    pixels: usize,
}

pub fn size(bytes: &[u8]) -> Result<(usize, usize), String> {
    header(bytes).map(|header| (header.columns, header.rows))
}

pub fn read(bytes: &[u8], channel: Option<Channel>) -> Result<Picture, String> {
    let Header { columns, rows, falls, bits, palette, pixels } = header(bytes)?;
    // A row ends at a multiple of 4 bytes.
    let stride = (columns * bits / 8).next_multiple_of(4);
    let data = bytes.get(pixels..).and_then(|data| data.get(..rows * stride));
    let data =
        data.ok_or_else(|| format!("its {} bytes cannot hold the {} of its pixels", bytes.len(), rows * stride))?;
    // Blue, green, red.
    let colour = |entry: &[u8], at: usize| entry[2 - at];
    let entries = &bytes[palette.min(pixels)..pixels];
    let (entries, _) = entries.as_chunks::<4>();
    let coloured = bits > 8 || entries.iter().any(|e| e[0] != e[1] || e[1] != e[2]);
    let at = place(if coloured { 3 } else { 1 }, channel)?;
    let mut values = zeros::<u8>(columns * rows)?;
    for (r, out) in values.chunks_mut(columns).enumerate() {
        let row = &data[if falls { r } else { rows - 1 - r } * stride..];
        for (c, out) in out.iter_mut().enumerate() {
            *out = match bits {
                8 => {
                    let index = usize::from(row[c]);
                    let entry = entries.get(index).ok_or_else(|| format!("its palette has no colour {index}"))?;
                    colour(entry, at)
                }
                _ => colour(&row[c * bits / 8..], at),
            };
        }
    }
    Picture::whole((columns, rows), Numbers::U8(values))
}

fn header(bytes: &[u8]) -> Result<Header, String> {
    let number = |at: usize, size: usize| -> Result<u32, String> {
        let digits = bytes.get(at..at + size).ok_or("it is cut off within its header")?;
        Ok(digits.iter().rev().fold(0, |number, digit| number << 8 | u32::from(*digit)))
    };
    let (pixels, length) = (number(10, 4)? as usize, number(14, 4)? as usize);
    if length < 40 {
        return Err(format!("its header is of OS/2 ({length} bytes): save it as BMP of Windows, PNG or TIFF"));
    }
    let (columns, rows) = (number(18, 4)?.cast_signed(), number(22, 4)?.cast_signed());
    let (bits, packing) = (number(28, 2)? as usize, number(30, 4)?);
    if ![8, 24, 32].contains(&bits) || packing != 0 {
        return Err(format!("its pixels have {bits} bit and packing {packing}; 8, 24 and 32 bit without are read"));
    }
    let (columns, height) = bounded(columns.max(0).unsigned_abs().into(), rows.unsigned_abs().into())?;
    Ok(Header { columns, rows: height, falls: rows < 0, bits, palette: 14 + length, pixels: pixels.min(bytes.len()) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(columns: i32, rows: i32, bits: u16, palette: &[[u8; 4]], data: &[u8]) -> Vec<u8> {
        let start = 54 + 4 * palette.len() as u32;
        let mut bytes = [b"BM".as_slice(), &[0; 8], &start.to_le_bytes(), &40_u32.to_le_bytes()].concat();
        bytes.extend([columns.to_le_bytes(), rows.to_le_bytes()].concat());
        bytes.extend([[1, 0], bits.to_le_bytes()].concat());
        bytes.resize(54, 0);
        bytes.extend(palette.as_flattened());
        bytes.extend(data);
        bytes
    }

    #[test]
    fn pictures_are_read() {
        let grey: Vec<[u8; 4]> = (0..=255).map(|k| [k, k, k, 0]).collect();
        let up = read(&file(3, 2, 8, &grey, &[4, 5, 6, 0, 1, 2, 3, 0]), None).unwrap();
        assert_eq!(up.values, Numbers::U8(vec![1, 2, 3, 4, 5, 6]));
        let down = read(&file(3, -2, 8, &grey, &[4, 5, 6, 0, 1, 2, 3, 0]), None).unwrap();
        assert_eq!(down.values, Numbers::U8(vec![4, 5, 6, 1, 2, 3]));
        let colour = file(1, 1, 24, &[], &[10, 20, 30, 0]);
        let of = |channel| read(&colour, Some(channel)).unwrap().values.at(0);
        assert_eq!([of(Channel::Red), of(Channel::Green), of(Channel::Blue)], [30.0, 20.0, 10.0]);
    }

    #[test]
    fn wrong_pictures_are_named() {
        for (bytes, said) in [
            (file(3, 2, 8, &[[0; 4]], &[0, 0, 0, 0, 0, 9, 0, 0]), "its palette has no colour 9"),
            (file(3, 2, 24, &[], &[0; 10]), "cannot hold the 24"),
            (file(3, 2, 4, &[], &[0; 10]), "its pixels have 4 bit"),
            (file(0, 2, 24, &[], &[0; 10]), "it has 0 x 2 pixels"),
            (file(i32::MAX, i32::MIN, 8, &[], &[0; 10]), "pixels; from 1 to"),
            (file(1, 1, 24, &[], &[0; 4]), "it is coloured"),
            (b"BM123".to_vec(), "cut off"),
        ] {
            let error = read(&bytes, None).unwrap_err();
            assert!(error.contains(said), "{error}");
        }
    }
}
