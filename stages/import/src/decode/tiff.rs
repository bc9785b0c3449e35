//! TIFF and BigTIFF: grey and RGB of 8, 16 (signed too) and 32 bit and floating-point, by strips and tiles, of one page or several.

use std::io::Cursor;

use tiff::decoder::{ChunkType, Decoder, DecodingResult, Limits};
use tiff::tags::Tag;

use super::numbers::{Numbers, zeros};
use super::{Channel, Picture, bounded, can_hold, place};

/// Above what LZW (about 2,700) and deflate (1,032) pack at most into one byte.
const RATIO: u64 = 4096;
/// Bytes of a strip or tile that is larger than its picture.
const SMALL: u64 = 16 << 20;
/// Pages that are counted.
const MOST_PAGES: usize = 1000;

type File<'a> = Decoder<Cursor<&'a [u8]>>;

pub fn size(bytes: &[u8]) -> Result<(usize, usize), String> {
    open(bytes).map(|(_, size)| size)
}

/// The file with the size of its first page.
fn open(bytes: &[u8]) -> Result<(File<'_>, (usize, usize)), String> {
    tags_fit(bytes)?;
    let mut decoder = Decoder::new(Cursor::new(bytes)).map_err(said)?;
    let (columns, rows) = decoder.dimensions().map_err(said)?;
    Ok((decoder, bounded(u64::from(columns), u64::from(rows))?))
}

/// `page`: which of several, from 0; a file of one page needs none.
pub fn read(bytes: &[u8], channel: Option<Channel>, page: Option<usize>) -> Result<Picture, String> {
    let (mut decoder, size) = open(bytes)?;
    let (mut decoder, size) = match page {
        Some(page) => turned_to(decoder, page)?,
        None => {
            let pages = pages(&mut decoder)?;
            if pages > 1 {
                let pages = if pages > MOST_PAGES { format!("more than {MOST_PAGES}") } else { pages.to_string() };
                return Err(format!(
                    "it has {pages} pages, and a frame is one picture: name each by `page`, or leave {{phase}} out of the pattern"
                ));
            }
            drop(decoder);
            (open(bytes)?.0, size)
        }
    };
    let orientation = decoder.find_tag_unsigned::<u16>(Tag::Orientation).map_err(said)?.unwrap_or(1);
    let picture = one(decoder, bytes, size, channel)?;
    turned(picture, orientation)
}

/// The page that is asked for: smaller copies of pages do not count.
fn turned_to(mut decoder: File<'_>, page: usize) -> Result<(File<'_>, (usize, usize)), String> {
    let mut at = 0;
    while at < page {
        let pages = at + 1;
        if !decoder.more_images() || at > MOST_PAGES {
            return Err(super::no_page(page, pages));
        }
        decoder.next_image().map_err(said)?;
        at += usize::from(!is_copy(&mut decoder)?);
    }
    let (columns, rows) = decoder.dimensions().map_err(said)?;
    let size = bounded(u64::from(columns), u64::from(rows))?;
    Ok((decoder, size))
}

/// How many pictures are in it.
pub fn count(bytes: &[u8]) -> Result<usize, String> {
    pages(&mut open(bytes)?.0)
}

/// The picture as its orientation tag (TIFF 6.0, section 8) has it seen.
fn turned(picture: Picture, orientation: u16) -> Result<Picture, String> {
    let Picture { rows, columns, ref values, .. } = picture;
    let (up, left) = match orientation {
        1 => return Ok(picture),
        2 => (false, true),
        3 => (true, true),
        4 => (true, false),
        other => {
            return Err(format!(
                "its tag `Orientation` is {other}, which turns it on its side: save it upright (orientation 1)"
            ));
        }
    };
    let places = (0..rows).flat_map(|r| {
        let row = if up { rows - 1 - r } else { r };
        (0..columns).map(move |c| row * columns + if left { columns - 1 - c } else { c })
    });
    Ok(Picture { values: values.pick(places), ..picture })
}

fn one(mut decoder: File<'_>, bytes: &[u8], size: (usize, usize), channel: Option<Channel>) -> Result<Picture, String> {
    let (count, bits) = match decoder.colortype().map_err(said)? {
        tiff::ColorType::Gray(bits) => (1, bits),
        tiff::ColorType::GrayA(bits) => (2, bits),
        tiff::ColorType::RGB(bits) => (3, bits),
        tiff::ColorType::RGBA(bits) => (4, bits),
        other => return Err(format!("its pixels are {other:?}, not grey or RGB")),
    };
    let at = place(count, channel)?;
    if ![8, 16, 32, 64].contains(&bits) {
        return Err(format!("its pixels have {bits} bit, not 8, 16, 32 or 64"));
    }
    let pixel = count as u64 * u64::from(bits / 8);
    let whole = (size.0 * size.1) as u64 * pixel;
    can_hold(bytes.len(), whole, RATIO)?;
    let (width, height) = decoder.chunk_dimensions();
    if decoder.get_chunk_type() == ChunkType::Tile
        && u64::from(width).saturating_mul(u64::from(height)).saturating_mul(pixel) > whole.max(SMALL)
    {
        return Err(format!("its tiles of {width} x {height} pixels are larger than the picture"));
    }
    let mut limits = Limits::default();
    limits.decoding_buffer_size = whole.max(SMALL) as usize;
    limits.intermediate_buffer_size = limits.intermediate_buffer_size.max(bytes.len());
    Picture::whole(size, pixels(&mut decoder.with_limits(limits), size, count, at)?)
}

