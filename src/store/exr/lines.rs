//! The pixels of an image file: part by part and line by line, with a table before the first that says where each chunk begins.
//!
//! A chunk is a line (of a drawing 16) behind the number of its part, that of its first line and its length. Files are written front to back, so that
//! their digest is known with their last byte; of a file that was written so, the lines of a part that is not packed lie at equal distances, and are
//! read many at a time.

use std::io::{self, BufReader, Read, Seek, SeekFrom, Write};
use std::path::PathBuf;

use exr::math::Vec2;
use exr::meta::attribute::IntegerBounds;
use exr::meta::header::Header;
use exr::meta::{Headers, MetaData, magic_number};
use exr::prelude::Compression;
use turbid_contract::ImageStack;

use crate::store::error::StoreError;

/// Bytes that are written or read at a time: few enough to stay in the cache of a core between the steps that they go through.
const PIECE: usize = 256 << 10;

/// Writes a file, front to back. Errors: a pixel that is not finite; those of writing.
pub fn write(stack: &ImageStack, headers: &[Header], to: &mut impl Write) -> Result<(), StoreError> {
    let wrong = |e: exr::error::Error| StoreError::unfit(format!("the images cannot be written as EXR: {e}"));
    let several = headers.len() > 1;
    let mut head = Vec::new();
    let requirements = MetaData::validate(headers, true).map_err(wrong)?;
    magic_number::write(&mut head).map_err(wrong)?;
    requirements.write(&mut head).map_err(wrong)?;
    Header::write_all(headers, &mut head, several).map_err(wrong)?;
    let parts: Result<Vec<Part>, StoreError> = (0..headers.len()).map(|k| Part::of(stack, k, &headers[k])).collect();
    let parts = parts?;
    let mut at = head.len() + 8 * headers.iter().map(|header| header.chunk_count).sum::<usize>();
    for length in parts.iter().flat_map(Part::lengths) {
        head.extend((at as u64).to_le_bytes());
        at += Tag::length(several) + length;
    }
    let failed =
        |source| StoreError::Io { doing: "write images".into(), path: PathBuf::from("temporary file"), source };
    to.write_all(&head).map_err(failed)?;
    drop(head);
    let mut piece = Piece { bytes: Vec::with_capacity(PIECE + (1 << 16)), to };
    for (part, of) in parts.iter().enumerate() {
        for (k, length) in of.lengths().enumerate() {
            Tag { part, line: k * of.lines, length }.append(several, &mut piece.bytes);
            match &of.packed {
                Some(packed) => piece.bytes.extend_from_slice(packed.chunk(k)),
                None => {
                    let line = &of.pixels[k * of.columns..][..of.columns];
                    finite(stack, part, line, k)?;
                    append(line, &mut piece.bytes);
                }
            }
            piece.pass(PIECE).map_err(failed)?;
        }
    }
    piece.pass(0).map_err(failed)
}

/// Bytes on their way.
struct Piece<'a, W> {
    bytes: Vec<u8>,
    to: &'a mut W,
}

impl<W: Write> Piece<'_, W> {
    /// Writes what there is once it has so many bytes.
    fn pass(&mut self, least: usize) -> io::Result<()> {
        if self.bytes.len() >= least {
            self.to.write_all(&self.bytes)?;
            self.bytes.clear();
        }
        Ok(())
    }
}

fn append(line: &[f32], bytes: &mut Vec<u8>) {
    let start = bytes.len();
    bytes.resize(start + 4 * line.len(), 0);
    let places = bytes[start..].chunks_exact_mut(4);
    places.zip(line).for_each(|(place, value)| place.copy_from_slice(&value.to_le_bytes()));
}

/// Error: one of these pixels of a layer, whose first is in row `row`, is not finite.
fn finite(stack: &ImageStack, layer: usize, pixels: &[f32], row: usize) -> Result<(), StoreError> {
    // Of the magnitudes' bits: a loop that does not end early is several times faster.
    let largest = pixels.iter().fold(0, |most, value| value.abs().to_bits().max(most));
    if largest < f32::INFINITY.to_bits() {
        return Ok(());
    }
    let at = pixels.iter().position(|value| !value.is_finite()).expect("the largest is not");
    let (name, value, columns) = (&stack.layers[layer].info.name, pixels[at], stack.columns());
    Err(StoreError::unfit(format!(
        "layer {layer} `{name}` has the value {value} at row {}, column {}; every pixel must be finite (mask it)",
        row + at / columns,
        at % columns
    )))
}

