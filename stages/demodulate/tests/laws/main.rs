//! The stage as the engine calls it: what goes in, what comes out, and what is refused.

use std::f64::consts::PI;

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Covariance, Frames};
use turbid_contract::{Ctx, Error, ImageStack, LayerInfo, LayerKind, MemoryHost, Stage};
use turbid_demodulate::{Demodulate, In, Out, Params};

mod acquisition;
mod errors;
mod even_light;
mod forms;
mod inputs;
mod masks;
mod single_shot;
mod speckle;
mod steps;

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
    let inputs = In { frames: frames.into(), covariance, scene: None, source: std::marker::PhantomData };
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
