//! EXR: one channel of one flat picture, by blocks of rows or tiles.

use exr::block::UncompressedBlock;
use exr::block::chunk::{Chunk, CompressedBlock, CompressedScanLineBlock, CompressedTileBlock, TileCoordinates};
use exr::compression::Compression;
use exr::math::{RoundingMode, Vec2};
use exr::meta::attribute::{ChannelDescription, LevelMode, LineOrder, SampleType, Text, TileDescription};
use exr::meta::header::Header as Encoding;
use exr::meta::{BlockDescription, MetaData, Requirements};

use super::exr_header::{self, Bytes, ChannelInfo, Header, Sample, wrong};
use super::numbers::{Numbers, zeros};
use super::{Channel, Picture, can_hold};

/// Above what deflate packs at most into one byte (1,032), a third of the bytes of which PXR24 leaves out;
const RATIO: u64 = 2048;
/// and DWA may keep one number of 64.
const RATIO_DWA: u64 = 200_000;
/// Bytes of a tile that is larger than its picture.
const SMALL: usize = 16 << 20;

pub fn read(bytes: &[u8], channel: Option<Channel>) -> Result<Picture, String> {
    let header = exr_header::read(bytes)?;
    let wanted = wanted(&header.channels, channel)?;
    let blocks = Blocks::of(&header)?;
    let table = bytes.len().saturating_sub(header.table) / 8;
    if blocks.count() > table {
        return Err(wrong(&format!("it has room for {table} of its {} blocks", blocks.count())));
    }
    let size = (header.columns, header.rows);
    let pixels = header.columns * header.rows;
    let ratio = if header.compression >= 8 { RATIO_DWA } else { RATIO };
    can_hold(bytes.len(), pixels as u64 * header.pixel_bytes() as u64, ratio)?;
    let mut values = match header.channels[wanted].sample {
        Sample::U32 => Numbers::U32(zeros(pixels)?),
        Sample::F16 | Sample::F32 => Numbers::F32(zeros(pixels)?),
    };
    let library = encoding(&header, &blocks);
    let mut offsets = Bytes::new(bytes, header.table);
    let mut seen = vec![false; blocks.count()];
    for _ in 0..blocks.count() {
        let at = usize::try_from(offsets.u64()?).unwrap_or(usize::MAX);
        let (index, packed) = blocks.block(&mut Bytes::new(bytes, at), &header)?;
        // A block that stands for many would make a large picture of a small file.
        if std::mem::replace(&mut seen[index], true) {
            return Err(wrong("one of its blocks stands twice"));
        }
        let area = blocks.area(index);
        let unpacked = unpack(&library, &header, packed, &blocks, index)?;
        copy(&unpacked, &header, wanted, area, &mut values);
    }
    Picture::whole(size, values)
}

fn wanted(channels: &[ChannelInfo], channel: Option<Channel>) -> Result<usize, String> {
    let name: &[u8] = match channel {
        Some(channel) => [b"R", b"G", b"B"][channel as usize],
        None if channels.len() == 1 => &channels[0].name,
        None => b"Y",
    };
    channels.iter().position(|c| c.name == name).ok_or_else(|| {
        const NAMED: usize = 8;
        let mut has: Vec<_> = channels.iter().take(NAMED).map(|c| String::from_utf8_lossy(&c.name)).collect();
        if channels.len() > NAMED {
            has.push("...".into());
        }
        let wanted = String::from_utf8_lossy(name);
        format!("it has the channels {}, not `{wanted}`: say `channel: red`, `green` or `blue`", has.join(", "))
    })
}

/// How the picture is cut.
struct Blocks {
    tiled: bool,
    /// Of a block.
    width: usize,
    height: usize,
    across: usize,
    columns: usize,
    rows: usize,
}

/// Part of a picture.
#[derive(Clone, Copy)]
struct Area {
    x: usize,
    y: usize,
    width: usize,
    height: usize,
}

