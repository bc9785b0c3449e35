//! Laws of sections: they cover the wall once, follow what was asked for, and name what is wrong.

use std::marker::PhantomData;

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{MaskReason, Modulation, Section, Sections, Truth};
use turbid_contract::{Ctx, Error, ImageStack, LayerInfo, LayerKind, MemoryHost, Problems, Stage};
use turbid_section::{In, Method, Params, SectionTube};

const N: usize = 200;
const LENGTH: f64 = 250.0;

/// A tube of 20 mm seen from its axis, 110 mm over its mouth at z = 5 mm, with a rim around: light falls like 1 / D^3.
fn tube_of(n: usize) -> (ImageStack, ImageStack) {
    let depth = |row: usize, column: usize| {
        let at = |k: usize| (k as f64 + 0.5 - 0.5 * n as f64) * 26.0 / n as f64;
        10.0 * 110.0 / at(row).hypot(at(column)) - 110.0
    };
    let image = |value: &dyn Fn(f64) -> f64| Array2::from_shape_fn((n, n), |(r, c)| value(depth(r, c)) as f32);
    let wall = |d: f64| (0.0..=LENGTH).contains(&d);
    let mut truth = ImageStack::new(n, n);
    let hole = |d: f64| d > LENGTH;
    truth.push(LayerInfo::value("height", "mm"), image(&|d| if hole(d) { 0.0 } else { 5.0 - d.max(0.0) }));
    truth.push(LayerInfo::value("normal_z", "1"), image(&|d| if d < 0.0 { 1.0 } else { 0.0 }));
    truth.push(LayerInfo::value("object", "1"), image(&|_| 1.0));
    truth.push(LayerInfo::new("mask", LayerKind::Mask, "1"), image(&|d| f64::from(hole(d))));
    truth.attributes.insert("objects".into(), serde_json::json!(["lamp", "wall"]));
    let mut modulation = ImageStack::new(n, n);
    let light = |d: f64| if wall(d) { (100.0 / (100.0 + d)).powi(3) } else { 1.1 };
    for (name, f_x, factor) in [("m_dc", 0.0, 1.0), ("m_ac", 0.0, 1.0), ("m_dc", 0.05, 1.0), ("m_ac", 0.05, 0.3)] {
        modulation.push(LayerInfo::value(name, "W mm^-2 sr^-1").with_f_x(f_x), image(&|d| factor * light(d)));
    }
    (modulation, truth)
}

fn tube() -> (ImageStack, ImageStack) {
    tube_of(N)
}

fn run(params: &Params, (modulation, truth): (ImageStack, ImageStack)) -> Result<Sections, Error> {
    let inputs = In { modulation: Modulation(modulation), truth: Truth(truth), source: PhantomData };
    SectionTube::run(params, inputs, Ctx::new(&MemoryHost::default())).map(|out| out.sections)
}

fn with(method: Method, count: Option<u32>) -> Params {
    Params { method, count, ..Params::default() }
}

fn bounds(list: &[Section]) -> Vec<f64> {
    let ends = list.iter().map(|s| s.to_mm);
    [list[0].from_mm].into_iter().chain(ends).collect()
}

/// Every method: sections follow each other from the mouth to the deepest pixel, each pixel lies within its own, shares are those of
/// direct neighbours, the pixels are counted, the rim and the hole are masked.
#[test]
fn sections_cover_the_wall_once() {
    for method in [Method::IntensitySteps, Method::EqualLength, Method::EqualLogIntensity, Method::Optimal] {
        let sections = run(&with(method, None), tube()).unwrap();
        let list = sections.list().unwrap();
        assert_eq!(list.len(), 5, "{method:?}");
        assert!(list.windows(2).all(|w| w[0].to_mm == w[1].from_mm && w[0].m_dc > w[1].m_dc), "{list:?}");
        let pixels = |name: &str| sections.0.find(name, None).unwrap().pixels().into_owned();
        let (own, arc, mask) = (pixels("section"), pixels("arc_length"), pixels("mask"));
        let (_, truth) = tube();
        let (height, normal) =
            (truth.find("height", None).unwrap().pixels(), truth.find("normal_z", None).unwrap().pixels());
        let hole = truth.find("mask", None).unwrap().pixels();
        let mut counted = vec![0; 5];
        for (i, share) in sections.shares().unwrap().into_iter().enumerate() {
            let Some([(section, weight), (neighbour, rest)]) = share else {
                assert!(mask[i] == MaskReason::OutsideSections.code() && (normal[i] == 1.0 || hole[i] == 1.0));
                continue;
            };
            let (s, k) = (f64::from(arc[i]), own[i] as usize);
            // f32 heights: 250 mm to 2e-5.
            assert!((s - (5.0 - f64::from(height[i]))).abs() < 1e-4, "{s}");
            assert!(s >= list[k].from_mm - 1e-4 && s <= list[k].to_mm + 1e-4, "{s} in {k}: {list:?}");
            assert!(section == k && section.abs_diff(neighbour) <= 1 && (weight + rest - 1.0).abs() < 1e-12);
            counted[k] += 1;
        }
        assert!(counted.iter().zip(&list).all(|(&n, s)| n == s.pixels), "{counted:?} {list:?}");
    }
}

