//! Laws of the fits as plain functions.

use turbid_chromophores::least_squares::{MOST, Noise};
use turbid_chromophores::scatter::{self, PowerLawFit};
use turbid_chromophores::unmix::{self, Mixture};
use turbid_optics::chromophore::{Chromophore, reduced_scattering};

use crate::Random;

/// What one unit of each absorbs at the wavelengths.
fn columns(chromophores: &[Chromophore], wavelengths: &[f64]) -> Vec<Vec<f64>> {
    let at = |c: &Chromophore| wavelengths.iter().map(|&nm| c.mu_a_per_mm(nm).expect("it is in the table")).collect();
    chromophores.iter().map(at).collect()
}

fn mixed(columns: &[Vec<f64>], amounts: &[f64]) -> Vec<f64> {
    (0..columns[0].len()).map(|i| columns.iter().zip(amounts).map(|(c, x)| c[i] * x).sum()).collect()
}

/// What is written by chromophores comes back: to 1e-12 of each amount, whatever the weights.
#[test]
fn amounts_come_back() {
    let wavelengths = [480.0, 532.0, 560.0, 620.0, 660.0, 730.0, 760.0, 850.0, 930.0, 970.0];
    let amounts = [40.0, 20.0, 0.7, 0.1, 0.01];
    let columns = columns(&Chromophore::ALL, &wavelengths);
    let mu_a = mixed(&columns, &amounts);
    let se: Vec<f64> = mu_a.iter().enumerate().map(|(i, mu)| mu * (0.01 + 0.01 * i as f64)).collect();
    for noise in [Noise::Unknown, Noise::Independent(&se)] {
        let mut scratch = unmix::Scratch::default();
        let found = Mixture::new(&columns).unmix(&mu_a, noise, true, &mut scratch).expect("they differ");
        for (is, exact) in found.amounts.iter().zip(amounts) {
            assert!((is / exact - 1.0).abs() < 1e-12, "{noise:?}: {is} {exact}");
        }
        assert!(found.residual < 1e-15 && found.held == 0);
        assert!(found.amounts[5..].iter().all(|&x| x == 0.0));
    }
}

/// One chromophore is a weighted mean, and its error that of one; as many wavelengths as chromophores are solved exactly, however they are weighted.
#[test]
fn small_problems_have_closed_forms() {
    let (column, mu_a, se) = (vec![2.0, 1.0, 4.0], [2.2, 0.9, 4.4], [0.1, 0.2, 0.4]);
    let mut scratch = unmix::Scratch::default();
    let one = Mixture::new(std::slice::from_ref(&column));
    let one = one.unmix(&mu_a, Noise::Independent(&se), true, &mut scratch).expect("it absorbs");
    let weights: Vec<f64> = column.iter().zip(se).map(|(c, se)| c * c / (se * se)).collect();
    let sum: f64 = weights.iter().sum();
    let mean = (0..3).map(|i| weights[i] * mu_a[i] / column[i]).sum::<f64>() / sum;
    assert!((one.amounts[0] / mean - 1.0).abs() < 1e-14);
    assert!((one.covariance.unwrap()[0][0] * sum - 1.0).abs() < 1e-14);
    let chi2: f64 = (0..3).map(|i| ((mu_a[i] - mean * column[i]) / se[i]).powi(2)).sum();
    assert!((one.chi2.unwrap() / chi2 - 1.0).abs() < 1e-12);

    // x = A^-1 y with [[1, 2], [3, 1]]: x_0 = (2 y_1 - y_0) / 5.
    let square = Mixture::new(&[vec![1.0, 3.0], vec![2.0, 1.0]]);
    for noise in [Noise::Unknown, Noise::Independent(&[0.3, 0.1]), Noise::Full(&[0.09, 0.01, 0.01, 0.01])] {
        let two = square.unmix(&[5.0, 5.0], noise, true, &mut scratch).unwrap();
        assert!((two.amounts[0] - 1.0).abs() < 1e-14 && (two.amounts[1] - 2.0).abs() < 1e-14, "{two:?}");
        let variance = |c01: f64| (0.09 + 4.0 * 0.01 - 4.0 * c01) / 25.0;
        let exact = match noise {
            Noise::Unknown => None,
            Noise::Independent(_) => Some(variance(0.0)),
            Noise::Full(_) => Some(variance(0.01)),
        };
        assert_eq!(two.covariance.is_some(), exact.is_some());
        assert!(two.covariance.zip(exact).is_none_or(|(c, exact)| (c[0][0] / exact - 1.0).abs() < 1e-13), "{two:?}");
    }
}