impl Blocks {
    fn of(header: &Header) -> Result<Self, String> {
        let (columns, rows) = (header.columns, header.rows);
        let whole = columns * rows * header.pixel_bytes();
        let (width, height) = match header.tiles {
            None => (columns, packing(header.compression)?.scan_lines_per_block()),
            Some((width, height)) => {
                let bytes = width.checked_mul(height).and_then(|n| n.checked_mul(header.pixel_bytes()));
                if bytes.is_none_or(|bytes| bytes > whole.max(SMALL)) {
                    return Err(format!("its tiles of {width} x {height} pixels are larger than the picture"));
                }
                (width, height)
            }
        };
        Ok(Self { tiled: header.tiles.is_some(), width, height, across: columns.div_ceil(width), columns, rows })
    }

    fn count(&self) -> usize {
        self.across * self.rows.div_ceil(self.height)
    }

    fn area(&self, index: usize) -> Area {
        let (x, y) = (index % self.across * self.width, index / self.across * self.height);
        Area { x, y, width: self.width.min(self.columns - x), height: self.height.min(self.rows - y) }
    }

    /// The number of the block that stands there, and its packed bytes.
    fn block<'a>(&self, input: &mut Bytes<'a>, header: &Header) -> Result<(usize, &'a [u8]), String> {
        let outside = || wrong("one of its blocks lies outside of the picture");
        if header.numbered && input.i32()? != 0 {
            return Err(wrong("one of its blocks belongs to no part"));
        }
        let (column, row) = if self.tiled {
            let (column, row) = (input.i32()?, input.i32()?);
            if (input.i32()?, input.i32()?) != (0, 0) {
                return Err(wrong("its table leads to a smaller copy of the picture"));
            }
            (i64::from(column), i64::from(row))
        } else {
            let y = i64::from(input.i32()?) - i64::from(header.first_row);
            if y % self.height as i64 != 0 {
                return Err(outside());
            }
            (0, y / self.height as i64)
        };
        let inside = |at: i64, count: usize| usize::try_from(at).ok().filter(|&at| at < count).ok_or_else(outside);
        let row = inside(row, self.rows.div_ceil(self.height))?;
        let index = row * self.across + inside(column, self.across)?;
        let length = usize::try_from(input.i32()?).map_err(|_| wrong("one of its blocks has a negative size"))?;
        Ok((index, input.take(length)?))
    }
}

/// The packing that a number in the header stands for.
fn packing(number: u8) -> Result<Compression, String> {
    Ok(match number {
        0 => Compression::Uncompressed,
        1 => Compression::RLE,
        2 => Compression::ZIP1,
        3 => Compression::ZIP16,
        4 => Compression::PIZ,
        5 => Compression::PXR24,
        6 => Compression::B44,
        7 => Compression::B44A,
        8 => Compression::DWAA(None),
        9 => Compression::DWAB(None),
        other => return Err(format!("it is packed in a way ({other}) that is not known: save it with ZIP")),
    })
}

/// What the library needs to know of the picture, which for it lies at (0, 0).
fn encoding(header: &Header, blocks: &Blocks) -> MetaData {
    let channels = header.channels.iter().map(|c| {
        let sample = match c.sample {
            Sample::U32 => SampleType::U32,
            Sample::F16 => SampleType::F16,
            Sample::F32 => SampleType::F32,
        };
        ChannelDescription::new(Text::from_slice_unchecked(&c.name), sample, c.linear)
    });
    let description = match header.tiles {
        None => BlockDescription::ScanLines,
        Some(_) => BlockDescription::Tiles(TileDescription {
            tile_size: Vec2(blocks.width, blocks.height),
            level_mode: LevelMode::Singular,
            rounding_mode: RoundingMode::Down,
        }),
    };
    let compression = packing(header.compression).expect("`Blocks::of` knows it");
    let size = Vec2(header.columns, header.rows);
    let own = Encoding::new(Text::from_slice_unchecked(b"picture"), size, channels.collect());
    let own = own.with_encoding(compression, description, LineOrder::Increasing);
    let requirements = Requirements {
        file_format_version: 2,
        is_single_layer_and_tiled: blocks.tiled,
        has_long_names: true,
        has_deep_data: false,
        has_multiple_layers: false,
    };
    MetaData { requirements, headers: std::iter::once(own).collect() }
}

