//! How scattering couples the directions.

#![allow(clippy::needless_range_loop, reason = "rows and columns of one matrix")]

use turbid_optics::PhaseFunction;

use crate::angles::Directions;
use crate::cholesky::{Cholesky, cholesky_of_sums};
use crate::matrix::{Matrix, zeros};

/// Scattering between the nodes, azimuth averaged, by one phase function.
pub struct Coupling<const N: usize> {
    /// Even part, times both weights, off the diagonal; the diagonal follows from conservation.
    pub even: Matrix<N>,
    /// Odd part, times the roots of both weights.
    pub odd: Matrix<N>,
    /// Fraction of the scattering that is not taken as exactly forward (of g > 0) or backward (of g < 0), with all its digits.
    pub rest: f64,
    /// Fraction of the scattering that is taken as exactly backward.
    backward: f64,
}

impl<const N: usize> Coupling<N> {
    /// Of the terms of a phase function, each with its share.
    pub fn new(directions: &Directions<N>, phase: &PhaseFunction) -> Self {
        let [forward, backward] = phase.terms();
        let first = Self::of_term(directions, forward.1);
        if backward.0 == 0.0 {
            return first;
        }
        let second = Self::of_term(directions, backward.1);
        let rest = forward.0 * first.rest + backward.0 * second.rest;
        let shares = [forward.0 * first.rest / rest, backward.0 * second.rest / rest];
        let mixed = |a: &Matrix<N>, b: &Matrix<N>| -> Matrix<N> {
            std::array::from_fn(|i| std::array::from_fn(|j| shares[0] * a[i][j] + shares[1] * b[i][j]))
        };
        Self {
            even: mixed(&first.even, &second.even),
            odd: mixed(&first.odd, &second.odd),
            rest,
            backward: forward.0 * first.backward + backward.0 * second.backward,
        }
    }

    /// Of Henyey and Greenstein's function of `g` in (-1, 1).
    fn of_term(directions: &Directions<N>, g: f64) -> Self {
        let Directions { terms, weights, .. } = *directions;
        let sharp = g.abs();
        let log = if sharp > 0.0 { libm::log(sharp) } else { -800.0 };
        let order = terms as f64;
        // A rule of n > 1 aliases the moments beyond N of sharp peaks, to less light back than none; of blunt ones they help. So
        // the phase function goes over from the one truncation to the other while its moments |g|^l outgrow the rule.
        let short = terms.min(N) as f64;
        let blend = if directions.n == 1.0 { 0.0 } else { libm::exp(4.0 * short * log) };
        let mixed = |long: f64, short: f64| (1.0 - blend) * long + blend * short;
        let rest = mixed(-libm::expm1(order * log), -libm::expm1(short * log));
        let peak = mixed(libm::exp(order * log), libm::exp(short * log));
        let legendre = directions.cosines.map(|x| {
            let mut values = vec![1.0, x];
            for l in 2..terms {
                let k = l as f64;
                values.push(((2.0 * k - 1.0) * x * values[l - 1] - (k - 1.0) * values[l - 2]) / k);
            }
            values
        });
        let (mut even, mut odd) = (zeros(), zeros());
        for l in 0..terms {
            // Of either truncation |g|^l - f = |g|^l (1 - |g|^(L-l)), f = |g|^L.
            let l_f = l as f64;
            let beyond = |order: f64| if l_f < order { -libm::expm1((order - l_f) * log) } else { 0.0 };
            let moment = libm::exp(l_f * log) * mixed(beyond(order), beyond(short)) / rest;
            let moment = if l % 2 == 1 && g < 0.0 { -moment } else { moment };
            let factor = (2 * l + 1) as f64 * moment;
            let part: &mut Matrix<N> = if l % 2 == 0 { &mut even } else { &mut odd };
            for i in 0..N {
                for j in 0..N {
                    part[i][j] += factor * legendre[i][l] * legendre[j][l];
                }
            }
        }
        for i in 0..N {
            for j in 0..N {
                let both = weights[i] * weights[j];
                even[i][j] *= both;
                odd[i][j] *= both.sqrt();
            }
        }
        Self { even, odd, rest, backward: if g < 0.0 { peak } else { 0.0 } }
    }

    /// U of [`crate::modes`] per unit depth, at this share of scattering.
    pub fn odd_matrix(&self, directions: &Directions<N>, scatter: f64) -> Matrix<N> {
        let backward = scatter * 2.0 * self.backward / self.rest;
        let roots = &directions.inverse_roots;
        std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                let diagonal = if i == j { 1.0 + backward } else { 0.0 };
                (diagonal - scatter * self.odd[i][j]) * roots[i] * roots[j]
            })
        })
    }

    /// The transposed factor of V per unit depth, before its scaling by the root of cosine times weight.
    pub fn even_factor(&self, directions: &Directions<N>, absorb: f64, scatter: f64) -> Option<Matrix<N>> {
        cholesky_of_sums(self.even.map(|row| row.map(|x| scatter * x)), directions.weights.map(|w| absorb * w))
    }

    /// Whether both are positive definite. They are mixtures of a positive diagonal and these: positive at albedo 1 means
    /// positive everywhere.
    pub fn is_resolved(&self, directions: &Directions<N>) -> bool {
        Cholesky::new(self.odd_matrix(directions, 1.0)).is_some() && self.even_factor(directions, 1e-200, 1.0).is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::incidence::Incidence;

    /// Matched, each node scatters all that it scatters: Radau is exact for every even moment kept.
    #[test]
    fn coupling_conserves() {
        let rule = Directions::<8>::new(1.0, Incidence::Normal);
        let of_g = [-0.9, 0.0, 0.5, 0.99].map(PhaseFunction::henyey_greenstein);
        let two_term = [(0.9, -0.3, 0.95), (0.99, 0.5, 0.3)].map(|(g_forward, g_backward, forward)| {
            PhaseFunction::TwoTermHenyeyGreenstein { g_forward, g_backward, forward }
        });
        for phase in of_g.into_iter().chain(two_term) {
            for (row, weight) in Coupling::new(&rule, &phase).even.iter().zip(rule.weights) {
                let sum = row.iter().fold(0.0, |sum, x| sum + x);
                assert!((sum / weight - 1.0).abs() < 1e-12, "{phase}: {sum} of {weight}");
            }
        }
    }
}
