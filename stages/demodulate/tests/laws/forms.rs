//! What is said of the outputs before a run, and inputs that do not fit.

use std::f64::consts::TAU;
use std::marker::PhantomData;

use serde_json::{Value, json};
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Covariance, Frames, Payload};
use turbid_contract::{
    Ctx, Form, ImageStack, Known, LayerInfo, LayerKind, Length, MemoryHost, PerLength, Problem, Problems, Stage,
};
use turbid_demodulate::{Demodulate, In, Method, Params};

const N: usize = 48;
const RADIANCE: &str = "W mm^-2 sr^-1";

/// Which frames there are.
#[derive(Clone, Default)]
struct Shown {
    wavelengths_nm: Vec<Option<f64>>,
    f_x: Vec<f64>,
    orientations_deg: Vec<f64>,
    phases: usize,
    errors: bool,
    /// Frames that do not know their errors in a pixel.
    flags: bool,
}

fn shown() -> Shown {
    let orientations_deg = vec![0.0, 90.0];
    Shown { wavelengths_nm: vec![None], f_x: vec![0.0, 0.1, 0.2], orientations_deg, phases: 3, ..Shown::default() }
}

fn frames(shown: &Shown) -> Frames {
    let mut stack = ImageStack::new(N, N);
    let mut push = |info: LayerInfo, of: &dyn Fn(f64) -> f64| {
        let along = |r: usize, c: usize| if info.orientation_deg == Some(90.0) { N - r } else { c };
        let data = Array2::from_shape_fn((N, N), |(r, c)| of(along(r, c) as f64) as f32);
        stack.push(info.clone(), data);
        if shown.errors {
            stack.push(info.standard_error(), Array2::from_elem((N, N), 1e-3));
        }
        if shown.flags {
            stack.push(info.se_unknown(), Array2::from_shape_fn((N, N), |place| f32::from(u8::from(place == (3, 3)))));
        }
    };
    for &wavelength_nm in &shown.wavelengths_nm {
        let info = |f_x: f64| LayerInfo { wavelength_nm, ..LayerInfo::value("radiance", RADIANCE).with_f_x(f_x) };
        for &f_x in &shown.f_x {
            if f_x == 0.0 {
                push(info(f_x), &|_| 0.5);
                continue;
            }
            for &o in &shown.orientations_deg {
                for k in 0..shown.phases {
                    let phase = TAU * k as f64 / shown.phases as f64;
                    let info = LayerInfo { phase_rad: Some(phase), orientation_deg: Some(o), ..info(f_x) };
                    push(info, &|x| 0.5 + 0.3 * libm::cos(TAU * f_x * x + phase));
                }
            }
        }
    }
    for name in ["view_deg", "thickness"] {
        stack.push(LayerInfo::new(name, LayerKind::Condition, "deg"), Array2::zeros((N, N)));
    }
    stack.attributes.insert("conditions".into(), json!({"said_by": "user", "seen": []}));
    Frames(stack)
}

fn covariance(shown: &Shown) -> Covariance {
    let mut stack = ImageStack::new(N, N);
    let mut quantities: Vec<Value> = Vec::new();
    for &w in &shown.wavelengths_nm {
        let first = quantities.len();
        let mut list = |part: &str, f_x: f64, o: f64| {
            let mut said = json!({"part": part, "f_x_per_mm": f_x, "orientation_deg": o});
            if let Some(w) = w {
                said["wavelength_nm"] = w.into();
            }
            quantities.push(said);
        };
        list("dc", 0.0, 0.0);
        for &f_x in shown.f_x.iter().filter(|f| **f > 0.0) {
            shown.orientations_deg.iter().for_each(|&o| ["re", "im"].iter().for_each(|part| list(part, f_x, o)));
        }
        for (i, j) in (first..quantities.len()).flat_map(|i| (i..quantities.len()).map(move |j| (i, j))) {
            let mut info = LayerInfo::new("cov", LayerKind::Covariance, "W^2 mm^-4 sr^-2");
            (info.pair, info.wavelength_nm) = (Some([i as u32, j as u32]), w);
            stack.push(info, Array2::from_elem((N, N), if i == j { 1e-6 } else { 0.0 }));
        }
    }
    stack.attributes.insert("quantities".into(), quantities.into());
    Covariance(stack)
}

