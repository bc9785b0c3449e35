//! PGM of netpbm: grey pictures of 8 and 16 bit (`P5`).

use super::npy::numbers;
use super::{Picture, bounded};

pub fn size(bytes: &[u8]) -> Result<(usize, usize), String> {
    header(bytes).map(|(size, ..)| size)
}

pub fn read(bytes: &[u8]) -> Result<Picture, String> {
    let (size, highest, data) = header(bytes)?;
    let (kind, wide) = if highest > 255 { (">u2", 2) } else { ("|u1", 1) };
    let n = size.0 * size.1 * wide;
    let data = data.get(..n).ok_or_else(|| format!("it ends after {} of {n} bytes of its pixels", data.len()))?;
    let picture = Picture::whole(size, numbers(kind, data, true).expect("a known type"))?;
    Ok(Picture { highest: Some(f64::from(highest)), ..picture })
}

/// Columns and rows, the highest number, and the bytes of the pixels.
type Header<'a> = ((usize, usize), u32, &'a [u8]);

fn header(bytes: &[u8]) -> Result<Header<'_>, String> {
    let mut at = 2;
    let mut number = || -> Option<u64> {
        // White space and comments, digits, one white space.
        while let Some(&byte) = bytes.get(at) {
            match byte {
                b'#' => at += bytes.get(at..)?.iter().position(|&b| b == b'\n')?,
                byte if byte.is_ascii_whitespace() => at += 1,
                _ => break,
            }
        }
        let digits = bytes.get(at..)?.iter().take_while(|b| b.is_ascii_digit()).count();
        let text = std::str::from_utf8(&bytes[at..at + digits]).ok()?;
        at += digits + 1;
        text.parse().ok()
    };
    let numbers = [number(), number(), number()];
    let [Some(columns), Some(rows), Some(highest)] = numbers else {
        return Err("its header does not say columns, rows and the highest number".to_owned());
    };
    if !(1..=65535).contains(&highest) {
        return Err(format!("its highest number is {highest}; from 1 to 65535 are read"));
    }
    Ok((bounded(columns, rows)?, highest as u32, bytes.get(at..).unwrap_or_default()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decode::Numbers;

    #[test]
    fn grey_pictures_are_read() {
        let picture = read(b"P5 # a comment\n3 1\n255\n\x01\x02\xff").unwrap();
        assert_eq!((picture.values, picture.highest), (Numbers::U8(vec![1, 2, 255]), Some(255.0)));
        let picture = read(b"P5\n1 2\n4095\n\x01\x02\x0f\xff").unwrap();
        assert_eq!((picture.values, picture.highest), (Numbers::U16(vec![258, 4095]), Some(4095.0)));
    }

    #[test]
    fn wrong_pictures_are_named() {
        for (bytes, said) in [
            (&b"P5\n3 1\n255\n\x01\x02"[..], "it ends after 2 of 3 bytes"),
            (b"P5\n3\n", "does not say columns"),
            (b"P5\n3 1\n70000\n", "its highest number is 70000"),
            (b"P5\n0 1\n255\n", "it has 0 x 1 pixels"),
            (b"P5\n999999999 999999999\n255\n", "pixels; from 1 to"),
            (b"P5 # no end", "does not say columns"),
        ] {
            let error = read(bytes).unwrap_err();
            assert!(error.contains(said), "{error}");
        }
    }
}
