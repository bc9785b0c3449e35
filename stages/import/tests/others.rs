//! Pictures that NumPy, tifffile and ImageMagick wrote (`tests/data/make.py`), read number by number.

use std::path::Path;

use turbid_import::{Channel, Numbers, Picture, Raw, RawType, Wanted, decode, pages};

const ROWS: usize = 5;
const COLUMNS: usize = 7;

fn bytes(name: &str) -> Vec<u8> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name);
    std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Pixel (r, c) holds 10 r + c, in a page p 1000 p more.
fn ramp() -> impl Iterator<Item = u16> {
    (0..ROWS as u16).flat_map(|r| (0..COLUMNS as u16).map(move |c| 10 * r + c))
}

fn bytes_of_ramp(more: u16) -> Numbers {
    Numbers::U8(ramp().map(|n| (n + more) as u8).collect())
}

fn page(p: u16) -> Numbers {
    Numbers::U16(ramp().map(|n| n + 1000 * p).collect())
}

fn signed() -> Numbers {
    Numbers::I16(ramp().map(|n| n as i16 - 20).collect())
}

fn doubles() -> Numbers {
    Numbers::F64(ramp().map(|n| f64::from(n) / 64.0).collect())
}

fn read(name: &str, wanted: Wanted<'_>) -> Picture {
    let picture = decode(&bytes(name), wanted).unwrap_or_else(|error| panic!("{name}: {error}"));
    assert_eq!((picture.rows, picture.columns), (ROWS, COLUMNS), "{name}");
    picture
}

#[test]
fn numbers_are_those_that_were_written() {
    let float = Numbers::F32(ramp().map(|n| f32::from(n) / 64.0).collect());
    for (name, numbers, highest) in [
        ("u8.npy", bytes_of_ramp(0), Some(255.0)),
        ("i16_big.npy", signed(), Some(32767.0)),
        ("f32.npy", float, None),
        ("fortran.npy", page(0), Some(65535.0)),
        ("one.npz", page(0), Some(65535.0)),
        ("plain.mat", page(0), Some(65535.0)),
        ("spaces.txt", doubles(), None),
        ("commas.csv", doubles(), None),
        ("i16.tif", signed(), Some(32767.0)),
        ("deflate.tif", page(0), Some(65535.0)),
        ("upside_down.tif", page(0), Some(65535.0)),
        ("grey.pgm", bytes_of_ramp(0), Some(255.0)),
        ("grey.bmp", bytes_of_ramp(0), Some(255.0)),
        // ImageMagick spreads 8 bit over 16: 257 for each number.
        ("grey16.pgm", Numbers::U16(ramp().map(|n| 257 * n).collect()), Some(65535.0)),
    ] {
        let picture = read(name, Wanted::default());
        assert_eq!((picture.values, picture.highest), (numbers, highest), "{name}");
    }
    for name in ["planar.tif", "colours.bmp"] {
        for (channel, more) in [(Channel::Red, 0), (Channel::Green, 100), (Channel::Blue, 200)] {
            let picture = read(name, Wanted { channel: Some(channel), ..Wanted::default() });
            assert_eq!(picture.values, bytes_of_ramp(more), "{name}, {channel:?}");
        }
    }
}

#[test]
fn arrays_are_found_by_their_names() {
    let float = Numbers::F32(ramp().map(|n| f32::from(n) / 64.0).collect());
    let named = |variable| Wanted { variable: Some(variable), ..Wanted::default() };
    assert_eq!(read("two.npz", named("mu_a")).values, float);
    assert_eq!(read("two.npz", Wanted { page: Some(2), ..named("pages") }).values, page(2));
    assert_eq!(pages(&bytes("two.npz"), Some("pages"), None), Ok(3));
    let packed = read("packed.mat", named("f64"));
    assert_eq!((packed.values, packed.highest), (doubles(), None));
    assert_eq!(read("packed.mat", named("i16")).values, signed());
    for (name, variable, said) in [
        ("two.npz", None, "it holds several arrays: say which by `variable`: mu_a, pages"),
        ("two.npz", Some("mua"), "it holds no array `mua`; it holds mu_a, pages"),
        ("packed.mat", None, "it holds several arrays: say which by `variable`: f64, i16"),
        ("packed.mat", Some("mua"), "it holds no array `mua` of numbers; it holds name, complex, one, f64, i16"),
        ("packed.mat", Some("complex"), "it holds no array `complex` of numbers"),
        ("u8.npy", Some("a"), "its picture has no name"),
        ("i16.tif", Some("a"), "its picture has no name"),
    ] {
        let found = decode(&bytes(name), Wanted { variable, ..Wanted::default() }).unwrap_err();
        assert!(found.contains(said), "{name}: {found}");
    }
}