/// Noise that is 0 somewhere, or a covariance that is singular, leaves equal weights, and the errors are those that such weights have.
#[test]
fn errors_without_weights_are_propagated() {
    let (column, mut scratch) = (vec![1.0, 1.0], unmix::Scratch::default());
    let mean = Mixture::new(std::slice::from_ref(&column));
    let found = mean.unmix(&[1.0, 3.0], Noise::Independent(&[0.0, 0.4]), true, &mut scratch).unwrap();
    assert!((found.amounts[0] - 2.0).abs() < 1e-15 && found.chi2.is_none());
    assert!((found.covariance.unwrap()[0][0].sqrt() - 0.2).abs() < 1e-15);
    // Fully correlated: the mean is as uncertain as each.
    let full = mean.unmix(&[1.0, 3.0], Noise::Full(&[0.16, 0.16, 0.16, 0.16]), true, &mut scratch).unwrap();
    assert!((full.covariance.unwrap()[0][0].sqrt() - 0.4).abs() < 1e-15);
}

/// Random problems: the solution has no negative amount, meets the conditions of Karush, Kuhn and Tucker, and is the best of all choices of what is
/// held, each solved by slow coordinate descent of the whole problem.
#[test]
fn non_negative_solutions_are_optimal() {
    let mut random = Random::new(1);
    let (mut held, mut scratch) = (0, unmix::Scratch::default());
    for case in 0..2000 {
        let count = 1 + case % MOST;
        let rows = count + case % 5;
        let mut column = || (0..rows).map(|_| random.uniform() + 0.3 * random.normal()).collect::<Vec<f64>>();
        let columns: Vec<Vec<f64>> = (0..count).map(|_| column()).collect();
        let y: Vec<f64> = (0..rows).map(|_| random.normal()).collect();
        let se: Vec<f64> = (0..rows).map(|_| 0.2 + random.uniform()).collect();
        let found = Mixture::new(&columns).unmix(&y, Noise::Independent(&se), true, &mut scratch);
        let found = found.unwrap_or_else(|| panic!("case {case}: random columns are independent"));
        let x = &found.amounts[..count];
        assert!(x.iter().all(|&x| x >= 0.0), "case {case}: {x:?}");
        let rest = |x: &[f64], i: usize| y[i] - (0..count).map(|k| columns[k][i] * x[k]).sum::<f64>();
        let slope = |x: &[f64], k: usize| (0..rows).map(|i| columns[k][i] * rest(x, i) / (se[i] * se[i])).sum::<f64>();
        let size = |k: usize| (0..rows).map(|i| (columns[k][i] / se[i]).powi(2)).sum::<f64>();
        for k in 0..count {
            let slope = slope(x, k) / size(k).sqrt();
            // Where it is free the slope is 0; where it is held, to let it go would not help.
            assert!(if x[k] > 0.0 { slope.abs() < 1e-7 } else { slope < 1e-7 }, "case {case}: {k} of {x:?}: {slope}");
        }
        let sum = |x: &[f64]| (0..rows).map(|i| (rest(x, i) / se[i]).powi(2)).sum::<f64>();
        let mut slow = vec![0.0_f64; count];
        for _ in 0..300 {
            for k in 0..count {
                slow[k] = (slow[k] + slope(&slow, k) / size(k)).max(0.0);
            }
        }
        assert!(sum(x) <= sum(&slow) + 1e-9, "case {case}: {} {}", sum(x), sum(&slow));
        assert!((found.chi2.unwrap() - sum(x)).abs() <= 1e-7 * (1.0 + sum(x)), "case {case}");
        assert_eq!(found.held as usize, x.iter().filter(|&&x| x == 0.0).count(), "case {case}");
        held += usize::from(found.held > 0);
    }
    assert!(held > 1000, "{held} of 2000 problems have a bound");
}