fn known(frames: &Frames, covariance: Option<&Covariance>) -> Known {
    let mut known = Known { wanted: vec!["modulation".into()], ..Known::default() };
    let covariance = covariance.map(|c| ("covariance", c.clone().into_artifact()));
    for (port, artifact) in [("frames", frames.clone().into_artifact())].into_iter().chain(covariance) {
        known.connected.push(port.into());
        known.forms.insert(port.into(), vec![Form::of(&artifact).into()]);
        known.extents.insert(port.into(), artifact.extent());
        known.producers.insert(port.into(), format!("shots.{port}"));
    }
    known
}

fn assert_held(params: &Params, frames: &Frames, covariance: Option<&Covariance>) {
    let known = known(frames, covariance);
    let wanted = if params.method == Method::Speckle { Vec::new() } else { vec!["phase".to_owned()] };
    let host = MemoryHost { wanted, ..MemoryHost::default() };
    let mut problems = Problems::default();
    Demodulate::check(params, &known, &mut problems);
    assert!(problems.is_empty(), "{problems:?}");
    let forms = Demodulate::describe(params, &known);
    assert!(Demodulate::plan(params, &known).memory.is_some());
    let inputs =
        In { frames: frames.clone().into(), covariance: covariance.cloned(), scene: None, source: PhantomData };
    let out = Demodulate::run(params, inputs, Ctx::new(&host)).unwrap();
    let phase = out.phase.map(|phase| ("phase", phase.into_artifact()));
    for (port, artifact) in [("modulation", out.modulation.into_artifact())].into_iter().chain(phase) {
        let form = &forms[port];
        assert!(form.pixels.is_some() && form.layers.is_some(), "{port}: {form:?}");
        assert_eq!(form.broken_by(&Form::of(&artifact)), None, "{port} of {params:?}");
    }
}

#[test]
fn what_is_said_is_made() {
    let coloured = || Shown { wavelengths_nm: vec![Some(650.0), Some(532.0)], ..shown() };
    for shown in [shown(), coloured()] {
        for (errors, flags) in [(false, false), (true, false), (true, true)] {
            let shown = Shown { errors, flags, ..shown.clone() };
            assert_held(&Params::default(), &frames(&shown), None);
            assert_held(&Params::default(), &frames(&shown), Some(&covariance(&shown)));
            let single = Params { method: Method::SingleShot, pixel_mm: Some(Length(1.0)), ..Params::default() };
            assert_held(&single, &frames(&shown), None);
            let even = Shown { f_x: vec![0.0], ..shown };
            let f_x = vec![PerLength(0.1), PerLength(0.12)];
            let window = Some(Length(24.0));
            let speckle = Params { method: Method::Speckle, f_x, window, ..single };
            assert_held(&speckle, &frames(&even), None);
        }
    }
}

/// Frames that may have errors or not leave layers open, and keep size and attributes.
#[test]
fn what_is_in_doubt_is_open() {
    let frames = frames(&Shown { errors: true, ..shown() });
    let mut known = known(&frames, None);
    let form = &mut known.forms.get_mut("frames").unwrap()[0];
    let mut doubt = (**form).clone();
    let layers = doubt.layers.as_mut().unwrap();
    doubt.perhaps = layers.iter().filter(|l| l.kind == LayerKind::StandardError).cloned().collect();
    layers.retain(|l| l.kind != LayerKind::StandardError);
    *form = doubt.into();
    let said = &Demodulate::describe(&Params::default(), &known)["modulation"];
    assert!(said.layers.is_none() && said.pixels == Some([48, 48]) && said.attribute("conditions").is_some());
}

