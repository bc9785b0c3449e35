//! Inputs that do not do, and frames without light.

use std::f64::consts::PI;

use turbid_contract::payload::{Covariance, Frames};
use turbid_contract::{ImageStack, Known, Length, Problems, Stage};
use turbid_demodulate::{Demodulate, Method, Params};

use crate::{Truth, covariance, demodulate, frames, push, with};

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