/// A part on its way into a file.
struct Part<'a> {
    pixels: std::borrow::Cow<'a, [f32]>,
    columns: usize,
    /// Lines of a chunk.
    lines: usize,
    packed: Option<Packed>,
}

impl<'a> Part<'a> {
    /// Error: it is packed, and a pixel is not finite.
    fn of(stack: &'a ImageStack, layer: usize, header: &Header) -> Result<Self, StoreError> {
        let (pixels, columns) = (stack.layers[layer].pixels(), stack.columns());
        let lines = header.compression.scan_lines_per_block();
        let mut packed = None;
        if header.compression != Compression::Uncompressed {
            finite(stack, layer, &pixels, 0)?;
            packed = Some(Packed::of(&pixels, columns, header)?);
        }
        Ok(Self { pixels, columns, lines, packed })
    }

    /// Of its chunks.
    fn lengths(&self) -> impl Iterator<Item = usize> {
        let chunks = self.pixels.chunks(self.lines * self.columns).enumerate();
        chunks.map(|(k, pixels)| self.packed.as_ref().map_or(4 * pixels.len(), |packed| packed.chunk(k).len()))
    }
}

/// The chunks of a part that is packed, one behind the other.
struct Packed {
    bytes: Vec<u8>,
    /// Where each begins, and where the last ends.
    starts: Vec<usize>,
}

impl Packed {
    fn of(pixels: &[f32], columns: usize, header: &Header) -> Result<Self, StoreError> {
        let lines = header.compression.scan_lines_per_block();
        let mut packed = Self { bytes: Vec::new(), starts: vec![0] };
        let mut before: &[f32] = &[];
        for (k, chunk) in pixels.chunks(lines * columns).enumerate() {
            // Most lines of most masks are as the line before.
            if same(before, chunk) {
                packed.bytes.extend_from_within(packed.starts[k - 1]..);
            } else {
                packed.bytes.extend(packed_bytes(chunk, section(k * lines, chunk.len() / columns, columns), header)?);
            }
            packed.starts.push(packed.bytes.len());
            before = chunk;
        }
        Ok(packed)
    }

    fn chunk(&self, k: usize) -> &[u8] {
        &self.bytes[self.starts[k]..self.starts[k + 1]]
    }
}

/// Whether they are the same to the bit.
fn same(a: &[f32], b: &[f32]) -> bool {
    a.len() == b.len() && a.iter().zip(b).fold(0, |bits, (a, b)| bits | (a.to_bits() ^ b.to_bits())) == 0
}

fn packed_bytes(pixels: &[f32], section: IntegerBounds, header: &Header) -> Result<Vec<u8>, StoreError> {
    let bytes = pixels.iter().flat_map(|value| value.to_ne_bytes()).collect();
    let packed = header.compression.compress_image_section_to_le(header, bytes, section);
    packed.map_err(|e| StoreError::unfit(format!("the images cannot be written as EXR: {e}")))
}

fn section(first: usize, lines: usize, columns: usize) -> IntegerBounds {
    IntegerBounds { position: Vec2(0, first as i32), size: Vec2(columns, lines) }
}

/// What stands before the bytes of a chunk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Tag {
    part: usize,
    line: usize,
    length: usize,
}

impl Tag {
    /// Bytes of a tag; a file of one part does not number it.
    const fn length(several: bool) -> usize {
        if several { 12 } else { 8 }
    }

    fn append(self, several: bool, bytes: &mut Vec<u8>) {
        if several {
            bytes.extend((self.part as i32).to_le_bytes());
        }
        bytes.extend((self.line as i32).to_le_bytes());
        bytes.extend((self.length as i32).to_le_bytes());
    }

    /// `None`: a number below 0.
    fn read(bytes: &[u8], several: bool) -> Option<Self> {
        let mut numbers = bytes.chunks_exact(4).map(|b| i32::from_le_bytes([b[0], b[1], b[2], b[3]]).try_into().ok());
        let part = if several { numbers.next()?? } else { 0 };
        Some(Self { part, line: numbers.next()??, length: numbers.next()?? })
    }
}

/// Where the chunks of a file begin, and what its parts are.
pub struct Layout {
    pub headers: Headers,
    /// Of each part.
    starts: Vec<Vec<u64>>,
}

