//! The stage as the engine calls it: what goes in, what comes out, and what is refused.

use std::f64::consts::PI;

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Covariance, Frames, MaskReason};
use turbid_contract::{
    Ctx, Error, ImageStack, Known, LayerInfo, LayerKind, Length, MemoryHost, PerLength, Problems, Stage,
};
use turbid_demodulate::{Demodulate, Filter, In, Method, Out, Params, Steps};

mod errors;
mod forms;

/// A pattern's response at one pixel: M_DC and the complex fringe amplitude of each f_x.
struct Truth {
    dc: f64,
    fringes: Vec<(f64, f64, f64)>,
}

fn push(stack: &mut ImageStack, f_x: f64, phase: f64, value: &dyn Fn(usize, usize) -> f64, se: Option<f64>) {
    let mut info = LayerInfo::value("radiance", "W mm^-2 sr^-1").with_f_x(f_x);
    info.phase_rad = Some(phase);
    let dim = (stack.rows(), stack.columns());
    stack.push(info.clone(), Array2::from_shape_fn(dim, |(r, c)| value(r, c) as f32));
    if let Some(se) = se {
        stack.push(info.standard_error(), Array2::from_elem(dim, se as f32));
    }
}

fn frames(
    rows: usize,
    columns: usize,
    truth: &Truth,
    steps: usize,
    se: Option<f64>,
    noise: &mut dyn FnMut() -> f64,
) -> Frames {
    let mut stack = ImageStack::new(rows, columns);
    let mut plane = |stack: &mut ImageStack, f_x, phase, mean: f64| {
        let values = Array2::from_shape_fn((rows, columns), |_| mean + noise());
        push(stack, f_x, phase, &|r, c| values[(r, c)], se);
    };
    plane(&mut stack, 0.0, 0.0, truth.dc);
    for &(f_x, m_ac, phi) in &truth.fringes {
        for k in 0..steps {
            let d = 2.0 * PI * k as f64 / steps as f64;
            plane(&mut stack, f_x, d, truth.dc + m_ac * (phi + d).cos());
        }
    }
    Frames(stack)
}

fn demodulate(frames: Frames, covariance: Option<Covariance>, wanted: &[&str]) -> Result<(Out, MemoryHost), Error> {
    with(&Params::default(), frames, covariance, wanted)
}

fn with(
    params: &Params,
    frames: Frames,
    covariance: Option<Covariance>,
    wanted: &[&str],
) -> Result<(Out, MemoryHost), Error> {
    let host = MemoryHost { wanted: wanted.iter().map(|w| w.to_string()).collect(), ..MemoryHost::default() };
    let inputs = In { frames, covariance, scene: None, source: std::marker::PhantomData };
    let out = Demodulate::run(params, inputs, Ctx::new(&host))?;
    Ok((out, host))
}

fn at(stack: &ImageStack, name: &str, f_x: Option<f64>) -> f64 {
    f64::from(stack.find(name, f_x).unwrap_or_else(|| panic!("layer {name} at {f_x:?}")).data[(0, 0)])
}

