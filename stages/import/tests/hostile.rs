//! Pictures that claim more than they hold, and pictures with any bytes changed: an error, never a panic, a hang or all the memory.

use std::io::Cursor;

use exr::prelude::{
    Blocks, Compression, Encoding, FlatSamples, Image, LineOrder, ReadChannels, ReadLayers, SpecificChannels, Vec2,
    WritableImage, f16,
};
use turbid_import::{Channel, Picture, Wanted};

fn decode(bytes: &[u8], channel: Option<Channel>) -> Result<Picture, String> {
    turbid_import::decode(bytes, Wanted { channel, ..Wanted::default() })
}

const COLUMNS: usize = 37;
const ROWS: usize = 41;

fn number(x: usize, y: usize) -> f32 {
    libm::sinf(0.3 * x as f32) * libm::cosf(0.2 * y as f32) + 1.5
}

/// Three channels of three kinds.
fn exr(compression: Compression, blocks: Blocks) -> Vec<u8> {
    let encoding = Encoding { compression, blocks, line_order: LineOrder::Increasing };
    let pixel = |at: Vec2<usize>| {
        let v = number(at.0, at.1);
        (f16::from_f32(v), 0.5 * v, (1000.0 * v) as u32)
    };
    let channels = SpecificChannels::build().with_channel("R").with_channel("G").with_channel("B").with_pixel_fn(pixel);
    let mut bytes = Cursor::new(Vec::new());
    let layer =
        exr::prelude::Layer::new((COLUMNS, ROWS), exr::prelude::LayerAttributes::named("p"), encoding, channels);
    Image::from_layer(layer).write().to_buffered(&mut bytes).expect("it can be written");
    bytes.into_inner()
}

fn by_library(bytes: &[u8], name: &str) -> Vec<f64> {
    let image = exr::prelude::read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer();
    let image = image.all_attributes().from_buffered(Cursor::new(bytes)).expect("the library reads what it wrote");
    let channels = &image.layer_data.channel_data.list;
    match &channels.iter().find(|c| c.name.eq(name)).expect("the channel").sample_data {
        FlatSamples::F16(v) => v.iter().map(|v| f64::from(v.to_f32())).collect(),
        FlatSamples::F32(v) => v.iter().map(|&v| f64::from(v)).collect(),
        FlatSamples::U32(v) => v.iter().map(|&v| f64::from(v)).collect(),
    }
}

const PACKINGS: [Compression; 8] = [
    Compression::Uncompressed,
    Compression::RLE,
    Compression::ZIP1,
    Compression::ZIP16,
    Compression::PIZ,
    Compression::PXR24,
    Compression::B44,
    Compression::B44A,
];

/// Every packing in rows and in tiles, every kind of number: bit for bit what the library makes of the whole file.
#[test]
fn blocks_one_by_one_are_the_whole_picture() {
    for compression in PACKINGS {
        for blocks in [Blocks::ScanLines, Blocks::Tiles(Vec2(16, 16)), Blocks::Tiles(Vec2(64, 64))] {
            let bytes = exr(compression, blocks);
            for (channel, name) in [(Channel::Red, "R"), (Channel::Green, "G"), (Channel::Blue, "B")] {
                let case = format!("{compression:?} {blocks:?} {name}");
                let picture = decode(&bytes, Some(channel)).unwrap_or_else(|e| panic!("{case}: {e}"));
                assert_eq!((picture.columns, picture.rows), (COLUMNS, ROWS), "{case}");
                assert_eq!(picture.values.iter().collect::<Vec<_>>(), by_library(&bytes, name), "{case}");
            }
        }
    }
}

fn png(colour: png::ColorType, depth: png::BitDepth, data: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, COLUMNS as u32, ROWS as u32);
    encoder.set_color(colour);
    encoder.set_depth(depth);
    encoder.add_text_chunk("made".into(), "for a test".into()).unwrap();
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(data).unwrap();
    writer.finish().unwrap();
    bytes
}