/// All channels of a block: of each row, one channel after the other.
fn unpack(
    library: &MetaData,
    header: &Header,
    packed: &[u8],
    blocks: &Blocks,
    index: usize,
) -> Result<Vec<u8>, String> {
    let area = blocks.area(index);
    let expected = area.width * area.height * header.pixel_bytes();
    if packed.len() > expected || header.compression == 0 && packed.len() != expected {
        let what = format!("one of its blocks has {} bytes, and {expected} unpacked", packed.len());
        return Err(wrong(&what));
    }
    if header.compression >= 8 {
        check_dwa(packed, area, header.channels.len())?;
    }
    let bytes = packed.to_vec();
    let block = if blocks.tiled {
        let tile_index = Vec2(index % blocks.across, index / blocks.across);
        let coordinates = TileCoordinates { tile_index, level_index: Vec2(0, 0) };
        CompressedBlock::Tile(CompressedTileBlock { coordinates, compressed_pixels_le: bytes })
    } else {
        CompressedBlock::ScanLine(CompressedScanLineBlock { y_coordinate: area.y as i32, compressed_pixels_le: bytes })
    };
    let chunk = Chunk { layer_index: 0, compressed_block: block };
    let unpacked = UncompressedBlock::decompress_chunk(chunk, library, false).map_err(|e| wrong(&e.to_string()))?;
    if unpacked.data.len() != expected {
        return Err(wrong(&format!("one of its blocks unpacks to {} bytes, not {expected}", unpacked.data.len())));
    }
    Ok(unpacked.data)
}

/// A block of DWA begins with eleven counters, and the library makes room by them.
fn check_dwa(packed: &[u8], area: Area, channels: usize) -> Result<(), String> {
    if packed.is_empty() {
        return Err(wrong("one of its blocks is empty"));
    }
    // It works on squares of 8 x 8 pixels, in up to 4 bytes a number; run lengths take no more than twice that.
    let padded = area.width.next_multiple_of(8) * area.height.next_multiple_of(8);
    let most = (padded * channels * 8 + 4096) as u64;
    let mut counters = Bytes::new(packed, 0);
    for at in 0..10 {
        let counter = counters.u64()?;
        if at > 0 && counter > most {
            return Err(wrong(&format!("one of its blocks claims {counter} numbers, and at most {most} fit")));
        }
    }
    Ok(())
}

/// Copies one channel of a block to its place.
fn copy(unpacked: &[u8], header: &Header, wanted: usize, area: Area, values: &mut Numbers) {
    let before: usize = header.channels[..wanted].iter().map(|c| c.sample.bytes()).sum();
    let own = header.channels[wanted].sample;
    for row in 0..area.height {
        let line = (row * header.pixel_bytes() + before) * area.width;
        let line = &unpacked[line..][..own.bytes() * area.width];
        let to = (area.y + row) * header.columns + area.x..;
        match values {
            Numbers::U32(all) => fill(&mut all[to], line.as_chunks().0, u32::from_ne_bytes),
            Numbers::F32(all) if own == Sample::F16 => {
                fill(&mut all[to], line.as_chunks().0, |b| exr::prelude::f16::from_ne_bytes(b).to_f32());
            }
            Numbers::F32(all) => fill(&mut all[to], line.as_chunks().0, f32::from_ne_bytes),
            _ => unreachable!("EXR has three kinds of numbers"),
        }
    }
}

fn fill<T, const N: usize>(to: &mut [T], from: &[[u8; N]], number: impl Fn([u8; N]) -> T) {
    to.iter_mut().zip(from).for_each(|(to, bytes)| *to = number(*bytes));
}
