//! Least squares of functions of the place to the responses of a region's pixels, of all orders at once.

use std::ops::Range;

use crate::chart::Functions;
use crate::orthonormal::Orthonormal;
use crate::reduced::Reduced;
use crate::regions::Region;

/// What is fitted to what.
pub struct Fit<'a> {
    pub region: &'a Region,
    pub reduced: &'a Reduced,
    /// 1 / variance of the response to 1, as it is expected.
    pub weights: Vec<f64>,
    pub functions: Functions,
    /// Where these are not all that the chart has, up to which order of all it is looked for what they leave out.
    pub rest: Option<usize>,
}

/// The functions of a fit up to an order, and those behind them by which it is told what they leave out.
#[derive(Clone, Copy, Debug)]
pub struct Bounded {
    functions: Functions,
    pub order: usize,
    rest: Option<(Functions, usize)>,
}

impl Bounded {
    pub fn of(fit: &Fit<'_>, order: usize) -> Self {
        let rest = fit.rest.map(|rest| (fit.region.chart.all_functions(), rest));
        Self { functions: fit.functions, order, rest }
    }

    /// How many functions the fit has.
    pub fn inside(&self) -> usize {
        self.functions.terms(self.order)
    }

    /// Those that it has not: of the next order, and of all.
    pub fn beyond(&self) -> [Range<usize>; 2] {
        let next = self.functions.terms(self.order + 1);
        [self.inside()..next, next..next + self.rest.map_or(0, |(all, order)| all.terms(order))]
    }

    pub fn count(&self) -> usize {
        self.beyond()[1].end
    }

    /// All of them at a place.
    pub fn basis(&self, place: [f64; 2], into: &mut Vec<f64>) {
        self.functions.basis(place, self.order + 1, into);
        if let Some((all, order)) = self.rest {
            let mut more = Vec::new();
            all.basis(place, order, &mut more);
            into.extend(more);
        }
    }
}

/// Coefficients of functions by which the squares of the weighed residuals over some pixels are least.
pub struct LeastSquares {
    pub phi: Orthonormal,
    /// `[term][response]`.
    pub coefficients: Vec<f64>,
    /// Their variances, `[term][response]`.
    pub variances: Vec<f64>,
}

impl LeastSquares {
    /// Of the `m` functions that `basis` gives at a place.
    pub fn of(fit: &Fit<'_>, active: &[bool], m: usize, basis: &dyn Fn([f64; 2], &mut Vec<f64>)) -> Self {
        let q = fit.reduced.q;
        let some = || (0..fit.region.len()).filter(|&i| active[i]);
        let (mut b, mut gram) = (Vec::new(), vec![0.0; m * m]);
        for i in some() {
            basis(fit.region.places[i], &mut b);
            for (k, row) in gram.chunks_exact_mut(m).enumerate() {
                let wb = fit.weights[i] * b[k];
                row[..=k].iter_mut().zip(&b).for_each(|(sum, b)| *sum += wb * b);
            }
        }
        (0..m).for_each(|k| (0..k).for_each(|l| gram[l * m + k] = gram[k * m + l]));
        let phi = Orthonormal::of(&gram, m);
        let (mut coefficients, mut variances, mut values) = (vec![0.0; m * q], vec![0.0; m * q], Vec::new());
        for i in some() {
            basis(fit.region.places[i], &mut b);
            phi.at(&b, &mut values);
            for (k, value) in values.iter().enumerate() {
                let weight = fit.weights[i] * value;
                for a in 0..q {
                    coefficients[k * q + a] += weight * fit.reduced.value(i, a);
                    variances[k * q + a] += weight * weight * fit.reduced.variance(i, a);
                }
            }
        }
        Self { phi, coefficients, variances }
    }

    /// By how much the sum of (coefficient / standard error)^2 over functions and the responses of a group exceeds their number, and that number.
    pub fn excess(&self, terms: Range<usize>, group: &Range<usize>, q: usize) -> (f64, f64) {
        let new = terms.filter(|&k| self.phi.is_new(k));
        let each = new.flat_map(|k| group.clone().map(move |a| k * q + a)).filter(|&ka| self.variances[ka] > 0.0);
        each.fold((0.0, 0.0), |(sum, count), ka| {
            (sum + self.coefficients[ka] * self.coefficients[ka] / self.variances[ka] - 1.0, count + 1.0)
        })
    }
}

/// Fits of all orders.
pub struct Trial {
    pub solved: LeastSquares,
    /// The highest order.
    pub top: usize,
    /// For each group of responses what the orders up to each take off the squares of the errors, less what they add to them, in units of the noise of a function (Mallows).
    gains: Vec<Vec<f64>>,
}

impl Trial {
    /// Up to `most` functions to the `active` pixels; `None` where these have no order 2.
    pub fn of(fit: &Fit<'_>, active: &[bool], most: usize) -> Option<Self> {
        let functions = fit.functions;
        let top = (2..).take_while(|&order| functions.terms(order) <= most).last()?;
        let basis = |place: [f64; 2], into: &mut Vec<f64>| functions.basis(place, top, into);
        let solved = LeastSquares::of(fit, active, functions.terms(top), &basis);
        let gains = fit.reduced.groups().map(|group| {
            let all = (1..=top).scan(0.0, |sum, order| {
                let terms = functions.terms(order - 1)..functions.terms(order);
                let (excess, count) = solved.excess(terms, &group, fit.reduced.q);
                *sum += excess - count;
                Some(*sum)
            });
            std::iter::once(0.0).chain(all).collect()
        });
        let gains = gains.collect();
        Some(Self { solved, top, gains })
    }

    /// The order to take: two more than that of which the error is expected to be least, so that what is left out is well below the noise: after many paths one more is off by as
    /// much, beside edges by twice that; `None` where there is none beyond to tell.
    pub fn order(&self) -> Option<usize> {
        let least_error = |gains: &Vec<f64>| {
            let best = gains.iter().enumerate().fold(
                (0, 0.0),
                |best, (order, &gain)| {
                    if gain > best.1 { (order, gain) } else { best }
                },
            );
            best.0
        };
        let order = (self.gains.iter().map(least_error).max().unwrap_or(0) + 2).max(2);
        (order < self.top).then_some(order)
    }

    /// What an order takes off the squares of all errors.
    pub fn gain(&self, order: usize) -> f64 {
        self.gains.iter().map(|gains| gains[order]).sum()
    }
}
