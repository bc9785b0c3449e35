//! One shot of a fringe in place of three.

use std::f64::consts::PI;

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Frames, MaskReason};
use turbid_contract::{ImageStack, Known, LayerInfo, Length, Problems, Stage};
use turbid_demodulate::{Demodulate, Filter, Method, Params};

use crate::{noise, push, with};

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

/// What the window cannot follow is part of the error: over texture of the sample's own (smoothed noise, 4 px wide) the stated error of M_DC and M_AC
/// covers what is off, and on even tissue it is that of the noise alone.
#[test]
fn structure_that_no_window_follows_is_in_the_error() {
    let (rows, columns, f_x, sigma) = (40, 128, 0.1, 0.002);
    let mut draw = noise(11);
    let white: Vec<f64> = (0..rows * columns).map(|_| draw()).collect();
    let kernel: Vec<f64> = (-12..=12).map(|k: i32| (-0.5 * (f64::from(k) / 4.0).powi(2)).exp()).collect();
    let gain = kernel.iter().map(|w| w * w).sum::<f64>().sqrt();
    let texture = |r: usize, c: usize| {
        let at = |k: usize| white[r * columns + (c + columns + k - 12) % columns];
        kernel.iter().enumerate().map(|(k, w)| w * at(k)).sum::<f64>() / gain
    };
    for strength in [0.0, 0.08] {
        let truth = |r: usize, c: usize| 1.0 + strength * texture(r, c);
        let params = Params { method: Method::SingleShot, pixel_mm: Some(Length(1.0)), ..Params::default() };
        let values = Array2::from_shape_fn((rows, columns), |(r, c)| {
            truth(r, c) * (0.5 + 0.2 * (2.0 * PI * f_x * c as f64).cos()) + sigma * draw()
        });
        let mut stack = ImageStack::new(rows, columns);
        push(&mut stack, f_x, 0.0, &|r, c| values[(r, c)], Some(sigma));
        let out = with(&params, Frames(stack), None, &[]).unwrap().0.modulation.0;
        for (name, level) in [("m_dc", 0.5), ("m_ac", 0.2)] {
            let value = out.find(name, Some(f_x)).unwrap();
            let se = &out.standard_error(&value.info).unwrap().data;
            let off =
                |at: (usize, usize)| (f64::from(value.data[at]) - level * truth(at.0, at.1)).abs() / f64::from(se[at]);
            let places = || (0..rows).flat_map(|r| (0..columns).map(move |c| (r, c)));
            let within = |limit: f64| places().filter(|&at| off(at) < limit).count() as f64 / (rows * columns) as f64;
            let (one, two) = (within(1.0), within(2.0));
            println!("{strength} {name}: {one:.3} {two:.3}");
            // Neighbours share a window of 20 pixels: some 250 independent errors, sd 3 % at 68 % and 1.4 % at 95 %.
            assert!(
                (0.59..0.80).contains(&one) && two > 0.90,
                "{strength} {name}: {one:.3} within 1, {two:.3} within 2"
            );
        }
    }
}
