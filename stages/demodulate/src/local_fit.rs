//! One frame instead of three: mean and fringe of a pixel by least squares over its neighbours on the line.
//!
//! In a Gaussian window around pixel k, line[k + j] = dc + re cos(2 pi f_c j) - im sin(2 pi f_c j). A constant and a fringe are told apart exactly by
//! any window, so that it can be half as wide as the filters that part them in frequency, and at the end of a line, or beside pixels
//! that do not count, the fit goes on with what there is: nothing is made up beyond the end.

use std::borrow::Cow;

use turbid_optics::elementary::sin_cos_turns;

use crate::unknown_steps::inverted;

/// Standard deviations at which a window ends: weights below 3e-4 are left out.
const REACH: f64 = 4.0;

/// A fit whose noise has more than this many times the variance of a full window's is none. At the end of a line it is 2 to 3 times.
const MOST_NOISE: f64 = 10.0;

/// Standard deviations of its own by which the variance of noise alone may be too large: once in a thousand pixels.
const LARGE_CHANCE: f64 = 3.0;

/// Share of a full window's weight below which pixels far away speak for what lies between. At the end of a line it is a half.
const LEAST_WEIGHT: f64 = 0.3;

/// Below this share of the determinant of evenly spread phases the inverse is rounding; the noise decides long before.
const LEAST_DETERMINANT: f64 = 1e-9;

/// What a pixel is made of: (dc, re, im) = sum of `weights[i]` x line[`first` + i].
#[derive(Clone, Debug, PartialEq)]
pub struct Weights {
    pub first: usize,
    pub weights: Vec<[f64; 3]>,
}

impl Weights {
    /// (dc, re, im), the fringe at the phase that it has in this pixel.
    pub fn apply(&self, line: &[f64]) -> [f64; 3] {
        self.weights
            .iter()
            .zip(&line[self.first..])
            .fold([0.0; 3], |sum, (w, &value)| [sum[0] + w[0] * value, sum[1] + w[1] * value, sum[2] + w[2] * value])
    }

    /// Covariance of (dc, re, im), from the variances of the line's pixels.
    pub fn covariance(&self, variances: &[f64]) -> [[f64; 3]; 3] {
        let own = self.weights.iter().zip(&variances[self.first..]);
        let of = |p: usize, q: usize| own.clone().map(|(w, variance)| w[p] * w[q] * variance).sum();
        [0, 1, 2].map(|p| [0, 1, 2].map(|q| of(p, q)))
    }

    /// dc of `mean`, re and im of these.
    pub fn with_mean(&self, mean: &Self) -> Self {
        let first = self.first.min(mean.first);
        let end = (self.first + self.weights.len()).max(mean.first + mean.weights.len());
        let mut weights = vec![[0.0; 3]; end - first];
        weights[mean.first - first..].iter_mut().zip(&mean.weights).for_each(|(w, mean)| w[0] = mean[0]);
        let own = weights[self.first - first..].iter_mut().zip(&self.weights);
        own.for_each(|(w, own)| (w[1], w[2]) = (own[1], own[2]));
        Self { first, weights }
    }

    /// Sum of the variances of dc, re and im under white noise of variance 1.
    fn noise(&self) -> f64 {
        self.weights.iter().flatten().map(|w| w * w).sum()
    }
}

/// Fits along lines of one length, all with the same carrier and window.
pub struct LocalFit {
    /// Pixels to either side that have a say.
    reach: usize,
    /// By the place in the window, from -`reach` on: what a pixel is made of, (dc, re, im) -> value, and its weight.
    rows: Vec<([f64; 3], f64)>,
    /// Noise and weight of a window that nothing cuts.
    full: [f64; 2],
    /// Of lines without a bad pixel.
    whole: Vec<Option<Weights>>,
}

impl LocalFit {
    /// Fits on lines of `length` pixels with a carrier in (0, 1/2) cycles per pixel, under Gaussians of standard deviation `sigma` pixels.
    pub fn new(carrier: f64, sigma: f64, length: usize) -> Self {
        let reach = libm::ceil(REACH * sigma) as usize;
        let row = |i: usize| {
            let j = i as f64 - reach as f64;
            let (sin, cos) = sin_cos_turns(carrier * j);
            let x = j / sigma;
            ([1.0, cos, -sin], libm::exp(-0.5 * x * x))
        };
        let rows: Vec<([f64; 3], f64)> = (0..=2 * reach).map(row).collect();
        let weight = rows.iter().map(|(_, weight)| weight).sum();
        let mut fit = Self { reach, rows, full: [f64::INFINITY, 0.0], whole: Vec::new() };
        let all = vec![true; (2 * reach + 1).max(length)];
        let noise = fit.solve(reach, &all).map_or(0.0, |w| w.noise());
        fit.full = [noise, weight];
        fit.whole = (0..length).map(|k| fit.solve(k, &all[..length])).collect();
        fit
    }

