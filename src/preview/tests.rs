//! Laws of whole pictures: every payload's typical stack renders, masked pixels never show, bytes repeat.

use ndarray::Array2;
use serde_json::json;
use turbid_contract::payload::MaskReason;
use turbid_contract::{Artifact, ImageStack, LayerInfo, LayerKind, Record};

use super::canvas::Rgb;
use super::colour::HATCH;
use super::picture;

type Pixel = fn(usize, usize) -> f32;

fn stack(rows: usize, columns: usize, layers: &[(LayerInfo, Pixel)]) -> ImageStack {
    let mut stack = ImageStack::new(rows, columns);
    for (info, pixel) in layers {
        stack.push(info.clone(), Array2::from_shape_fn((rows, columns), |(r, c)| pixel(r, c)));
    }
    stack
}

fn png(stack: ImageStack) -> Vec<u8> {
    picture(&Artifact::Images(stack), "a title").expect("a stack of layers has a picture")
}

fn decode(bytes: &[u8]) -> (u32, u32, Vec<Rgb>) {
    let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().expect("a PNG");
    let mut pixels = vec![0; reader.output_buffer_size().expect("it fits")];
    let info = reader.next_frame(&mut pixels).expect("whole");
    (info.width, info.height, pixels.chunks(3).map(|p| [p[0], p[1], p[2]]).collect())
}

fn value(name: &str, unit: &str) -> LayerInfo {
    LayerInfo::value(name, unit)
}

fn mask() -> LayerInfo {
    LayerInfo::new("mask", LayerKind::Mask, "1")
}

const RAMP: Pixel = |r, c| (r * 7 + c) as f32 * 1e-3;

/// Every payload that is a stack of images, in several sizes.
#[test]
fn every_payload_has_a_picture() {
    let phased = |name: &str, f: f64, phase: f64| {
        let mut info = value(name, "W mm^-2 sr^-1").with_f_x(f);
        info.phase_rad = Some(phase);
        info
    };
    let cov = |i, j| {
        let mut info = LayerInfo::new("cov", LayerKind::Covariance, "1");
        info.pair = Some([i, j]);
        info
    };
    let r_d = value("r_d", "1").with_f_x(0.1);
    let payloads: [(&str, Vec<(LayerInfo, Pixel)>); 9] = [
        ("frames", [0.0, 2.1, 4.2].map(|p| (phased("radiance", 0.1, p), RAMP)).to_vec()),
        ("covariance", vec![(cov(0, 0), RAMP), (cov(0, 1), RAMP), (cov(1, 1), RAMP)]),
        (
            "modulation",
            vec![(value("m_dc", "1"), RAMP), (value("m_ac", "1"), RAMP), (cov(0, 1), RAMP), (mask(), |_, _| 0.0)],
        ),
        ("phase", vec![(value("phase", "rad"), |r, c| (r + c) as f32 % 6.0 - 3.0)]),
        ("reflectance", vec![(r_d.clone(), RAMP), (r_d.standard_error(), RAMP), (mask(), |r, _| (r % 10) as f32)]),
        ("maps", vec![(value("mu_a", "mm^-1"), RAMP), (value("mu_s_prime", "mm^-1"), RAMP), (mask(), |_, _| 0.0)]),
        (
            "truth",
            vec![(value("object", "1"), |r, _| (r % 3) as f32), (value("normal_x", "1"), RAMP), (mask(), |_, _| 1.0)],
        ),
        ("errors", ["mu_a", "mu_a_truth", "mu_a_error"].map(|n| (value(n, "mm^-1"), RAMP)).to_vec()),
        ("preview", ["red", "green", "blue"].map(|n| (value(n, "1"), RAMP)).to_vec()),
    ];
    for (payload, layers) in payloads {
        for (rows, columns) in [(1, 1), (1, 40), (64, 64), (3, 700)] {
            let mut images = stack(rows, columns, &layers);
            images.attributes.insert("objects".into(), json!(["slab", "polyp"]));
            let (width, height, pixels) = decode(&png(images.clone()));
            assert!(width > 60 && height > 40 && width < 3000 && height < 3000, "{payload}: {width} x {height}");
            // Margins stay white: nothing is cut.
            let white = |x: u32, y: u32| pixels[(y * width + x) as usize] == [255; 3];
            assert!((0..height).all(|y| white(0, y) && white(width - 1, y)), "{payload} {rows} x {columns}");
            assert!((0..width).all(|x| white(x, 0) && white(x, height - 1)), "{payload} {rows} x {columns}");
            assert_eq!(png(images.clone()), png(images), "{payload}");
        }
    }
}

/// What a masked pixel holds changes nothing in the picture, and its place is striped.
#[test]
fn masked_pixels_are_never_coloured_as_data() {
    let layers: [(LayerInfo, Pixel); 3] = [
        (value("mu_a", "mm^-1"), RAMP),
        (value("mu_a", "mm^-1").standard_error(), RAMP),
        (mask(), |r, c| if r < 20 && c < 20 { MaskReason::BelowTable.code() } else { 0.0 }),
    ];
    for n in [40, 700] {
        let clean = stack(n, n, &layers);
        for held in [0.0, -5.0, 1e30, f32::NAN] {
            let mut dirty = clean.clone();
            for layer in &mut dirty.layers[..2] {
                layer.data.slice_mut(ndarray::s![..20, ..20]).fill(held);
            }
            assert_eq!(png(clean.clone()), png(dirty), "{held} in {n} pixels shows");
        }
    }
    let striped = |images: ImageStack| decode(&png(images)).2.iter().filter(|p| HATCH.contains(p)).count();
    // 40 pixels are shown 7 times enlarged (their standard errors 4 times), and a quarter of them is masked.
    assert_eq!(striped(stack(40, 40, &layers)), 400 * (7 * 7 + 4 * 4));
}

#[test]
fn extreme_layers_have_pictures() {
    let extremes: [Pixel; 9] = [
        |r, _| r as f32 * 1e-30,
        |r, c| -((r + c) as f32),
        |_, _| 0.0,
        |_, _| 7.5,
        |_, _| f32::NAN,
        |r, _| if r == 0 { f32::INFINITY } else { f32::NEG_INFINITY },
        |r, _| if r == 0 { f32::MAX } else { f32::MIN },
        |_, _| f32::from_bits(1),
        |_, c| 1.0 + c as f32 * f32::EPSILON,
    ];
    for (i, pixel) in extremes.into_iter().enumerate() {
        for name in ["mu_a", "mu_a_error", "phase", "mask", "object", "red"] {
            for kind in [LayerKind::Value, LayerKind::Mask, LayerKind::StandardError, LayerKind::Covariance] {
                let mut info = LayerInfo::new(name, kind, "mm^-1");
                info.mean_se = Some(if i % 2 == 0 { 0.0 } else { 1e-12 });
                let mut images = stack(5, 4, &[(info, pixel)]);
                images.attributes.insert("objects".into(), json!(["slab"]));
                let (width, height, _) = decode(&png(images));
                assert!(width < 1500 && height < 1500, "{name} {kind:?} {i}: {width} x {height}");
            }
        }
    }
}

#[test]
fn records_and_empty_stacks_have_none() {
    assert_eq!(picture(&Artifact::Record(Record::default()), "scene"), None);
    assert_eq!(picture(&Artifact::Images(ImageStack::new(3, 3)), "nothing"), None);
}
