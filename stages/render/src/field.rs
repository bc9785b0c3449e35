//! What an image is made from: for every pixel the responses (1, re, im, ..) with their covariance.

use crate::moments::Moments;
use crate::shown::{Shown, Terms};

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
}

/// Every pixel by its own paths: the errors of pixels are independent.
pub struct Sampled<'a> {
    pub moments: &'a Moments,
    /// Paths of each pixel.
    pub paths: &'a [u32],
}

impl Field for Sampled<'_> {
    fn pixels(&self) -> usize {
        self.paths.len()
    }

    fn mean(&self, pixel: usize, i: usize) -> f64 {
        self.moments.mean(pixel, i, self.paths[pixel])
    }

    fn covariance(&self, pixel: usize, a: &[(usize, f64)], b: &[(usize, f64)]) -> f64 {
        let n = self.paths[pixel];
        let pairs = a.iter().flat_map(|a| b.iter().map(move |b| (a, b)));
        pairs.map(|(&(i, wi), &(j, wj))| wi * wj * self.moments.covariance(pixel, i, j, n)).sum()
    }

    fn variance_of_mean(&self, _: &[(usize, f64)], total: f64) -> f64 {
        let n = self.paths.len() as f64;
        total / (n * n)
    }
}

/// What an error is judged by, as weights of responses.
pub struct Watched {
    pub dc: Terms,
    /// re and im of the fringe with the highest f_x, first orientation.
    pub fringe: Option<[Terms; 2]>,
}

impl Watched {
    pub fn of(shown: &Shown) -> Self {
        let (dc, fringe) = shown.watched();
        Self { dc: dc.clone(), fringe: fringe.map(|parts| parts.map(Terms::clone)) }
    }
}

/// Median over the lit pixels of SE(M_AC) / M_AC of the fringe (of M_DC where there is none); `None` where no pixel is lit.
pub fn relative_error(field: &dyn Field, watched: &Watched) -> Option<f64> {
    let mut errors: Vec<f64> = (0..field.pixels()).filter_map(|pixel| error_of(field, pixel, watched)).collect();
    if errors.is_empty() {
        return None;
    }
    let middle = errors.len() / 2;
    Some(*errors.select_nth_unstable_by(middle, f64::total_cmp).1)
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
