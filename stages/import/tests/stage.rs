//! Files as cameras and programs write them, the correction by dark and flat field, and every mistake.

use std::io::Cursor;
use std::sync::Arc;

use serde_json::{Value, json};
use turbid_contract::kit::Inputs;
use turbid_contract::payload::{Frames, MaskReason, Rig};
use turbid_contract::{Ctx, Error, ImageStack, Known, LayerKind, MemoryHost, Payload, Problems, StageRow};
use turbid_import::{Channel, ImportFrames, Picture, Wanted};

#[path = "stage/darkness.rs"]
mod darkness;
#[path = "stage/forms.rs"]
mod forms;

fn decode(bytes: &[u8], channel: Option<Channel>) -> Result<Picture, String> {
    turbid_import::decode(bytes, Wanted { channel, ..Wanted::default() })
}

const ROWS: usize = 6;
const COLUMNS: usize = 8;

fn png(colour: png::ColorType, depth: png::BitDepth, data: &[u8], rows: usize) -> Arc<[u8]> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, COLUMNS as u32, rows as u32);
    encoder.set_color(colour);
    encoder.set_depth(depth);
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(data).unwrap();
    writer.finish().unwrap();
    bytes.into()
}

fn grey8(value: impl Fn(usize) -> u8) -> Arc<[u8]> {
    let data: Vec<u8> = (0..ROWS * COLUMNS).map(value).collect();
    png(png::ColorType::Grayscale, png::BitDepth::Eight, &data, ROWS)
}

fn tiff<C: tiff::encoder::colortype::ColorType>(data: &[C::Inner]) -> Vec<u8>
where
    [C::Inner]: tiff::encoder::TiffValue,
{
    let mut bytes = Cursor::new(Vec::new());
    tiff::encoder::TiffEncoder::new(&mut bytes).unwrap().write_image::<C>(COLUMNS as u32, ROWS as u32, data).unwrap();
    bytes.into_inner()
}

fn tiff16(value: impl Fn(usize) -> u16) -> Arc<[u8]> {
    let data: Vec<u16> = (0..ROWS * COLUMNS).map(value).collect();
    tiff::<tiff::encoder::colortype::Gray16>(&data).into()
}

fn import(params: &Value, files: &[(&str, Arc<[u8]>)]) -> Result<ImageStack, Error> {
    let files = files.iter().map(|(at, bytes)| ((*at).to_owned(), bytes.clone())).collect();
    let host = MemoryHost { files, ..MemoryHost::default() };
    let outputs = StageRow::of::<ImportFrames>().run(params, &Inputs::none(), Ctx::new(&host))?;
    Ok(Frames::from_artifact(outputs.into_iter().next().unwrap().1).unwrap().0)
}

/// What `check` says of params and files, a line each.
fn check(params: &Value, files: &[(&str, Arc<[u8]>)]) -> String {
    let mut problems = Problems::default();
    let files = files.iter().map(|(at, bytes)| ((*at).to_owned(), bytes.clone())).collect();
    StageRow::of::<ImportFrames>().check(params, &Known { files, ..Known::default() }, &mut problems);
    problems.into_parts().0.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")
}

