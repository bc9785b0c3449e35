//! Laws of whole pictures: every payload's typical stack renders, masked pixels never show, bytes repeat.

use ndarray::Array2;
use serde_json::json;
use turbid_contract::payload::MaskReason;
use turbid_contract::{Artifact, Cells, ImageStack, LayerInfo, LayerKind, Record, Table};

use super::canvas::Canvas;
use super::colour::{HATCH, MARK};
use super::{Caption, draw, picture};

type Pixel = fn(usize, usize) -> f32;

fn stack(rows: usize, columns: usize, layers: &[(LayerInfo, Pixel)]) -> ImageStack {
    let mut stack = ImageStack::new(rows, columns);
    for (info, pixel) in layers {
        stack.push(info.clone(), Array2::from_shape_fn((rows, columns), |(r, c)| pixel(r, c)));
    }
    stack
}

fn drawn(stack: ImageStack) -> Canvas {
    draw(&Artifact::Images(stack), "a title").expect("a stack of layers has a picture")
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
            let canvas = drawn(images.clone());
            let (width, height) = (canvas.width(), canvas.height());
            assert!(width > 60 && height > 40 && width < 3000 && height < 3000, "{payload}: {width} x {height}");
            // Margins stay white: nothing is cut.
            let white = |x, y| canvas.get(x, y) == Some([255; 3]);
            assert!((0..height).all(|y| white(0, y) && white(width - 1, y)), "{payload} {rows} x {columns}");
            assert!((0..width).all(|x| white(x, 0) && white(x, height - 1)), "{payload} {rows} x {columns}");
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
            assert!(drawn(clean.clone()) == drawn(dirty), "{held} in {n} pixels shows");
        }
    }
    let striped = |images: ImageStack| {
        let canvas = drawn(images);
        let pixels = (0..canvas.height()).flat_map(|y| (0..canvas.width()).map(move |x| (x, y)));
        pixels.filter(|&(x, y)| canvas.get(x, y).is_some_and(|c| HATCH.contains(&c))).count()
    };
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
                let canvas = drawn(images);
                let (width, height) = (canvas.width(), canvas.height());
                assert!(width < 1500 && height < 1500, "{name} {kind:?} {i}: {width} x {height}");
            }
        }
    }
}

#[test]
fn records_and_empty_stacks_have_none() {
    assert_eq!(picture(&Artifact::Record(Record::default()), &Caption::default()), None);
    assert_eq!(picture(&Artifact::Images(ImageStack::new(3, 3)), &Caption::default()), None);
}

/// Rows in the order of the payload: f_x outermost, then mu_a, then mu_s'.
fn lut(f_x: &[f64], mu_a: &[f64], mu_s_prime: &[f64], r_d: impl Fn(f64, f64, f64) -> f64) -> Table {
    let mut columns: [Vec<f64>; 4] = Default::default();
    for &f in f_x {
        for (&a, &s) in mu_a.iter().flat_map(|a| mu_s_prime.iter().map(move |s| (a, s))) {
            for (column, value) in columns.iter_mut().zip([a, s, f, r_d(f, a, s)]) {
                column.push(value);
            }
        }
    }
    let mut table = Table::default();
    for (name, cells) in ["mu_a", "mu_s_prime", "f_x", "r_d"].into_iter().zip(columns) {
        table.push(name, "1", Cells::F64(cells));
    }
    table
}

#[test]
fn tables_with_a_full_grid_have_pictures_and_others_none() {
    let log = |n: usize| -> Vec<f64> { (0..n).map(|i| libm::exp2(i as f64 - 9.0)).collect() };
    let reflectance = |f: f64, a: f64, s: f64| s / (s + 4.0 * a + f);
    for (frequencies, n, m) in [(1, 1, 1), (2, 1, 4), (2, 2, 2), (3, 13, 30), (20, 3, 3)] {
        let f_x: Vec<f64> = (0..frequencies).map(|i| f64::from(i) * 0.05).collect();
        for value in [reflectance, |_, _, _| 0.0, |_, _, _| 1e-30, |f, _, _| if f > 0.0 { f64::NAN } else { 0.5 }] {
            let table = lut(&f_x, &log(n), &log(m), value);
            let canvas = draw(&Artifact::Table(table), "a table").unwrap();
            assert!(canvas.width() > 300 && canvas.height() > 300, "{frequencies} {n} {m}");
        }
    }
    let mut torn = lut(&[0.0, 0.1], &log(3), &log(3), reflectance);
    for column in &mut torn.columns {
        let Cells::F64(cells) = &mut column.cells else { unreachable!() };
        cells.pop();
    }
    let mut metrics = Table::default();
    metrics.push("mu_a", "mm^-1", Cells::F64(vec![0.1]));
    for table in [torn, metrics, Table::default(), lut(&[], &[], &[], reflectance)] {
        assert_eq!(draw(&Artifact::Table(table), "no grid"), None);
    }
}