/// No tag of the first directory claims more than the file holds: the library reserves memory by these counts before a limit can be set.
///
/// A directory that is cut short is left to the library.
fn tags_fit(bytes: &[u8]) -> Result<(), String> {
    let big = bytes.starts_with(b"MM");
    // BigTIFF counts in 8 bytes what TIFF counts in 4, and its entries in 8 in place of 2.
    let is_large = bytes.get(2..4).is_some_and(|magic| magic.contains(&43));
    let (wide, few, entry_bytes, first) = if is_large { (8, 8, 20, 8) } else { (4, 2, 12, 4) };
    let number = |at: usize, length: usize| -> Option<u64> {
        let digits = bytes.get(at..at.checked_add(length)?)?.iter();
        let join = |number: u64, digit: &u8| number << 8 | u64::from(*digit);
        Some(if big { digits.fold(0, join) } else { digits.rev().fold(0, join) })
    };
    let Some((start, entries)) = number(first, wide).and_then(|start| {
        let start = usize::try_from(start).ok().filter(|start| *start < bytes.len())?;
        Some((start, number(start, few)?))
    }) else {
        return Ok(());
    };
    let entry = |k: usize| {
        let at = k.checked_mul(entry_bytes)?.checked_add(start + few)?;
        Some((number(at, 2)?, number(at + 2, 2)?, number(at + 4, wide)?))
    };
    for (tag, kind, count) in (0..entries as usize).map_while(entry) {
        // Bytes of a value by its type: TIFF 6.0, section 2; 13 and above are later additions.
        let size = match kind {
            3 | 8 => 2,
            4 | 9 | 11 | 13 => 4,
            5 | 10 | 12 | 16..=18 => 8,
            _ => 1,
        };
        if count.saturating_mul(size) > bytes.len() as u64 {
            return Err(format!(
                "its tag {tag} claims {count} values of {size} bytes, and the file has {}",
                bytes.len()
            ));
        }
    }
    Ok(())
}

/// One channel, strip by strip or tile by tile.
fn pixels(decoder: &mut File<'_>, (columns, rows): (usize, usize), count: usize, at: usize) -> Result<Numbers, String> {
    let (width, height) = decoder.chunk_dimensions();
    let (width, height) = (width as usize, height as usize);
    let across = columns.div_ceil(width);
    let parts = across * rows.div_ceil(height);
    let planar = decoder.find_tag_unsigned::<u16>(Tag::PlanarConfiguration).map_err(said)? == Some(2);
    // In a planar file the strips of each channel follow those of the one before, and hold nothing else.
    let (first, count, at) = if planar { (at * parts, 1, 0) } else { (0, count, at) };
    let mut all: Option<Numbers> = None;
    for part in 0..parts {
        let index = u32::try_from(first + part).map_err(|_| "it has too many strips".to_owned())?;
        let read = decoder.read_chunk(index).map_err(said)?;
        let (x, y) = (part % across * width, part / across * height);
        let place = Place { columns, x, y, width: width.min(columns - x), height: height.min(rows - y), count, at };
        if all.is_none() {
            if parts == 1 && count == 1 {
                return numbers(read);
            }
            all = Some(like(&read, columns * rows)?);
        }
        let taken = all.as_mut().is_some_and(|all| place.take(read, all));
        if !taken {
            return Err("its strips or tiles are shorter than they should be".to_owned());
        }
    }
    all.ok_or_else(|| "it has no pixels".to_owned())
}

/// Where the pixels of a strip or tile belong, and which of their numbers is taken.
struct Place {
    columns: usize,
    x: usize,
    y: usize,
    width: usize,
    height: usize,
    count: usize,
    at: usize,
}

impl Place {
    fn take(&self, read: DecodingResult, all: &mut Numbers) -> bool {
        match (read, all) {
            (DecodingResult::U8(read), Numbers::U8(all)) => self.copy(&read, all),
            (DecodingResult::U16(read), Numbers::U16(all)) => self.copy(&read, all),
            (DecodingResult::I16(read), Numbers::I16(all)) => self.copy(&read, all),
            (DecodingResult::U32(read), Numbers::U32(all)) => self.copy(&read, all),
            (DecodingResult::F32(read), Numbers::F32(all)) => self.copy(&read, all),
            (DecodingResult::F64(read), Numbers::F64(all)) => self.copy(&read, all),
            _ => false,
        }
    }

