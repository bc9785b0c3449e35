//! Least squares of functions of the place to the responses of a region's pixels, of all orders at once.

use std::ops::Range;

use crate::chart::{Functions, Place};
use crate::orthonormal::Orthonormal;
use crate::reduced::Reduced;
use crate::regions::Region;

/// So many functions are tried, and more where that is not enough; there are [`PER_TERM`] pixels for each.
pub const TERMS: [usize; 4] = [36, 66, 144, 256];
pub const PER_TERM: usize = 4;

/// What is fitted to what: a group of responses that are alike.
pub struct Fit<'a> {
    pub region: &'a Region,
    pub reduced: &'a Reduced,
    pub responses: Range<usize>,
    /// 1 / variance of the response to 1, as it is expected.
    pub weights: &'a [f64],
    pub functions: Functions,
    /// Where these are not all that there are: all, and up to which order it is looked for what is left out.
    pub rest: Option<(Functions, usize)>,
}

impl Fit<'_> {
    pub fn place(&self, i: usize) -> Place {
        self.region.place(i, self.reduced.fringe(&self.responses))
    }

    /// The first trial that has functions enough, and its order.
    pub fn lowest(&self, active: &[bool]) -> Option<(Trial, usize)> {
        let count = active.iter().filter(|&&active| active).count();
        TERMS.into_iter().find_map(|most| {
            let trial = Trial::of(self, active, most.min(count / PER_TERM))?;
            trial.order().map(|order| (trial, order))
        })
    }
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
        Self { functions: fit.functions, order, rest: fit.rest }
    }

    /// How many functions the fit has.
    pub fn inside(&self) -> usize {
        self.functions.terms(self.order)
    }

    /// Those of the fit, and those that it has not: of the next order, and of all.
    pub fn parts(&self) -> [Range<usize>; 3] {
        let (inside, next) = (self.inside(), self.functions.terms(self.order + 1));
        [0..inside, inside..next, next..next + self.rest.map_or(0, |(all, order)| all.terms(order))]
    }

    pub fn count(&self) -> usize {
        self.parts()[2].end
    }

    /// All of them at a place.
    pub fn basis(&self, place: Place, into: &mut Vec<f64>) {
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
    /// `[term][response of the group]`.
    pub coefficients: Vec<f64>,
    /// Their variances, `[term][response of the group]`.
    pub variances: Vec<f64>,
    /// How many responses there are.
    pub width: usize,
}

impl LeastSquares {
    /// Of the `m` functions that `basis` gives at a place.
    pub fn of(fit: &Fit<'_>, active: &[bool], m: usize, basis: &dyn Fn(Place, &mut Vec<f64>)) -> Self {
        let some = || (0..fit.region.len()).filter(|&i| active[i]);
        let (mut b, mut gram) = (Vec::new(), vec![0.0; m * m]);
        for i in some() {
            basis(fit.place(i), &mut b);
            for (k, row) in gram.chunks_exact_mut(m).enumerate() {
                let wb = fit.weights[i] * b[k];
                row[..=k].iter_mut().zip(&b).for_each(|(sum, b)| *sum += wb * b);
            }
        }
        (0..m).for_each(|k| (0..k).for_each(|l| gram[l * m + k] = gram[k * m + l]));
        let (phi, width) = (Orthonormal::of(&gram, m), fit.responses.len());
        let (mut coefficients, mut variances, mut values) = (vec![0.0; m * width], vec![0.0; m * width], Vec::new());
        for i in some() {
            basis(fit.place(i), &mut b);
            phi.at(&b, &mut values);
            for (k, value) in values.iter().enumerate() {
                let weight = fit.weights[i] * value;
                for (place, a) in fit.responses.clone().enumerate() {
                    coefficients[k * width + place] += weight * fit.reduced.value(i, a);
                    variances[k * width + place] += weight * weight * fit.reduced.variance(i, a);
                }
            }
        }
        Self { phi, coefficients, variances, width }
    }