/// Of an artifact with a table for each pair of g and n the first is drawn.
#[test]
fn the_first_of_several_tables_is_drawn() {
    let nodes: Vec<f64> = (0..4).map(|i| libm::exp2(f64::from(i) - 9.0)).collect();
    let of = |gain: f64| lut(&[0.0, 0.1], &nodes, &nodes, move |f: f64, a: f64, s: f64| s / (s + gain * a + f));
    let (first, second) = (of(4.0), of(9.0));
    let mut both = Table::default();
    for (name, values) in [("g", [0.8, 0.7]), ("n", [1.4, 1.4])] {
        both.push(name, "1", Cells::F64(values.iter().flat_map(|&value| [value; 32]).collect()));
    }
    for (a, b) in first.columns.iter().zip(&second.columns) {
        let (Cells::F64(a_cells), Cells::F64(b_cells)) = (&a.cells, &b.cells) else { unreachable!() };
        both.push(a.name.as_str(), "1", Cells::F64([a_cells.as_slice(), b_cells].concat()));
    }
    let shown = draw(&Artifact::Table(both), "tables").expect("it is drawn");
    let alone = draw(&Artifact::Table(first), "tables").expect("it is drawn");
    assert_eq!((shown.width(), shown.height()), (alone.width(), alone.height()));
}

/// What `outside: nearest` fills in is striped in the map, its standard error and its error, and nowhere in the truth.
#[test]
fn the_end_of_a_table_is_marked() {
    let out: Pixel = |r, c| if r < 20 && c < 10 { MaskReason::AboveTable.code() } else { 0.0 };
    let marked = |names: &[&str], with_errors: bool, outside: Pixel| {
        let mut layers: Vec<(LayerInfo, Pixel)> = names.iter().map(|n| (value(n, "mm^-1"), RAMP)).collect();
        if with_errors {
            layers.push((value("mu_a", "mm^-1").standard_error(), RAMP));
        }
        layers.extend([(value("outside", "1"), outside), (mask(), (|r, _| if r == 0 { 2.0 } else { 0.0 }) as Pixel)]);
        let canvas = drawn(stack(40, 40, &layers));
        let pixels = (0..canvas.height()).flat_map(|y| (0..canvas.width()).map(move |x| (x, y)));
        pixels.filter(|&(x, y)| canvas.get(x, y) == Some(MARK)).count()
    };
    // 19 x 10 pixels outside that are not masked, 7 x 7 (errors 4 x 4) of the screen each, a third of them in stripes; 33 or 34 of the
    // 100 pixels of a legend's box. Stripes begin within a pixel of the thirds.
    let (map, error, legend) = (190 * 49 / 3, 190 * 16 / 3, 34);
    let near = |found: usize, expected: usize| found.abs_diff(expected) < 60;
    assert!(near(marked(&["mu_a"], false, out), map + legend));
    assert!(near(marked(&["mu_a", "mu_a_truth", "mu_a_error"], false, out), 2 * (map + legend)));
    assert!(near(marked(&["mu_a"], true, out), map + error + 2 * legend));
    assert_eq!(marked(&["mu_a", "mu_a_error"], true, |_, _| 0.0), 0, "nothing lies outside");
    // Of a standard error that is a lower bound: its map, not that of the value.
    let info = value("mu_a", "mm^-1");
    let layers: [(LayerInfo, Pixel); 3] = [
        (info.clone(), RAMP),
        (info.standard_error(), RAMP),
        (info.se_unknown(), |r, _| if r < 20 { 1.0 } else { 0.0 }),
    ];
    let canvas = drawn(stack(40, 40, &layers));
    let pixels = (0..canvas.height()).flat_map(|y| (0..canvas.width()).map(move |x| (x, y)));
    let found = pixels.filter(|&(x, y)| canvas.get(x, y) == Some(MARK)).count();
    assert!(near(found, 800 * 16 / 3 + legend), "{found}");
}

fn titles(stack: &ImageStack) -> Vec<String> {
    let figure = super::stack::figure(stack, "a title");
    let panels = figure.sections.iter().flat_map(|s| s.rows.iter().flatten());
    panels.map(|p| format!("{} | {}", p.title.letters(), p.subtitle.letters())).collect()
}

/// Frames that differ in nothing that they say are numbered, others are not.
#[test]
fn every_panel_has_its_own_title() {
    let speckle = value("radiance", "W mm^-2 sr^-1").with_f_x(0.0);
    let mut layers: Vec<(LayerInfo, Pixel)> = vec![(speckle, RAMP); 12];
    layers.push((value("radiance", "W mm^-2 sr^-1").with_f_x(0.1), RAMP));
    let found = titles(&stack(8, 8, &layers));
    assert_eq!(found[2], "radiance (W mm−2 sr−1) | fx = 0 mm−1, no. 3 of 12");
    assert_eq!(found[12], "radiance (W mm−2 sr−1) | fx = 0.1 mm−1");
    let distinct: std::collections::BTreeSet<_> = found.iter().collect();
    assert_eq!(distinct.len(), 13, "{found:?}");
}

