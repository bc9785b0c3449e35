//! The power law of scattering, mu_s' = a (lambda / 500 nm)^-b, by weighted least squares.

use turbid_optics::chromophore::SCATTERING_NM;
use turbid_optics::elementary::{exp, ln};

use crate::least_squares::{MOST, Noise, Weights, factorise, turned, unit};

/// a (mm^-1) and b, with their covariance where the noise is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PowerLaw {
    pub a: f64,
    pub b: f64,
    pub covariance: Option<[[f64; 2]; 2]>,
}

/// The wavelengths of a fit.
#[derive(Clone, Debug)]
pub struct PowerLawFit {
    /// ln(lambda / 500 nm)
    logs: Vec<f64>,
}

/// Memory that is used again for each pixel.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    weights: Weights,
    columns: Vec<f64>,
}

/// Steps from the start until nothing changes: 2 to 4 where noise is some per cent.
const STEPS: usize = 50;
/// Change of ln a and b at which the fit ends; what is left is smaller by the relative residual once more, and below what images keep.
const ENOUGH: f64 = 1e-6;
/// Powers beyond this are no scattering, and the way to them no fit.
const STEEPEST: f64 = 40.0;

impl PowerLawFit {
    pub fn new(wavelengths_nm: &[f64]) -> Self {
        Self { logs: wavelengths_nm.iter().map(|nm| libm::log(nm / SCATTERING_NM)).collect() }
    }

    /// The law that explains `mu_s_prime` (mm^-1) best: least squares of mu_s' itself, by steps from the line through ln mu_s'.
    ///
    /// Logarithms alone would be off by half the relative variance, and weights of the measured values by more: those of the law itself are not. `None`
    /// where fewer than two values are above 0, and where no law is near.
    pub fn fit(&self, mu_s_prime: &[f64], noise: Noise<'_>, scratch: &mut Scratch) -> Option<PowerLaw> {
        let rows = self.logs.len();
        let [mut ln_a, mut b] = self.line(mu_s_prime)?;
        let Scratch { weights, columns } = scratch;
        weights.set(rows, noise);
        for _ in 0..STEPS {
            if !(b.abs() <= STEEPEST && ln_a.abs() <= STEEPEST) {
                return None;
            }
            columns.clear();
            columns.extend(self.logs.iter().map(|t| exp(ln_a - b * t)));
            columns.extend_from_within(..);
            columns[rows..].iter_mut().zip(&self.logs).for_each(|(v, t)| *v *= -t);
            for (i, mu) in mu_s_prime.iter().enumerate() {
                columns.push(mu - columns[i]);
            }
            columns.chunks_exact_mut(rows).for_each(|column| weights.whiten(column));
            let factors = factorise(columns, rows, 2)?;
            let step = factors.solution();
            ln_a += step[0];
            b += step[1];
            if step[0].abs() + step[1].abs() <= ENOUGH {
                let of_rhs = if weights.are_equal() { turned(columns, rows, 2, noise) } else { Some(unit(2)) };
                let a = exp(ln_a);
                // Of (ln a, b); a itself changes by a d(ln a).
                let covariance = of_rhs.map(|t| {
                    let c: [[f64; MOST]; MOST] = factors.covariance(&t);
                    [[a * a * c[0][0], a * c[0][1]], [a * c[1][0], c[1][1]]]
                });
                return Some(PowerLaw { a, b, covariance });
            }
        }
        None
    }

    /// The straight line through ln mu_s' where mu_s' is above 0: ln a and b.
    fn line(&self, mu_s_prime: &[f64]) -> Option<[f64; 2]> {
        let (mut n, mut sums) = (0.0, [0.0; 4]);
        for (&t, &mu) in self.logs.iter().zip(mu_s_prime).filter(|(_, mu)| **mu >= f64::MIN_POSITIVE) {
            let y = ln(mu);
            n += 1.0;
            sums.iter_mut().zip([t, y, t * t, t * y]).for_each(|(sum, v)| *sum += v);
        }
        let [t, y, tt, ty] = sums;
        let spread = n * tt - t * t;
        (n >= 2.0 && spread > 0.0).then(|| {
            let slope = (n * ty - t * y) / spread;
            [(y - slope * t) / n, -slope]
        })
    }
}
