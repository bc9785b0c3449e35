//! What an image is made from: for every pixel the responses (1, re, im, ..) with their covariance.

use crate::moments::Moments;
use crate::projected::{Projected, Terms};

/// Estimates of the responses of every pixel, whose errors may be common to pixels.
pub trait Field {
    fn pixels(&self) -> usize;

    /// Response i of a pixel.
    fn mean(&self, pixel: usize, i: usize) -> f64;

    /// Covariance of the errors of two sums of weight x response in a pixel.
    fn covariance(&self, pixel: usize, a: &[(usize, f64)], b: &[(usize, f64)]) -> f64;

    /// Variance of one; never below 0.
    fn variance(&self, pixel: usize, terms: &[(usize, f64)]) -> f64 {
        // Rounding may leave a sum of squares just below zero.
        self.covariance(pixel, terms, terms).max(0.0)
    }

    /// Variance of such a sum's mean over the image, the variances of whose pixels add up to `total`.
    fn variance_of_mean(&self, terms: &[(usize, f64)], total: f64) -> f64;

    /// Whether the errors of a pixel are larger than its covariance says, nobody knows by how much.
    fn se_unknown(&self, _pixel: usize) -> bool {
        false
    }

    /// The same of the mean over the image.
    fn mean_se_unknown(&self) -> bool {
        false
    }
}

/// Every pixel by its own paths: the errors of pixels are independent.
pub struct Sampled<'a> {
    pub moments: &'a Moments,
    /// Paths of each pixel.
    pub paths: &'a [u32],
    /// Kurtosis of a path - 1: by it standard errors are inflated, so that they hold the truth as often as they should; see [`inflation`]. 0: they are not.
    pub spread: f64,
}

/// From fewer paths than this nothing is known about errors.
pub const LEAST_PATHS: u32 = 64;

/// By what the sampled standard error of a mean of `n` paths is multiplied so that it holds the truth in 68.3 % of cases.
///
/// Few paths see the rare bright places. A pixel that has missed them is too dark, and its sampled variance too small: both at once, so that
/// the interval misses the truth. The sampled variance has as many degrees of freedom as a normal sample's has with
/// nu = 2 n / (kurtosis - 1), and Student's t of nu degrees exceeds the normal 68.3 % quantile by 1 + 1 / (2 nu) to first order. Below 4
/// degrees variances are pooled instead (`variance_smoothing.rs`); where they cannot be, 4 are taken.
pub fn inflation(n: u32, spread: f64) -> f64 {
    let n = f64::from(n.max(LEAST_PATHS));
    1.0 + spread.min(0.5 * n) / (4.0 * n)
}

impl Sampled<'_> {
    /// By what it is inflated, and itself without.
    pub fn apart(self) -> (f64, Self) {
        (self.spread, Self { spread: 0.0, ..self })
    }

    pub fn with_spread(&self, spread: f64) -> Self {
        Self { spread, ..*self }
    }

    fn raw(&self, pixel: usize, a: &[(usize, f64)], b: &[(usize, f64)]) -> f64 {
        let n = self.paths[pixel];
        let pairs = a.iter().flat_map(|a| b.iter().map(move |b| (a, b)));
        pairs.map(|(&(i, wi), &(j, wj))| wi * wj * self.moments.covariance(pixel, i, j, n)).sum()
    }
}

impl Field for Sampled<'_> {
    fn pixels(&self) -> usize {
        self.paths.len()
    }

    fn mean(&self, pixel: usize, i: usize) -> f64 {
        self.moments.mean(pixel, i, self.paths[pixel])
    }

    fn covariance(&self, pixel: usize, a: &[(usize, f64)], b: &[(usize, f64)]) -> f64 {
        let inflation = inflation(self.paths[pixel], self.spread);
        inflation * inflation * self.raw(pixel, a, b)
    }

    fn variance_of_mean(&self, terms: &[(usize, f64)], _: f64) -> f64 {
        // All pixels together see what is rare, as far as their paths go.
        let (n, paths) = (self.paths.len() as f64, self.paths.iter().fold(0, |sum: u32, &n| sum.saturating_add(n)));
        let inflation = inflation(paths, self.spread);
        let sum: f64 = (0..self.paths.len()).map(|pixel| self.raw(pixel, terms, terms).max(0.0)).sum();
        inflation * inflation * sum / (n * n)
    }
}

/// What an error is judged by, as weights of responses.
pub struct Watched {
    pub dc: Terms,
    /// re and im of the fringe with the highest f_x, first orientation.
    pub fringe: Option<[Terms; 2]>,
}

impl Watched {
    pub fn of(projected: &Projected) -> Self {
        let (dc, fringe) = projected.watched();
        Self { dc: dc.clone(), fringe: fringe.map(|parts| parts.map(Terms::clone)) }
    }
}

/// Median over the lit pixels of SE(M_AC) / M_AC of the fringe (of M_DC where there is none); `None` where no pixel is lit.
pub fn relative_error(field: &dyn Field, watched: &Watched) -> Option<f64> {
    relative_error_of(field, watched, 0.5)
}

/// The same of the pixel that has more than this `part` of the others below it.
pub fn relative_error_of(field: &dyn Field, watched: &Watched, part: f64) -> Option<f64> {
    let mut errors: Vec<f64> = (0..field.pixels()).filter_map(|pixel| error_of(field, pixel, watched)).collect();
    if errors.is_empty() {
        return None;
    }
    let place = (part * errors.len() as f64) as usize;
    Some(*errors.select_nth_unstable_by(place, f64::total_cmp).1)
}

/// SE / mean of what is watched in a pixel; `None` where it is dark.
fn error_of(field: &dyn Field, pixel: usize, watched: &Watched) -> Option<f64> {
    let mean = |terms: &Terms| -> f64 { terms.iter().map(|&(i, w)| w * field.mean(pixel, i)).sum() };
    let Some([re, im]) = &watched.fringe else {
        let dc = mean(&watched.dc);
        return (dc > 0.0).then(|| field.variance(pixel, &watched.dc).sqrt() / dc);
    };
    let (x, y) = (mean(re), mean(im));
    let m2 = x * x + y * y;
    // Variance along the phase of the mean.
    let along: Terms = re.iter().map(|&(i, w)| (i, x * w)).chain(im.iter().map(|&(i, w)| (i, y * w))).collect();
    (m2 > 0.0).then(|| (field.variance(pixel, &along) / m2).sqrt() / m2.sqrt())
}
