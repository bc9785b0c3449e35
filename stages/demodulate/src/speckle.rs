//! Speckle instead of fringes: M_DC and the amplitude at any spatial frequency from frames of random light, without phases.
//!
//! In a window around each pixel the power of the frame at f, averaged over directions, is M_AC^2(f) times the power of the projected speckle, which
//! a reference phantom shares: their ratio is that of fringes. The frame's noise has a power of its own, which is taken off.
//! Source: Chen, Papadakis, Durr, "Speckle illumination spatial frequency domain imaging for projector-free optical property mapping",
//! Opt. Lett. 46, 675 (2021), arXiv:2006.03661.

use std::f64::consts::PI;

use turbid_optics::elementary::sin_cos_turns;

use crate::fourier::{Complex, product};

/// One frame: values and, where known, standard errors, row by row; both 0 where `good` is false.
pub struct Shot<'a> {
    pub value: &'a [f32],
    pub se: Option<&'a [f32]>,
}

/// Gaussian windows over an image, pixels that are not good left out.
pub struct Windows<'a> {
    good: &'a [bool],
    columns: usize,
    /// Of the Gaussian, from the centre outwards along rows and along columns.
    half: [Vec<f64>; 2],
}

/// The sums of one window at each pixel, divided by the sum of the weights.
pub struct Power {
    /// Amplitude at f, of the unit of the frames: that of white speckle is its standard deviation from pixel to pixel.
    pub m_ac: Vec<f64>,
    /// Independent directions and frames that were averaged.
    pub samples: f64,
}

impl<'a> Windows<'a> {
    /// Windows whose Gaussians have standard deviations of `sigma` pixels along rows and along columns.
    pub fn new(good: &'a [bool], columns: usize, sigma: [f64; 2]) -> Self {
        let half = sigma.map(|sigma| {
            let reach = libm::ceil(4.0 * sigma) as usize;
            (0..=reach).map(|i| libm::exp(-0.5 * (i as f64 / sigma) * (i as f64 / sigma))).collect()
        });
        Self { good, columns, half }
    }

    /// Sum of weight x value over each window.
    pub fn sum(&self, of: impl Fn(usize) -> f64, squared: bool) -> Vec<f64> {
        self.turned(of, [0.0; 2], squared).into_iter().map(|z| z[0]).collect()
    }

    /// Sum of weight (squared, if wanted) x value x e^(-2 pi i f d) over each window, d from its centre; `f` in cycles per pixel.
    fn turned(&self, of: impl Fn(usize) -> f64, f: [f64; 2], squared: bool) -> Vec<Complex> {
        let (n, columns) = (self.good.len(), self.columns);
        let rows = n / columns;
        let taps = |half: &[f64], f: f64| -> Vec<Complex> {
            let tap = |(i, &w): (usize, &f64)| {
                let (sin, cos) = sin_cos_turns(f * i as f64);
                let w = if squared { w * w } else { w };
                [w * cos, -w * sin]
            };
            half.iter().enumerate().map(tap).collect()
        };
        let (along, down) = (taps(&self.half[0], f[0]), taps(&self.half[1], f[1]));
        let plane: Vec<Complex> = (0..n).map(|i| [if self.good[i] { of(i) } else { 0.0 }, 0.0]).collect();
        let mut across = vec![[0.0; 2]; n];
        for (row, out) in across.chunks_mut(columns).enumerate() {
            convolve(&along, columns, |c| plane[row * columns + c], |c, z| out[c] = z);
        }
        let mut out = vec![[0.0; 2]; n];
        for c in 0..columns {
            convolve(&down, rows, |r| across[r * columns + c], |r, z| out[r * columns + c] = z);
        }
        out
    }

    /// Sum of the weights of each window.
    pub fn weights(&self) -> Vec<f64> {
        self.sum(|_| 1.0, false)
    }

    /// Mean over each window; 0 where nothing in it is good.
    pub fn mean(&self, of: impl Fn(usize) -> f64, weights: &[f64]) -> Vec<f64> {
        let sums = self.sum(of, false);
        sums.iter().zip(weights).map(|(&sum, &weight)| if weight > 0.0 { sum / weight } else { 0.0 }).collect()
    }

