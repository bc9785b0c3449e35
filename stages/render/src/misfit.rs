//! What residuals of a fit in blocks of pixels show beyond noise.

use std::borrow::Borrow;
use std::ops::Range;

/// Squares that exceed their noise by less than so many of its standard deviations are taken for noise: added up wherever they are positive they would make every
/// error too large.
const CLEAR: f64 = 1.5;

/// The mean residual of a response in a block.
pub struct Score {
    pub mean: f64,
    /// Its variance, as the paths of the block say, and as those of the whole region do.
    pub sampled: f64,
    pub expected: f64,
    pub weight: f64,
}

impl Score {
    /// In units of its noise.
    pub fn squared(&self) -> f64 {
        let noise = self.sampled.max(self.expected);
        if noise > 0.0 { self.mean * self.mean / noise } else { 0.0 }
    }
}

/// What is left of reduced responses in blocks beyond noise.
pub struct Misfit {
    /// Of a ring: its number; everywhere in the region if there is none.
    pub ring: Option<u32>,
    /// Mean square of each response.
    pub variances: Vec<f64>,
    /// Pixels that share one.
    pub pixels: f64,
}

impl Misfit {
    /// By how much squares of mean residuals exceed their noise, of the `scores` of blocks of so many pixels, `[block][response]`, those of a group together; and the largest mean square of scores
    /// of any response.
    pub fn of(
        groups: impl Iterator<Item = Range<usize>> + Clone,
        ring: Option<u32>,
        pixels: f64,
        scores: &[impl Borrow<Vec<Score>>],
    ) -> (Self, f64) {
        let (mut variances, mut chi2) = (vec![0.0; groups.clone().map(|g| g.end).max().unwrap_or(0)], 0.0_f64);
        for group in groups.filter(|_| !scores.is_empty()) {
            let of = || scores.iter().flat_map(|scores| group.clone().map(move |a| &scores.borrow()[a]));
            let weight: f64 = of().map(|s| s.weight).sum();
            let squares = of().map(|s| s.weight * s.mean * s.mean).sum::<f64>() / weight;
            let noise = of().map(|s| s.weight * s.sampled).sum::<f64>() / weight;
            if noise > 0.0 {
                chi2 = chi2.max(squares / noise);
            }
            let count = (scores.len() * group.len()) as f64;
            let is_clear = squares > noise * (1.0 + CLEAR * (2.0 / count).sqrt());
            group.for_each(|a| variances[a] = if is_clear { squares - noise } else { 0.0 });
        }
        (Self { ring, variances, pixels }, chi2)
    }

    /// The larger one of each response.
    pub fn or(mut self, other: Self) -> Self {
        if other.variances.iter().sum::<f64>() > self.variances.iter().sum::<f64>() {
            self.pixels = other.pixels;
        }
        self.variances.iter_mut().zip(other.variances).for_each(|(own, other)| *own = own.max(other));
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scores(means: &[f64]) -> Vec<Vec<Score>> {
        means.iter().map(|&mean| vec![Score { mean, sampled: 1.0, expected: 1.0, weight: 1.0 }]).collect()
    }

    /// Of eight blocks of one response noise has squares of 1 +- sqrt(2 / 8): a mean square of 1.5 is noise, one of 2 (above 1.75) is not, and exceeds it by 1.
    #[test]
    fn noise_is_no_misfit() {
        let of = |square: f64| {
            let (misfit, chi2) = Misfit::of(std::iter::once(0..1), None, 4.0, &scores(&[square.sqrt(); 8]));
            assert!((chi2 - square).abs() < 1e-12);
            misfit.variances[0]
        };
        assert_eq!(of(1.5), 0.0);
        assert!((of(2.0) - 1.0).abs() < 1e-12);
        let none: [Vec<Score>; 0] = [];
        assert_eq!(Misfit::of(std::iter::once(0..1), None, 4.0, &none).0.variances, [0.0]);
    }

    /// What cancels around a ring shows in its quarters.
    #[test]
    fn quarters_show_what_cancels_around() {
        let whole = Misfit::of(std::iter::once(0..1), Some(2), 40.0, &scores(&[0.0])).0;
        let quarters = Misfit::of(std::iter::once(0..1), Some(2), 10.0, &scores(&[4.0, -4.0, 4.0, -4.0])).0;
        let both = whole.or(quarters);
        assert_eq!((both.variances[0], both.pixels), (15.0, 10.0));
    }
}
