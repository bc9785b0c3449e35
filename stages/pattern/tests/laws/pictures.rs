//! Patterns from files.

use std::marker::PhantomData;

use turbid_contract::payload::Scene;
use turbid_contract::{AngleDeg, Ctx, Known, Payload, PerLength, Problems, Stage};
use turbid_pattern::image::Image;
use turbid_pattern::{PatternIn, PatternParams, PatternStage};

use crate::{fringes, host, pattern, reached, tube};

/// A 16 bit grey PNG of square size.
pub fn png_of(side: u32, grey: impl Fn(usize) -> u16) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, side, side);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    let data: Vec<u8> = (0..(side * side) as usize).flat_map(|i| grey(i).to_be_bytes()).collect();
    encoder.write_header().and_then(|mut w| w.write_image_data(&data)).expect("a picture");
    bytes
}

pub fn pictures(count: usize) -> PatternParams {
    let files = (0..count).map(|i| format!("shown/{i}.png")).collect();
    let image = Image { files, f_x: None, orientation_deg: AngleDeg(0.0), gamma: 1.0 };
    PatternParams { image: Some(image), ..fringes(&[], &[0.0]) }
}

/// Fringes written into pictures, as grey values under a gamma, are the fringes that they were, to the 16 bit of a file, and reach the
/// same frequency on the surface; of pictures of something else nothing is said.
#[test]
fn pictures_show_what_they_hold() {
    let scene = tube(64);
    let (expected, map) = pattern(&fringes(&[0.3], &[0.0]), &scene);
    for gamma in [1.0, 2.2] {
        let coded = |layer: usize| {
            let light = expected.layers[layer].pixels();
            png_of(64, |i| (65535.0 * f64::from(light[i]).powf(1.0 / gamma)).round() as u16)
        };
        let mut host = host();
        host.files = (0..3).map(|k| (format!("image.files.{k}"), coded(k).into())).collect();
        let run = |f_x: Option<PerLength>| {
            let mut params = pictures(3);
            params.image = params.image.map(|image| Image { f_x, gamma, ..image });
            let out =
                PatternStage::run(&params, PatternIn { scene: scene.clone(), source: PhantomData }, Ctx::new(&host));
            let out = out.expect("a pattern");
            (out.pattern.0, out.surface_frequency.expect("wanted").0)
        };
        let (shown, reached_by) = run(Some(PerLength(0.3)));
        for (a, b) in shown.layers.iter().zip(&expected.layers) {
            assert_eq!(a.info, b.info);
            // Half a step of the file, steepest at white; and f32.
            let worst = a.pixels().iter().zip(b.pixels().iter()).fold(0.0, |w: f32, (a, b)| w.max((a - b).abs()));
            assert!(f64::from(worst) < 0.5 * gamma / 65535.0 + 1e-7, "gamma {gamma}: off by {worst}");
        }
        let [f, g] = [&reached_by, &map].map(|map| reached(map, 0.3));
        let off = f.iter().zip(&g).filter(|(a, b)| a.1 == 0.0 && b.1 == 0.0).map(|(a, b)| (a.0 / b.0 - 1.0).abs());
        let (count, worst) = off.fold((0, 0.0), |(n, w), off| (n + 1, f64::max(w, off)));
        assert!(count > 100 && worst < 1e-2, "{count} pixels, off by {worst}");
        let (plain, _) = run(None);
        assert_eq!(plain.layers[2].data, shown.layers[2].data);
        assert!(plain.layers.iter().all(|l| l.info.f_x_per_mm.is_none() && l.info.phase_rad.is_none()));
    }
}

/// What is wrong with pictures is told with the file's field; where they lie is not in the key.
#[test]
fn mistakes_in_pictures_are_named() {
    let found = |params: &PatternParams, scene: &Scene, files: &[Vec<u8>]| {
        let mut known = Known::default();
        let at = |k: usize| format!("image.files.{k}");
        known.files = files.iter().enumerate().map(|(k, bytes)| (at(k), bytes.clone().into())).collect();
        known.insert("scene", scene.clone().into_artifact());
        let mut problems = Problems::default();
        PatternStage::check(params, &known, &mut problems);
        problems.into_parts().0.iter().map(ToString::to_string).collect::<Vec<_>>()
    };
    let (good, small) = (png_of(64, |_| 9), png_of(32, |_| 9));
    let scene = tube(64);
    assert_eq!(found(&pictures(1), &scene, std::slice::from_ref(&good)), Vec::<String>::new());
    let mut unsized_projector = tube(64);
    unsized_projector.projector.as_mut().unwrap().pixels = None;
    assert_eq!(found(&pictures(1), &unsized_projector, std::slice::from_ref(&small)), Vec::<String>::new());
    let fringe = |f_x: f64, n: usize| {
        let params = pictures(n);
        PatternParams { image: params.image.map(|i| Image { f_x: Some(PerLength(f_x)), ..i }), ..params }
    };
    let with = |change: &dyn Fn(&mut PatternParams)| {
        let mut params = pictures(1);
        change(&mut params);
        params
    };
    let wrong = [
        (pictures(1), vec![small.clone()], "image.files.0", "64 x 64 pixels, not 32 x 32"),
        (pictures(2), vec![good.clone(), small], "image.files.1", "32 x 32 pixels, `shown/0.png` has 64 x 64"),
        (pictures(1), vec![b"GIF89a".to_vec()], "image.files.0", "`shown/0.png`: it is no PNG"),
        (pictures(1), vec![good[..good.len() / 2].to_vec()], "image.files.0", "it is no PNG"),
        (pictures(0), vec![], "image.files", "nothing would be shown"),
        (fringe(0.1, 2), vec![good.clone(); 2], "image.files", "2 phases"),
        (fringe(-0.1, 3), vec![good.clone(); 3], "image.f_x", "-0.1"),
        (with(&|p| p.pixels = Some([64, 64])), vec![good.clone()], "pixels", "pixels of its own"),
        (with(&|p| p.f_x = vec![PerLength(0.1)]), vec![good.clone()], "image", "two patterns"),
        (with(&|p| p.image.as_mut().unwrap().gamma = 0.0), vec![good], "image.gamma", "0"),
    ];
    for (params, files, field, words) in wrong {
        let problems = found(&params, &scene, &files);
        assert!(problems.iter().any(|p| p.starts_with(field) && p.contains(words)), "{field}, {words}: {problems:?}");
    }
    let moved = with(&|p| p.image.as_mut().unwrap().files = vec!["elsewhere/0.png".into()]);
    assert_eq!(PatternStage::canonical(&moved), PatternStage::canonical(&pictures(1)));
    assert_eq!(PatternStage::files(&pictures(2))[1].at, "image.files.1");
}
