//! Estimates with glints added to them.

use super::Glints;
use crate::field::Field;

/// A field, and the glints of its pixels: they have no errors.
pub struct Glinting<'a> {
    pub field: Box<dyn Field + 'a>,
    pub glints: Glints,
}

impl Field for Glinting<'_> {
    fn pixels(&self) -> usize {
        self.field.pixels()
    }

    fn mean(&self, pixel: usize, i: usize) -> f64 {
        self.field.mean(pixel, i) + self.glints.get(&pixel).map_or(0.0, |responses| responses[i])
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
}
