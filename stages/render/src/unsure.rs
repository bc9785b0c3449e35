//! Estimates some of whose standard errors are not known.

use crate::field::Field;
use crate::moments::Brightness;
use crate::neighbours::around;
use crate::tail::{image_holds, is_held, is_peaked};

/// A field with pixels whose errors are larger than it says, nobody knows by how much.
pub struct Unsure<'a> {
    pub field: Box<dyn Field + 'a>,
    /// One for each pixel.
    pub pixels: Vec<bool>,
    /// Whether that holds of the mean over the image.
    pub mean: bool,
}

impl<'a> Unsure<'a> {
    /// A field whose variances are pooled over the pixels around, of which those where these paths do not hold the tail are unsure; `expected`: the kurtosis that
    /// the scene says.
    pub fn of_tail(field: Box<dyn Field + 'a>, seen: &[Brightness], expected: f64, columns: usize) -> Self {
        let held = |pixel: usize| {
            let (mut paths, mut variance, mut fourth) = (0.0, 0.0, 0.0);
            for other in around(pixel, columns, seen.len()).map(|p| seen[p]) {
                paths += other.paths;
                variance += other.paths * other.variance;
                fourth += other.paths * other.fourth;
            }
            variance == 0.0 || is_held(paths, variance, fourth, expected)
        };
        let peaked = is_peaked(expected);
        Self {
            pixels: (0..seen.len()).map(|pixel| peaked && !held(pixel)).collect(),
            mean: peaked && !image_holds(seen, expected),
            field,
        }
    }
}

impl Field for Unsure<'_> {
    fn pixels(&self) -> usize {
        self.field.pixels()
    }

    fn mean(&self, pixel: usize, i: usize) -> f64 {
        self.field.mean(pixel, i)
    }

    fn covariance(&self, pixel: usize, a: &[(usize, f64)], b: &[(usize, f64)]) -> f64 {
        self.field.covariance(pixel, a, b)
    }

    fn variance(&self, pixel: usize, terms: &[(usize, f64)]) -> f64 {
        self.field.variance(pixel, terms)
    }

    fn variance_of_mean(&self, terms: &[(usize, f64)], total: f64) -> f64 {
        self.field.variance_of_mean(terms, total)
    }

    fn se_unknown(&self, pixel: usize) -> bool {
        self.pixels[pixel] || self.field.se_unknown(pixel)
    }

    fn mean_se_unknown(&self) -> bool {
        self.mean || self.field.mean_se_unknown()
    }
}