fn told(params: &Params, known: &Known) -> Problem {
    let mut problems = Problems::default();
    Demodulate::check(params, known, &mut problems);
    let mut found = problems.into_parts().0;
    assert_eq!(found.len(), 1, "{found:?}");
    found.remove(0)
}

#[track_caller]
fn assert_told(params: &Params, known: &Known, parts: &[&str]) {
    let text = told(params, known).to_string();
    parts.iter().for_each(|part| assert!(text.contains(part), "`{part}` is missing in `{text}`"));
}

/// The rules of the run find before it what does not fit, with the port, who makes it, and both values.
#[test]
fn wrong_joints_are_named() {
    let fine = Params::default();
    let with = |shown: &Shown| known(&frames(shown), None);
    let phases = with(&Shown { phases: 2, ..shown() });
    assert_told(&fine, &phases, &["in.frames: `shots.frames`: ", "the 2 phases at f_x = 0.1 mm^-1", "at least 3"]);
    let mut silent = with(&shown());
    let strip = |known: &mut Known, strip: &dyn Fn(&mut LayerInfo)| {
        let form = &mut known.forms.get_mut("frames").unwrap()[0];
        let mut open = (**form).clone();
        open.layers.as_mut().unwrap().iter_mut().for_each(strip);
        *form = open.into();
    };
    strip(&mut silent, &|info| info.f_x_per_mm = None);
    assert_told(&fine, &silent, &["in.frames", "does not say its f_x"]);
    let mut silent = with(&shown());
    strip(&mut silent, &|info| info.phase_rad = None);
    assert_told(&fine, &silent, &["in.frames", "does not say its phase"]);
    let mut empty = with(&shown());
    strip(&mut empty, &|info| info.kind = LayerKind::Condition);
    assert_told(&fine, &empty, &["in.frames", "no layer with values"]);

    let beside = |shown: &Shown, other: &Shown| known(&frames(shown), Some(&covariance(other)));
    let other = beside(&shown(), &Shown { f_x: vec![0.0, 0.3], ..shown() });
    let both = "in.covariance: `shots.covariance` does not belong to `shots.frames`: ";
    let lacks = "the covariance lacks `re` at f_x = 0.1 mm^-1: it has it at f_x = 0.3 mm^-1; f_x = 0.3 mm^-1, 90 deg";
    assert_told(&fine, &other, &[both, lacks, "of one stage"]);
    let other = beside(&shown(), &Shown { wavelengths_nm: vec![Some(650.0)], ..shown() });
    assert_told(&fine, &other, &[both, "lacks `dc` at f_x = 0 mm^-1", "650 nm"]);
    let mut small = beside(&shown(), &shown());
    let form = &mut small.forms.get_mut("covariance").unwrap()[0];
    *form = Form { pixels: Some([4, 8]), ..(**form).clone() }.into();
    assert_told(&fine, &small, &[both, "the covariance is 8 x 4 pixels, the frames are 48 x 48"]);
}

/// Noise in another unit than the signal is found before the run, and in it: a covariance of radiances beside frames of counts would give standard
/// errors that are 1e6 times too small.
#[test]
fn covariances_in_another_unit_are_named() {
    let (shown, fine) = (shown(), Params::default());
    let mut counts = frames(&shown);
    let values = counts.0.layers.iter_mut().filter(|layer| layer.info.kind == LayerKind::Value);
    values.for_each(|layer| layer.info.unit = "counts".into());
    let parts =
        ["`shots.covariance` does not belong to `shots.frames`: ", "in W^2 mm^-4 sr^-2", "in counts", "counts^2"];
    assert_told(&fine, &known(&counts, Some(&covariance(&shown))), &parts);
    let inputs =
        In { frames: counts.clone().into(), covariance: Some(covariance(&shown)), scene: None, source: PhantomData };
    let error = Demodulate::run(&fine, inputs, Ctx::new(&MemoryHost::default())).err().expect("it is refused");
    assert!(
        error.to_string().contains("the covariance is in W^2 mm^-4 sr^-2, but the frames are in counts"),
        "{error}"
    );
    for square in ["counts^2", "(counts)^2"] {
        let mut fits = covariance(&shown);
        fits.0.layers.iter_mut().for_each(|layer| layer.info.unit = square.into());
        assert_held(&fine, &counts, Some(&fits));
    }
}