/// An amount that is held has no error of its own, and those beside it have the errors of the fit without it.
#[test]
fn held_amounts_are_taken_for_known() {
    let wavelengths = [660.0, 730.0, 850.0, 940.0];
    let three = columns(&[Chromophore::HbO2, Chromophore::Hb, Chromophore::Water], &wavelengths);
    let mu_a = mixed(&three, &[40.0, 20.0, -0.1]);
    let se: Vec<f64> = mu_a.iter().map(|mu| 0.02 * mu).collect();
    let mut scratch = unmix::Scratch::default();
    let noise = Noise::Independent(&se);
    let held = Mixture::new(&three).unmix(&mu_a, noise, true, &mut scratch).unwrap();
    let without = Mixture::new(&three[..2]).unmix(&mu_a, noise, false, &mut scratch).unwrap();
    assert!(held.held == 1 && held.amounts[2] == 0.0);
    let (c, d) = (held.covariance.unwrap(), without.covariance.unwrap());
    for i in 0..2 {
        assert!((held.amounts[i] / without.amounts[i] - 1.0).abs() < 1e-12);
        assert!((0..2).all(|k| (c[i][k] / d[i][k] - 1.0).abs() < 1e-11) && c[i][2] == 0.0 && c[2][i] == 0.0);
    }
    let free = Mixture::new(&three).unmix(&mu_a, noise, false, &mut scratch).unwrap();
    assert!((free.amounts[2] + 0.1).abs() < 1e-12 && free.held == 0);
}

/// Columns that are the same cannot be told apart.
#[test]
fn dependent_columns_have_no_solution() {
    let same = Mixture::new(&[vec![1.0, 2.0], vec![2.0, 4.0]]);
    assert_eq!(same.unmix(&[1.0, 2.0], Noise::Unknown, true, &mut unmix::Scratch::default()), None);
}

/// A power law comes back with its exponent, of two wavelengths and of many; what is no scattering has none.
#[test]
fn power_laws_come_back() {
    let mut scratch = scatter::Scratch::default();
    for wavelengths in [&[660.0, 850.0][..], &[450.0, 500.0, 600.0, 800.0, 1000.0]] {
        for (a, b) in [(1.5, 1.2), (0.3, 4.0), (6.0, 0.0), (1.0, -1.0)] {
            let mu: Vec<f64> = wavelengths.iter().map(|&nm| reduced_scattering(a, b, nm)).collect();
            let se: Vec<f64> = mu.iter().map(|mu| 0.03 * mu).collect();
            for noise in [Noise::Unknown, Noise::Independent(&se)] {
                let law = PowerLawFit::new(wavelengths).fit(&mu, noise, &mut scratch).expect("it is one");
                assert!((law.a / a - 1.0).abs() < 1e-12 && (law.b - b).abs() < 1e-12, "{law:?}");
            }
        }
    }
    let fit = PowerLawFit::new(&[500.0, 1000.0]);
    for mu in [[1.0, 0.0], [-1.0, 2.0], [0.0, 0.0], [1e-30, 1.0]] {
        assert_eq!(fit.fit(&mu, Noise::Unknown, &mut scratch), None, "{mu:?}");
    }
    // At 500 nm a is mu_s' itself; b = ln(mu_500 / mu_1000) / ln 2.
    let law = fit.fit(&[2.0, 1.0], Noise::Independent(&[0.1, 0.05]), &mut scratch).unwrap();
    let c = law.covariance.unwrap();
    assert!((c[0][0].sqrt() - 0.1).abs() < 1e-12, "{law:?}");
    assert!((c[1][1].sqrt() - 0.05 * 2.0_f64.sqrt() / std::f64::consts::LN_2).abs() < 1e-12, "{law:?}");
}