/// Sections, neighbours and reasons are classes with names, not numbers on a bar with a mean.
#[test]
fn classes_have_a_legend_and_no_bar() {
    let layers: [(LayerInfo, Pixel); 4] = [
        (value("section", "1"), |r, _| (r % 3) as f32),
        (value("neighbour", "1"), |r, _| (r % 2) as f32),
        (value("outside", "1"), |r, _| if r < 3 { 4.0 } else { 0.0 }),
        (mask(), |r, _| if r == 0 { 13.0 } else { 0.0 }),
    ];
    let mut images = stack(9, 9, &layers);
    let section = |from: f64| json!({"from_mm": from, "to_mm": from + 10.0, "pixels": 9, "m_dc": 1e-3});
    images.attributes.insert("sections".into(), json!([section(0.0), section(10.0), section(20.0)]));
    let figure = super::stack::figure(&images, "a title");
    let panels: Vec<_> = figure.sections.iter().flat_map(|s| s.rows.iter().flatten()).collect();
    assert!(panels.iter().all(|p| p.bar.is_none()));
    let legends: Vec<Vec<String>> = panels.iter().map(|p| p.notes.iter().map(|n| n.text.letters()).collect()).collect();
    assert_eq!(legends[0], ["0: 0 to 10 mm, 22.2 %", "1: 10 to 20 mm, 33.3 %", "2: 20 to 30 mm, 33.3 %"]);
    assert_eq!(legends[2], ["inside the table, 66.7 %", "darker than the table, 22.2 %"]);
    assert_eq!(legends[3], ["good, 88.9 %", "outside the sections, 11.1 %"]);
    // The colour of a section in the image is that of its legend.
    let super::panel::Swatch::Colour(colour) = panels[0].notes[1].swatch.unwrap() else { panic!("no colour") };
    let zoom = panels[0].image.width() / 9;
    assert_eq!(panels[0].image.get(zoom / 2, zoom * 4 + zoom / 2), Some(colour));
}

/// Every panel of a camera's images has a bar in mm, and the figure says the pitch.
#[test]
fn images_have_a_scale() {
    let mut images = stack(64, 64, &[(value("mu_a", "mm^-1"), RAMP), (mask(), |r, _| (r % 2) as f32)]);
    images.attributes.insert("pixel_pitch_mm".into(), json!([0.5, 0.5]));
    let figure = super::stack::figure(&images, "a title");
    for panel in figure.sections.iter().flat_map(|s| s.rows.iter().flatten()) {
        assert_eq!(panel.notes[0].text.letters(), "10 mm");
        assert!(
            matches!(panel.notes[0].swatch, Some(super::panel::Swatch::Length(100))),
            "20 pixels, 5 times enlarged"
        );
    }
    let said = figure.remarks[0].letters();
    assert!(said.starts_with("64 × 64 pixels of 0.5 × 0.5 mm in the plane that the camera looks at;"), "{said}");
}

/// The text chunks of the file as a reader finds them.
#[test]
fn the_file_says_where_it_comes_from() {
    let images = Artifact::Images(stack(8, 8, &[(value("mu_a", "mm^-1"), RAMP)]));
    let facts = vec![("Pipeline", "tube µ".to_owned()), ("Key", "ab12".to_owned())];
    let caption = Caption { title: "tube · maps · maps".into(), subtitle: "--set vars.samples=4".into(), facts };
    let bytes = picture(&images, &caption).unwrap();
    let reader = png::Decoder::new(std::io::Cursor::new(&bytes)).read_info().unwrap();
    let info = reader.info();
    let found: Vec<(String, String)> =
        info.utf8_text.iter().map(|t| (t.keyword.clone(), t.get_text().unwrap())).collect();
    assert_eq!(found, [("Pipeline".into(), "tube µ".into()), ("Key".into(), "ab12".into())]);
    assert_eq!(picture(&images, &caption), Some(bytes.clone()), "the same bytes");
    let bare = Caption { subtitle: String::new(), ..caption };
    assert_ne!(picture(&images, &bare), Some(bytes), "the overrides are words of the picture");
}

#[test]
fn the_same_artifact_gives_the_same_bytes() {
    let images = Artifact::Images(stack(64, 64, &[(value("mu_a", "mm^-1"), RAMP), (mask(), |r, _| (r % 4) as f32)]));
    let titled = |title: &str| picture(&images, &Caption { title: title.into(), ..Caption::default() });
    assert_eq!(titled("maps"), titled("maps"));
    assert_ne!(titled("maps"), titled("other maps"));
}