impl Layout {
    /// Reads the head of a file from its start. Error: it is none.
    pub fn read(mut from: impl Read) -> Result<Self, StoreError> {
        let headers = MetaData::read_from_buffered(&mut from, false).map_err(|e| wrong(&e.to_string()))?.headers;
        let mut table = |header: &Header| {
            let mut bytes = Vec::new();
            let length = 8 * header.chunk_count as u64;
            let read = from.by_ref().take(length).read_to_end(&mut bytes).map_err(|e| wrong(&e.to_string()))?;
            if read as u64 != length {
                return Err(wrong("it ends early"));
            }
            Ok(bytes.chunks_exact(8).map(|b| u64::from_le_bytes(b.try_into().expect("8 bytes"))).collect())
        };
        let starts = headers.iter().map(&mut table).collect::<Result<_, _>>()?;
        Ok(Self { headers, starts })
    }

    /// Reads the pixels of a part into a plane of its size.
    ///
    /// Error: the file cannot be read, or was not written by [`write`].
    pub fn part(&self, part: usize, from: &mut (impl Read + Seek), pixels: &mut [f32]) -> Result<(), StoreError> {
        let Some(&start) = self.starts[part].first() else { return Err(wrong("a part has no lines")) };
        from.seek(SeekFrom::Start(start)).map_err(|e| wrong(&e.to_string()))?;
        if self.headers[part].compression == Compression::Uncompressed {
            self.plain(part, from, pixels)
        } else {
            self.packed(part, from, pixels)
        }
    }

    fn plain(&self, part: usize, from: &mut impl Read, pixels: &mut [f32]) -> Result<(), StoreError> {
        let (columns, several) = (self.headers[part].layer_size.0, self.headers.len() > 1);
        let tag = Tag::length(several);
        let stride = tag + 4 * columns;
        let mut bytes = vec![0; (PIECE / stride).max(1) * stride];
        let mut line = 0;
        for lines in pixels.chunks_mut(bytes.len() / stride * columns) {
            let bytes = &mut bytes[..lines.len() / columns * stride];
            from.read_exact(bytes).map_err(|e| wrong(&e.to_string()))?;
            for (chunk, pixels) in bytes.chunks_exact(stride).zip(lines.chunks_exact_mut(columns)) {
                if Tag::read(&chunk[..tag], several) != Some(Tag { part, line, length: 4 * columns }) {
                    return Err(wrong("its lines are not where they should be"));
                }
                let values = chunk[tag..].chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
                pixels.iter_mut().zip(values).for_each(|(pixel, value)| *pixel = value);
                line += 1;
            }
        }
        Ok(())
    }

    fn packed(&self, part: usize, from: &mut impl Read, pixels: &mut [f32]) -> Result<(), StoreError> {
        let (header, several) = (&self.headers[part], self.headers.len() > 1);
        let (columns, lines) = (header.layer_size.0, header.compression.scan_lines_per_block());
        let mut from = BufReader::with_capacity(PIECE, from);
        let unreadable = |e: io::Error| wrong(&e.to_string());
        let (mut tag, mut bytes, mut before) = ([0; 12], Vec::new(), Vec::new());
        let tag = &mut tag[..Tag::length(several)];
        let most = header.max_block_byte_size();
        for start in (0..pixels.len()).step_by(lines * columns) {
            from.read_exact(tag).map_err(unreadable)?;
            let here = Tag::read(tag, several);
            let here = here.filter(|tag| (tag.part, tag.line) == (part, start / columns) && tag.length <= most);
            let Tag { line, length, .. } = here.ok_or_else(|| wrong("its lines are not where they should be"))?;
            bytes.resize(length, 0);
            from.read_exact(&mut bytes).map_err(unreadable)?;
            let count = (lines * columns).min(pixels.len() - start);
            if bytes == before && count == lines * columns {
                pixels.copy_within(start - count..start, start);
                continue;
            }
            let section = section(line, count / columns, columns);
            let unpacked = header.compression.decompress_image_section_from_le(header, bytes.clone(), section, false);
            let unpacked = unpacked.map_err(|e| wrong(&e.to_string()))?;
            let values = unpacked.chunks_exact(4).map(|b| f32::from_ne_bytes([b[0], b[1], b[2], b[3]]));
            pixels[start..start + count].iter_mut().zip(values).for_each(|(pixel, value)| *pixel = value);
            std::mem::swap(&mut before, &mut bytes);
        }
        Ok(())
    }
}

fn wrong(what: &str) -> StoreError {
    StoreError::unfit(format!("not an image stack of this turbid: {what}"))
}