/// Bounds are where the closed form has them, to a ring (the deepest pixel is at 246.6 mm of 250: rings of 0.96 mm) and to the noise of
/// sampling 1 / D^3 by pixels within rings.
#[test]
fn bounds_are_those_of_the_light() {
    let all = run(&with(Method::EqualLength, Some(1)), tube()).unwrap().list().unwrap();
    let deepest = all[0].to_mm;
    let ring = deepest / 256.0;
    let near = |found: Vec<f64>, expected: &dyn Fn(f64) -> f64, count: u32| {
        for (k, &b) in found.iter().enumerate() {
            let wanted = expected(k as f64 / f64::from(count));
            assert!((b - wanted).abs() < 2.0 * ring, "{k}: {b} {wanted}, {found:?}");
        }
    };
    let of = |method, count| bounds(&run(&with(method, Some(count)), tube()).unwrap().list().unwrap());
    near(of(Method::EqualLength, 5), &|q| q * deepest, 5);
    let low = (100.0 / (100.0 + deepest)).powi(3);
    near(of(Method::IntensitySteps, 5), &|q| 100.0 * ((1.0 - q * (1.0 - low)).powf(-1.0 / 3.0) - 1.0), 5);
    near(of(Method::EqualLogIntensity, 5), &|q| 100.0 * (low.powf(-q / 3.0) - 1.0), 5);
    // White is the rim's 1.1; the mouth's 1 is 232 grey levels. A section ends with the first ring that is more than 40 of them below its
    // first: the light in the middles of both is more apart than that, that of the ring before is not; a ring's mean over pixels lies
    // within the ring's own span of its middle.
    let steps = Params { threshold: Some(40.0), ..with(Method::IntensitySteps, None) };
    let list = run(&steps, tube()).unwrap().list().unwrap();
    let grey = |s: f64| 255.0 / 1.1 * (100.0 / (100.0 + s)).powi(3);
    for pair in list.windows(2) {
        let (first, next) = (pair[0].from_mm, pair[1].from_mm);
        let span = |s: f64| 0.5 * (grey(s) - grey(s + ring));
        let apart = |ring_start: f64| grey(first + 0.5 * ring) - grey(ring_start + 0.5 * ring);
        let slack = |ring_start: f64| span(first) + span(ring_start);
        assert!(apart(next) > 40.0 - slack(next), "{list:?}");
        assert!(apart(next - ring) <= 40.0 + slack(next - ring), "{list:?}");
    }
    assert!(list.len() >= 5, "{list:?}");
}

/// Within the optimal sections the pixels vary less than within those of any other method.
#[test]
fn optimal_sections_vary_least() {
    let (modulation, _) = tube();
    let light = modulation.find("m_dc", Some(0.0)).unwrap().pixels().into_owned();
    let spread = |method| {
        let sections = run(&with(method, None), tube()).unwrap();
        let shares = sections.shares().unwrap();
        let mut sums = [[0.0_f64; 3]; 5];
        for (share, &m) in shares.iter().zip(&light) {
            if let Some([(k, _), _]) = share {
                let ln = f64::from(m).ln();
                sums[*k] = [sums[*k][0] + 1.0, sums[*k][1] + ln, sums[*k][2] + ln * ln];
            }
        }
        sums.iter().map(|[n, sum, square]| square - sum * sum / n).sum::<f64>()
    };
    let optimal = spread(Method::Optimal);
    for method in [Method::IntensitySteps, Method::EqualLength, Method::EqualLogIntensity] {
        assert!(optimal < spread(method), "{method:?}: {} {optimal}", spread(method));
    }
}

