//! Standard errors, and what noise does to means and masks.

use std::f64::consts::PI;

use turbid_contract::ndarray::Array2;
use turbid_contract::payload::{Frames, MaskReason};
use turbid_contract::{ImageStack, LayerInfo, LayerKind, Length};
use turbid_demodulate::{Method, NoiseBias, Params};

use crate::{Truth, at, covariance, demodulate, frames, noise, with};

/// Standard errors from independent frames against the spread of 40,000 noisy pixels. The relative error of a sampled standard
/// deviation is sqrt(kurtosis - 1) / (2 sqrt n) <= 0.4 %; 5 sigma = 2 %. Covariances: |error| <= 5 s_a s_b / sqrt n.
#[test]
fn standard_errors_are_the_spread() {
    let sigma = 0.004;
    let truth = Truth { dc: 0.5, fringes: vec![(0.1, 0.2, 0.7), (0.2, 0.1, -2.0)] };
    let mut next = noise(7);
    let (out, host) =
        demodulate(frames(200, 200, &truth, 3, Some(sigma), &mut || sigma * next()), None, &["phase"]).unwrap();
    let stack = &out.modulation.0;
    let values: Vec<_> = stack.layers.iter().filter(|l| l.info.kind == LayerKind::Value).collect();
    let moments = |a: &Array2<f32>, b: &Array2<f32>| {
        let n = a.len() as f64;
        let mean = |x: &Array2<f32>| x.iter().map(|&v| f64::from(v)).sum::<f64>() / n;
        let (ma, mb) = (mean(a), mean(b));
        a.iter().zip(b).map(|(&x, &y)| (f64::from(x) - ma) * (f64::from(y) - mb)).sum::<f64>() / n
    };
    for layer in &values {
        let spread = moments(&layer.data, &layer.data).sqrt();
        let se = f64::from(stack.standard_error(&layer.info).unwrap().data[(0, 0)]);
        assert!(
            (spread / se - 1.0).abs() < 0.02,
            "{} {:?}: spread {spread}, se {se}",
            layer.info.name,
            layer.info.f_x_per_mm
        );
        let mean_se = layer.info.mean_se.unwrap();
        assert!((mean_se * 200.0 / se - 1.0).abs() < 0.02);
    }
    let mut pairs = 0;
    for cov in stack.layers.iter().filter(|l| l.info.kind == LayerKind::Covariance) {
        let [a, b] = cov.info.pair.unwrap().map(|k| &stack.layers[k as usize]);
        let scale = (moments(&a.data, &a.data) * moments(&b.data, &b.data)).sqrt();
        let mean: f64 = cov.data.iter().map(|&v| f64::from(v)).sum::<f64>() / cov.data.len() as f64;
        assert!((moments(&a.data, &b.data) - mean).abs() < 5.0 * scale / 200.0, "pair {:?}", cov.info.pair);
        pairs += 1;
    }
    assert_eq!(pairs, 10, "pairs of m_ac(0), m_dc, m_ac at 0.1 and 0.2");
    let phase = &out.phase.unwrap().0;
    let layer = phase.find("phase", Some(0.2)).unwrap();
    let se = f64::from(phase.find("phase_se", Some(0.2)).unwrap().data[(0, 0)]);
    assert!((moments(&layer.data, &layer.data).sqrt() / se - 1.0).abs() < 0.05);
    // The Rician bias s^2 / (2 M_AC), s^2 = 2 sigma^2 / 3, at the highest f_x.
    let bias = host.measures.lock().unwrap()["rician_bias"];
    let want = 100.0 * (2.0 * sigma * sigma / 3.0) / (2.0 * 0.1 * 0.1);
    assert!((bias / want - 1.0).abs() < 0.01, "{bias} % for {want} %");
}

