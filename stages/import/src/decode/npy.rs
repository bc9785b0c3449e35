//! NumPy's `.npy`: one array of whole or floating-point numbers, rows by columns, or pages of them.
//!
//! Source: NumPy Enhancement Proposal 1, "A simple file format for NumPy arrays".

use super::Picture;
use super::array::{Array, Order};
use super::numbers::Numbers;

/// What the header says.
struct Header<'a> {
    kind: &'a str,
    array: Array,
    /// The bytes behind it.
    data: &'a [u8],
}

pub fn size(bytes: &[u8]) -> Result<(usize, usize), String> {
    header(bytes).map(|Header { array, .. }| (array.columns, array.rows))
}

/// Pictures that are in it.
pub fn pages(bytes: &[u8]) -> Result<usize, String> {
    header(bytes).map(|header| header.array.pages)
}

/// The picture of a page; of several pages one has to be named.
pub fn read(bytes: &[u8], page: Option<usize>) -> Result<Picture, String> {
    let Header { kind, array, data } = header(bytes)?;
    let size = kind[2..].parse::<usize>().map_err(|_| unknown(kind))?;
    let (own, wanted) = (array.count().saturating_mul(size), page.unwrap_or(0));
    if data.len() < own {
        return Err(format!("it ends after {} of {own} bytes of its numbers", data.len()));
    }
    let big = kind.starts_with('>');
    // A page that lies in one piece is all that is read.
    let piece = own / array.pages;
    if let Some(data) = array.page_in_one_piece(page).then(|| &data[wanted * piece..(wanted + 1) * piece]) {
        return Picture::whole((array.columns, array.rows), numbers(kind, data, big).ok_or_else(|| unknown(kind))?);
    }
    let numbers = numbers(kind, &data[..own], big).ok_or_else(|| unknown(kind))?;
    array.with(numbers).picture(page)
}

fn unknown(kind: &str) -> String {
    format!("its numbers are of the type `{kind}`; uint8, uint16, uint32, int16, float32 and float64 are read")
}

/// Numbers of a type as NumPy writes it, without the sign of their order.
pub(super) fn numbers(kind: &str, data: &[u8], big: bool) -> Option<Numbers> {
    macro_rules! of {
        ($variant:ident, $type:ty, $size:literal) => {
            Numbers::$variant(
                data.as_chunks::<$size>()
                    .0
                    .iter()
                    .map(|&b| if big { <$type>::from_be_bytes(b) } else { <$type>::from_le_bytes(b) })
                    .collect(),
            )
        };
    }
    Some(match &kind[1..] {
        "u1" => Numbers::U8(data.to_vec()),
        "u2" => of!(U16, u16, 2),
        "u4" => of!(U32, u32, 4),
        "i2" => of!(I16, i16, 2),
        "f4" => of!(F32, f32, 4),
        "f8" => of!(F64, f64, 8),
        _ => return None,
    })
}

fn header(bytes: &[u8]) -> Result<Header<'_>, String> {
    let cut = || "it is cut off within its header".to_owned();
    let (length, start) = match bytes.get(6).ok_or_else(cut)? {
        1 => (u64::from(u16::from_le_bytes(*bytes.get(8..).and_then(|b| b.first_chunk()).ok_or_else(cut)?)), 10),
        2 | 3 => (u64::from(u32::from_le_bytes(*bytes.get(8..).and_then(|b| b.first_chunk()).ok_or_else(cut)?)), 12),
        other => return Err(format!("it is of version {other} of .npy; 1, 2 and 3 are read")),
    };
    let end = usize::try_from(start as u64 + length).ok().filter(|end| *end <= bytes.len()).ok_or_else(cut)?;
    let text = std::str::from_utf8(&bytes[start..end]).map_err(|_| "its header is no text".to_owned())?;
    let behind =
        |key: &str| text.split_once(key).map(|(_, rest)| rest.trim_start().trim_start_matches(':').trim_start());
    let lacks = |what: &str| format!("its header does not say {what}");
    let kind = behind("'descr'").and_then(|rest| rest.strip_prefix('\'')).and_then(|rest| rest.split('\'').next());
    let kind = kind.filter(|kind| kind.len() > 2 && kind.is_ascii()).ok_or_else(|| lacks("the type of its numbers"))?;
    let fortran = behind("'fortran_order'").is_some_and(|rest| rest.starts_with("True"));
    let order = if fortran { Order::Pages } else { Order::Rows };
    let shape = behind("'shape'").and_then(|rest| rest.strip_prefix('(')).and_then(|rest| rest.split(')').next());
    let shape = shape.ok_or_else(|| lacks("its shape"))?.split(',').map(str::trim).filter(|n| !n.is_empty());
    let shape: Result<Vec<u64>, _> = shape.map(str::parse).collect();
    let array = Array::new(&shape.map_err(|_| lacks("its shape in whole numbers"))?, order)?;
    Ok(Header { kind, array, data: &bytes[end..] })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(descr: &str, shape: &str, data: &[u8]) -> Vec<u8> {
        let text = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}\n");
        [b"\x93NUMPY\x01\x00".as_slice(), &(text.len() as u16).to_le_bytes(), text.as_bytes(), data].concat()
    }

    #[test]
    fn arrays_are_read() {
        let data: Vec<u8> = (0..24).collect();
        assert_eq!(read(&file("|u1", "(2, 3)", &data[..6]), None).unwrap().values, Numbers::U8(data[..6].to_vec()));
        let two = read(&file("<u2", "(2, 2, 3)", &data), Some(1)).unwrap();
        assert_eq!(two.values, Numbers::U16(vec![3340, 3854, 4368, 4882, 5396, 5910]));
        let signed = read(&file(">i2", "(1, 2)", &[0xff, 0xfe, 0, 5]), None).unwrap();
        assert_eq!((signed.values, signed.highest), (Numbers::I16(vec![-2, 5]), Some(32767.0)));
        let float = read(&file("<f4", "(1, 1)", &0.25_f32.to_le_bytes()), None).unwrap();
        assert_eq!((float.values, float.highest), (Numbers::F32(vec![0.25]), None));
    }

    #[test]
    fn wrong_arrays_are_named() {
        for (bytes, said) in [
            (file("|u1", "(2, 3)", &[0; 5]), "it ends after 5 of 6 bytes"),
            (file("<c8", "(2, 3)", &[0; 48]), "of the type `<c8`"),
            (file("|u1", "(6,)", &[0; 6]), "it has the shape [6]"),
            (file("|u1", "(0, 3)", &[]), "it has 3 x 0 pixels"),
            (file("<f8", "(99999999, 99999999)", &[]), "pixels; from 1 to"),
            (file("|u1", "(2, x)", &[]), "does not say its shape"),
            (file("|u1", "(2, 3)", &[0; 6])[..20].to_vec(), "cut off"),
        ] {
            let error = read(&bytes, None).unwrap_err();
            assert!(error.contains(said), "{error}");
        }
        assert_eq!(
            read(&file("|u1", "(2, 3)", &[0; 6]), Some(1)).unwrap_err(),
            "it has 1 page, and page 2 is asked for"
        );
    }
}
