//! Steps that are not what frames say of them.

use std::f64::consts::PI;

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Frames, MaskReason};
use turbid_contract::{ImageStack, Known, LayerInfo, LayerKind, MemoryHost, Problems, Stage};
use turbid_demodulate::{Demodulate, Method, Params, Steps};

use crate::{demodulate, push, with};

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
}
