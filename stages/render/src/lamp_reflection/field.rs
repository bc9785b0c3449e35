//! Estimates with lamp reflections added to them.

use super::{LampReflections, ManifoldSampled};
use crate::field::Field;

/// A field, and the lamp reflections of its pixels: those that are known have no errors.
pub struct WithLampReflections<'a> {
    pub field: Box<dyn Field + 'a>,
    pub lamp_reflections: LampReflections,
    pub sampled: Option<ManifoldSampled>,
}

impl ManifoldSampled {
    fn covariance(&self, pixel: usize, a: &[(usize, f64)], b: &[(usize, f64)]) -> f64 {
        let pairs = a.iter().flat_map(|a| b.iter().map(move |b| (a, b)));
        pairs.map(|(&(i, wi), &(j, wj))| wi * wj * self.moments.covariance(pixel, i, j, self.trials)).sum()
    }
}

impl Field for WithLampReflections<'_> {
    fn pixels(&self) -> usize {
        self.field.pixels()
    }

    fn mean(&self, pixel: usize, i: usize) -> f64 {
        let known = self.lamp_reflections.get(&pixel).map_or(0.0, |responses| responses[i]);
        let sampled = self.sampled.as_ref().map_or(0.0, |sampled| sampled.moments.mean(pixel, i, sampled.trials));
        self.field.mean(pixel, i) + known + sampled
    }

    fn covariance(&self, pixel: usize, a: &[(usize, f64)], b: &[(usize, f64)]) -> f64 {
        let sampled = self.sampled.as_ref().map_or(0.0, |sampled| sampled.covariance(pixel, a, b));
        self.field.covariance(pixel, a, b) + sampled
    }

    fn variance(&self, pixel: usize, terms: &[(usize, f64)]) -> f64 {
        let sampled = self.sampled.as_ref().map_or(0.0, |sampled| sampled.covariance(pixel, terms, terms).max(0.0));
        self.field.variance(pixel, terms) + sampled
    }

    fn variance_of_mean(&self, terms: &[(usize, f64)], total: f64) -> f64 {
        let Some(sampled) = &self.sampled else { return self.field.variance_of_mean(terms, total) };
        // A trial is seen by one pixel at most: their errors are hardly correlated.
        let all: f64 = (0..self.pixels()).map(|pixel| sampled.covariance(pixel, terms, terms).max(0.0)).sum();
        let n = self.pixels() as f64;
        self.field.variance_of_mean(terms, (total - all).max(0.0)) + all / (n * n)
    }

    fn se_unknown(&self, pixel: usize) -> bool {
        self.field.se_unknown(pixel)
    }

    fn mean_se_unknown(&self) -> bool {
        self.field.mean_se_unknown()
    }
}