/// The same ramp in every kind of file: numbers come back as they were written, with the highest that there is.
#[test]
fn every_kind_of_file_is_read() {
    use tiff::encoder::colortype::{Gray8, Gray32, Gray32Float, RGB16};
    let n = ROWS * COLUMNS;
    let ramp = |top: f64| (0..n).map(move |i| (top * i as f64 / n as f64).floor());
    let bytes: Vec<u8> = ramp(255.0).map(|v| v as u8).collect();
    let words: Vec<u16> = ramp(65535.0).map(|v| v as u16).collect();
    let long: Vec<u32> = ramp(4e9).map(|v| v as u32).collect();
    let float: Vec<f32> = ramp(1e6).map(|v| v as f32 * 1e-9).collect();
    let big_endian: Vec<u8> = words.iter().flat_map(|w| w.to_be_bytes()).collect();
    let coloured: Vec<u16> = words.iter().flat_map(|&w| [1, w, 3]).collect();
    let mut exr = Cursor::new(Vec::new());
    {
        use exr::prelude::{SpecificChannels, WritableImage};
        let pixel = |at: exr::prelude::Vec2<usize>| (float[at.1 * COLUMNS + at.0],);
        let channels = SpecificChannels::build().with_channel("Y").with_pixel_fn(pixel);
        exr::prelude::Image::from_channels((COLUMNS, ROWS), channels).write().to_buffered(&mut exr).unwrap();
    }
    type Case = (&'static str, Vec<u8>, Option<Channel>, Option<f64>, Vec<f64>);
    let cases: [Case; 7] = [
        ("png 8", grey8(|i| bytes[i]).to_vec(), None, Some(255.0), bytes.iter().map(|&v| f64::from(v)).collect()),
        (
            "png 16",
            png(png::ColorType::Grayscale, png::BitDepth::Sixteen, &big_endian, ROWS).to_vec(),
            None,
            Some(65535.0),
            words.iter().map(|&v| f64::from(v)).collect(),
        ),
        ("tiff 8", tiff::<Gray8>(&bytes), None, Some(255.0), bytes.iter().map(|&v| f64::from(v)).collect()),
        ("tiff 32", tiff::<Gray32>(&long), None, Some(4_294_967_295.0), long.iter().map(|&v| f64::from(v)).collect()),
        ("tiff float", tiff::<Gray32Float>(&float), None, None, float.iter().map(|&v| f64::from(v)).collect()),
        (
            "tiff rgb",
            tiff::<RGB16>(&coloured),
            Some(Channel::Green),
            Some(65535.0),
            words.iter().map(|&v| f64::from(v)).collect(),
        ),
        ("exr", exr.into_inner(), None, None, float.iter().map(|&v| f64::from(v)).collect()),
    ];
    for (name, bytes, channel, highest, values) in cases {
        let picture = decode(&bytes, channel).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!((picture.rows, picture.columns, picture.highest), (ROWS, COLUMNS, highest), "{name}");
        assert_eq!(picture.values.iter().collect::<Vec<_>>(), values, "{name}");
        // Cut anywhere it is refused, never read in part and never a panic.
        for cut in [9, bytes.len() / 2, bytes.len() - 5] {
            assert!(
                decode(&bytes[..cut], channel).is_err() || name == "tiff 8" || cut + 5 == bytes.len(),
                "{name} cut at {cut}"
            );
        }
    }
    let rgb = tiff::<RGB16>(&coloured);
    assert!(decode(&rgb, None).unwrap_err().contains("say `channel: red`"));
    assert!(decode(&grey8(|_| 1), Some(Channel::Red)).unwrap_err().contains("leave `channel` out"));
    assert!(decode(b"GIF89a", None).unwrap_err().contains("neither PNG, TIFF, EXR, BMP"));
}

/// Frame = (number - dark) / response: a scene behind vignette and offset comes back, whatever the exposure; saturated and
/// dead pixels are masked in all frames and hold 0.
#[test]
fn dark_and_flat_are_taken_off() {
    let scene = |i: usize, phase: f64| 0.3 + 0.1 * libm::cos(0.7 * i as f64 + phase);
    let vignette = |i: usize| if i == 5 { 0.001 } else { 1.0 - 0.01 * (i % COLUMNS) as f64 };
    let dark = |i: usize| 1000.0 + 3.0 * (i / COLUMNS) as f64;
    let number = move |i: usize, light: f64| {
        let level = dark(i) + 40_000.0 * light * vignette(i);
        if i == 11 { 65_535 } else { level.round() as u16 }
    };
    let turn = 2.0 * std::f64::consts::PI / 3.0;
    let mut files = vec![
        ("dark", tiff16(|i| dark(i) as u16)),
        ("flat", tiff16(|i| (dark(i) + 50_000.0 * vignette(i)).round() as u16)),
    ];
    let names = ["frames.0.file", "frames.1.file", "frames.2.file"];
    let exposures = [0.0, 1.0, -1.0];
    let mut listed = Vec::new();
    for (k, exposure) in exposures.into_iter().enumerate() {
        let light = libm::exp2(exposure);
        files.push((names[k], tiff16(move |i| number(i, 0.4 * light * scene(i, turn * k as f64)))));
        listed.push(
            json!({"file": "a.tif", "f_x": 0.1, "phase_deg": 120 * k, "exposure": exposure, "wavelength_nm": 635}),
        );
    }
    let params = json!({"frames": listed, "dark": "d.tif", "flat": "f.tif", "full_scale": 2e-5, "full_well": 20000, "read_noise": 5});
    let stack = import(&params, &files).unwrap();
    assert_eq!(stack.layers.len(), 7);
    let mask = &stack.layers[6];
    assert_eq!((mask.info.kind, mask.info.wavelength_nm), (LayerKind::Mask, Some(635.0)));
    // The flat's mean is over all that respond; the scene is known up to it.
    let all: Vec<f64> = (0..ROWS * COLUMNS).map(vignette).collect();
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    for (k, exposure) in exposures.into_iter().enumerate() {
        let info = &stack.layers[k].info;
        assert_eq!(
            (info.f_x_per_mm, info.orientation_deg, info.unit.as_str()),
            (Some(0.1), Some(0.0), "W mm^-2 sr^-1")
        );
        assert!((info.phase_rad.unwrap() - turn * k as f64).abs() < 1e-12);
        for i in 0..ROWS * COLUMNS {
            let at = (i / COLUMNS, i % COLUMNS);
            let (value, se) = (f64::from(stack.layers[k].data[at]), f64::from(stack.layers[3 + k].data[at]));
            let reason = match i {
                5 => MaskReason::LowSignal,
                11 => MaskReason::Saturated,
                _ => MaskReason::Good,
            };
            assert_eq!(mask.data[at], reason.code());
            if reason != MaskReason::Good {
                assert_eq!((value, se), (0.0, 0.0));
                continue;
            }
            let want = 40_000.0 / 65_535.0 * 2e-5 * 0.4 * scene(i, turn * k as f64) * mean;
            // Rounding of frame, dark and flat: at most 1.5 numbers of the frame and 1 in 45,000 of the flat.
            let numbers = 40_000.0 * 0.4 * libm::exp2(exposure) * scene(i, turn * k as f64) * 0.9;
            assert!((value / want - 1.0).abs() < 1.5 / numbers + 1.0 / 45_000.0, "{value} {want}");
            let light = value / (2e-5 * libm::exp2(-exposure)) * (vignette(i) / mean);
            let variance = light / 20_000.0 + (5.0 / 20_000.0_f64).powi(2);
            assert!((se / value / (variance.sqrt() / light) - 1.0).abs() < 1e-3, "{se}");
        }
    }
}

/// A pattern names files by f_x, phase and wavelength as they stand in the pipeline; a gamma is turned back.
#[test]
fn patterns_name_files() {
    let params = json!({
        "pattern": "shots/s_{wavelength}_{f_x}_{phase}.png", "f_x": [0, 0.1], "phases": 3, "wavelength_nm": [635, 850], "gamma": 2.2
    });
    let prepared = (StageRow::of::<ImportFrames>().prepare)(&params).unwrap();
    let files = prepared.files();
    let names: Vec<&str> = files.iter().map(|f| f.path.as_str()).collect();
    assert_eq!(names.len(), 8);
    assert_eq!(
        (names[0], names[3], names[7]),
        ("shots/s_635_0_0.png", "shots/s_635_0.1_2.png", "shots/s_850_0.1_2.png")
    );
    assert!(
        prepared.canonical().unwrap().to_string().contains("\"s_{wavelength}_{f_x}_{phase}.png\""),
        "folders are not in the key"
    );
    let fields: Vec<String> = prepared.files().iter().map(|f| f.at.clone()).collect();
    let files: Vec<(&str, Arc<[u8]>)> = fields.iter().map(|at| (at.as_str(), grey8(|_| 128))).collect();
    let stack = import(&params, &files).unwrap();
    assert_eq!(stack.layers.len(), 8);
    let level = libm::pow(128.0 / 255.0, 2.2);
    assert!(
        stack
            .layers
            .iter()
            .all(|l| l.data.iter().all(|&v| (f64::from(v) / level - 1.0).abs() < 1e-6) && l.info.unit == "1")
    );
}

#[test]
fn every_mistake_has_its_field() {
    let one = |f_x: f64, phase: u32| json!({"file": "a.png", "f_x": f_x, "phase_deg": phase});
    for (params, message) in [
        (json!({}), "no files are named"),
        (
            json!({"pattern": "a_{phase}.png", "f_x": [0.1], "phases": 4_000_000_000_u32}),
            "phases: 4000000000 files are named, more than 10000",
        ),
        (json!({"pattern": "a.png"}), "pattern: a pattern needs f_x"),
        (json!({"pattern": "a.png", "f_x": [0, 0.1]}), "`a.png` names one file for all: {f_x} is missing"),
        (json!({"pattern": "a_{f_x}.png", "f_x": [0.1]}), "{phase} is missing"),
        (json!({"pattern": "a_{f_x}.png", "f_x": [0, 0]}), "f_x.1: f_x = 0 mm^-1 stands twice"),
        (
            json!({"pattern": "a_{wavelength}.png", "f_x": [0], "wavelength_nm": [650, 650]}),
            "wavelength_nm.1: wavelength_nm = 650 nm stands twice",
        ),
        (json!({"pattern": "{fx}_{phase}.png", "f_x": [0.1]}), "`{fx}_{phase}.png`: nothing stands for {fx}"),
        (
            json!({"pattern": "a_{phase}.png", "f_x": [0.1], "phases": 2}),
            "phases: two frames at f_x = 0.1 mm^-1 fix no sinusoid",
        ),
        (json!({"frames": [one(0.1, 0), one(0.1, 90)]}), "frames.0.file: two frames at f_x = 0.1"),
        (json!({"frames": [one(0.0, 0)], "pattern": "x"}), "give one of them"),
        (json!({"frames": [one(-1.0, 0)]}), "frames.0.f_x: f_x = -1 mm^-1 must be >= 0"),
        (json!({"frames": [one(0.0, 0)], "gamma": 0}), "gamma: gamma = 0 must lie in [0.1, 10]"),
        (json!({"frames": [one(0.0, 0)], "saturation": 1.2}), "saturation: saturation = 1.2 must lie in (0, 1]"),
        (json!({"frames": [one(0.0, 0)], "bits": 40}), "bits: bits = 40 bits must lie in [1, 32]"),
        (json!({"frames": [one(0.0, 0)], "read_noise": 4}), "read_noise: read_noise is in electrons"),
    ] {
        let found = check(&params, &[]);
        assert!(found.contains(message), "{params}: {found}");
    }
    let two = json!({"frames": [one(0.0, 0), one(0.0, 0)], "flat": "f.png"});
    let small = png(png::ColorType::Grayscale, png::BitDepth::Eight, &[9; 2 * COLUMNS], 2);
    let found =
        check(&two, &[("frames.0.file", grey8(|_| 7)), ("frames.1.file", small), ("flat", Arc::from(*b"no picture"))]);
    assert!(found.contains("frames.1.file: `a.png` has 8 x 2 pixels, `a.png` has 8 x 6"), "{found}");
    assert!(found.contains("flat: `f.png`: it is neither PNG, TIFF, EXR, BMP"), "{found}");
    // A camera of 12 bits in files of 16: full scale is 4095, and what is above it is no number of it.
    let twelve = |bits: u32| json!({"frames": [one(0.0, 0)], "bits": bits});
    let stack = import(&twelve(12), &[("frames.0.file", tiff16(|_| 819))]).unwrap();
    assert!(stack.layers[0].data.iter().all(|&v| v == 0.2));
    for (bits, file, message) in [
        (
            12,
            tiff16(|i| 4090 + i as u16),
            "`a.png`: it holds numbers up to 4137 of at most 65535, a camera of 12 bits writes up to 4095",
        ),
        (10, grey8(|_| 7), "of at most 255, a camera of 10 bits writes up to 1023"),
    ] {
        let found = check(&twelve(bits), &[("frames.0.file", file)]);
        assert!(found.contains(message), "{found}");
    }
    // What only the pixels show.
    let single = json!({"frames": [one(0.0, 0)], "dark": "d.png"});
    // A file may be another one by the time that the stage runs: it looks as well.
    let fails = |files: &[(&str, Arc<[u8]>)]| {
        let (found, late) = (check(&single, files), import(&single, files).unwrap_err().to_string());
        assert!(found.contains(&late), "before: {found}, later: {late}");
        found
    };
    let bright = fails(&[("frames.0.file", grey8(|i| if i < 40 { 255 } else { 9 })), ("dark", grey8(|_| 1))]);
    assert!(bright.contains("83 % of the pixels of `a.png` are saturated"), "{bright}");
    let dark = fails(&[("frames.0.file", grey8(|_| 3)), ("dark", grey8(|_| 3))]);
    assert!(dark.contains("no pixel of `a.png` is brighter than darkness"), "{dark}");
}

/// One picture listed three times (pages of it, as its author thinks): each is named where it stands, before anything runs; pages and files of their own
/// are not.
#[test]
fn what_is_hardly_meant_is_warned_of() {
    let warnings = |frames: Value| {
        let mut problems = Problems::default();
        StageRow::of::<ImportFrames>().check(&json!({ "frames": frames }), &Known::default(), &mut problems);
        let (wrong, warnings) = problems.into_parts();
        assert!(wrong.is_empty(), "{wrong:?}");
        warnings.iter().map(ToString::to_string).collect::<Vec<_>>()
    };
    let one = |file: &str, f_x: f64, phase: u32| json!({"file": file, "f_x": f_x, "phase_deg": phase});
    let found = warnings(json!([one("a.tif", 0.0, 0), one("a.tif", 0.0, 120), one("a.tif", 0.0, 240)]));
    assert_eq!(found.len(), 2, "{found:?}");
    assert!(found[0].starts_with("frames.1.file: `a.tif` stands at frames.0 too"), "{found:?}");
    assert!(found[1].starts_with("frames.2.file: `a.tif` stands at frames.0 too"), "{found:?}");
    let page = |page: u32| json!({"file": "a.tif", "f_x": 0, "phase_deg": 120 * page, "page": page});
    assert!(warnings(json!([page(1), page(2), page(3)])).is_empty());
    let fine = json!([one("a", 0.0, 0), one("b", 0.1, 0), one("c", 0.1, 120), one("d", 0.1, 240)]);
    assert!(warnings(fine).is_empty());
}

/// A pattern that has phases says that of f_x = 0 one alone is read, where that is so.
#[test]
fn the_plan_says_which_phases_are_left_out() {
    let left_out = |f_x: &[f64], phases_at_0: u32| {
        let params = json!({"pattern": "a_{f_x}_{phase}.png", "f_x": f_x, "phases_at_0": phases_at_0});
        let params = serde_json::from_value(params).unwrap();
        <ImportFrames as turbid_contract::Stage>::plan(&params, &Known::default()).left_out.join("; ")
    };
    assert!(left_out(&[0.0, 0.1], 1).contains("phases at f_x = 0 but number 0"));
    assert!(!left_out(&[0.1], 1).contains("phases"));
    assert!(!left_out(&[0.0, 0.1], 3).contains("phases"));
}

/// A file of two pages, of which one would be read silently; numbers that are no shares of full scale; numbers that are none.
#[test]
fn pages_counts_and_infinite_pixels_are_named() {
    use tiff::encoder::colortype::{Gray16, Gray32Float};
    let n = ROWS * COLUMNS;
    let mut two = Cursor::new(Vec::new());
    {
        let mut encoder = tiff::encoder::TiffEncoder::new(&mut two).unwrap();
        for _ in 0..2 {
            encoder.write_image::<Gray16>(COLUMNS as u32, ROWS as u32, &vec![9; n]).unwrap();
        }
    }
    assert!(decode(&two.into_inner(), None).unwrap_err().contains("it has 2 pages"));
    let float = |value: &dyn Fn(usize) -> f32| -> Arc<[u8]> {
        tiff::<Gray32Float>(&(0..n).map(value).collect::<Vec<_>>()).into()
    };
    let params = json!({"frames": [{"file": "a.tif", "f_x": 0}], "flat": "f.tif", "full_scale": 1});
    let warnings = |frame: Arc<[u8]>| {
        let flat = float(&|i| if i == 7 { f32::INFINITY } else { 1.0 });
        let files = [("frames.0.file".to_owned(), frame), ("flat".to_owned(), flat)];
        let known = Known { files: files.into(), ..Known::default() };
        let mut problems = Problems::default();
        StageRow::of::<ImportFrames>().check(&params, &known, &mut problems);
        let (wrong, warnings) = problems.into_parts();
        assert!(wrong.is_empty(), "{wrong:?}");
        warnings.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
    };
    let shares = warnings(float(&|i| i as f32 / 48.0));
    assert!(shares.contains("`f.tif`: 1 of 48"), "{shares}");
    let odd = float(&|i| [0.5, f32::INFINITY, f32::NAN, 0.5][i % 4]);
    assert!(warnings(odd.clone()).contains("`a.tif`: 24 of 48 pixels are no finite numbers; they are masked"));
    // Masked in the run as well: also where the flat field alone is infinite.
    let flat = float(&|i| if i == 7 { f32::INFINITY } else { 1.0 });
    let stack = import(&params, &[("frames.0.file", odd), ("flat", flat)]).unwrap();
    let mask = stack.layers.iter().find(|l| l.info.kind == LayerKind::Mask).unwrap();
    let bad = mask.data.iter().filter(|&&m| m == MaskReason::NotFinite.code()).count();
    assert_eq!(bad, 25, "24 of the frame and one of the flat field");
}

/// Counts in floating-point files say of how many bits they are; then they are read as those of whole numbers.
#[test]
fn counts_in_floating_point_files_have_bits() {
    use tiff::encoder::colortype::Gray32Float;
    let n = ROWS * COLUMNS;
    let counts = |i: usize| if i == 5 { 4095 } else { 1000 + 7 * i as u16 };
    let float: Arc<[u8]> = tiff::<Gray32Float>(&(0..n).map(|i| f32::from(counts(i))).collect::<Vec<_>>()).into();
    let params = json!({"frames": [{"file": "a.tif", "f_x": 0}]});
    let problem = check(&params, &[("frames.0.file", float.clone())]);
    assert!(
        problem.contains("`a.tif` holds floating-point numbers up to 4095") && problem.contains("bits: 16"),
        "{problem}"
    );
    let params = json!({"frames": [{"file": "a.tif", "f_x": 0}], "bits": 12, "full_well": 10000});
    assert_eq!(check(&params, &[("frames.0.file", float.clone())]), "");
    let [read, whole] = [float, tiff16(counts)].map(|file| import(&params, &[("frames.0.file", file)]).unwrap());
    assert_eq!(read, whole);
    assert_eq!(read.mask(None).unwrap().data.iter().filter(|&&m| m == MaskReason::Saturated.code()).count(), 1);
}

/// The name of the bench goes on with the frames, and is known before the run; an empty one is a mistake.
#[test]
fn the_bench_is_named() {
    let params = json!({"frames": [{"file": "a.png", "f_x": 0}], "rig": " bench 2 "});
    let stack = import(&params, &[("frames.0.file", grey8(|i| 100 + i as u8))]).unwrap();
    assert_eq!(Rig::of(&stack.attributes), Some(Rig::named("bench 2")));
    let job = (StageRow::of::<ImportFrames>().prepare)(&params).unwrap();
    assert_eq!(Rig::of(&job.describe(&Known::default())["frames"].attributes), Some(Rig::named("bench 2")));
    let mut problems = Problems::default();
    let empty = json!({"frames": [{"file": "a.png", "f_x": 0}], "rig": " "});
    StageRow::of::<ImportFrames>().check(&empty, &Known::default(), &mut problems);
    let (mistakes, _) = problems.into_parts();
    assert!(mistakes.len() == 1 && mistakes[0].path == "rig", "{mistakes:?}");
}

/// What a file of numbers `0..n` is read as: pages as phases of a pattern, by their names, and none left unread.
#[test]
fn pages_are_phases() {
    use tiff::encoder::colortype::Gray16;
    let n = ROWS * COLUMNS;
    let pages = |count: u16, large: bool| -> Arc<[u8]> {
        let mut bytes = Cursor::new(Vec::new());
        let page = |k: u16| vec![1000 * (k + 1); n];
        if large {
            let mut encoder = tiff::encoder::TiffEncoder::new_big(&mut bytes).unwrap();
            (0..count).for_each(|k| encoder.write_image::<Gray16>(COLUMNS as u32, ROWS as u32, &page(k)).unwrap());
        } else {
            let mut encoder = tiff::encoder::TiffEncoder::new(&mut bytes).unwrap();
            (0..count).for_each(|k| encoder.write_image::<Gray16>(COLUMNS as u32, ROWS as u32, &page(k)).unwrap());
        }
        bytes.into_inner().into()
    };
    let pattern = json!({"pattern": "a_{f_x}.tif", "f_x": [0.1], "phases": 3});
    let at = |bytes: &Arc<[u8]>| [0, 1, 2].map(|k| (["pattern.0", "pattern.1", "pattern.2"][k], bytes.clone()));
    for large in [false, true] {
        let stack = import(&pattern, &at(&pages(3, large))).unwrap();
        for (k, layer) in stack.layers.iter().enumerate() {
            let want = (1000.0 * (k as f64 + 1.0) / 65535.0) as f32;
            assert!(layer.data.iter().all(|&v| v == want), "page {k}");
            let phase = 2.0 * std::f64::consts::PI * k as f64 / 3.0;
            assert!((layer.info.phase_rad.unwrap() - phase).abs() < 1e-12);
        }
        let found = check(&pattern, &at(&pages(4, large)));
        assert!(found.contains("pattern.0: `a_0.1.tif` has 4 pages, and no frame is page 4"), "{found}");
        let found = check(&pattern, &at(&pages(2, large)));
        assert!(found.contains("pattern.2: `a_0.1.tif`: it has 2 pages, and page 3 is asked for"), "{found}");
    }
    // Those of one file in another order, by name.
    let one = |page: u32, phase: u32| json!({"file": "a.tif", "f_x": 0.1, "phase_deg": phase, "page": page});
    let named = json!({"frames": [one(3, 0), one(1, 120), one(2, 240)]});
    let files = [0, 1, 2].map(|k| (["frames.0.file", "frames.1.file", "frames.2.file"][k], pages(3, false)));
    let stack = import(&named, &files).unwrap();
    let firsts: Vec<f32> = stack.layers.iter().map(|layer| layer.data[(0, 0)] * 65535.0).collect();
    assert_eq!(firsts, [3000.0, 1000.0, 2000.0]);
}

/// Three steps of even light by a pattern carry their phases; one frame carries none.
#[test]
fn even_light_in_steps_has_phases() {
    let of = |phases_at_0: u32| {
        let params = json!({"pattern": "a_{phase:1}.png", "f_x": [0], "phases_at_0": phases_at_0});
        let names: Vec<String> = (0..phases_at_0).map(|k| format!("pattern.{k}")).collect();
        let files: Vec<(&str, Arc<[u8]>)> = names.iter().map(|name| (name.as_str(), grey8(|_| 99))).collect();
        import(&params, &files).unwrap().layers.iter().map(|layer| layer.info.phase_rad).collect::<Vec<_>>()
    };
    assert_eq!(of(1), [None]);
    let third = 2.0 * std::f64::consts::PI / 3.0;
    assert_eq!(of(3), [Some(0.0), Some(third), Some(2.0 * third)]);
}

/// A part of the picture, and squares of its pixels: means, variances of means, and no pixel beside a saturated one passes for good.
#[test]
fn pictures_are_cropped_and_binned() {
    let ramp = grey8(|i| if i == 9 { 255 } else { i as u8 });
    let params = |crop: Value, bin: u32| json!({"frames": [{"file": "a.png", "f_x": 0}], "crop": crop, "bin": bin, "full_well": 1000, "pixel_mm": 0.5});
    let stack = import(&params(json!([2, 1, 5, 4]), 1), &[("frames.0.file", ramp.clone())]).unwrap();
    let layer = |stack: &ImageStack, k: usize| stack.layers[k].data.clone();
    assert_eq!(layer(&stack, 0).dim(), (4, 5));
    assert_eq!(layer(&stack, 0)[(0, 0)], (10.0_f64 / 255.0) as f32);
    assert_eq!(layer(&stack, 0)[(3, 4)], (38.0_f64 / 255.0) as f32);
    let plain = import(&params(json!([0, 0, 8, 6]), 1), &[("frames.0.file", ramp.clone())]).unwrap();
    let binned = import(&params(json!([0, 0, 8, 6]), 2), &[("frames.0.file", ramp.clone())]).unwrap();
    assert_eq!(layer(&binned, 0).dim(), (3, 4));
    // Pixels 2, 3, 10 and 11.
    assert!((layer(&binned, 0)[(0, 1)] - 6.5 / 255.0).abs() < 1e-7);
    let se = |stack: &ImageStack, at| f64::from(layer(stack, 1)[at]).powi(2);
    let want = (se(&plain, (0, 2)) + se(&plain, (0, 3)) + se(&plain, (1, 2)) + se(&plain, (1, 3))) / 16.0;
    assert!((se(&binned, (0, 1)) / want - 1.0).abs() < 1e-5);
    let mask = |stack: &ImageStack| stack.mask(None).unwrap().data.clone();
    assert_eq!(mask(&plain).iter().filter(|&&m| m != 0.0).count(), 1);
    assert_eq!(mask(&binned)[(0, 0)], MaskReason::Saturated.code());
    assert_eq!(binned.attributes["pixel_pitch_mm"], json!([1.0, 1.0]));
    for (crop, bin, message) in [
        (json!([4, 0, 5, 6]), 1, "`a.png`: it has 8 x 6 pixels, and crop = [4, 0, 5, 6] ends at 9 x 6"),
        (json!([0, 0, 0, 6]), 1, "crop = 0 px must be a width and a height > 0"),
        (json!([0, 0, 3, 6]), 4, "`a.png`: it has 3 x 6 pixels, fewer than bin = 4 a side"),
        (json!([0, 0, 3, 6]), 0, "bin = 0 px must lie in [1, 64]"),
    ] {
        let found = check(&params(crop, bin), &[("frames.0.file", ramp.clone())]);
        assert!(found.contains(message), "{found}");
    }
}
