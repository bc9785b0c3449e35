//! First-order propagation of frame noise to M_DC, M_AC and the phase.
//!
//! M_AC = |Z| with Z = re + i im, so dM_AC = cos(phi) d re + sin(phi) d im: an error along Z. The error across Z turns
//! the phase, and to second order it makes M_AC too large by its variance / (2 M_AC), the Rician bias.

/// An element of the covariance matrix of all (dc, re, im), one number per pixel.
#[derive(Clone, Debug)]
pub enum Element<'a> {
    /// Independent quantities.
    Zero,
    /// Given per pixel.
    Given(&'a [f32]),
    /// From independent frames: sum of weight x standard error squared.
    Frames(Vec<(f64, &'a [f32])>),
}

impl<'a> Element<'a> {
    /// Covariance of two linear combinations (weights `a`, `b`) of independent frames with standard errors `se`.
    pub fn of_frames(a: &[f64], b: &[f64], se: &[&'a [f32]]) -> Self {
        Self::Frames(a.iter().zip(b).map(|(a, b)| a * b).zip(se.iter().copied()).collect())
    }

    fn at(&self, pixel: usize) -> f64 {
        match self {
            Self::Zero => 0.0,
            Self::Given(plane) => f64::from(plane[pixel]),
            Self::Frames(terms) => {
                terms.iter().map(|(weight, se)| weight * f64::from(se[pixel]) * f64::from(se[pixel])).sum()
            }
        }
    }
}

/// Covariance block between (dc, re, im) of one fringe and (dc, re, im) of another or the same.
#[derive(Clone, Debug)]
pub struct Block<'a>(pub [[Element<'a>; 3]; 3]);

/// d quantity / d (dc, re, im).
pub type Gradient = [f64; 3];

/// M_DC = dc.
pub const OF_M_DC: Gradient = [1.0, 0.0, 0.0];

/// M_AC = |Z| (along Z) and the direction across Z; both zero where Z = 0, which has no direction.
pub fn along_and_across(re: f64, im: f64) -> [Gradient; 2] {
    let m_ac = (re * re + im * im).sqrt();
    if m_ac > 0.0 {
        let (cos, sin) = (re / m_ac, im / m_ac);
        [[0.0, cos, sin], [0.0, -sin, cos]]
    } else {
        [[0.0; 3]; 2]
    }
}

impl Block<'_> {
    /// Covariance at `pixel` of two quantities with these gradients.
    pub fn covariance(&self, a: &Gradient, b: &Gradient, pixel: usize) -> f64 {
        let mut sum = 0.0;
        for (row, a) in self.0.iter().zip(a) {
            for (element, b) in row.iter().zip(b) {
                let weight = a * b;
                // Most weights vanish (M_DC has one part, M_AC two); an element that is not needed is not read.
                if weight != 0.0 {
                    sum += weight * element.at(pixel);
                }
            }
        }
        sum
    }

    /// Variance at `pixel`; a covariance matrix that was rounded to f32 may be negative by a rounding error, that is 0.
    pub fn variance(&self, a: &Gradient, pixel: usize) -> f64 {
        let variance = self.covariance(a, a, pixel);
        if variance < 0.0 { 0.0 } else { variance }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phase_shift::Weights;

    /// N equal steps with white noise sigma: var M_DC = sigma^2/N, var M_AC = 2 sigma^2/N, no correlation.
    #[test]
    fn white_noise_gives_the_closed_form() {
        let sigma = 0.01_f32;
        for n in [3, 4, 7] {
            let phases: Vec<f64> = (0..n).map(|k| 2.0 * std::f64::consts::PI * k as f64 / n as f64).collect();
            let w = Weights::least_squares(&phases).unwrap().weights;
            let plane = [sigma];
            let se = vec![&plane[..]; n];
            let block = Block([0, 1, 2].map(|a| [0, 1, 2].map(|b| Element::of_frames(&w[a], &w[b], &se))));
            let [along, across] = along_and_across(0.3, -0.4);
            let s2 = f64::from(sigma).powi(2) / n as f64;
            assert!((block.variance(&OF_M_DC, 0) / s2 - 1.0).abs() < 1e-14);
            assert!((block.variance(&along, 0) / (2.0 * s2) - 1.0).abs() < 1e-14);
            assert!((block.variance(&across, 0) / (2.0 * s2) - 1.0).abs() < 1e-14);
            assert!(block.covariance(&OF_M_DC, &along, 0).abs() < 1e-15 * s2.sqrt());
        }
    }
}
