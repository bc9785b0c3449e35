//! Speckle in place of fringes.

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Frames, MaskReason};
use turbid_contract::{ImageStack, Known, LayerInfo, Length, PerLength, Problems, Stage};
use turbid_demodulate::{Demodulate, Method, Params};

use crate::{Truth, frames, noise, with};

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