    /// Pixels to either side that have a say.
    pub fn reach(&self) -> usize {
        self.reach
    }

    /// The window of pixel k on a line: the first of its pixels, and what each is made of with its weight.
    fn window(&self, k: usize, length: usize) -> (usize, &[([f64; 3], f64)]) {
        let (first, end) = (k.saturating_sub(self.reach), (k + self.reach + 1).min(length));
        (first, &self.rows[first + self.reach - k..end + self.reach - k])
    }

    /// The weights of pixel k where only `good` pixels count; `None` where they do not tell mean and fringe apart.
    pub fn weights(&self, k: usize, good: &[bool]) -> Option<Cow<'_, Weights>> {
        let (first, rows) = self.window(k, good.len());
        if good[first..first + rows.len()].iter().all(|&good| good) {
            return self.whole[k].as_ref().map(Cow::Borrowed);
        }
        self.solve(k, good).map(Cow::Owned)
    }

    fn solve(&self, k: usize, good: &[bool]) -> Option<Weights> {
        let (first, rows) = self.window(k, good.len());
        let window: Vec<f64> =
            rows.iter().zip(&good[first..]).map(|((_, w), &good)| if good { *w } else { 0.0 }).collect();
        let [noise, weight] = self.full;
        if window.iter().sum::<f64>() < LEAST_WEIGHT * weight {
            return None;
        }
        let mut normal = [[0.0; 3]; 3];
        for ((x, _), weight) in rows.iter().zip(&window) {
            (0..3).for_each(|p| (0..3).for_each(|q| normal[p][q] += weight * x[p] * x[q]));
        }
        let inverse = inverted(normal, LEAST_DETERMINANT)?;
        let of = |x: &[f64; 3], w: f64| inverse.map(|row| w * (row[0] * x[0] + row[1] * x[1] + row[2] * x[2]));
        let weights = Weights { first, weights: rows.iter().zip(&window).map(|((x, _), &w)| of(x, w)).collect() };
        (weights.noise() <= MOST_NOISE * noise).then_some(weights)
    }

    /// Variance of the structure that the fit of pixel k cannot follow, as one of independent pixels: what it leaves of the line beyond `noise`, the
    /// variance of a pixel; 0 where noise alone may leave as much.
    ///
    /// sum w^2 r^2 over its expectation for residuals of variance 1, sum w^2 (1 - h), h the share that a pixel has in its own fit. Squared weights look
    /// nearer to the pixel than the fit does: far from it a smooth sample departs more than where the fit is asked.
    pub fn structure(&self, k: usize, weights: &Weights, line: &[f64], good: &[bool], noise: f64) -> f64 {
        let [dc, re, im] = weights.apply(line);
        let (first, rows) = self.window(k, line.len());
        let (mut sum, mut freedom, mut squares) = (0.0, 0.0, 0.0);
        for (i, ((x, w), own)) in rows.iter().zip(&weights.weights).enumerate() {
            if good[first + i] {
                let residual = line[first + i] - (dc * x[0] + re * x[1] + im * x[2]);
                let w = w * w;
                let free = w * (1.0 - (x[0] * own[0] + x[1] * own[1] + x[2] * own[2]));
                sum += w * residual * residual;
                (freedom, squares) = (freedom + free, squares + free * free);
            }
        }
        if freedom <= 0.0 {
            return 0.0;
        }
        let chance = 1.0 + LARGE_CHANCE * (2.0 * squares).sqrt() / freedom;
        let left = sum / freedom;
        if left > chance * noise { left - noise } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    fn modulus([_, re, im]: [f64; 3]) -> f64 {
        (re * re + im * im).sqrt()
    }

    fn line(n: usize, carrier: f64, truth: impl Fn(usize) -> (f64, f64)) -> Vec<f64> {
        (0..n).map(|k| truth(k).0 + truth(k).1 * libm::cos(TAU * carrier * k as f64 + 0.8)).collect()
    }

    /// Even fringes come back to rounding everywhere, the first and the last pixel included, whatever the window and the carrier, at M_AC << M_DC
    /// too. 1e-11 of the mean: some 100 products of size 1 to 10 (the noise at the ends) times 2^-53.
    #[test]
    fn even_fringes_come_back_to_the_last_pixel() {
        for carrier in [0.33, 0.25, 0.1, 0.0737] {
            for periods in [0.25, 0.35, 0.6] {
                for (dc, ac) in [(1.0, 0.5), (1.0, 1e-3)] {
                    let line = line(60, carrier, |_| (dc, ac));
                    let fit = LocalFit::new(carrier, periods / carrier, 60);
                    for k in 0..60 {
                        let [found, re, im] = fit.weights(k, &[true; 60]).expect("four periods").apply(&line);
                        let phase = TAU * carrier * k as f64 + 0.8;
                        let off = [found - dc, re - ac * libm::cos(phase), im - ac * libm::sin(phase)];
                        assert!(off.iter().all(|off| off.abs() < 1e-11), "carrier {carrier}, pixel {k}: {off:?}");
                    }
                }
            }
        }
    }

    /// A step of 30 % in mean and fringe: beyond the reach of the window nothing of it is left, and within two periods it does less than a Gaussian
    /// filter does.
    #[test]
    fn edges_end_with_the_window() {
        use crate::single_shot::{Filter, part};
        let carrier = 0.1;
        let truth = |k: usize| if k < 256 { (1.0, 0.5) } else { (1.3, 0.65) };
        let line = line(512, carrier, truth);
        let fit = LocalFit::new(carrier, 0.35 / carrier, 512);
        let filtered = part(&line, carrier, Filter::Gaussian);
        let ours: Vec<[f64; 3]> = (0..512).map(|k| fit.weights(k, &[true; 512]).unwrap().apply(&line)).collect();
        let theirs = |k: usize| [filtered.dc[k], filtered.fringe[k][0], filtered.fringe[k][1]];
        let (mut own, mut other) = (0.0, 0.0);
        for (k, &ours) in ours.iter().enumerate().take(412).skip(100) {
            let (dc, ac) = truth(k);
            let error = |z: [f64; 3]| (z[0] / dc - 1.0).abs() + (modulus(z) / ac - 1.0).abs();
            if !(256 - fit.reach()..256 + fit.reach()).contains(&k) {
                assert!(error(ours) < 1e-11, "pixel {k}: {}", error(ours));
            }
            (own, other) = (own + error(ours), other + error(theirs(k)));
        }
        assert!(own < 0.9 * other, "sum of errors {own}, under Gaussian filters {other}");
    }

    /// Pixels that do not count have no say, and where too few are left there is no fit: a gap of half a period is bridged, one of two periods is not.
    #[test]
    fn bad_pixels_have_no_say() {
        let (carrier, n) = (0.1, 80);
        let fit = LocalFit::new(carrier, 0.35 / carrier, n);
        for (gap, bridged) in [(38..43, true), (30..50, false)] {
            let good: Vec<bool> = (0..n).map(|k| !gap.contains(&k)).collect();
            let mut line = line(n, carrier, |_| (1.0, 0.4));
            gap.clone().for_each(|k| line[k] = 1e3);
            for k in 0..n {
                if let Some(weights) = fit.solve(k, &good) {
                    let z = weights.apply(&line);
                    assert!(
                        (z[0] - 1.0).abs() < 1e-10 && (modulus(z) - 0.4).abs() < 1e-10,
                        "{gap:?}, pixel {k}: {z:?}"
                    );
                }
            }
            assert_eq!(fit.solve(40, &good).is_some(), bridged, "{gap:?}");
        }
    }

    /// White noise of different strength from pixel to pixel: the covariance of (dc, re, im) over 4000 lines is what the weights say, inside, at the end
    /// and beside a gap. Errors of sampled covariances: sqrt((1 + r^2) / n) of s_p s_q; 5 of them.
    #[test]
    fn the_noise_is_known() {
        use turbid_optics::philox::{key, philox4x32, unit};
        let (carrier, n, lines) = (0.11, 40, 4000_u64);
        let sigma = |k: usize| 1.0 + 0.5 * libm::sin(k as f64);
        let variances: Vec<f64> = (0..n).map(|k| sigma(k) * sigma(k)).collect();
        let good: Vec<bool> = (0..n).map(|k| k != 22).collect();
        let fit = LocalFit::new(carrier, 0.35 / carrier, n);
        let all = [true; 40];
        for (k, good) in [(20, &all[..]), (0, &all), (24, &good)] {
            let weights = fit.weights(k, good).unwrap();
            let want = weights.covariance(&variances);
            let mut found = [[0.0; 3]; 3];
            for seed in 0..lines {
                let uniform = |k: usize| unit(philox4x32([k as u32, 0, 0, 0], key(seed))[0]) - 0.5;
                let line: Vec<f64> = (0..n).map(|k| sigma(k) * 12.0_f64.sqrt() * uniform(k)).collect();
                let z = weights.apply(&line);
                for p in 0..3 {
                    for q in 0..3 {
                        found[p][q] += z[p] * z[q] / lines as f64;
                    }
                }
            }
            for p in 0..3 {
                for q in 0..3 {
                    let tolerance = 5.0 * (2.0 * want[p][p] * want[q][q] / lines as f64).sqrt();
                    assert!(
                        (found[p][q] - want[p][q]).abs() < tolerance,
                        "{p} {q}: {} for {}",
                        found[p][q],
                        want[p][q]
                    );
                }
            }
        }
    }
}
