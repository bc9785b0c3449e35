//! Estimates with glints added to them.

use super::{Chanced, Glints};
use crate::field::Field;

/// A field, and the glints of its pixels: those that are known have no errors.
pub struct Glinting<'a> {
    pub field: Box<dyn Field + 'a>,
    pub glints: Glints,
    pub chanced: Option<Chanced>,
}

impl Chanced {
    fn covariance(&self, pixel: usize, a: &[(usize, f64)], b: &[(usize, f64)]) -> f64 {
        let pairs = a.iter().flat_map(|a| b.iter().map(move |b| (a, b)));
        pairs.map(|(&(i, wi), &(j, wj))| wi * wj * self.moments.covariance(pixel, i, j, self.trials)).sum()
    }
}

impl Field for Glinting<'_> {
    fn pixels(&self) -> usize {
        self.field.pixels()
    }

    fn mean(&self, pixel: usize, i: usize) -> f64 {
        let known = self.glints.get(&pixel).map_or(0.0, |responses| responses[i]);
        let chanced = self.chanced.as_ref().map_or(0.0, |chanced| chanced.moments.mean(pixel, i, chanced.trials));
        self.field.mean(pixel, i) + known + chanced
    }

    fn covariance(&self, pixel: usize, a: &[(usize, f64)], b: &[(usize, f64)]) -> f64 {
        let chanced = self.chanced.as_ref().map_or(0.0, |chanced| chanced.covariance(pixel, a, b));
        self.field.covariance(pixel, a, b) + chanced
    }

    fn variance(&self, pixel: usize, terms: &[(usize, f64)]) -> f64 {
        let chanced = self.chanced.as_ref().map_or(0.0, |chanced| chanced.covariance(pixel, terms, terms).max(0.0));
        self.field.variance(pixel, terms) + chanced
    }

    fn variance_of_mean(&self, terms: &[(usize, f64)], total: f64) -> f64 {
        let Some(chanced) = &self.chanced else { return self.field.variance_of_mean(terms, total) };
        // A trial is seen by one pixel at most: their errors are hardly correlated.
        let all: f64 = (0..self.pixels()).map(|pixel| chanced.covariance(pixel, terms, terms).max(0.0)).sum();
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