fn tiff<C: tiff::encoder::colortype::ColorType>(
    data: &[C::Inner],
    compression: tiff::encoder::Compression,
    rows_per_strip: u32,
) -> Vec<u8>
where
    [C::Inner]: tiff::encoder::TiffValue,
{
    let mut bytes = Cursor::new(Vec::new());
    let mut encoder = tiff::encoder::TiffEncoder::new(&mut bytes).unwrap().with_compression(compression);
    let mut image = encoder.new_image::<C>(COLUMNS as u32, ROWS as u32).unwrap();
    image.rows_per_strip(rows_per_strip).unwrap();
    image.write_data(data).unwrap();
    bytes.into_inner()
}

/// Strips of any height, packed or not, give the numbers that were written.
#[test]
fn strips_one_by_one_are_the_whole_picture() {
    use tiff::encoder::Compression::{Deflate, Lzw, Packbits, Uncompressed};
    use tiff::encoder::colortype::{Gray16, RGB8};
    let n = COLUMNS * ROWS;
    let grey: Vec<u16> = (0..n).map(|i| (i * 977 % 65_536) as u16).collect();
    let coloured: Vec<u8> = (0..3 * n).map(|i| (i * 31 % 256) as u8).collect();
    let deflate = Deflate(tiff::encoder::compression::DeflateLevel::Fast);
    for (name, compression) in [("plain", Uncompressed), ("LZW", Lzw), ("bits", Packbits), ("deflate", deflate)] {
        for rows in [1, 7, 16, 41] {
            let case = format!("{name}, strips of {rows} rows");
            let read =
                decode(&tiff::<Gray16>(&grey, compression, rows), None).unwrap_or_else(|e| panic!("{case}: {e}"));
            assert!(read.values.iter().eq(grey.iter().map(|&v| f64::from(v))), "{case}");
            let read = decode(&tiff::<RGB8>(&coloured, compression, rows), Some(Channel::Blue)).expect(&case);
            assert!(read.values.iter().eq(coloured.iter().skip(2).step_by(3).map(|&v| f64::from(v))), "{case}");
        }
    }
}

/// A file's bytes with those at `at` replaced.
fn with(bytes: &[u8], at: usize, new: &[u8]) -> Vec<u8> {
    let mut changed = bytes.to_vec();
    changed[at..at + new.len()].copy_from_slice(new);
    changed
}

fn place_of(bytes: &[u8], what: &[u8]) -> usize {
    bytes.windows(what.len()).position(|w| w == what).expect("it is in the file")
}

/// Headers of a few hundred bytes that claim gigabytes are refused by what they claim, whatever it is.
#[test]
fn claims_are_compared_with_the_bytes_that_are_there() {
    let file = exr(Compression::ZIP16, Blocks::ScanLines);
    let window = place_of(&file, b"dataWindow\0box2i\0") + 17 + 4;
    let corner = |x: i32, y: i32| with(&file, window + 8, &[x.to_le_bytes(), y.to_le_bytes()].concat());
    let said = |bytes: &[u8]| decode(bytes, Some(Channel::Red)).expect_err("it is refused");
    assert!(said(&corner(99_999, 99_999)).contains("it has 100000 x 100000 pixels"));
    assert!(said(&corner(i32::MAX, i32::MAX)).contains("it has 2147483648 x 2147483648 pixels"));
    assert!(said(&corner(-5, 3)).contains("it has 0 x 4 pixels"));
    assert!(said(&corner(0, (1 << 19) - 1)).contains("of its 32768 blocks"));
    assert!(said(&corner((1 << 28) - 1, 0)).contains("cannot hold the 2684354560 of its pixels"));
    // The second block stands where the first does: a file that is larger than it is.
    let table = table_of(&file);
    let first: [u8; 8] = file[table..table + 8].try_into().expect("eight bytes");
    assert!(said(&with(&file, table + 8, &first)).contains("one of its blocks stands twice"));
    let tiled = exr(Compression::RLE, Blocks::Tiles(Vec2(16, 16)));
    let tiles = place_of(&tiled, b"tiles\0tiledesc\0") + 15 + 4;
    let side = (1_u32 << 30).to_le_bytes();
    assert!(said(&with(&tiled, tiles, &[side, side].concat())).contains("are larger than the picture"));
    let channels = place_of(&file, b"channels\0chlist\0") + 16 + 4;
    // B, kind, linear and three bytes, sampling in x.
    let sampled = with(&file, channels + 2 + 4 + 4, &2_i32.to_le_bytes());
    assert!(said(&sampled).contains("channel `B` has fewer pixels than the picture"));
    let deep = with(&file, 5, &[8]);
    assert!(said(&deep).contains("deep"), "{}", said(&deep));

    let grey = png(png::ColorType::Grayscale, png::BitDepth::Eight, &[7; COLUMNS * ROWS]);
    let mut wide = with(&grey, 16, &[(1_u32 << 28).to_be_bytes(), 1_u32.to_be_bytes()].concat());
    let crc = crc32(&wide[12..29]).to_be_bytes();
    wide = with(&wide, 29, &crc);
    assert!(decode(&wide, None).unwrap_err().contains("cannot hold the 268435456 of its pixels"));

    let grey = tiff::<tiff::encoder::colortype::Gray8>(&[7; COLUMNS * ROWS], tiff::encoder::Compression::Packbits, 41);
    let width = place_of(&grey, &[0, 1, 4, 0, 1, 0, 0, 0, COLUMNS as u8]) + 8;
    assert!(decode(&with(&grey, width, &[0, 0, 0x40, 0]), None).unwrap_err().contains("cannot hold the 171966464"));
}

