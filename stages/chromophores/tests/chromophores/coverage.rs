//! Stated standard errors hold the truth as often as they say, over repeated noise.

use turbid_chromophores::Chromophores;
use turbid_contract::kit::Trial;
use turbid_contract::ndarray::Array2;
use turbid_contract::payload::Concentrations;
use turbid_contract::serde_json::json;
use turbid_contract::{ImageStack, LayerInfo, LayerKind};
use turbid_optics::chromophore::{Chromophore, reduced_scattering};

use crate::{Random, maps};

/// Pixels, each with noise of its own.
const PIXELS: usize = 20_000;

/// Shares (%) of the pixels within 1 and 1.96 standard errors of the truth.
fn coverage(stack: &ImageStack, name: &str, truth: f64) -> [f64; 2] {
    let layer = stack.find(name, None).expect("it is made");
    let se = stack.standard_error(&layer.info).expect("it has errors").pixels();
    let values = layer.pixels();
    let off = values.iter().zip(&*se).map(|(v, se)| ((f64::from(*v) - truth) / f64::from(*se)).abs());
    let off: Vec<f64> = off.collect();
    [1.0, 1.96].map(|limit| 100.0 * off.iter().filter(|z| **z <= limit).count() as f64 / off.len() as f64)
}

/// 20 000 pixels of one tissue at eight wavelengths, noise of 1 to 3 %: all concentrations are far above 0. The share of truths within 1 and 1.96
/// standard errors is 68.3 and 95 %; five standard deviations of such a share are 1.6 and 0.8 %, and 0.4 % is left to what the first order neglects.
#[test]
fn truths_lie_within_the_stated_errors() {
    let wavelengths = [540.0, 580.0, 620.0, 660.0, 730.0, 800.0, 880.0, 940.0];
    let truth = [
        ("HbO2", 40.0),
        ("Hb", 20.0),
        ("water", 0.7),
        ("scatter_a", 1.5),
        ("scatter_b", 1.2),
        ("THb", 60.0),
        ("StO2", 2.0 / 3.0),
    ];
    let mu_a = |k: usize| -> f64 {
        let amount = |c: &Chromophore| truth.iter().find(|(name, _)| *name == c.name()).map_or(0.0, |(_, x)| *x);
        Chromophore::ALL.iter().map(|c| amount(c) * c.mu_a_per_mm(wavelengths[k]).expect("in the table")).sum()
    };
    let mut random = Random::new(7);
    let maps = maps(PIXELS, &wavelengths, &["mu_a", "mu_s_prime"], &mut |name, k, _| {
        let value = if name == "mu_a" { mu_a(k) } else { reduced_scattering(1.5, 1.2, wavelengths[k]) };
        let se = value * (0.01 + 0.02 * k as f64 / 7.0);
        (value + se * random.normal(), Some(se))
    });
    for fit in ["non_negative", "linear"] {
        let params = json!({"chromophores": ["HbO2", "Hb", "water"], "scattering": true, "fit": fit});
        let made = Trial::of::<Chromophores>(params).input("maps", maps.clone()).run().expect("it runs");
        let Concentrations(stack) = made.get("concentrations");
        for (name, exact) in truth {
            let [one, two] = coverage(&stack, name, exact);
            let layer = stack.find(name, None).expect("it is made");
            let mean = layer.pixels().iter().map(|&v| f64::from(v)).sum::<f64>() / PIXELS as f64;
            let of_mean = layer.info.mean_se.expect("all errors are known");
            println!("{fit} {name}: {one:.2} % {two:.2} %, mean {mean:.5} +- {of_mean:.5}");
            assert!((one - 68.27).abs() < 2.0 && (two - 95.0).abs() < 1.2, "{fit} {name}: {one} % {two} %");
            // 5 standard errors, and a tenth of a per cent for the curvature of ratio and power.
            assert!((mean - exact).abs() <= 5.0 * of_mean + 1e-3 * exact, "{fit} {name}: {mean} +- {of_mean}");
        }
        let chi2 = made.host.measured("reduced_chi2").expect("eight wavelengths for three");
        assert!((chi2 - 1.0).abs() < 0.03, "{chi2}");
        assert!(made.host.warned().is_empty(), "{:?}", made.host.warned());
    }
}

/// Errors that wavelengths share (a reference, for one) are counted where the maps state their covariance.
#[test]
fn shared_errors_are_counted() {
    let wavelengths = [660.0, 730.0, 850.0, 940.0];
    let of = |c: Chromophore, nm: f64| c.mu_a_per_mm(nm).expect("in the table");
    let mu_a = wavelengths.map(|nm| 40.0 * of(Chromophore::HbO2, nm) + 20.0 * of(Chromophore::Hb, nm));
    let (own, common) = (0.01, 0.05);
    let mut random = Random::new(3);
    let shared: Vec<f64> = (0..PIXELS).map(|_| common * random.normal()).collect();
    let mut maps = maps(PIXELS, &wavelengths, &["mu_a"], &mut |_, k, pixel| {
        let se = mu_a[k] * libm::hypot(own, common);
        (mu_a[k] * (1.0 + own * random.normal() + shared[pixel]), Some(se))
    });
    for (i, k) in (0..4).flat_map(|i| (i + 1..4).map(move |k| (i, k))) {
        let mut info = LayerInfo::new("cov", LayerKind::Covariance, "mm^-2");
        info.pair = Some([i as u32, k as u32]);
        maps.0.push(info, Array2::from_elem((1, PIXELS), (common * common * mu_a[i] * mu_a[k]) as f32));
    }
    let made = Trial::of::<Chromophores>(json!({})).input("maps", maps).run().expect("it runs");
    let Concentrations(stack) = made.get("concentrations");
    for (name, exact) in [("HbO2", 40.0), ("Hb", 20.0), ("THb", 60.0), ("StO2", 2.0 / 3.0)] {
        let [one, two] = coverage(&stack, name, exact);
        println!("{name}: {one:.2} % {two:.2} %");
        assert!((one - 68.27).abs() < 2.0 && (two - 95.0).abs() < 1.2, "{name}: {one} % {two} %");
    }
    // A common scale of all wavelengths leaves the saturation: 5 % of THb, but less of StO2.
    let se = |name: &str| f64::from(stack.find(&format!("{name}_se"), None).expect("it is made").pixels()[0]);
    assert!(se("THb") / 60.0 > 0.05 && se("StO2") < 0.01, "{} {}", se("THb"), se("StO2"));
}