#[test]
fn pages_are_read_one_by_one() {
    let raw = Raw { dtype: RawType::Uint16, size: [COLUMNS as u32, ROWS as u32], offset: 0, big_endian: false };
    for (name, raw) in [
        ("pages.tif", None),
        ("pages_big.tif", None),
        ("pages_u16.npy", None),
        ("fortran_pages.npy", None),
        ("pages.mat", None),
        ("pages.raw", Some(raw)),
    ] {
        assert_eq!(pages(&bytes(name), None, raw), Ok(3), "{name}");
        for p in 0..3 {
            let picture = read(name, Wanted { page: Some(p), raw, ..Wanted::default() });
            assert_eq!(picture.values, page(p as u16), "{name}, page {p}");
        }
        let beyond = decode(&bytes(name), Wanted { page: Some(3), raw, ..Wanted::default() }).unwrap_err();
        assert_eq!(beyond, "it has 3 pages, and page 4 is asked for", "{name}");
        if raw.is_none() {
            let none = decode(&bytes(name), Wanted::default()).unwrap_err();
            assert!(none.contains("it has 3 pages, and a frame is one picture"), "{name}: {none}");
        }
    }
}

/// Every file of this folder, cut short at every byte, is refused or (where a picture ends before the file) read as it was; other kinds are named.
#[test]
fn wrong_files_are_named() {
    let red = Wanted { channel: Some(Channel::Red), ..Wanted::default() };
    for (name, wanted) in [
        ("u8.npy", Wanted::default()),
        ("f32.npy", Wanted::default()),
        ("one.npz", Wanted::default()),
        ("two.npz", Wanted { variable: Some("mu_a"), ..Wanted::default() }),
        ("plain.mat", Wanted::default()),
        ("packed.mat", Wanted { variable: Some("f64"), ..Wanted::default() }),
        ("i16.tif", Wanted::default()),
        ("deflate.tif", Wanted::default()),
        ("grey.pgm", Wanted::default()),
        ("grey.bmp", Wanted::default()),
        ("colours.bmp", red),
        ("pages.tif", Wanted { page: Some(2), ..Wanted::default() }),
        ("pages_big.tif", Wanted { page: Some(2), ..Wanted::default() }),
    ] {
        let (whole, picture) = (bytes(name), read(name, wanted));
        for cut in 0..whole.len() {
            if let Ok(found) = decode(&whole[..cut], wanted) {
                assert_eq!(found, picture, "{name} cut at {cut}");
            }
        }
        assert!(decode(&whole[..whole.len() / 2], wanted).is_err(), "{name}");
    }
    let changed = |name: &str, at: usize, to: &[u8]| {
        let mut bytes = bytes(name);
        bytes[at..at + to.len()].copy_from_slice(to);
        bytes
    };
    for (bytes, wanted, said) in [
        (bytes("palette.tif"), Wanted::default(), "it has a palette of colours"),
        (bytes("planar.tif"), Wanted::default(), "it is coloured"),
        (bytes("grey.pgm"), red, "it is grey"),
        (bytes("u8.npy"), red, "it is grey"),
        (bytes("colours.bmp"), Wanted::default(), "it is coloured"),
        (bytes("u8.npy"), Wanted { page: Some(1), ..Wanted::default() }, "it has 1 page, and page 2"),
        (bytes("grey.bmp"), Wanted { page: Some(1), ..Wanted::default() }, "it has 1 page, and page 2"),
        (changed("grey.bmp", 18, &[0xff; 4]), Wanted::default(), "0 x 5 pixels"),
        (changed("grey.bmp", 18, &[0xff, 0xff, 0xff, 0x0f]), Wanted::default(), "pixels; from 1 to"),
        (changed("grey.bmp", 30, &[1]), Wanted::default(), "packing 1"),
        (changed("u8.npy", 6, &[9]), Wanted::default(), "of version 9"),
        (changed("u8.npy", 8, &[0xff, 0xff]), Wanted::default(), "cut off within its header"),
        (b"MATLAB 5.0 MAT-file".to_vec(), Wanted::default(), "cut off within its header"),
        (b"MATLAB 7.3 MAT-file".to_vec(), Wanted::default(), "it is HDF5"),
        (b"\x89HDF\r\n".to_vec(), Wanted::default(), "it is HDF5"),
        (vec![0xff, 0xd8, 0xff, 0xe0], Wanted::default(), "it is a JPEG"),
        (b"GIF89a".to_vec(), Wanted::default(), "neither PNG"),
        (Vec::new(), Wanted::default(), "neither PNG"),
        (b"PK\x03\x04 no archive".to_vec(), Wanted::default(), "it is a damaged archive"),
        (changed("plain.mat", 126, b"MI"), Wanted::default(), "big-endian"),
        (changed("packed.mat", 200, &[0xff; 8]), Wanted::default(), "cut off or damaged"),
        (b"1, 2, 3\n4, 5\n".to_vec(), Wanted::default(), "line 2 has 2 cells, the first has 3"),
        (b"1, 2, 3\n4, 5, inn\n".to_vec(), Wanted::default(), "line 2, cell 3: `inn` is no number"),
        (b"1,,3\n".to_vec(), Wanted::default(), "line 1, cell 2: `` is no number"),
        (b"P2\n1 1\n255\n7\n".to_vec(), Wanted::default(), "PGM (P5)"),
        (b"P5\n1 1\n0\n7".to_vec(), Wanted::default(), "its highest number is 0"),
    ] {
        let found = decode(&bytes, wanted).expect_err("it is wrong");
        assert!(found.contains(said), "{found} for {said}");
    }
}