/// Where the table of blocks begins: behind the 0 that ends the header, which ends with the last attribute's value.
fn table_of(file: &[u8]) -> usize {
    let mut at = 8;
    while file[at] != 0 {
        let text = |at: usize| file[at..].iter().position(|&b| b == 0).expect("an end") + 1;
        let kind = at + text(at);
        let size = kind + text(kind);
        at = size + 4 + u32::from_le_bytes(file[size..size + 4].try_into().expect("four bytes")) as usize;
    }
    at + 1
}

/// As PNG defines it.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0_u32, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |c, _| if c & 1 == 1 { c >> 1 ^ 0xedb8_8320 } else { c >> 1 })
    })
}

/// A colour profile that unpacks to 64 MB, in a picture of 1.5 kB: it is not read.
#[test]
fn profiles_are_not_unpacked() {
    let grey = png(png::ColorType::Grayscale, png::BitDepth::Eight, &[7; COLUMNS * ROWS]);
    let packed = {
        use std::io::Write;
        let mut packer = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
        (0..64).for_each(|_| packer.write_all(&[0; 1 << 20]).unwrap());
        packer.finish().unwrap()
    };
    let body = [b"iCCPk\0\0".as_slice(), &packed].concat();
    let chunk = [&(body.len() as u32 - 4).to_be_bytes()[..], &body, &crc32(&body).to_be_bytes()].concat();
    let bombed = [&grey[..33], &chunk, &grey[33..]].concat();
    assert_eq!(decode(&bombed, None).unwrap(), decode(&grey, None).unwrap());
}

/// Random numbers of a fixed seed (splitmix64).
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % n as u64) as usize
    }

    /// A file with one to four things changed.
    fn changed(&mut self, file: &[u8]) -> Vec<u8> {
        const ODD: [u32; 12] =
            [0, 1, 2, 255, 256, 0x7fff, 0xffff, 0x0100_0000, 0x7fff_ffff, 0x8000_0000, 0xffff_fffe, 0xffff_ffff];
        let mut bytes = file.to_vec();
        for _ in 0..=self.below(4) {
            // Headers are where the claims stand.
            let reach = if self.below(2) == 0 { bytes.len().min(400) } else { bytes.len() };
            if reach < 8 {
                break;
            }
            let at = self.below(reach);
            match self.below(7) {
                0 => bytes[at] ^= 1 << self.below(8),
                1 => bytes[at] = [0, 1, 127, 128, 255][self.below(5)],
                2 | 3 if at + 4 <= bytes.len() => {
                    let odd = ODD[self.below(ODD.len())];
                    let new = if self.below(2) == 0 { odd.to_le_bytes() } else { odd.to_be_bytes() };
                    bytes[at..at + 4].copy_from_slice(&new);
                }
                4 => bytes.truncate(at.max(8)),
                5 => {
                    let end = (at + 1 + self.below(64)).min(bytes.len());
                    bytes.drain(at..end);
                }
                _ => {
                    let end = (at + 1 + self.below(64)).min(bytes.len());
                    let again = bytes[at..end].to_vec();
                    bytes.splice(at..at, again);
                }
            }
        }
        if bytes.starts_with(b"\x89PNG") && self.below(4) > 0 {
            with_right_sums(&mut bytes);
        }
        bytes
    }
}