    /// Those of the first `terms` functions of the place themselves, which are not orthonormal, for one response of the group.
    pub fn of_functions(&self, response: usize, terms: usize) -> Vec<f64> {
        let own: Vec<f64> = (0..terms).map(|k| self.coefficients[k * self.width + response]).collect();
        self.phi.back(&own)
    }

    /// By how much the sum of (coefficient / standard error)^2 over functions and responses exceeds their number, and that number.
    pub fn excess(&self, terms: Range<usize>) -> (f64, f64) {
        let new = terms.filter(|&k| self.phi.is_new(k));
        let each = new.flat_map(|k| k * self.width..(k + 1) * self.width).filter(|&ka| self.variances[ka] > 0.0);
        each.fold((0.0, 0.0), |(sum, count), ka| {
            (sum + self.coefficients[ka] * self.coefficients[ka] / self.variances[ka] - 1.0, count + 1.0)
        })
    }
}

/// A group of responses that are alike.
pub struct Fitted {
    pub responses: Range<usize>,
    fringe: Option<usize>,
    /// Coefficients of those beyond the fit are 0 with errors that bound what is left out.
    pub functions: Bounded,
    pub solved: LeastSquares,
}

impl Fitted {
    pub fn of(fit: &Fit<'_>, order: usize, active: &[bool]) -> Self {
        let functions = Bounded::of(fit, order);
        let basis = |place: Place, into: &mut Vec<f64>| functions.basis(place, into);
        let solved = LeastSquares::of(fit, active, functions.count(), &basis);
        Self { responses: fit.responses.clone(), fringe: fit.reduced.fringe(&fit.responses), functions, solved }
    }

    /// The functions in pixel i, orthonormal.
    pub fn at(&self, region: &Region, i: usize, b: &mut Vec<f64>, phi: &mut Vec<f64>) {
        self.functions.basis(region.place(i, self.fringe), b);
        self.solved.phi.at(b, phi);
    }

    /// The fit to response a where the functions are `phi`.
    pub fn value(&self, a: usize, phi: &[f64]) -> f64 {
        let (solved, place) = (&self.solved, a - self.responses.start);
        (0..self.functions.inside()).map(|k| phi[k] * solved.coefficients[k * solved.width + place]).sum()
    }
}

/// Fits of all orders.
pub struct Trial {
    pub solved: LeastSquares,
    /// The highest order.
    top: usize,
    /// What the orders up to each take off the squares of the errors, less what they add to them, in units of the noise of a function (Mallows).
    gains: Vec<f64>,
}

impl Trial {
    /// Up to `most` functions to the `active` pixels; `None` where these have no order 2.
    pub fn of(fit: &Fit<'_>, active: &[bool], most: usize) -> Option<Self> {
        let functions = fit.functions;
        let top = (2..).take_while(|&order| functions.terms(order) <= most).last()?;
        let basis = |place: Place, into: &mut Vec<f64>| functions.basis(place, top, into);
        let solved = LeastSquares::of(fit, active, functions.terms(top), &basis);
        let all = (1..=top).scan(0.0, |sum, order| {
            let (excess, count) = solved.excess(functions.terms(order - 1)..functions.terms(order));
            *sum += excess - count;
            Some(*sum)
        });
        let gains = std::iter::once(0.0).chain(all).collect();
        Some(Self { solved, top, gains })
    }

    /// The order to take: two more than that of which the error is expected to be least, so that what is left out is well below the noise: after many paths one more is off by as
    /// much, beside edges by twice that; `None` where there is none beyond to tell.
    pub fn order(&self) -> Option<usize> {
        let best = self.gains.iter().enumerate().fold(
            (0, 0.0),
            |best, (order, &gain)| {
                if gain > best.1 { (order, gain) } else { best }
            },
        );
        let order = best.0 + 2;
        (order < self.top).then_some(order)
    }

    /// What an order takes off the squares of all errors.
    pub fn gain(&self, order: usize) -> f64 {
        self.gains[order]
    }
}