    /// M_DC under each window and its variance: the mean over shots, and how unlike each other they are; `None` for a single shot.
    ///
    /// `around` are the windows over which variances are averaged: those of a few shots scatter.
    pub fn m_dc(&self, shots: &[Shot<'_>], around: &Windows<'_>) -> (Vec<f64>, Option<Vec<f64>>) {
        let weights = self.weights();
        let means: Vec<Vec<f64>> = shots.iter().map(|shot| self.mean(|i| f64::from(shot.value[i]), &weights)).collect();
        let n = shots.len() as f64;
        let m_dc: Vec<f64> = (0..self.good.len()).map(|i| means.iter().map(|m| m[i]).sum::<f64>() / n).collect();
        let variance = |i: usize| means.iter().map(|m| (m[i] - m_dc[i]).powi(2)).sum::<f64>() / (n * (n - 1.0));
        let variances = (shots.len() > 1).then(|| around.mean(variance, &around.weights()));
        (m_dc, variances)
    }

    /// The amplitude at `f` cycles per pixel along x and along y, averaged over directions and shots; `periods` is how many of them the window of four
    /// standard deviations holds. 0 where noise explains all of it.
    ///
    /// A window sees a band of frequencies of standard deviation s = 1 / (sqrt 8 pi sigma) around f, and power that falls with f draws what it sees to lower ones: the
    /// mean over the band is P + s^2 / 2 (P'' + P' / f). The bands at f - s and f + s tell how much that is, and it is taken off.
    pub fn power(&self, shots: &[Shot<'_>], f: [f64; 2], periods: f64, weights: &[f64]) -> Power {
        let n = self.good.len();
        let directions = libm::ceil(PI * periods).max(4.0) as usize;
        let squares = self.sum(|_| 1.0, true);
        let s = band(periods);
        let means: Vec<Vec<f64>> = shots.iter().map(|shot| self.mean(|i| f64::from(shot.value[i]), weights)).collect();
        let at = |factor: f64| self.seen(shots, &means, f.map(|f| factor * f), directions);
        let (below, own, above) = (at(1.0 - s), at(1.0), at(1.0 + s));
        let floor = self.sum(
            |i| {
                let variance = |s: &Shot<'_>| s.se.map_or(0.0, |se| f64::from(se[i]) * f64::from(se[i]));
                shots.iter().map(variance).sum::<f64>() / shots.len() as f64
            },
            true,
        );
        let m_ac = |i: usize| {
            let drawn = 0.5 * (above[i] - 2.0 * own[i] + below[i]) + 0.25 * s * (above[i] - below[i]);
            // Noise is as strong at all frequencies: nothing of it is drawn.
            let power = own[i] - drawn - floor[i];
            if power > 0.0 && squares[i] > 0.0 { (power / squares[i]).sqrt() } else { 0.0 }
        };
        let samples = (directions * shots.len()) as f64 / CORRECTION_VARIANCE;
        Power { m_ac: (0..n).map(m_ac).collect(), samples }
    }

    /// Mean over directions and shots of |F|^2 at `f`, noise included; `means` are those of each shot over the windows.
    fn seen(&self, shots: &[Shot<'_>], means: &[Vec<f64>], f: [f64; 2], directions: usize) -> Vec<f64> {
        let n = self.good.len();
        let mut power = vec![0.0; n];
        for k in 0..directions {
            let (sin, cos) = sin_cos_turns(0.5 * (k as f64 + 0.5) / directions as f64);
            let f = [f[0] * cos, f[1] * sin];
            let constant = self.turned(|_| 1.0, f, false);
            for (shot, mean) in shots.iter().zip(means) {
                let sum = self.turned(|i| f64::from(shot.value[i]), f, false);
                for i in 0..n {
                    // What a constant would leave in a window that is cut off is no speckle.
                    let z = [sum[i][0] - mean[i] * constant[i][0], sum[i][1] - mean[i] * constant[i][1]];
                    power[i] += z[0] * z[0] + z[1] * z[1];
                }
            }
        }
        let count = (directions * shots.len()) as f64;
        power.iter().map(|p| p / count).collect()
    }
}

/// Standard deviation of the band that a window of so many periods sees, as a share of f.
pub fn band(periods: f64) -> f64 {
    4.0 / (8.0_f64.sqrt() * PI * periods)
}

/// What the correction for the band does to the variance of the power: c' R c of c = (-1/2, 2, -1/2) with the correlations e^(-1/4) and e^(-1) of
/// powers one and two s apart under a Gaussian window.
const CORRECTION_VARIANCE: f64 = 1.568;

/// sum_j tap_|j| (conjugate for j < 0) value(k + j) at each k of a line, without what lies beyond its ends.
fn convolve(taps: &[Complex], n: usize, value: impl Fn(usize) -> Complex, mut put: impl FnMut(usize, Complex)) {
    let reach = taps.len() - 1;
    for k in 0..n {
        let mut sum = [0.0; 2];
        for j in k.saturating_sub(reach)..(k + reach + 1).min(n) {
            let tap = taps[j.abs_diff(k)];
            let tap = if j < k { [tap[0], -tap[1]] } else { tap };
            let z = product(tap, value(j));
            sum = [sum[0] + z[0], sum[1] + z[1]];
        }
        put(k, sum);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;
    use turbid_optics::philox::{key, philox4x32, unit};

    const SIDE: usize = 64;

    fn normal(i: usize, stream: u32) -> f64 {
        let [a, b, ..] = philox4x32([i as u32, stream, 0, 0], key(11));
        (-2.0 * libm::log(unit(a))).sqrt() * libm::cos(TAU * unit(b))
    }

    /// White speckle of mean 1 and contrast 0.2, `shrink` times as large after a Gaussian blur of `sigma` pixels, on a torus.
    fn speckle(stream: u32, sigma: f64, shrink: f64) -> Vec<f32> {
        let white: Vec<f64> = (0..SIDE * SIDE).map(|i| 1.0 + 0.2 * normal(i, stream)).collect();
        let reach = libm::ceil(5.0 * sigma) as isize;
        let taps: Vec<f64> = (-reach..=reach)
            .map(|j| if sigma == 0.0 { 1.0 } else { libm::exp(-0.5 * (j as f64 / sigma) * (j as f64 / sigma)) })
            .collect();
        let whole: f64 = taps.iter().sum();
        let line = |plane: &[f64], step: isize| -> Vec<f64> {
            let at = |i: usize, j: isize| {
                let (r, c) = ((i / SIDE) as isize, (i % SIDE) as isize);
                let (r, c) = if step == 1 { (r, c + j) } else { (r + j, c) };
                plane[(r.rem_euclid(SIDE as isize) * SIDE as isize + c.rem_euclid(SIDE as isize)) as usize]
            };
            let sum = |i: usize| taps.iter().enumerate().map(|(k, w)| w * at(i, k as isize - reach)).sum::<f64>();
            (0..plane.len()).map(|i| sum(i) / whole).collect()
        };
        line(&line(&white, 1), 2).iter().map(|v| (shrink * v) as f32).collect()
    }

    fn m_ac(values: &[Vec<f32>], se: Option<&[f32]>, f: f64) -> Power {
        let good = vec![true; SIDE * SIDE];
        let windows = Windows::new(&good, SIDE, [6.0; 2]);
        let shots: Vec<Shot<'_>> = values.iter().map(|value| Shot { value, se }).collect();
        windows.power(&shots, [f; 2], 24.0 * f, &windows.weights())
    }

    fn root_mean_square(of: &[f64]) -> f64 {
        (of.iter().map(|v| v * v).sum::<f64>() / of.len() as f64).sqrt()
    }

    /// White speckle has its standard deviation as amplitude at every f; the image holds some 40 independent windows times 8 directions or more: powers are
    /// known to 6 %, amplitudes to 3 %, within 4.5 of that.
    #[test]
    fn white_speckle_has_its_standard_deviation() {
        let white = [speckle(1, 0.0, 1.0)];
        for f in [0.1, 0.15, 0.2] {
            let plain = root_mean_square(&m_ac(&white, None, f).m_ac);
            assert!((plain / 0.2 - 1.0).abs() < 4.5 * 0.03, "f = {f}: {plain}");
        }
    }

    /// A blur of sigma pixels leaves exp(-2 (pi f sigma)^2) of the amplitude. Over 14 speckles the mean ratio of blurred to white is that within 4.5 of its own
    /// standard errors and the next order of the correction, (2 s f (2 pi sigma)^2)^4 / 24 of the power; without correction it would be 4 % too large at
    /// f = 0.15, that is more than 4 standard errors off.
    #[test]
    fn amplitudes_are_those_of_the_blur() {
        let (f, sigma) = (0.15, 1.5);
        let ratio = |seed: u32| {
            let of = |sigma: f64| root_mean_square(&m_ac(&[speckle(seed, sigma, 1.0)], None, f).m_ac);
            of(sigma) / of(0.0)
        };
        let ratios: Vec<f64> = (1..=14).map(ratio).collect();
        let mean = ratios.iter().sum::<f64>() / 14.0;
        let se = (ratios.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / (14.0 * 13.0)).sqrt();
        let want = libm::exp(-2.0 * (PI * f * sigma) * (PI * f * sigma));
        let slope = band(24.0 * f) * f * 2.0 * f * (TAU * sigma).powi(2);
        let next = slope.powi(4) / 24.0;
        println!("{mean} +- {se} for {want}, next order {next}");
        assert!((mean / want - 1.0).abs() < 4.5 * se / want + next, "{mean} +- {se} for {want}");
        assert!(4.5 * se / want + next < 0.04, "{se}: too few speckles to tell");
    }

    /// Powers of single windows spread by 1 / sqrt(samples), within a factor: neighbours are not independent, directions nearly.
    #[test]
    fn the_spread_is_that_of_the_samples() {
        let found = m_ac(&[speckle(3, 0.0, 1.0), speckle(4, 0.0, 1.0)], None, 0.2);
        let power: Vec<f64> = found.m_ac.iter().map(|m| m * m).collect();
        let mean = power.iter().sum::<f64>() / power.len() as f64;
        let spread = (power.iter().map(|p| (p / mean - 1.0).powi(2)).sum::<f64>() / power.len() as f64).sqrt();
        let want = 1.0 / found.samples.sqrt();
        assert!((0.7..1.5).contains(&(spread / want)), "{spread} for {want}");
    }

    /// The mean of eight speckles under a window is 1 within the error that their differences tell, at 400 places: sd of z 1 within its scatter (some 100
    /// independent windows: 7 %, 3 of these).
    #[test]
    fn the_error_of_the_mean_is_known() {
        let values: Vec<Vec<f32>> = (20..28).map(|seed| speckle(seed, 0.8, 1.0)).collect();
        let shots: Vec<Shot<'_>> = values.iter().map(|value| Shot { value, se: None }).collect();
        let good = vec![true; SIDE * SIDE];
        let of = |sigma: f64| Windows::new(&good, SIDE, [sigma; 2]);
        let (m_dc, variances) = of(2.0).m_dc(&shots, &of(6.0));
        let variances = variances.expect("eight speckles");
        let z: Vec<f64> = (0..400)
            .map(|k| (k % 20 * 3 + 3) * SIDE + k / 20 * 3 + 3)
            .map(|i| (m_dc[i] - 1.0) / variances[i].sqrt())
            .collect();
        let sd = (z.iter().map(|z| z * z).sum::<f64>() / z.len() as f64).sqrt();
        assert!((sd - 1.0).abs() < 0.21, "{sd}");
        assert!(of(2.0).m_dc(&shots[..1], &of(6.0)).1.is_none());
    }

    /// Camera noise of half the speckle's contrast adds a quarter to the power; known, it is taken off.
    #[test]
    fn known_noise_is_taken_off() {
        let plain = [speckle(5, 0.0, 1.0)];
        let noisy = [(0..SIDE * SIDE).map(|i| plain[0][i] + (0.1 * normal(i, 9)) as f32).collect::<Vec<f32>>()];
        let se = vec![0.1_f32; SIDE * SIDE];
        let of = |values: &[Vec<f32>], se: Option<&[f32]>| root_mean_square(&m_ac(values, se, 0.2).m_ac).powi(2);
        let (bare, raw, corrected) = (of(&plain, None), of(&noisy, None), of(&noisy, Some(&se)));
        assert!(raw / bare > 1.15 && (corrected / bare - 1.0).abs() < 0.08, "{bare} {raw} {corrected}");
    }
}