/// One frame by least squares, 500 times with fresh noise of the strength that the frame says (twice as strong in the right half), one pixel missing:
/// errors in units of the standard errors have a standard deviation of 1, ends and the neighbours of the gap included, the means
/// of the image theirs, M_DC and M_AC the covariance that is stated. 500 x 24 lines of 4 windows: spreads known to 1 %; of means to 3 %; 5 sigma.
#[test]
fn one_frame_knows_its_noise() {
    let (rows, columns, f_x, runs) = (24, 40, 0.1, 500);
    let strength = |c: usize| if c < columns / 2 { 0.003 } else { 0.006 };
    let mut next = noise(11);
    let params = Params { method: Method::SingleShot, pixel_mm: Some(Length(1.0)), ..Params::default() };
    // Sums over runs and pixels of z^2 of M_DC, M_AC and phase, of the product of the first two, and of the covariance that is stated for it.
    let (mut squares, mut product, mut stated, mut n) = ([0.0; 3], 0.0, 0.0, 0.0);
    let mut means = [0.0; 2];
    for _ in 0..runs {
        let mut stack = ImageStack::new(rows, columns);
        let mut info = LayerInfo::value("radiance", "1").with_f_x(f_x);
        info.phase_rad = Some(0.0);
        let fringe = |c: usize| 0.5 + 0.2 * (2.0 * PI * f_x * c as f64 + 0.7).cos();
        let values = Array2::from_shape_fn((rows, columns), |(_, c)| (fringe(c) + strength(c) * next()) as f32);
        stack.push(info.clone(), values);
        stack.push(info.standard_error(), Array2::from_shape_fn((rows, columns), |(_, c)| strength(c) as f32));
        stack.layers[0].data[(5, 3)] = f32::INFINITY;
        let (out, _) = with(&params, Frames(stack), None, &["phase"]).unwrap();
        let (found, phase) = (&out.modulation.0, &out.phase.unwrap().0);
        let layer = |stack: &ImageStack, name: &str| stack.find(name, Some(f_x)).unwrap().clone();
        let [dc, ac, phi] = [layer(found, "m_dc"), layer(found, "m_ac"), layer(phase, "phase")];
        let [dc_se, ac_se, phi_se] = [layer(found, "m_dc_se"), layer(found, "m_ac_se"), layer(phase, "phase_se")];
        let index = |l: &turbid_contract::Layer| found.layers.iter().position(|k| k.info == l.info).unwrap() as u32;
        let pair = Some([index(&dc), index(&ac)]);
        let shared = found.layers.iter().find(|l| l.info.pair == pair).expect("the covariance of M_DC and M_AC");
        let mask = &found.find("mask", None).unwrap().data;
        assert_eq!(mask.iter().filter(|&&m| m != 0.0).count(), 1);
        let (mut sums, mut good) = ([0.0; 2], 0.0);
        for at in (0..rows * columns).map(|i| (i / columns, i % columns)).filter(|&at| mask[at] == 0.0) {
            let off = |l: &turbid_contract::Layer, truth: f64| f64::from(l.data[at]) - truth;
            let turned = off(&phi, 2.0 * PI * f_x * at.1 as f64 + 0.7);
            let turned = turned - 2.0 * PI * (turned / (2.0 * PI)).round();
            let errors = [off(&dc, 0.5), off(&ac, 0.2), turned];
            for (k, se) in [&dc_se, &ac_se, &phi_se].into_iter().enumerate() {
                squares[k] += (errors[k] / f64::from(se.data[at])).powi(2);
            }
            let scale = f64::from(dc_se.data[at]) * f64::from(ac_se.data[at]);
            (product, stated) = (product + errors[0] * errors[1] / scale, stated + f64::from(shared.data[at]) / scale);
            (sums[0], sums[1], good, n) = (sums[0] + errors[0], sums[1] + errors[1], good + 1.0, n + 1.0);
        }
        for (k, layer) in [&dc, &ac].into_iter().enumerate() {
            means[k] += (sums[k] / good / layer.info.mean_se.unwrap()).powi(2) / f64::from(runs);
        }
    }
    for (k, name) in ["M_DC", "M_AC", "phase"].into_iter().enumerate() {
        let sd = (squares[k] / n).sqrt();
        assert!((sd - 1.0).abs() < 0.05, "{name}: sd of z {sd}");
    }
    assert!(((product - stated) / n).abs() < 0.05, "correlation {}, stated {}", product / n, stated / n);
    for (k, name) in ["M_DC", "M_AC"].into_iter().enumerate() {
        assert!((means[k].sqrt() - 1.0).abs() < 0.16, "mean of {name}: sd of z {}", means[k].sqrt());
    }
}