    fn copy<T: Copy>(&self, read: &[T], all: &mut [T]) -> bool {
        if read.len() < self.width * self.height * self.count {
            return false;
        }
        for (row, numbers) in read.chunks_exact(self.width * self.count).take(self.height).enumerate() {
            let start = (self.y + row) * self.columns + self.x;
            let pixels = numbers.chunks_exact(self.count).map(|pixel| pixel[self.at]);
            all[start..start + self.width].iter_mut().zip(pixels).for_each(|(to, number)| *to = number);
        }
        true
    }
}

fn numbers(read: DecodingResult) -> Result<Numbers, String> {
    match read {
        DecodingResult::U8(v) => Ok(Numbers::U8(v)),
        DecodingResult::U16(v) => Ok(Numbers::U16(v)),
        DecodingResult::I16(v) => Ok(Numbers::I16(v)),
        DecodingResult::U32(v) => Ok(Numbers::U32(v)),
        DecodingResult::F32(v) => Ok(Numbers::F32(v)),
        DecodingResult::F64(v) => Ok(Numbers::F64(v)),
        _ => {
            Err("its numbers are neither unsigned of 8, 16 or 32 bit, nor signed of 16, nor floating-point".to_owned())
        }
    }
}

/// Zeros of the type that was read.
fn like(read: &DecodingResult, n: usize) -> Result<Numbers, String> {
    match read {
        DecodingResult::U8(_) => Ok(Numbers::U8(zeros(n)?)),
        DecodingResult::U16(_) => Ok(Numbers::U16(zeros(n)?)),
        DecodingResult::I16(_) => Ok(Numbers::I16(zeros(n)?)),
        DecodingResult::U32(_) => Ok(Numbers::U32(zeros(n)?)),
        DecodingResult::F32(_) => Ok(Numbers::F32(zeros(n)?)),
        DecodingResult::F64(_) => Ok(Numbers::F64(zeros(n)?)),
        _ => numbers(DecodingResult::I8(Vec::new())),
    }
}

fn pages(decoder: &mut File<'_>) -> Result<usize, String> {
    let (mut pages, mut seen) = (1, 1);
    while decoder.more_images() && seen <= MOST_PAGES {
        decoder.next_image().map_err(said)?;
        seen += 1;
        pages += usize::from(!is_copy(decoder)?);
    }
    Ok(if seen > MOST_PAGES { seen } else { pages })
}

/// Whether this is a smaller copy of a picture, for file browsers, and no page of its own.
fn is_copy(decoder: &mut File<'_>) -> Result<bool, String> {
    let kind = decoder.find_tag_unsigned::<u32>(Tag::NewSubfileType).map_err(said)?;
    Ok(kind.is_some_and(|kind| kind & 1 == 1))
}

fn said(error: tiff::TiffError) -> String {
    use tiff::{TiffError, TiffUnsupportedError::InterpretationWithBits, tags::PhotometricInterpretation};
    if let TiffError::UnsupportedError(InterpretationWithBits(PhotometricInterpretation::RGBPalette, _)) = error {
        return "it has a palette of colours, whose indices are no brightness: save it as grey or RGB".to_owned();
    }
    format!("it is no TIFF that can be read: {error}")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Both orders of bytes; a tag of as many bytes as the file has is let through, one of more is not.
    #[test]
    fn tags_claim_no_more_than_the_file_holds() {
        let file = |big: bool, count: u32| {
            let two = |n: u16| if big { n.to_be_bytes() } else { n.to_le_bytes() };
            let four = |n: u32| if big { n.to_be_bytes() } else { n.to_le_bytes() };
            let head = [if big { b"MM".as_slice() } else { b"II" }, &two(42), &four(8)].concat();
            [head, two(1).to_vec(), two(273).to_vec(), two(4).to_vec(), four(count).to_vec(), four(0).to_vec()].concat()
        };
        for big in [false, true] {
            assert_eq!(file(big, 1).len(), 22);
            assert_eq!(tags_fit(&file(big, 5)), Ok(()));
            let said = tags_fit(&file(big, 67_108_865)).unwrap_err();
            assert_eq!(said, "its tag 273 claims 67108865 values of 4 bytes, and the file has 22");
            (0..22).for_each(|cut| assert_eq!(tags_fit(&file(big, 1)[..cut]), Ok(()), "cut at {cut}"));
        }
        assert_eq!(tags_fit(b"II*\0\xff\xff\xff\xff"), Ok(()));
    }
}
