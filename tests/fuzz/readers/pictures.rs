//! Pictures: frames of a camera (PNG, TIFF, EXR, and as arrays of other programs), and textures of a scene (PNG).

use std::io::Cursor;
use std::panic::catch_unwind;

use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, Layer, LayerAttributes, LineOrder,
    WritableImage,
};
use png::{BitDepth, ColorType};
use serde_json::json;
use tiff::encoder::compression::DeflateLevel;
use tiff::encoder::{Compression as Packing, TiffEncoder, colortype};

use super::stage::FileOf;
use super::{Reader, Seen};
use crate::mutate::Form;

/// Columns and rows of the seeds.
const SIZE: (usize, usize) = (7, 5);
/// No compression here is stronger (LZW packs 2,700 bytes into one): what a header claims beyond it cannot be in the file.
const EXPANSION: usize = 4096;
fn frame() -> FileOf {
    let params = json!({"frames": [{"file": "frame", "f_x": 0}]});
    FileOf { stage: "import_frames", at: "frames.0.file", params }
}

fn texture() -> FileOf {
    let params = json!({
        "media": {},
        "objects": {"plane": {"slab": {"thickness": 10, "top": 0}, "surface": {"lambertian": {"image": {"file": "texture", "size": [10, 10]}}}}},
        "camera": {"position": [300, 100, 400], "look_at": [0, 0, 0], "field": [32, 32], "pixels": [4, 4]},
        "projector": {"position": [0, -60, 500], "look_at": [0, 0, 0], "field": [200, 200], "power": 5},
    });
    FileOf { stage: "scene", at: "objects.plane.surface.lambertian.image.file", params }
}

pub fn readers() -> Vec<Reader> {
    let framed = |name, form, share, seeds, claims| {
        let read = |input: &[u8]| Ok(seen(&frame(), input));
        Reader { name, form, share, seeds, claims, read, law: |input| frame().run(input) }
    };
    let textures = || {
        let grey = ColorType::Grayscale;
        vec![png_of(7, 5, BitDepth::Eight, grey), png_of(3, 9, BitDepth::Sixteen, grey)]
    };
    vec![
        framed("png", Form::Png, 3, pngs, |input| claimed(input, of_png)),
        framed("tiff", Form::Binary, 4, tiffs, |input| claimed(input, of_tiff)),
        framed("exr", Form::Binary, 4, exrs, |input| claimed(input, of_exr)),
        framed("arrays", Form::Binary, 4, arrays, packed),
        Reader {
            name: "texture",
            form: Form::Png,
            share: 2,
            seeds: textures,
            claims: |input| claimed(input, of_png),
            read: |input| Ok(seen(&texture(), input)),
            law: |input| texture().run(input),
        },
    ]
}

fn seen(file: &FileOf, input: &[u8]) -> Seen {
    Seen::as_large(file.check(input), input)
}

/// Pixels are decoded to 8 bytes each, whatever the file has.
fn claimed(input: &[u8], pixels: fn(&[u8]) -> Option<usize>) -> usize {
    // What cannot read a header may panic at it, as long as the reader does not.
    let pixels = catch_unwind(|| pixels(input)).ok().flatten().unwrap_or(0);
    pixels.saturating_mul(8).min(input.len() * EXPANSION)
}

/// Deflate makes a byte of 1032 at the most; arrays of bytes are read as numbers of 8 bytes.
fn packed(input: &[u8]) -> usize {
    input.len() * 1032 * 8
}

fn of_png(input: &[u8]) -> Option<usize> {
    let number = |at: usize| Some(u32::from_be_bytes(*input.get(at..)?.first_chunk()?) as usize);
    number(16)?.checked_mul(number(20)?)?.checked_mul(4)
}

fn of_tiff(input: &[u8]) -> Option<usize> {
    let size = tiff::decoder::Decoder::new(Cursor::new(input)).ok()?.dimensions().ok()?;
    (size.0 as usize).checked_mul(size.1 as usize)?.checked_mul(4)
}

fn of_exr(input: &[u8]) -> Option<usize> {
    let header = exr::meta::MetaData::read_from_buffered(input, false).ok()?.headers.into_iter().next()?;
    let size = header.layer_size;
    size.0.checked_mul(size.1)?.checked_mul(header.channels.list.len())
}

pub fn png_of(columns: u32, rows: u32, depth: BitDepth, colour: ColorType) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, columns, rows);
    encoder.set_color(colour);
    encoder.set_depth(depth);
    let length = colour.samples() * (depth as usize) / 8 * (columns * rows) as usize;
    let data: Vec<u8> = (0..length).map(|i| (i * 37 % 251) as u8).collect();
    let mut writer = encoder.write_header().expect("a header of our own");
    writer.write_image_data(&data).expect("as many bytes as the header says");
    writer.finish().expect("it is written to memory");
    bytes
}

/// A stream of zeros in zlib's format, a thousandth as long: the data of an even picture.
fn zlib_of_zeros(mebibytes: u32) -> Vec<u8> {
    let mut bytes = Vec::new();
    let encoder = png::Encoder::new(&mut bytes, 1023, 1024 * mebibytes);
    let mut writer = encoder.write_header().expect("a header of our own");
    writer.write_image_data(&vec![0; (1023 * 1024 * mebibytes) as usize]).expect("as many bytes as the header says");
    writer.finish().expect("it is written to memory");
    let mut at = 8;
    let mut data = Vec::new();
    while let Some(head) = bytes.get(at..at + 8) {
        let length = u32::from_be_bytes(*head.first_chunk().expect("8 bytes")) as usize;
        if &head[4..] == b"IDAT" {
            data.extend(&bytes[at + 8..at + 8 + length]);
        }
        at += 12 + length;
    }
    data
}