/// With 29 % of noise in each of 40,000 pixels the mean of M_AC comes back: what is left is s^4 / (8 M^4) = 0.08 %, and the
/// mean's own error of 0.15 %. Uncorrected it is s^2 / (2 M^2) = 4 % too high.
#[test]
fn the_rician_bias_is_taken_off() {
    let (m_ac, snr) = (0.2, 3.5);
    let sigma = m_ac / snr * 1.5_f64.sqrt();
    let truth = Truth { dc: 0.5, fringes: vec![(0.1, m_ac, 0.7)] };
    for (noise_bias, want) in [(NoiseBias::Correct, 0.0), (NoiseBias::Keep, 0.5 / (snr * snr))] {
        let mut next = noise(3);
        let frames = frames(200, 200, &truth, 3, Some(sigma), &mut || sigma * next());
        let (out, _) = with(&Params { noise_bias, ..Params::default() }, frames, None, &[]).unwrap();
        // Some 1 % are masked, for what their neighbours show.
        let plane = |name: &str, f_x: Option<f64>| &out.modulation.0.find(name, f_x).unwrap().data;
        let (data, mask) = (plane("m_ac", Some(0.1)), plane("mask", None));
        let good: Vec<f64> = data.iter().zip(mask).filter(|(_, m)| **m == 0.0).map(|(&v, _)| f64::from(v)).collect();
        assert!(good.len() > 39_000, "{}", good.len());
        let bias = good.iter().sum::<f64>() / good.len() as f64 / m_ac - 1.0;
        assert!((bias - want).abs() < 0.0008 + 4.0 * 0.0015, "{noise_bias:?}: {bias} for {want}");
    }
}

/// Noise does not choose its pixels: with a signal of 2 standard errors all are masked, with 4.2 none, although in 16 and
/// 12 % of them the pixel's own signal is on the other side of 3.
#[test]
fn the_mask_is_blind_to_the_noise_of_the_pixel() {
    for (snr, want) in [(2.0, 1.0), (4.2, 0.0)] {
        let sigma = 0.2 / snr * 1.5_f64.sqrt();
        let truth = Truth { dc: 0.5, fringes: vec![(0.1, 0.2, 0.7)] };
        let mut next = noise(3);
        let (out, _) = demodulate(frames(60, 60, &truth, 3, Some(sigma), &mut || sigma * next()), None, &[]).unwrap();
        let mask = &out.modulation.0.find("mask", None).unwrap().data;
        let masked = mask.iter().filter(|&&m| m != 0.0).count() as f64 / 3600.0;
        assert!((masked - want).abs() < 0.01, "signal {snr}: {masked}");
    }
}