/// Checksums of chunks as they should be, so that what is behind them is reached.
fn with_right_sums(bytes: &mut [u8]) {
    let mut at = 8;
    while let Some(length) = bytes.get(at..at + 4).map(|b| u32::from_be_bytes(b.try_into().expect("four bytes"))) {
        let end = at + 8 + length as usize;
        if end + 4 > bytes.len() {
            return;
        }
        let sum = crc32(&bytes[at + 4..end]).to_be_bytes();
        bytes[end..end + 4].copy_from_slice(&sum);
        at = end + 4;
    }
}

/// `MUTATIONS=4000` tries so many of each file in place of the few that every test run tries.
#[test]
fn changed_files_are_read_or_refused() {
    use tiff::encoder::colortype::{Gray16, Gray32Float, RGB8};
    let count = std::env::var("MUTATIONS").ok().and_then(|n| n.parse().ok()).unwrap_or(24);
    let n = COLUMNS * ROWS;
    let words: Vec<u16> = (0..n).map(|i| (i * 977 % 65_536) as u16).collect();
    let floats: Vec<f32> = (0..n).map(|i| i as f32).collect();
    let bytes: Vec<u8> = (0..8 * n).map(|i| (i * 31 % 256) as u8).collect();
    let deflate = tiff::encoder::Compression::Deflate(tiff::encoder::compression::DeflateLevel::Fast);
    let mut files = vec![
        ("png 8".to_owned(), png(png::ColorType::Grayscale, png::BitDepth::Eight, &bytes[..n])),
        ("png rgba 16".to_owned(), png(png::ColorType::Rgba, png::BitDepth::Sixteen, &bytes)),
        ("tiff 16".to_owned(), tiff::<Gray16>(&words, tiff::encoder::Compression::Lzw, 7)),
        ("tiff float".to_owned(), tiff::<Gray32Float>(&floats, deflate, 41)),
        ("tiff rgb".to_owned(), tiff::<RGB8>(&bytes[..3 * n], tiff::encoder::Compression::Packbits, 5)),
    ];
    for compression in PACKINGS {
        files.push((format!("exr {compression:?}"), exr(compression, Blocks::ScanLines)));
    }
    files.push(("exr tiles".to_owned(), exr(Compression::PIZ, Blocks::Tiles(Vec2(16, 16)))));
    // Blocks that are taken for DWA begin with counters by which the library makes room.
    let mut dwa = exr(Compression::RLE, Blocks::ScanLines);
    let at = place_of(&dwa, b"compression\0compression\0") + 24 + 4;
    dwa[at] = 8;
    files.push(("exr dwa".to_owned(), dwa));
    std::panic::set_hook(Box::new(|_| {}));
    let mut random = Random(15);
    let (mut read, mut refused, mut gave_up) = (0, 0, 0);
    let mut slowest = (0.0, String::new());
    for (name, file) in &files {
        for _ in 0..count {
            let changed = random.changed(file);
            let began = std::time::Instant::now();
            let coloured = name.contains("rgb") || name.starts_with("exr");
            match decode(&changed, coloured.then_some(Channel::Green)) {
                Ok(picture) => {
                    assert_eq!(picture.values.len(), picture.rows * picture.columns, "{name}");
                    read += 1;
                }
                Err(said) => {
                    refused += 1;
                    gave_up += usize::from(said.contains("gave up"));
                }
            }
            let seconds = began.elapsed().as_secs_f64();
            if seconds > slowest.0 {
                slowest = (seconds, name.clone());
            }
        }
    }
    let _ = std::panic::take_hook();
    println!("{read} read, {refused} refused ({gave_up} panics caught), slowest {slowest:?}");
    assert_eq!(read + refused, count * files.len());
    assert!(read > count && refused > count, "the changes reach what is behind checksums and headers");
    // The machine may be busy; what hangs takes for ever.
    assert!(slowest.0 < 20.0, "{slowest:?}");
}