/// A PNG with a chunk more, behind its header; its checksum is made right.
fn with_chunk(mut png: Vec<u8>, kind: &[u8; 4], data: &[u8]) -> Vec<u8> {
    let chunk = [&(data.len() as u32).to_be_bytes()[..], kind, data, &[0; 4]].concat();
    drop(png.splice(33..33, chunk));
    crate::checksums::png(&mut png);
    png
}

fn pngs() -> Vec<Vec<u8>> {
    let grey = |depth| png_of(SIZE.0 as u32, SIZE.1 as u32, depth, ColorType::Grayscale);
    let profile = [&b"k\0\0"[..], &zlib_of_zeros(40)].concat();
    vec![
        grey(BitDepth::Eight),
        grey(BitDepth::Sixteen),
        png_of(7, 5, BitDepth::Eight, ColorType::GrayscaleAlpha),
        with_chunk(grey(BitDepth::Eight), b"tEXt", b"Title\0a picture"),
        // 40 MiB of zeros in 100 kB, as a colour profile that nobody asks for.
        with_chunk(grey(BitDepth::Eight), b"iCCP", &profile),
        with_chunk(grey(BitDepth::Eight), b"zTXt", &profile),
    ]
}

fn tiffs() -> Vec<Vec<u8>> {
    let (columns, rows) = (SIZE.0 as u32, SIZE.1 as u32);
    let count = SIZE.0 * SIZE.1;
    let bytes: Vec<u8> = (0..count).map(|i| (i * 7) as u8).collect();
    let words: Vec<u16> = (0..count).map(|i| (i * 700) as u16).collect();
    let floats: Vec<f32> = (0..count).map(|i| i as f32 / 40.0).collect();
    let mut all = Vec::new();
    for kind in 0..3 {
        for compression in
            [Packing::Uncompressed, Packing::Deflate(DeflateLevel::default()), Packing::Lzw, Packing::Packbits]
        {
            let mut file = Cursor::new(Vec::new());
            let encoder = TiffEncoder::new(&mut file).expect("it is written to memory");
            let mut encoder = encoder.with_compression(compression);
            let done = match kind {
                0 => encoder.write_image::<colortype::Gray8>(columns, rows, &bytes),
                1 => encoder.write_image::<colortype::Gray16>(columns, rows, &words),
                _ => encoder.write_image::<colortype::Gray32Float>(columns, rows, &floats),
            };
            done.expect("it is written to memory");
            all.push(file.into_inner());
        }
    }
    all
}

/// As NumPy, SciPy and ImageMagick write them.
fn arrays() -> Vec<Vec<u8>> {
    macro_rules! files {
        ($($name:literal),*) => {
            vec![$(include_bytes!(concat!("../../../stages/import/tests/data/", $name)).to_vec()),*]
        };
    }
    files![
        "u8.npy",
        "f32.npy",
        "i16_big.npy",
        "fortran.npy",
        "one.npz",
        "plain.mat",
        "spaces.txt",
        "commas.csv",
        "grey.bmp",
        "grey.pgm",
        "grey16.pgm"
    ]
}

fn exrs() -> Vec<Vec<u8>> {
    let compressions = [
        Compression::Uncompressed,
        Compression::RLE,
        Compression::ZIP1,
        Compression::ZIP16,
        Compression::PIZ,
        Compression::PXR24,
        Compression::B44,
    ];
    let of = |size: (usize, usize), compression, blocks, samples: FlatSamples| {
        let encoding = Encoding { compression, blocks, line_order: LineOrder::Increasing };
        let channels = AnyChannels::sort([AnyChannel::new("Y", samples)].into_iter().collect());
        let image = Image::from_layer(Layer::new(size, LayerAttributes::default(), encoding, channels));
        let mut bytes = Vec::new();
        image.write().non_parallel().to_buffered(Cursor::new(&mut bytes)).expect("it is written to memory");
        bytes
    };
    let pixel = |i: usize| (i * 13 % 29) as f32 / 29.0;
    let floats = |size: (usize, usize)| FlatSamples::F32((0..size.0 * size.1).map(pixel).collect());
    let halves = |size: (usize, usize)| {
        FlatSamples::F16((0..size.0 * size.1).map(|i| exr::prelude::f16::from_f32(pixel(i))).collect())
    };
    let large = (20, 33);
    let mut all: Vec<Vec<u8>> = compressions.iter().map(|&c| of(SIZE, c, Blocks::ScanLines, floats(SIZE))).collect();
    all.extend(compressions.iter().map(|&c| of(large, c, Blocks::ScanLines, halves(large))));
    all.push(of(large, Compression::ZIP16, Blocks::Tiles((8, 8).into()), floats(large)));
    // 1 MB, of zeros but for a pixel, in 4 kB.
    let zeros = FlatSamples::F32((0..512 * 512).map(|i| f32::from(u8::from(i == 0))).collect());
    all.push(of((512, 512), Compression::ZIP16, Blocks::ScanLines, zeros));
    all
}