/// With a covariance given: var M_AC = g^T C g along Z, cov(M_DC, M_AC) = g^T c; the same paths in every frame make M_DC at
/// f_x = 0 and M_DC at f_x > 0 one number.
#[test]
fn a_given_covariance_is_propagated() {
    let c = [[4.0, 1.0, 0.5], [1.0, 3.0, -0.4], [0.5, -0.4, 2.0]].map(|row| row.map(|v| 1e-6 * v));
    let cov = covariance(&[("dc", 0.0), ("re", 0.1), ("im", 0.1)], &[&c[0], &c[1], &c[2]]);
    let (cos, sin) = (0.6, 0.8);
    let truth = Truth { dc: 0.5, fringes: vec![(0.1, 0.2, 0.8_f64.atan2(0.6))] };
    let (out, _) = demodulate(frames(1, 1, &truth, 3, None, &mut || 0.0), Some(cov), &[]).unwrap();
    let stack = &out.modulation.0;
    let variance = cos * cos * c[1][1] + 2.0 * cos * sin * c[1][2] + sin * sin * c[2][2];
    assert!((at(stack, "m_ac_se", Some(0.1)) / variance.sqrt() - 1.0).abs() < 1e-5);
    assert!((at(stack, "m_dc_se", Some(0.1)) / c[0][0].sqrt() - 1.0).abs() < 1e-6);
    let pair = |a: (&str, f64), b: (&str, f64)| {
        let index = |q: (&str, f64)| {
            stack.layers.iter().position(|l| l.info.name == q.0 && l.info.f_x_per_mm == Some(q.1)).unwrap() as u32
        };
        let wanted = Some([index(a), index(b)]);
        f64::from(stack.layers.iter().find(|l| l.info.pair == wanted).unwrap().data[(0, 0)])
    };
    let want = cos * c[0][1] + sin * c[0][2];
    assert!((pair(("m_ac", 0.0), ("m_ac", 0.1)) / want - 1.0).abs() < 1e-5);
    assert!((pair(("m_ac", 0.0), ("m_dc", 0.1)) / c[0][0] - 1.0).abs() < 1e-6);
}

/// One path that brings 400 times the light of its pixel, with a standard error as large, masks none of the 24 pixels around it, and stays: a mean
/// without it would be too low. A patch where the fringe is really below its noise is masked as before, but for its rim of two pixels.
#[test]
fn one_bright_path_masks_nothing() {
    let (n, own) = (15, (7, 7));
    let truth = Truth { dc: 0.5, fringes: vec![(0.1, 0.2, 0.7)] };
    let mut input = frames(n, n, &truth, 3, Some(0.01), &mut || 0.0);
    let plain = demodulate(input.clone(), None, &[]).unwrap().0.modulation;
    for layer in &mut input.0.layers {
        let bright = if layer.info.phase_rad == Some(0.0) { 200.0 } else { 2.0 };
        layer.data[own] = match layer.info.kind {
            LayerKind::Value => layer.data[own] + bright,
            _ => bright,
        };
    }
    let (out, _) = demodulate(input.clone(), None, &[]).unwrap();
    let stack = &out.modulation.0;
    assert!(stack.find("mask", None).unwrap().data.iter().all(|&m| m == 0.0), "{:?}", stack.find("mask", None));
    let (found, before) = (stack.find("m_ac", Some(0.1)).unwrap(), plain.0.find("m_ac", Some(0.1)).unwrap());
    for ((at, a), b) in found.data.indexed_iter().zip(&before.data) {
        assert_eq!(a == b, at != own, "{at:?}");
    }
    for layer in &mut input.0.layers {
        if layer.info.kind == LayerKind::StandardError {
            for (r, c) in (0..n).flat_map(|r| (0..6).map(move |c| (r, c))) {
                layer.data[(r, c)] = 0.2;
            }
        }
    }
    let (out, _) = demodulate(input, None, &[]).unwrap();
    let mask = &out.modulation.0.find("mask", None).unwrap().data;
    assert!((0..n).all(|r| (0..4).all(|c| mask[(r, c)] == MaskReason::LowSignal.code())), "{mask:?}");
    assert!((0..n).all(|r| (8..n).all(|c| mask[(r, c)] == 0.0)), "{mask:?}");
}

