//! Laws of exported files: known bytes, numbers that come back, errors that leave nothing behind.

use std::path::Path;

use ndarray::array;
use serde_json::json;
use turbid_contract::{Artifact, ArtifactKind, Cells, ImageStack, LayerInfo, LayerKind, Record, Table};

use super::{Format, export};

fn images() -> Artifact {
    let mut stack = ImageStack::new(2, 3);
    let mut info = LayerInfo::value("m_ac", "W mm^-2 sr^-1").with_f_x(0.1);
    info.phase_rad = Some(1.0 / 3.0);
    stack.push(info.clone(), array![[0.0, 1.5, -2.25], [1e-30, f32::MAX, 1.0 / 3.0]]);
    stack.push(info.standard_error(), array![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
    // Column by column in memory: files must not notice.
    stack
        .push(LayerInfo::new("mask", LayerKind::Mask, "1"), array![[0.0, 4.0], [1.0, 0.0], [0.0, 9.0]].reversed_axes());
    stack.attributes.insert("objects".into(), json!(["Gewebe, gesund", "µ \"x\""]));
    stack.attributes.insert("g".into(), json!(0.8));
    Artifact::Images(stack)
}

fn table() -> Artifact {
    let mut table = Table::default();
    table.push("region", "", Cells::Text(vec!["all".into(), "a, \"b\"\nµ".into()]));
    table.push("mu_a", "mm^-1", Cells::F64(vec![0.1, 1e-300]));
    table.push("n", "1", Cells::I64(vec![-3, i64::MAX]));
    table.push("good", "1", Cells::Bool(vec![true, false]));
    table.push("units", "1", Cells::F64(vec![f64::NAN, f64::NEG_INFINITY]));
    table.attributes.insert("thickness".into(), json!(null));
    table.attributes.insert("f_x".into(), json!([0.0, 0.1]));
    Artifact::Table(table)
}

fn record() -> Artifact {
    let fields =
        [("name", json!("slab")), ("n", json!(1.4)), ("count", json!(3)), ("camera", json!({"pixels": [64, 32]}))];
    Artifact::Record(Record { fields: fields.map(|(k, v)| (k.to_owned(), v)).into() })
}

fn encode(artifact: &Artifact, format: Format) -> Vec<u8> {
    let mut bytes = Vec::new();
    super::encode(artifact, format, std::io::Cursor::new(&mut bytes)).unwrap();
    bytes
}

fn text(artifact: &Artifact) -> String {
    String::from_utf8(encode(artifact, Format::Csv)).unwrap()
}

#[test]
fn csv_reads_as_expected() {
    assert_eq!(
        text(&table()),
        "region,mu_a,n,good,units\nall,0.1,-3,true,NaN\n\"a, \"\"b\"\"\nµ\",1e-300,9223372036854775807,false,-inf\n"
    );
    assert_eq!(text(&record()), "field,value\ncamera,\"{\"\"pixels\"\":[64,32]}\"\ncount,3\nn,1.4\nname,slab\n");
    let images = text(&images());
    let lines: Vec<&str> = images.lines().collect();
    assert_eq!(lines.len(), 1 + 3 * 6);
    assert_eq!(lines[1], "0,m_ac,value,W mm^-2 sr^-1,0.1,0.3333333333333333,,,0,0,0.0");
    assert_eq!(lines[18], "2,mask,mask,1,,,,,1,2,9.0");
    // The shortest digits that give the f32 back.
    let back: Vec<f32> = lines[1..7].iter().map(|l| l.rsplit(',').next().unwrap().parse().unwrap()).collect();
    assert_eq!(back, [0.0, 1.5, -2.25, 1e-30, f32::MAX, 1.0 / 3.0]);
}

/// Little-endian number at an offset.
fn u32_at(bytes: &[u8], at: usize) -> usize {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
}

/// Follows the chain of directories as a reader does, and finds every pixel and description.
#[test]
fn tiff_pages_come_back() {
    let artifact = images();
    let Artifact::Images(stack) = &artifact else { unreachable!() };
    let bytes = encode(&artifact, Format::Tiff);
    assert_eq!(&bytes[..4], b"II*\0");
    let mut directory = u32_at(&bytes, 4);
    for (index, layer) in stack.layers.iter().enumerate() {
        assert_eq!(directory % 2, 0, "directories start on even bytes");
        let count = usize::from(u16::from_le_bytes([bytes[directory], bytes[directory + 1]]));
        let tags: Vec<u16> = (0..count)
            .map(|i| u16::from_le_bytes([bytes[directory + 2 + 12 * i], bytes[directory + 3 + 12 * i]]))
            .collect();
        assert!(tags.is_sorted(), "{tags:?}");
        let at = |tag: u16| directory + 2 + 12 * tags.iter().position(|t| *t == tag).unwrap();
        let value = |tag| u32_at(&bytes, at(tag) + 8);
        assert_eq!([value(256), value(257), value(258), value(339)], [3, 2, 32, 3]);
        let data = &bytes[value(273)..value(273) + value(279)];
        let pixels: Vec<f32> = data.chunks(4).map(|c| f32::from_le_bytes(c.try_into().unwrap())).collect();
        assert_eq!(pixels, layer.data.iter().copied().collect::<Vec<_>>());
        let about = &bytes[value(270)..value(270) + u32_at(&bytes, at(270) + 4)];
        assert!(about.is_ascii() && about.ends_with(&[0]));
        let about: serde_json::Value = serde_json::from_slice(&about[..about.len() - 1]).unwrap();
        assert_eq!(serde_json::from_value::<LayerInfo>(about.clone()).unwrap(), layer.info);
        assert_eq!(about.get("attributes").is_some(), index == 0);
        directory = u32_at(&bytes, directory + 2 + 12 * count);
    }
    assert_eq!(directory, 0, "the last page has no successor");
}

/// The binary files that NumPy 2, SciPy 1 and tifffile were seen to read back (see docs/export.md) have these bytes.
#[test]
fn golden_bytes() {
    let digest = |artifact: &Artifact, format| blake3::hash(&encode(artifact, format)).to_hex()[..16].to_owned();
    let found: Vec<String> = [images(), table(), record()]
        .iter()
        .flat_map(|a| [Format::Npz, Format::Mat].map(|format| digest(a, format)))
        .chain([digest(&images(), Format::Tiff)])
        .collect();
    let seen = [
        "a0a8c6d60011ceb5",
        "df5dd72a1f3f6ea9",
        "98971a9a77201178",
        "11ee3e23cd4e3407",
        "875a41026b2ba4df",
        "2918b2b971ca5a3e",
        "728f6edf5e4ac69f",
    ];
    assert_eq!(found, seen);
}

/// Entries of the archive start where the directory says, and their checksums hold.
#[test]
fn npz_is_a_sound_archive() {
    for artifact in [images(), table(), record()] {
        let bytes = encode(&artifact, Format::Npz);
        let end = bytes.len() - 22;
        assert_eq!(&bytes[end..end + 4], b"PK\x05\x06");
        let entries = usize::from(u16::from_le_bytes([bytes[end + 10], bytes[end + 11]]));
        let mut at = u32_at(&bytes, end + 16);
        for _ in 0..entries {
            assert_eq!(&bytes[at..at + 4], b"PK\x01\x02");
            let (crc, size, name) =
                (u32_at(&bytes, at + 16), u32_at(&bytes, at + 24), u32_at(&bytes, at + 28) & 0xffff);
            let local = u32_at(&bytes, at + 42);
            assert_eq!(&bytes[local..local + 4], b"PK\x03\x04");
            assert_eq!(bytes[local + 30..local + 30 + name], bytes[at + 46..at + 46 + name]);
            let content = &bytes[local + 30 + name..local + 30 + name + size];
            assert_eq!(crc32fast::hash(content) as usize, crc);
            assert!(content.starts_with(b"\x93NUMPY\x01\x00"));
            let header = usize::from(u16::from_le_bytes([content[8], content[9]]));
            assert!((10 + header).is_multiple_of(64) && content[9 + header] == b'\n');
            at += 46 + name;
        }
        assert_eq!(at, end);
    }
}

#[test]
fn files_are_replaced_whole_and_errors_leave_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let to = |name: &str| folder.path().join(name);
    for (artifact, kind) in
        [(images(), ArtifactKind::Images), (table(), ArtifactKind::Table), (record(), ArtifactKind::Record)]
    {
        for format in Format::ALL.into_iter().filter(|f| f.takes(kind)) {
            let path = to(&format!("x.{}", format.extension()));
            std::fs::write(&path, "before").unwrap();
            export(&artifact, &path).unwrap();
            assert_eq!(std::fs::read(&path).unwrap(), encode(&artifact, format));
            std::fs::remove_file(path).unwrap();
        }
    }
    std::fs::create_dir(to("folder.csv")).unwrap();
    for (artifact, name, says) in [
        (images(), "x.png", "`.png` is not a format of export; known: .npz, .tiff, .csv, .mat"),
        (images(), "x", "the name has no ending; known: .npz"),
        (table(), "x.TIF", "a table cannot be a .tiff file; for a table: .npz, .csv, .mat"),
        (record(), "x.tiff", "a record cannot be a .tiff file"),
        (table(), "missing/x.csv", "cannot be written: "),
        (table(), "folder.csv", "it is a folder"),
    ] {
        let error = export(&artifact, &to(name)).unwrap_err().to_string();
        assert!(error.contains(says) && error.contains(name), "{error}");
    }
    let left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(left, ["folder.csv"]);
    assert_eq!(Format::of(Path::new("A.MAT"), ArtifactKind::Record).unwrap(), Format::Mat);
}

/// The pitch of pixels is in every format that has a place for it: an array in npz and mat, the resolution in TIFF (pixels per cm).
#[test]
fn pixels_keep_their_pitch() {
    let Artifact::Images(mut stack) = images() else { unreachable!() };
    let without = [Format::Npz, Format::Mat].map(|f| encode(&Artifact::Images(stack.clone()), f));
    assert!(without.iter().all(|bytes| !bytes.windows(14).any(|w| w == b"pixel_pitch_mm")));
    stack.attributes.insert("pixel_pitch_mm".into(), json!([0.32, 1.25]));
    let artifact = Artifact::Images(stack);
    let numbers = [0.32_f64, 1.25].map(f64::to_le_bytes).concat();
    for format in [Format::Npz, Format::Mat] {
        let bytes = encode(&artifact, format);
        // The last variable of the file; zip has its directory behind it.
        let data = bytes.windows(16).rposition(|w| w == numbers).expect("the numbers are in the file");
        let name = bytes[..data].windows(14).rposition(|w| w == b"pixel_pitch_mm").expect("their name is before them");
        assert!(data - name < 150, "{format:?}: the name stands before its numbers");
    }
    let bytes = encode(&artifact, Format::Tiff);
    let directory = u32_at(&bytes, 4);
    let entry = |tag: u16| {
        let count = usize::from(u16::from_le_bytes([bytes[directory], bytes[directory + 1]]));
        let mut entries = (0..count).map(|i| &bytes[directory + 2 + 12 * i..directory + 14 + 12 * i]);
        entries.find(|e| u16::from_le_bytes([e[0], e[1]]) == tag).map(|e| u32_at(e, 8)).expect("the page has the tag")
    };
    let resolution = |tag| f64::from(u32_at(&bytes, entry(tag)) as u32) / u32_at(&bytes, entry(tag) + 4) as f64;
    assert_eq!(([resolution(282), resolution(283)], entry(296)), ([31.25, 8.0], 3));
}

/// Resolutions from nanometres to a kilometre a pixel come back to four digits or more; what 32 bits cannot hold is left out.
#[test]
fn resolutions_fit_their_bits() {
    for pitch in [1e-6, 0.0033, 1.0 / 3.0, 1.0, 12.7, 1e6] {
        let [numerator, denominator] = super::tiff::per_cm(pitch).unwrap();
        let back = 10.0 / (f64::from(numerator) / f64::from(denominator));
        assert!((back / pitch - 1.0).abs() < 1e-4, "{pitch}: {numerator} / {denominator}");
    }
    assert_eq!([1e-300, 1e300].map(super::tiff::per_cm), [None; 2]);
}

/// What a killed export left beside its target goes with the next export to it; files of other targets stay.
#[test]
fn leftovers_of_a_killed_export_go_with_the_next() {
    let folder = tempfile::tempdir().unwrap();
    let to = folder.path().join("e.csv");
    let left = folder.path().join(format!("{}left", super::temporary_prefix(&to)));
    let other = folder.path().join(format!("{}left", super::temporary_prefix(Path::new("other.csv"))));
    [&left, &other].iter().for_each(|path| std::fs::write(path, "half").unwrap());
    export(&table(), &to).unwrap();
    assert_eq!([&to, &left, &other].map(|path| path.exists()), [true, false, true]);
}