#[test]
fn mistakes_are_named() {
    let error = |params: &Params, inputs| match run(params, inputs) {
        Err(error) => error.to_string(),
        Ok(sections) => panic!("{params:?}: {:?}", sections.list()),
    };
    let many = error(&with(Method::EqualLength, Some(200)), tube());
    assert!(many.contains("of 200") && many.contains("pixels with a good modulation"), "{many}");
    let steps = error(&with(Method::IntensitySteps, Some(30)), tube());
    assert!(steps.contains("30 sections would differ by") && steps.contains("equal_log_intensity"), "{steps}");
    let named = Params { objects: Some(vec!["lumen".into()]), ..Params::default() };
    assert!(error(&named, tube()).contains("no object `lumen`; it has lamp, wall"));
    let lamp = Params { objects: Some(vec!["lamp".into()]), ..Params::default() };
    assert!(error(&lamp, tube()).contains("no pixel shows a wall of lamp"));
    let (modulation, truth) = tube();
    let mut small = ImageStack::new(2, 3);
    small.layers = modulation
        .layers
        .iter()
        .map(|l| turbid_contract::Layer { info: l.info.clone(), data: Array2::ones((2, 3)) })
        .collect();
    assert!(error(&Params::default(), (small, truth.clone())).contains("3 x 2 pixels"));
    assert!(error(&Params::default(), (ImageStack::new(N, N), truth)).contains("no layer `m_dc`"));

    let told = |params: Params| {
        let mut problems = Problems::default();
        SectionTube::check(&params, &turbid_contract::Known::default(), &mut problems);
        problems.into_parts().0.iter().map(|p| p.path.clone()).collect::<Vec<_>>()
    };
    assert_eq!(told(Params { blend: 1.2, count: Some(0), ..Params::default() }), ["count", "blend"]);
    assert_eq!(told(Params { threshold: Some(9.0), method: Method::Optimal, ..Params::default() }), ["threshold"]);
    assert_eq!(
        told(Params { objects: Some(vec![]), threshold: Some(f64::NAN), ..Params::default() }),
        ["threshold", "objects"]
    );
    assert_eq!(told(Params::default()), Vec::<String>::new());
}

/// Small images have no pixels for five sections: as many as they have them for are made, with a word; who asks for five is told that there are none.
#[test]
fn small_images_have_fewer_sections() {
    for n in [12, 14, 16, 18] {
        let host = MemoryHost::default();
        let (modulation, truth) = tube_of(n);
        let inputs = In { modulation: Modulation(modulation), truth: Truth(truth), source: PhantomData };
        let list = SectionTube::run(&Params::default(), inputs, Ctx::new(&host)).unwrap().sections.list().unwrap();
        assert!((2..5).contains(&list.len()) && list.iter().all(|s| s.pixels >= 20), "{n}: {list:?}");
        let warnings = host.warnings.lock().unwrap().clone();
        let said = format!("{} sections in place of 5: section ", list.len());
        assert!(warnings.len() == 1 && warnings[0].starts_with(&said), "{n}: {warnings:?}");
        assert!(host.measures.lock().unwrap()["masked"] > 0.0);
        let asked = run(&with(Method::IntensitySteps, Some(5)), tube_of(n)).unwrap_err().to_string();
        assert!(asked.contains("pixels with a good modulation"), "{asked}");
    }
}

/// Where every pixel of the wall is masked the error says why, and what to do.
#[test]
fn a_wall_without_a_signal_says_why() {
    let (mut modulation, truth) = tube_of(32);
    let noisy = Array2::from_elem((32, 32), MaskReason::LowSignal.code());
    modulation.push(LayerInfo::new("mask", LayerKind::Mask, "1"), noisy);
    let said = run(&Params::default(), (modulation, truth)).unwrap_err().to_string();
    assert!(said.contains("has a good modulation: 100 % signal too weak"), "{said}");
    assert!(said.contains("`low_signal: 0` in `demodulate`"), "{said}");
}
