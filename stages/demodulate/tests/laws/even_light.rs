//! Frames at f_x = 0 that carry phases: an amplitude, free of whatever does not follow them.

use super::*;

const DEGREES: [f64; 3] = [0.0, 120.0, 240.0];

/// Even light of M_DC = `lit` in steps, over `ambient`; the steps that the light takes lie `turn_deg` beside the declared ones.
fn stepped(degrees: &[f64], turn_deg: f64, lit: f64, ambient: &dyn Fn(usize) -> f64, se: Option<f64>) -> ImageStack {
    let mut stack = ImageStack::new(8, 8);
    for (k, &d) in degrees.iter().enumerate() {
        let level = ambient(k) + lit * (1.0 + (d + turn_deg).to_radians().cos());
        push(&mut stack, 0.0, d.to_radians(), &|_, _| level, se);
    }
    stack
}

fn fringes(stack: &mut ImageStack, lit: f64, m_ac: f64, offset: f64) {
    for d in DEGREES {
        let turn = |c: usize| 2.0 * PI * 0.1 * c as f64 + d.to_radians();
        push(stack, 0.1, d.to_radians(), &|_, c| offset + lit + m_ac * turn(c).cos(), None);
    }
}

/// M_DC is what follows the phases, `ambient` the rest, whatever the number of steps and a first phase that nobody declared. f32 frames: 1e-6.
#[test]
fn light_that_does_not_follow_is_apart() {
    for degrees in [&DEGREES[..], &[0.0, 90.0, 180.0, 270.0], &[10.0, 100.0, 250.0, 300.0, 310.0]] {
        for turn in [0.0, 35.0, 180.0] {
            let frames = Frames(stepped(degrees, turn, 0.3, &|_| 0.07, None));
            let (out, host) = demodulate(frames, None, &[]).unwrap();
            let found = ["m_dc", "m_ac", "ambient"].map(|name| at(&out.modulation.0, name, Some(0.0)));
            let want = [0.3, 0.3, 0.07];
            assert!(found.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-6), "{degrees:?} {turn}: {found:?}");
            let said = host.warnings.lock().unwrap().join("\n");
            assert_eq!(said.contains("beside them"), turn != 0.0, "{said}");
        }
    }
}

/// A constant offset in all frames changes `ambient`, and not one bit of the other layers where the numbers are exact in f32.
#[test]
fn an_offset_is_ambient_light() {
    let of = |offset: f64| {
        let mut stack = ImageStack::new(8, 8);
        for (k, d) in [0.0, 90.0, 180.0, 270.0].into_iter().enumerate() {
            let level = offset + 0.25 * [2.0, 1.0, 0.0, 1.0][k];
            push(&mut stack, 0.0, f64::to_radians(d), &|_, _| level, None);
            push(&mut stack, 0.1, f64::to_radians(d), &|_, c| level + 0.0625 * (c % 4) as f64, None);
        }
        let (out, host) = demodulate(Frames(stack), None, &[]).unwrap();
        // A step without light is none that was forgotten.
        assert!(!host.warnings.lock().unwrap().join("").contains("is dark"));
        out.modulation.0
    };
    let (plain, offset) = (of(0.0), of(0.5));
    for (a, b) in plain.layers.iter().zip(&offset.layers) {
        let same = a.data == b.data;
        let holds_it = a.info.name == "ambient" || (a.info.name == "m_dc" && a.info.f_x_per_mm == Some(0.1));
        assert_eq!(same, !holds_it, "{:?}", a.info);
    }
    assert!((at(&offset, "ambient", Some(0.0)) - at(&plain, "ambient", Some(0.0)) - 0.5).abs() < 1e-6);
}

/// Room light that grows by the same in every frame: of three steps of light of amplitude D, M_DC moves by sum_n w_n n slope,
/// w = (2/3) cos d_n, that is by -slope; ambient takes the mean.
#[test]
fn drifting_room_light_leaves_its_slope() {
    let slope = 0.004;
    let frames = Frames(stepped(&DEGREES, 0.0, 0.3, &|k| 0.05 + slope * k as f64, None));
    let out = demodulate(frames, None, &[]).unwrap().0.modulation.0;
    // The direction of the frames' sum turns by what stands across: second order in slope / M_DC.
    let across = slope / 3.0_f64.sqrt() / 0.3;
    let want = (0.3 - slope) * (1.0 + 0.5 * across * across);
    assert!((at(&out, "m_dc", Some(0.0)) - want).abs() < 1e-5, "{}", at(&out, "m_dc", Some(0.0)));
}

/// Stated standard errors are the spread over 4000 pixels: sqrt(2 / 3) and, for the ambient light, 1 of a frame's. 5 sigma of a sampled
/// spread are 5.6 %.
#[test]
fn errors_are_the_spread() {
    let (rows, columns, se) = (50, 80, 0.01);
    let mut draw = noise(5);
    let mut stack = ImageStack::new(rows, columns);
    for d in DEGREES {
        let level = 0.05 + 0.3 * (1.0 + d.to_radians().cos());
        let values = Array2::from_shape_fn((rows, columns), |_| level + se * draw());
        push(&mut stack, 0.0, d.to_radians(), &|r, c| values[(r, c)], Some(se));
    }
    let out = demodulate(Frames(stack), None, &[]).unwrap().0.modulation.0;
    for (name, stated) in [("m_dc", se * (2.0_f64 / 3.0).sqrt()), ("ambient", se)] {
        let layer = |kind| out.layers.iter().find(|l| l.info.name.starts_with(name) && l.info.kind == kind).unwrap();
        let values = layer(LayerKind::Value).pixels().iter().map(|&v| f64::from(v)).collect::<Vec<_>>();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let spread = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt();
        let said = f64::from(layer(LayerKind::StandardError).data[(3, 3)]);
        assert!((said / stated - 1.0).abs() < 1e-5, "{name}: {said} for {stated}");
        assert!((spread / stated - 1.0).abs() < 0.056, "{name}: {spread} for {stated}");
    }
}

/// Frames of one phase, or of none, are repeats of one frame; two phases are neither, and phases beside frames without one fit nothing.
#[test]
fn phases_that_fix_no_amplitude_are_refused() {
    let mut repeats = ImageStack::new(8, 8);
    [0.2, 0.3, 0.4].into_iter().for_each(|level| push(&mut repeats, 0.0, 0.0, &|_, _| level, None));
    let out = demodulate(Frames(repeats), None, &[]).unwrap().0.modulation.0;
    assert!((at(&out, "m_dc", Some(0.0)) - 0.3).abs() < 1e-6);
    assert!(out.layers.iter().all(|layer| layer.info.name != "ambient"));
    for degrees in [&[0.0, 180.0][..], &[0.0, 180.0, 360.0], &[0.0, 0.0, 90.0]] {
        let mut stack = stepped(degrees, 0.0, 0.3, &|_| 0.0, None);
        fringes(&mut stack, 0.3, 0.1, 0.0);
        let refused = demodulate(Frames(stack), None, &[]).err().expect("two phases").to_string();
        assert!(refused.contains("fix no amplitude"), "{refused}");
    }
    let mut stack = stepped(&DEGREES, 0.0, 0.3, &|_| 0.0, None);
    stack.layers[1].info.phase_rad = None;
    let refused = demodulate(Frames(stack), None, &[]).err().expect("one has no phase").to_string();
    assert!(refused.contains("the 3 frames at f_x = 0 have phases of 0, 240 deg"), "{refused}");
}