/// Uniform in [-sqrt 3, sqrt 3): variance 1.
fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = (state ^ (state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        (((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64 - 0.5) * 12.0_f64.sqrt()
    }
}

/// M_DC, M_AC and phase of known fringes, from 1 pixel up, at M_DC / M_AC from 1 to 1e6; tolerance: frames rounded to f32,
/// 2^-24 (M_DC + M_AC) each, times the 1-norm of the weights (2/N sum |cos| <= 4/3), and the result's own rounding.
#[test]
fn known_fringes_come_back() {
    for (rows, columns) in [(1, 1), (3, 700)] {
        for ratio in [1.0, 1e2, 1e4, 1e6] {
            for steps in [3, 4, 5] {
                let (dc, m_ac, phi) = (0.7, 0.7 / ratio, 2.5);
                let truth = Truth { dc, fringes: vec![(0.1, m_ac, phi)] };
                let (out, _) =
                    demodulate(frames(rows, columns, &truth, steps, None, &mut || 0.0), None, &["phase"]).unwrap();
                let stack = &out.modulation.0;
                let rounding = 2.0_f64.powi(-24) * (dc + m_ac);
                for (name, f_x, want) in [("m_dc", 0.0, dc), ("m_ac", 0.0, dc), ("m_dc", 0.1, dc), ("m_ac", 0.1, m_ac)]
                {
                    let got = at(stack, name, Some(f_x));
                    assert!(
                        (got - want).abs() <= 1.4 * rounding + 1e-7 * want,
                        "{name} {f_x}: {got} for {want} ({steps})"
                    );
                }
                let phase = at(&out.phase.as_ref().unwrap().0, "phase", Some(0.1));
                assert!((phase - phi).abs() <= 1.4 * rounding / m_ac + 3e-7, "phase {phase} at ratio {ratio}");
                assert!(stack.find("mask", None).unwrap().data.iter().all(|&m| m == 0.0));
                assert!(stack.find("m_ac_se", None).is_none(), "no standard error where none is known");
            }
        }
    }
}

fn covariance(quantities: &[(&str, f64)], matrix: &[&[f64]]) -> Covariance {
    let mut stack = ImageStack::new(1, 1);
    let list: Vec<_> = quantities
        .iter()
        .map(|(part, f)| serde_json::json!({"part": part, "f_x_per_mm": f, "orientation_deg": 0.0}))
        .collect();
    stack.attributes.insert("quantities".into(), list.into());
    for (i, row) in matrix.iter().enumerate() {
        for (j, &value) in row.iter().enumerate().skip(i) {
            let mut info = LayerInfo::new("cov", LayerKind::Covariance, "W^2 mm^-4 sr^-2");
            info.pair = Some([i as u32, j as u32]);
            stack.push(info, Array2::from_elem((1, 1), value as f32));
        }
    }
    Covariance(stack)
}

/// Every reason to mask, each with zeros in all value layers.
#[test]
fn masked_pixels_hold_zero_and_the_reason() {
    // good; NaN in one frame; nothing at all; negative mean; good ones; fringes below 3 standard errors, of which the
    // first two have strong neighbours.
    let dc = [0.5, 0.5, 0.0, -0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5];
    let ac = [0.2, 0.2, 0.0, 0.2, 0.2, 0.2, 0.01, 0.01, 0.01, 0.01];
    let columns = dc.len();
    let mut stack = ImageStack::new(1, columns);
    for (f_x, k) in [(0.0, 0), (0.1, 0), (0.1, 1), (0.1, 2)] {
        let phase = 2.0 * PI * f64::from(k) / 3.0;
        let mut info = LayerInfo::value("radiance", "W mm^-2 sr^-1").with_f_x(f_x);
        info.phase_rad = Some(phase);
        let value = |c: usize| {
            if c == 1 && k == 2 { f64::NAN } else { dc[c] + if f_x > 0.0 { ac[c] * phase.cos() } else { 0.0 } }
        };
        stack.push(info.clone(), Array2::from_shape_fn((1, columns), |(_, c)| value(c) as f32));
        let se = |c: usize| if c == 2 { 0.0 } else { 0.01 };
        stack.push(info.standard_error(), Array2::from_shape_fn((1, columns), |(_, c)| se(c)));
    }
    let (out, _) = demodulate(Frames(stack), None, &["phase"]).unwrap();
    let stack = &out.modulation.0;
    let mask: Vec<f32> = stack.find("mask", None).unwrap().data.iter().copied().collect();
    use MaskReason::{Background, Good, LowSignal, NotFinite};
    let want = [Good, NotFinite, Background, LowSignal, Good, Good, Good, Good, LowSignal, LowSignal];
    assert_eq!(mask, want.map(MaskReason::code));
    for layer in stack.layers.iter().chain(&out.phase.unwrap().0.layers).filter(|l| l.info.kind != LayerKind::Mask) {
        let masked = layer.data.iter().zip(want).filter(|(_, reason)| *reason != Good);
        assert!(masked.into_iter().all(|(&v, _)| v == 0.0), "{}", layer.info.name);
    }
    let info = &stack.find("m_ac", Some(0.1)).unwrap().info;
    let good: f64 = stack.standard_error(info).unwrap().data.iter().map(|&se| f64::from(se).powi(2)).sum();
    assert!(
        (info.mean_se.unwrap() / (good.sqrt() / 5.0) - 1.0).abs() < 1e-6,
        "the mean's error counts good pixels only"
    );
}

/// A saturated frame and a mask that the frames bring along mask the pixel, each with its reason; its values are 0.
#[test]
fn saturated_and_masked_frames_are_masked() {
    let truth = Truth { dc: 0.5, fringes: vec![(0.1, 0.2, 0.0)] };
    let mut input = frames(1, 40, &truth, 3, Some(0.001), &mut || 0.0);
    for layer in &mut input.0.layers {
        if layer.info.kind == LayerKind::Value
            && layer.info.phase_rad == Some(0.0)
            && layer.info.f_x_per_mm == Some(0.1)
        {
            layer.data[(0, 7)] = 0.95;
        }
    }
    let mut mask = Array2::zeros((1, 40));
    mask[(0, 20)] = MaskReason::Background.code();
    input.0.push(LayerInfo::new("mask", LayerKind::Mask, "1"), mask);
    for with_errors in [true, false] {
        let mut frames = input.clone();
        if !with_errors {
            frames.0.layers.retain(|l| l.info.kind != LayerKind::StandardError);
        }
        let params = Params { saturation: Some(0.9), ..Params::default() };
        let (out, _) = with(&params, frames, None, &["phase"]).unwrap();
        let stack = &out.modulation.0;
        let mask = &stack.find("mask", None).unwrap().data;
        for (c, want) in [(6, MaskReason::Good), (7, MaskReason::Saturated), (20, MaskReason::Background)] {
            assert_eq!(mask[(0, c)], want.code(), "column {c}, errors {with_errors}");
            let m_ac = stack.find("m_ac", Some(0.1)).unwrap().data[(0, c)];
            assert_eq!(m_ac == 0.0, want != MaskReason::Good, "column {c}");
        }
    }
}

/// The bytes do not depend on whether the phase is wanted.
#[test]
fn wanting_the_phase_changes_nothing_else() {
    for steps in [3, 7] {
        let truth = Truth { dc: 0.5, fringes: vec![(0.1, 0.02, 2.0), (0.3, 0.2, 0.0)] };
        let mut next = noise(11);
        let input = frames(5, 77, &truth, steps, None, &mut || 0.01 * next());
        let plain = demodulate(input.clone(), None, &[]).unwrap().0.modulation;
        assert_eq!(plain, demodulate(input, None, &["phase"]).unwrap().0.modulation);
    }
}

/// One shot of a flat field stands in for three: M_DC, M_AC and phase away from the ends, along rows and columns, with standard errors
/// that are the spread of the pixels; a reason reaches as far as a filter does, and a fit goes on without the pixel; what cannot be parted is named.
#[test]
fn a_single_shot_reads_flat_fields() {
    let (n, f_x, sigma) = (120, 0.1, 0.002);
    let ways = [0.0, 90.0].into_iter().flat_map(|o| [(o, Filter::LeastSquares), (o, Filter::Gaussian)]);
    for (orientation, filter) in ways {
        let mut next = noise(5);
        let mut stack = ImageStack::new(n, n);
        let mut info = LayerInfo::value("radiance", "W mm^-2 sr^-1").with_f_x(f_x);
        (info.phase_rad, info.orientation_deg) = (Some(0.4), Some(orientation));
        // Row 0 lies at +y.
        let u = |r: usize, c: usize| if orientation == 0.0 { c as f64 } else { -(r as f64) };
        let value = |(r, c): (usize, usize)| 0.5 + 0.2 * (2.0 * PI * f_x * u(r, c) + 0.4 + 1.0).cos() + sigma * next();
        stack.push(info.clone(), Array2::from_shape_fn((n, n), value).mapv(|v: f64| v as f32));
        stack.push(info.standard_error(), Array2::from_elem((n, n), sigma as f32));
        stack.layers[0].data[(2, 2)] = f32::NAN;
        let params = Params { method: Method::SingleShot, filter, pixel_mm: Some(Length(1.0)), ..Params::default() };
        let (out, _) = with(&params, Frames(stack.clone()), None, &["phase"]).unwrap();
        let (found, phase) = (&out.modulation.0, &out.phase.unwrap().0);
        let inside = |r: usize, c: usize| (30..90).contains(&r) && (30..90).contains(&c);
        for (name, f, want) in [("m_dc", 0.0, 0.5), ("m_dc", f_x, 0.5), ("m_ac", f_x, 0.2)] {
            let layer = found.find(name, Some(f)).unwrap();
            let se = f64::from(found.standard_error(&layer.info).unwrap().data[(50, 50)]);
            let values: Vec<f64> =
                layer.data.indexed_iter().filter(|((r, c), _)| inside(*r, *c)).map(|(_, &v)| f64::from(v)).collect();
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            let spread = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt();
            // Pixels within 1.3 periods share noise: some 3600 / 15 independent ones, a spread known to 5 %; 4 sigma.
            assert!((mean - want).abs() < 4.0 * sigma / 3600.0_f64.sqrt() + 3e-4 * want, "{name}: {mean}");
            assert!((spread / se - 1.0).abs() < 0.2, "{name}: spread {spread}, se {se}");
        }
        let phi = &phase.find("phase", Some(f_x)).unwrap().data;
        for (r, c) in [(40, 41), (60, 77)] {
            let off = f64::from(phi[(r, c)]) - (2.0 * PI * f_x * u(r, c) + 1.0);
            assert!((off - 2.0 * PI * (off / (2.0 * PI)).round()).abs() < 0.05, "{off}");
        }
        let mask = &found.find("mask", None).unwrap().data;
        let (near, far) = if orientation == 0.0 { ((2, 30), (3, 2)) } else { ((30, 2), (2, 3)) };
        let reached = if filter == Filter::Gaussian { MaskReason::NotFinite.code() } else { 0.0 };
        assert_eq!((mask[(2, 2)], mask[near], mask[far]), (MaskReason::NotFinite.code(), reached, 0.0));
        let refused = |pixel: f64| {
            let params = Params { pixel_mm: Some(Length(pixel)), ..params.clone() };
            with(&params, Frames(stack.clone()), None, &[]).map(|_| ()).unwrap_err().to_string()
        };
        assert!(refused(4.0).contains("0.4000 cycles per pixel") && refused(0.1).contains("1.2 in the image"));
        let narrow = Params { window: Some(Length(8.0)), filter: Filter::LeastSquares, ..params.clone() };
        let message = with(&narrow, Frames(stack.clone()), None, &[]).map(|_| ()).unwrap_err().to_string();
        assert!(message.contains("a window of 8 mm holds 0.80 periods of f_x = 0.1"), "{message}");
    }
    for (params, said) in [
        (Params { filter: Filter::Gaussian, ..Params::default() }, "only `method: single_shot` reads filter"),
        (Params { window: Some(Length(9.0)), ..Params::default() }, "`method: speckle` read window"),
        (
            Params {
                method: Method::SingleShot,
                pixel_mm: Some(Length(1.0)),
                filter: Filter::Rectangle,
                window: Some(Length(9.0)),
                ..Params::default()
            },
            "only `least_squares` reads window",
        ),
    ] {
        let mut problems = Problems::default();
        Demodulate::check(&params, &Known::default(), &mut problems);
        let found = problems.into_parts().0;
        assert!(found.len() == 1 && found[0].to_string().contains(said), "{found:?}");
    }
    let mut problems = Problems::default();
    Demodulate::check(&Params { method: Method::SingleShot, ..Params::default() }, &Known::default(), &mut problems);
    assert!(problems.into_parts().0[0].to_string().contains("does not know their size"));
}

/// A fringe that is only the rounding of f32 frames is no signal, even without standard errors.
#[test]
fn rounding_is_no_fringe() {
    let truth = Truth { dc: 0.7, fringes: vec![(0.1, 1e-9, 1.0)] };
    let (out, _) = demodulate(frames(1, 1, &truth, 3, None, &mut || 0.0), None, &[]).unwrap();
    assert_eq!(at(&out.modulation.0, "mask", None), f64::from(MaskReason::LowSignal.code()));
}

/// Frames whose steps are 10 and 20 degrees off what they say: M_AC ripples by percents; with estimated steps it does not, to 1e-6, masked pixels have
/// no say, and how far off they were is measured.
#[test]
fn wrong_steps_are_found() {
    let (off, columns) = ([0.0, 10.0, -20.0, 0.0_f64], 400);
    let mut stack = ImageStack::new(1, columns);
    for (k, off) in off.iter().enumerate() {
        let d = 2.0 * PI * k as f64 / 4.0;
        let fringe = |c: usize| 0.5 + 0.2 * (2.0 * PI * 0.05 * c as f64 + d + off.to_radians()).cos();
        push(&mut stack, 0.1, d, &|_, c| if c < 20 { 9.0 * k as f64 } else { fringe(c) }, None);
    }
    let mask = Array2::from_shape_fn((1, columns), |(_, c)| if c < 20 { MaskReason::Saturated.code() } else { 0.0 });
    stack.push(LayerInfo::new("mask", LayerKind::Mask, "1"), mask);
    let worst = |steps: Steps| {
        let (out, host) = with(&Params { steps, ..Params::default() }, Frames(stack.clone()), None, &[]).unwrap();
        let m_ac = &out.modulation.0.find("m_ac", Some(0.1)).unwrap().data;
        let measured = host.measures.lock().unwrap().get("step_departure").copied();
        ((20..columns).map(|c| (f64::from(m_ac[(0, c)]) / 0.2 - 1.0).abs()).fold(0.0, f64::max), measured)
    };
    let (given, estimated) = (worst(Steps::Given), worst(Steps::Estimated));
    assert!(given.0 > 0.05 && given.1.is_none(), "{given:?}");
    // f32 frames, and steps from 380 of them.
    assert!(estimated.0 < 2e-6 && (estimated.1.unwrap() - 20.0).abs() < 1e-4, "{estimated:?}");
    let known = Known { connected: vec!["covariance".into()], ..Known::default() };
    for (method, message) in [(Method::PhaseShift, "re and im of the given steps"), (Method::SingleShot, "no steps")] {
        let mut problems = Problems::default();
        let params = Params { steps: Steps::Estimated, method, ..Params::default() };
        Demodulate::check(&params, &known, &mut problems);
        let found: Vec<String> = problems.into_parts().0.iter().map(ToString::to_string).collect();
        assert!(found.iter().any(|p| p.contains(message)), "{found:?}");
    }
}

/// Speckle on a sample that passes half the light at every f_x, against the same speckle on a reference: M_DC and M_AC are half, masked pixels have no
/// say, noise does not count, and what cannot be read is named.
#[test]
fn speckle_is_read_like_fringes() {
    let side = 48;
    let speckles = |shrink: f64, spoilt: bool| {
        let mut next = noise(5);
        let mut stack = ImageStack::new(side, side);
        let data = Array2::from_shape_fn((side, side), |_| (shrink * (1.0 + 0.3 * next())) as f32);
        let mut info = LayerInfo::value("radiance", "W mm^-2 sr^-1").with_f_x(0.0);
        stack.push(info.clone(), data.clone());
        info.phase_rad = Some(1.0);
        stack.push(info, Array2::from_shape_fn((side, side), |(r, c)| data[(c, r)]));
        if spoilt {
            stack.layers[0].data[(9, 9)] = f32::NAN;
            stack.layers[1].data[(9, 9)] = 1e9;
        }
        Frames(stack)
    };
    let params = Params {
        method: Method::Speckle,
        f_x: vec![PerLength(0.1), PerLength(0.3)],
        window: Some(Length(20.0)),
        pixel_mm: Some(Length(1.0)),
        ..Params::default()
    };
    let read = |frames: Frames| with(&params, frames, None, &[]).unwrap().0.modulation.0;
    let (reference, sample) = (read(speckles(1.0, false)), read(speckles(0.5, true)));
    for f_x in [0.0, 0.1, 0.3] {
        for name in ["m_dc", "m_ac"] {
            let of = |stack: &ImageStack| stack.find(name, Some(f_x)).unwrap().data.clone();
            let (a, b) = (of(&sample), of(&reference));
            for at in (0..side * side).map(|i| (i / side, i % side)).filter(|&at| at != (9, 9)) {
                // Far from the lost pixel the ratio is exact; beside it a window lacks one of 160 pixels.
                let near = at.0.abs_diff(9) < 21 && at.1.abs_diff(9) < 21;
                let tolerance = if near { 0.12 } else { 1e-5 };
                assert!((f64::from(a[at] / b[at]) / 0.5 - 1.0).abs() < tolerance, "{name} at {f_x}, {at:?}");
            }
        }
        let m_ac = reference.find("m_ac", Some(f_x)).unwrap().data.mean().unwrap();
        assert!(f_x == 0.0 || (f64::from(m_ac) / 0.3 - 1.0).abs() < 0.15, "{f_x}: {m_ac}");
    }
    let mask = &sample.find("mask", None).unwrap().data;
    assert_eq!(mask.iter().filter(|&&m| m != 0.0).count(), 1);
    assert_eq!(mask[(9, 9)], MaskReason::NotFinite.code());
    let check = |params: &Params| {
        let mut problems = Problems::default();
        Demodulate::check(params, &Known::default(), &mut problems);
        problems.into_parts().0.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")
    };
    for (wrong, message) in [
        (Params { f_x: Vec::new(), ..params.clone() }, "none is named"),
        (Params { window: None, ..params.clone() }, "window around a pixel is missing"),
        (Params { window: Some(Length(12.0)), ..params.clone() }, "holds 1.20 periods of f_x = 0.1 mm^-1"),
        (Params { pixel_mm: None, ..params.clone() }, "speckle counts in pixels"),
        (Params { method: Method::PhaseShift, ..params.clone() }, "only `method: speckle` reads f_x"),
    ] {
        assert!(check(&wrong).contains(message), "{}", check(&wrong));
    }
    let fine = with(&Params { f_x: vec![PerLength(0.6)], ..params.clone() }, speckles(1.0, false), None, &[]);
    assert!(fine.err().unwrap().to_string().contains("beyond what pixels of 1 x 1 mm resolve"));
    let truth = Truth { dc: 0.5, fringes: vec![(0.1, 0.2, 0.4)] };
    let fringes = with(&params, frames(8, 8, &truth, 3, None, &mut || 0.0), None, &[]);
    assert!(fringes.err().unwrap().to_string().contains("shows fringes of f_x = 0.1 mm^-1"));
}

/// Two orientations and two wavelengths stay apart.
#[test]
fn orientations_and_wavelengths_are_separate_layers() {
    let mut stack = ImageStack::new(1, 1);
    for (channel, wavelength) in [600.0, 700.0].into_iter().enumerate() {
        for (turn, orientation) in [0.0, 90.0].into_iter().enumerate() {
            for k in 0..3 {
                let mut info = LayerInfo::value("radiance", "1").with_f_x(0.1);
                info.phase_rad = Some(2.0 * PI * f64::from(k) / 3.0);
                (info.orientation_deg, info.wavelength_nm) = (Some(orientation), Some(wavelength));
                let m_ac = 0.1 + 0.1 * channel as f64 + 0.05 * turn as f64;
                stack
                    .push(info.clone(), Array2::from_elem((1, 1), (0.5 + m_ac * info.phase_rad.unwrap().cos()) as f32));
            }
        }
    }
    let (out, _) = demodulate(Frames(stack), None, &[]).unwrap();
    let found: Vec<_> = out.modulation.0.layers.iter().filter(|l| l.info.name == "m_ac").collect();
    assert_eq!(found.len(), 4);
    for (layer, want) in found.iter().zip([0.1, 0.15, 0.2, 0.25]) {
        assert!((f64::from(layer.data[(0, 0)]) - want).abs() < 1e-6, "{:?}", layer.info);
    }
    assert_eq!(out.modulation.0.layers.iter().filter(|l| l.info.kind == LayerKind::Mask).count(), 2);
}

/// Frames and covariances that do not do are named.
#[test]
fn wrong_inputs_are_named() {
    let truth = Truth { dc: 0.5, fringes: vec![(0.1, 0.2, 0.0)] };
    let make = |steps| frames(1, 1, &truth, steps, None, &mut || 0.0);
    let message = |frames, cov| demodulate(frames, cov, &[]).map(|_| ()).unwrap_err().to_string();
    assert!(message(make(2), None).contains("2 phases at f_x = 0.1 mm^-1"));
    assert!(message(Frames(ImageStack::new(1, 1)), None).contains("no layer with values"));
    let mut anonymous = make(3);
    anonymous.0.layers[1].info.f_x_per_mm = None;
    assert!(message(anonymous, None).contains("does not say its f_x"));
    let mut timeless = make(3);
    timeless.0.layers[1].info.phase_rad = None;
    assert!(message(timeless, None).contains("does not say its phase"));
    assert!(message(make(3), Some(covariance(&[("dc", 0.0)], &[&[1.0]]))).contains("lacks `re` at f_x = 0.1"));
    assert!(message(make(3), Some(Covariance(ImageStack::new(2, 1)))).contains("1 x 2 pixels"));
    let lists_only = covariance(&[("dc", 0.0), ("re", 0.1), ("im", 0.1)], &[]);
    assert!(message(make(3), Some(lists_only)).contains("lacks the pair"));

    let mut problems = Problems::default();
    Demodulate::check(&Params { low_signal: -1.0, ..Params::default() }, &Known::default(), &mut problems);
    assert!(problems.into_parts().0[0].to_string().contains("low_signal = -1 must be >= 0"));
}

/// What frames say of their steps is held against what they show: steps that were taken at 0, 120, 240 degrees and declared as 0, 90, 180 are named with what they
/// look like, at every f_x and not only at the highest; radians in the place of degrees; phases where there is no fringe; and an image without fringes of
/// all phases, where nothing can be told. Frames that are what they say raise no doubt.
#[test]
fn doubts_are_told() {
    let n = 60;
    let told = |f_x: &[f64], declared: [f64; 3], taken: [f64; 3]| {
        let mut stack = ImageStack::new(4, n);
        push(&mut stack, 0.0, 0.0, &|_, _| 0.5, None);
        for &f in f_x {
            for k in 0..3 {
                let turn = |c: usize| 2.0 * PI * f * c as f64 + taken[k].to_radians();
                push(&mut stack, f, declared[k].to_radians(), &|_, c| 0.5 + 0.3 * turn(c).cos(), None);
            }
        }
        demodulate(Frames(stack), None, &[]).unwrap().1
    };
    let said = |host: &MemoryHost| host.warnings.lock().unwrap().join("\n");
    let right = [0.0, 120.0, 240.0];
    assert_eq!(said(&told(&[0.05, 0.1], right, right)), "");
    let host = told(&[0.1], [0.0, 90.0, 180.0], right);
    let steps = said(&host);
    assert!(steps.contains("look like steps of 0, 120, 240 deg, not of 0, 90, 180 deg"), "{steps}");
    // (re, im) of three steps by the weights of others: M_AC ripples by some 28 % twice a period.
    let ripple = host.measures.lock().unwrap()["ripple_2f"];
    assert!((ripple - 28.0).abs() < 0.5, "{ripple}");
    let mut mixed = ImageStack::new(4, n);
    for (f, declared) in [(0.05, [0.0, 90.0, 180.0]), (0.1, right)] {
        for k in 0..3 {
            let turn = |c: usize| 2.0 * PI * f * c as f64 + right[k].to_radians();
            push(&mut mixed, f, f64::to_radians(declared[k]), &|_, c| 0.5 + 0.3 * turn(c).cos(), None);
        }
    }
    let host = demodulate(Frames(mixed), None, &[]).unwrap().1;
    let ripple = host.measures.lock().unwrap()["ripple_2f"];
    assert!((ripple - 28.0).abs() < 1.0, "the worst of all f_x is measured: {ripple}");
    let low = said(&host);
    assert!(low.contains("M_AC at f_x = 0.05 mm^-1 ripples") && !low.contains("f_x = 0.1 "), "{low}");
    let radians = said(&told(&[0.1], [0.0, 2.0943951, 4.1887902], right));
    assert!(
        radians.contains("0, 2.1, 4.2 deg) hardly fix a sinusoid") && radians.contains("are they in radians?"),
        "{radians}"
    );
    let flat = said(&told(&[0.0001], right, right));
    assert!(flat.contains("does not show fringes of all phases at f_x = 0.0001 mm^-1"), "{flat}");
    let mut thrice = ImageStack::new(4, n);
    (0..3).for_each(|k| push(&mut thrice, 0.0, 2.0 * PI * f64::from(k) / 3.0, &|_, _| 0.2 + 0.1 * f64::from(k), None));
    let (out, host) = demodulate(Frames(thrice), None, &[]).unwrap();
    assert!(said(&host).contains("the 3 frames at f_x = 0 say phases of 0, 120, 240 deg"), "{}", said(&host));
    assert!((at(&out.modulation.0, "m_dc", Some(0.0)) - 0.3).abs() < 1e-6);
}

/// Frames without any light (the projector below the surface) are named as such by every method, wavelength by wavelength; the masked share is that
/// of all wavelengths.
#[test]
fn frames_without_light_are_named() {
    let (rows, columns) = (8, 64);
    let frames = |levels: &[(f64, f64)]| {
        let mut stack = ImageStack::new(rows, columns);
        for &(nm, level) in levels {
            for k in 0..3 {
                let phase = 2.0 * PI * f64::from(k) / 3.0;
                let turn = |c: usize| 2.0 * PI * 0.1 * c as f64 + phase;
                push(&mut stack, 0.1, phase, &|_, c| level * (0.5 + 0.3 * turn(c).cos()), None);
                stack.layers.last_mut().unwrap().info.wavelength_nm = Some(nm);
            }
        }
        Frames(stack)
    };
    for method in [Method::PhaseShift, Method::SingleShot] {
        let params = Params { method, pixel_mm: Some(Length(1.0)), ..Params::default() };
        let (_, host) = with(&params, frames(&[(650.0, 0.0), (850.0, 1.0)]), None, &[]).unwrap();
        let said = host.warnings.lock().unwrap().clone();
        let one = |words: &str| said.iter().filter(|text| text.contains(words)).count();
        assert_eq!(one("the frames at 650 nm are 0 in every pixel: no light comes to the camera"), 1, "{said:?}");
        assert_eq!(one("all pixels of 650 nm are masked: 100 % background"), usize::from(method == Method::PhaseShift));
        assert_eq!(one("all pixels of 650 nm are masked: 100 % "), 1, "{said:?}");
        assert_eq!(one("850 nm"), 0, "{said:?}");
        assert_eq!(host.measures.lock().unwrap()["masked"], 50.0);
        let (_, host) = with(&params, frames(&[(850.0, 1.0)]), None, &[]).unwrap();
        assert!(host.warnings.lock().unwrap().is_empty());
        assert_eq!(host.measures.lock().unwrap()["masked"], 0.0);
    }
}