/// At 3.2 standard errors per pixel noise leaves some pixels without a fringe (|Z| below s / sqrt 2, where the Rician bias takes off more than there is): their
/// values stay, flagged, and so the mean of M_AC over all pixels is the truth to 4 standard errors and the s^4 / (8 M^4) that the correction leaves. Where
/// they are left out it is too high by more than that. Their phases are masked.
#[test]
fn pixels_that_noise_has_emptied_stay_in_the_mean() {
    let (m_ac, snr, side) = (0.2, 3.2_f64, 400);
    let sigma = m_ac / snr * 1.5_f64.sqrt();
    let truth = Truth { dc: 0.5, fringes: vec![(0.1, m_ac, 0.7)] };
    let mut next = noise(17);
    // Nearly normal: sums of four uniform numbers.
    let mut normal = || 0.5 * (next() + next() + next() + next());
    let input = frames(side, side, &truth, 3, Some(sigma), &mut || sigma * normal());
    let (out, _) = demodulate(input, None, &["phase"]).unwrap();
    let stack = &out.modulation.0;
    let layer = stack.find("m_ac", Some(0.1)).unwrap();
    let mask = &stack.find("mask", None).unwrap().data;
    let flags = &stack.se_unknown(&layer.info).expect("some pixels are flagged").data;
    let phase = out.phase.unwrap().0;
    let phase_mask = &phase.find("mask", None).unwrap().data;
    let (mut all, mut positive) = ((0.0, 0.0), (0.0, 0.0));
    for (at, &value) in layer.data.indexed_iter().filter(|(at, _)| mask[*at] == 0.0) {
        all = (all.0 + f64::from(value), all.1 + 1.0);
        if value > 0.0 {
            positive = (positive.0 + f64::from(value), positive.1 + 1.0);
        } else {
            assert!(flags[at] == 1.0 && phase_mask[at] == MaskReason::LowSignal.code(), "{at:?}");
        }
    }
    let share = 1.0 - positive.1 / all.1;
    // P(|Z| < s / sqrt 2) = integral of Rice's density, 0.0020 at 3.2.
    assert!(share > 0.0005 && share < 0.006, "{share}");
    let off = |(sum, n): (f64, f64)| sum / n / m_ac - 1.0;
    let limit = 4.0 / snr / f64::sqrt(all.1) + 1.0 / (8.0 * f64::powi(snr, 4));
    assert!(off(all).abs() < limit, "{} within {limit}", off(all));
    assert!(off(positive) - off(all) > 0.5 * share, "without them {} for {}", off(positive), off(all));
}

/// A frame that does not know its standard error at a pixel leaves those of M_DC, M_AC and phase of its own f_x unknown there, and no others; the
/// values stay. With frames that know the error of their mean that of M_AC is known too.
#[test]
fn unknown_errors_are_passed_on() {
    let truth = Truth { dc: 0.5, fringes: vec![(0.1, 0.2, 0.7), (0.2, 0.1, 0.1)] };
    for knows_mean in [false, true] {
        let mut input = frames(3, 4, &truth, 3, Some(0.001), &mut || 0.0);
        if knows_mean {
            input.0.layers.iter_mut().for_each(|l| l.info.mean_se = Some(0.001 / 12.0_f64.sqrt()));
        }
        let plain = demodulate(input.clone(), None, &["phase"]).unwrap().0;
        let flagged = input.0.layers.iter().filter(|l| l.info.kind == LayerKind::Value);
        let info = flagged.filter(|l| l.info.f_x_per_mm == Some(0.1)).nth(1).unwrap().info.clone();
        let mut flags = Array2::zeros((3, 4));
        flags[(1, 2)] = 1.0;
        input.0.push(info.se_unknown(), flags.clone());
        let (out, _) = demodulate(input, None, &["phase"]).unwrap();
        let (modulation, phase) = (out.modulation.0, out.phase.unwrap().0);
        for stack in [&modulation, &phase] {
            for layer in stack.layers.iter().filter(|l| l.info.kind == LayerKind::Value) {
                let own = layer.info.f_x_per_mm == Some(0.1);
                let found = stack.se_unknown(&layer.info).map(|l| l.data.clone());
                assert_eq!(found, own.then(|| flags.clone()), "{:?}", layer.info);
                if stack.find("phase", None).is_none() {
                    assert_eq!(layer.info.mean_se.is_some(), !own || knows_mean, "{:?}", layer.info);
                }
            }
        }
        let values = |stack: &ImageStack| {
            let values = stack.layers.iter().filter(|l| l.info.kind == LayerKind::Value);
            values.map(|l| l.data.clone()).collect::<Vec<_>>()
        };
        assert_eq!(values(&modulation), values(&plain.modulation.0));
    }
}