/// Methods that take their noise from elsewhere say so of a covariance that is connected, and that they do not read.
#[test]
fn a_covariance_that_is_not_read_is_warned_of() {
    let even = Shown { f_x: vec![0.0], ..shown() };
    let pixel_mm = Some(Length(1.0));
    let single = Params { method: Method::SingleShot, pixel_mm, ..Params::default() };
    let speckle = Params {
        method: Method::Speckle,
        f_x: vec![PerLength(0.1)],
        window: Some(Length(24.0)),
        pixel_mm,
        ..Params::default()
    };
    let warned = |params: &Params, known: &Known| {
        let mut problems = Problems::default();
        Demodulate::check(params, known, &mut problems);
        let (mistakes, warnings) = problems.into_parts();
        assert!(mistakes.is_empty(), "{mistakes:?}");
        warnings.iter().map(Problem::to_string).collect::<Vec<_>>()
    };
    for (params, method, shown, noise) in
        [(&single, "single_shot", shown(), "standard errors"), (&speckle, "speckle", even, "the spread of the frames")]
    {
        assert_eq!(warned(params, &known(&frames(&shown), None)), Vec::<String>::new());
        let told = warned(params, &known(&frames(&shown), Some(&covariance(&shown))));
        let [told] = &told[..] else { panic!("{told:?}") };
        for part in ["in.covariance: `shots.covariance` is not read", method, noise, "phase_shift"] {
            assert!(told.contains(part), "`{part}` is missing in `{told}`");
        }
    }
    assert!(warned(&Params::default(), &known(&frames(&shown()), Some(&covariance(&shown())))).is_empty());
}

#[test]
fn shots_and_speckle_that_cannot_be_read_are_named() {
    let with = |shown: &Shown| known(&frames(shown), None);
    let single = |pixel: f64| Params { method: Method::SingleShot, pixel_mm: Some(Length(pixel)), ..Params::default() };
    let nyquist = ["in.frames: `shots.frames`: ", "f_x = 0.1 mm^-1", "0.4000 cycles per pixel of 4 mm", "3 pixels"];
    assert_told(&single(4.0), &with(&shown()), &nyquist);
    let aslant = Shown { orientations_deg: vec![30.0], ..shown() };
    assert_told(&single(1.0), &with(&aslant), &["in.frames", "fringes at 30 deg", "orientation_deg 0 or 90"]);
    let even = Shown { f_x: vec![0.0], ..shown() };
    assert_told(&single(1.0), &with(&even), &["in.frames", "no fringes (f_x > 0)"]);
    let narrow = Params { window: Some(Length(5.0)), ..single(1.0) };
    assert_told(&narrow, &with(&shown()), &["window: ", "0.50 periods of f_x = 0.1 mm^-1"]);

    let speckle = |f_x: f64| Params {
        method: Method::Speckle,
        f_x: vec![PerLength(f_x)],
        window: Some(Length(60.0)),
        ..single(1.0)
    };
    assert_told(&speckle(0.1), &with(&shown()), &["in.frames", "a frame shows fringes of f_x = 0.1 mm^-1"]);
    assert_told(&speckle(0.6), &with(&even), &["f_x: ", "beyond what pixels of 1 x 1 mm resolve"]);
    let mut phase = with(&even);
    phase.wanted.push("phase".into());
    assert_told(&speckle(0.1), &phase, &["method: speckle has no phase", "phase_shift"]);
}
