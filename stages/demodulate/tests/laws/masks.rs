//! Pixels without a result, each with its reason.

use std::f64::consts::PI;

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Frames, MaskReason};
use turbid_contract::{ImageStack, LayerInfo, LayerKind};
use turbid_demodulate::Params;

use crate::{Truth, at, demodulate, frames, with};

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

/// A fringe that is only the rounding of f32 frames is no signal, even without standard errors.
#[test]
fn rounding_is_no_fringe() {
    let truth = Truth { dc: 0.7, fringes: vec![(0.1, 1e-9, 1.0)] };
    let (out, _) = demodulate(frames(1, 1, &truth, 3, None, &mut || 0.0), None, &[]).unwrap();
    assert_eq!(at(&out.modulation.0, "mask", None), f64::from(MaskReason::LowSignal.code()));
}
