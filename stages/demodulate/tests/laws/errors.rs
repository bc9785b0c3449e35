//! Standard errors, and what noise does to means and masks.

use turbid_contract::LayerKind;
use turbid_contract::ndarray::Array2;
use turbid_demodulate::{NoiseBias, Params};

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
        let data = &out.modulation.0.find("m_ac", Some(0.1)).unwrap().data;
        let good: Vec<f64> = data.iter().map(|&v| f64::from(v)).filter(|&v| v > 0.0).collect();
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
