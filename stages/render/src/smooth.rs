//! Reduced responses over a region as a smooth function of the places on its surface, where they are one.
//!
//! `docs/theory/render.md`, "Fit".

use crate::blocks::Blocks;
use crate::orthonormal::Orthonormal;
use crate::reduced::Reduced;
use crate::regions::{LEAST_PIXELS, Region};
use crate::variance_model::weights;

/// The highest order that is tried; there are [`PER_TERM`] pixels for each function.
const MOST_ORDER: usize = 9;
const PER_TERM: usize = 6;
/// An order is needed if its terms are larger than their noise by this many standard deviations of the noise's square.
const SIGNIFICANT: f64 = 3.0;
/// A block whose mean residual exceeds its standard error by this is not fitted. Of a thousand blocks of noise less than one in ten does.
const MOST_SCORE: f64 = 4.0;
/// In one go only blocks that are off by at least this part of the worst are given up: they pull at their neighbours.
const WORST: f64 = 0.5;
/// Rounds in which blocks are given up; what has misfits after that, or less than [`LEAST_PART`] of its pixels left, is not smooth.
const ROUNDS: usize = 8;
const LEAST_PART: f64 = 0.5;
/// Mean square of the scores of all blocks beyond which a region is not smooth.
const MOST_CHI2: f64 = 2.0;
/// Tiles for each function of the fit, so that the fit does not take up what they could show.
const TILES_PER_TERM: usize = 4;
/// A tile's variance is known from so few paths that it counts as no less than this part of what the fit leaves it.
const LEAST_LEFT: f64 = 0.1;

/// One channel over a region: response = gain x (carrier) x sum over k of coefficient_k phi_k(place).
pub struct Smooth {
    q: usize,
    /// Functions: those of the fit, then those of the next order, whose coefficients are 0 with errors that bound what is left out.
    terms: usize,
    phi: Orthonormal,
    /// Highest order of the functions of the fit.
    pub order: usize,
    /// Of the residuals over all pixels that are fitted, per degree of freedom.
    pub chi2: f64,
    /// For each pixel of the region whether it is.
    pub fitted: Vec<bool>,
    /// `[response][response][term][term]`.
    errors: Vec<f64>,
    /// Variance of what is left of each reduced response in a block beyond noise, and the pixels of a block.
    misfit: Vec<f64>,
    block: f64,
    /// `[pixel][response]` and `[pixel][response][response]`; zeros where it is not fitted.
    values: Vec<f64>,
    covariances: Vec<f64>,
}

/// A fit to the active pixels.
struct Trial {
    phi: Orthonormal,
    top: usize,
    /// `[term][response]`.
    coefficients: Vec<f64>,
    /// Highest order that is needed.
    needed: usize,
}

/// The mean residual of a response in a block.
struct Score {
    mean: f64,
    /// As the paths of the block say, and as those of the whole region do.
    sampled: f64,
    expected: f64,
    weight: f64,
}

impl Smooth {
    /// `None` where the responses are no smooth function. `paths`: of each pixel; `inflation`: of standard errors, see [`crate::field::inflation`].
    pub fn of(region: &Region, reduced: &Reduced, paths: &[u32], inflation: f64) -> Option<Self> {
        let weights = weights(region, reduced, paths)?;
        let fit = Fit { region, reduced, weights };
        let mut active = vec![true; region.len()];
        for _ in 0..ROUNDS {
            let count = active.iter().filter(|&&a| a).count();
            if count < LEAST_PIXELS || (count as f64) < LEAST_PART * region.len() as f64 {
                return None;
            }
            let trial = fit.trial(&active)?;
            let order = trial.order()?;
            let worst = fit.worst_blocks(&trial, order, &active);
            if worst.is_empty() {
                return fit.end(trial, order, active, inflation);
            }
            worst.into_iter().flatten().for_each(|i| active[i] = false);
        }
        None
    }

    /// Reduced response a of a pixel of the region that is fitted.
    pub fn value(&self, i: usize, a: usize) -> f64 {
        self.values[i * self.q + a]
    }

    pub fn covariance(&self, i: usize, a: usize, b: usize) -> f64 {
        self.covariances[(i * self.q + a) * self.q + b]
    }

    /// Variance of the sum over the fitted pixels of weight x reduced response, by `weights` of pixel i.
    pub fn variance_of_sum(&self, region: &Region, weights: &dyn Fn(usize) -> Vec<(usize, f64)>) -> f64 {
        // Weight of every coefficient in the sum, `[response][term]`.
        let mut sums = vec![0.0; self.q * self.terms];
        let (mut b, mut phi, mut alone) = (Vec::new(), Vec::new(), 0.0);
        for i in (0..region.len()).filter(|&i| self.fitted[i]) {
            self.functions(region, i, &mut b, &mut phi);
            for (a, w) in weights(i) {
                sums[a * self.terms..][..self.terms].iter_mut().zip(&phi).for_each(|(sum, p)| *sum += w * p);
                alone += w * w * self.misfit[a] * self.block;
            }
        }
        let m = self.terms;
        let of = |a: usize, b: usize| self.between(a, b, &sums[a * m..][..m], &sums[b * m..][..m]);
        let shared: f64 = (0..self.q).flat_map(|a| (0..self.q).map(move |b| (a, b))).map(|(a, b)| of(a, b)).sum();
        shared.max(0.0) + alone
    }

    fn functions(&self, region: &Region, i: usize, b: &mut Vec<f64>, phi: &mut Vec<f64>) {
        let order = if self.terms > region.chart.terms(self.order) { self.order + 1 } else { self.order };
        region.chart.basis(region.places[i], order, b);
        self.phi.at(b, phi);
    }

    /// Covariance of two sums of weight x coefficient.
    fn between(&self, a: usize, b: usize, left: &[f64], right: &[f64]) -> f64 {
        let m = self.terms;
        let block = &self.errors[(a * self.q + b) * m * m..][..m * m];
        let rows = block.chunks_exact(m).zip(left);
        rows.map(|(row, l)| l * row.iter().zip(right).map(|(c, r)| c * r).sum::<f64>()).sum()
    }
}

impl Trial {
    /// One more than is needed, so that what is left out is less than the noise; `None` where the highest that there is would not do.
    fn order(&self) -> Option<usize> {
        (self.needed < self.top).then(|| (self.needed + 1).max(2))
    }
}

/// What is fitted to what.
struct Fit<'a> {
    region: &'a Region,
    reduced: &'a Reduced,
    /// 1 / variance of the response to 1, as it is expected.
    weights: Vec<f64>,
}

impl Fit<'_> {
    fn some(&self, active: &[bool]) -> impl Iterator<Item = usize> + Clone {
        (0..self.region.len()).filter(|&i| active[i])
    }

    /// Least squares of all orders that the pixels hold.
    fn trial(&self, active: &[bool]) -> Option<Trial> {
        let (chart, q) = (self.region.chart, self.reduced.q);
        let count = self.some(active).count();
        let top = (2..=MOST_ORDER).take_while(|&order| PER_TERM * chart.terms(order) <= count).last()?;
        let m = chart.terms(top);
        let (mut b, mut gram) = (Vec::new(), vec![0.0; m * m]);
        for i in self.some(active) {
            chart.basis(self.region.places[i], top, &mut b);
            for (k, row) in gram.chunks_exact_mut(m).enumerate() {
                let wb = self.weights[i] * b[k];
                row[..=k].iter_mut().zip(&b).for_each(|(sum, b)| *sum += wb * b);
            }
        }
        (0..m).for_each(|k| (0..k).for_each(|l| gram[l * m + k] = gram[k * m + l]));
        let phi = Orthonormal::of(&gram, m);
        let (mut coefficients, mut variances, mut values) = (vec![0.0; m * q], vec![0.0; m * q], Vec::new());
        for i in self.some(active) {
            chart.basis(self.region.places[i], top, &mut b);
            phi.at(&b, &mut values);
            for (k, value) in values.iter().enumerate() {
                let weight = self.weights[i] * value;
                for a in 0..q {
                    coefficients[k * q + a] += weight * self.reduced.value(i, a);
                    variances[k * q + a] += weight * weight * self.reduced.variance(i, a);
                }
            }
        }
        let needed = (1..=top).rev().find(|&order| {
            let terms = || (chart.terms(order - 1)..chart.terms(order)).filter(|&k| phi.is_new(k));
            groups(q).any(|group| {
                let (excess, count) = excess(terms(), &group, &coefficients, &variances, q);
                excess > SIGNIFICANT * (2.0 * count).sqrt()
            })
        });
        Some(Trial { phi, top, coefficients, needed: needed.unwrap_or(0) })
    }

    /// Blocks whose residuals are no noise, if they are among the worst.
    fn worst_blocks(&self, trial: &Trial, order: usize, active: &[bool]) -> Vec<Vec<usize>> {
        let terms = self.region.chart.terms(order);
        let blocks = Blocks::of(self.region, active, TILES_PER_TERM * terms);
        let residuals = self.residuals(trial, order, active);
        let scale = self.scale(active);
        let score = |block: &Vec<usize>| {
            let of = |s: Score| s.mean.abs() / s.sampled.max(s.expected).sqrt();
            let scores = self.scores(trial, order, block, &residuals, &scale);
            scores.into_iter().map(of).filter(|z| z.is_finite()).fold(0.0, f64::max)
        };
        let scores: Vec<(f64, &Vec<usize>)> = blocks.all().map(|block| (score(block), block)).collect();
        let most = scores.iter().map(|s| s.0).fold(0.0, f64::max);
        let given_up = |z: f64| z > MOST_SCORE.max(WORST * most);
        scores.into_iter().filter(|s| given_up(s.0)).map(|s| s.1.clone()).collect()
    }

    /// Value less fit, `[pixel][response]`.
    fn residuals(&self, trial: &Trial, order: usize, active: &[bool]) -> Vec<f64> {
        let (chart, q) = (self.region.chart, self.reduced.q);
        let (mut residuals, mut b, mut phi) = (vec![0.0; self.region.len() * q], Vec::new(), Vec::new());
        for i in self.some(active) {
            chart.basis(self.region.places[i], order, &mut b);
            trial.phi.at(&b, &mut phi);
            for a in 0..q {
                let fit: f64 = phi.iter().enumerate().map(|(k, p)| p * trial.coefficients[k * q + a]).sum();
                residuals[i * q + a] = self.reduced.value(i, a) - fit;
            }
        }
        residuals
    }

    /// Variance x weight of each response, over all pixels.
    fn scale(&self, active: &[bool]) -> Vec<f64> {
        let count = self.some(active).count() as f64;
        let of = |a| self.some(active).map(|i| self.weights[i] * self.reduced.variance(i, a)).sum::<f64>() / count;
        (0..self.reduced.q).map(of).collect()
    }

    /// Of each response.
    fn scores(&self, trial: &Trial, order: usize, block: &[usize], residuals: &[f64], scale: &[f64]) -> Vec<Score> {
        let (chart, q) = (self.region.chart, self.reduced.q);
        let weight: f64 = block.iter().map(|&i| self.weights[i]).sum();
        let (mut mean, mut sampled) = (vec![0.0; q], vec![0.0; q]);
        let (mut b, mut phi, mut along) = (Vec::new(), Vec::new(), vec![0.0; chart.terms(order)]);
        for &i in block {
            let u = self.weights[i] / weight;
            chart.basis(self.region.places[i], order, &mut b);
            trial.phi.at(&b, &mut phi);
            along.iter_mut().zip(&phi).for_each(|(sum, p)| *sum += u * p);
            for a in 0..q {
                mean[a] += u * residuals[i * q + a];
                sampled[a] += u * u * self.reduced.variance(i, a);
            }
        }
        // What the fit has taken of the noise.
        let taken: f64 = along.iter().map(|p| p * p).sum();
        let left = |a: usize, variance: f64| (variance - scale[a] * taken).max(LEAST_LEFT * variance);
        let of = |a: usize| Score {
            mean: mean[a],
            sampled: left(a, sampled[a]),
            expected: left(a, scale[a] / weight),
            weight,
        };
        (0..q).map(of).collect()
    }

    /// Of the last trial; `None` where misfits of all blocks together are too large.
    fn end(&self, trial: Trial, order: usize, active: Vec<bool>, inflation: f64) -> Option<Smooth> {
        let (chart, q) = (self.region.chart, self.reduced.q);
        let blocks = Blocks::of(self.region, &active, TILES_PER_TERM * chart.terms(order));
        let (residuals, scale) = (self.residuals(&trial, order, &active), self.scale(&active));
        let tiles = blocks.tiles.iter();
        let scores: Vec<Vec<Score>> = tiles.map(|tile| self.scores(&trial, order, tile, &residuals, &scale)).collect();
        let mut misfit = vec![0.0; q];
        for group in groups(q) {
            let of = || scores.iter().flat_map(|scores| group.clone().map(move |a| &scores[a]));
            let (squares, noise) = (of().map(|s| s.mean * s.mean), of().map(|s| s.sampled));
            let weighted = |values: &mut dyn Iterator<Item = f64>| -> f64 {
                values.zip(of()).map(|(value, s)| s.weight * value).sum()
            };
            let (squares, noise) = (weighted(&mut squares.into_iter()), weighted(&mut noise.into_iter()));
            if squares > MOST_CHI2 * noise && noise > 0.0 {
                return None;
            }
            let weight: f64 = of().map(|s| s.weight).sum();
            let excess = if weight > 0.0 { ((squares - noise) / weight).max(0.0) } else { 0.0 };
            group.for_each(|a| misfit[a] = excess);
        }
        let chi2 = self.chi2(&residuals, &active, chart.terms(order));
        let next = order < trial.top;
        let terms = chart.terms(if next { order + 1 } else { order });
        let errors = self.errors(&trial, order, terms, &active, inflation * inflation);
        let mut smooth = Smooth {
            q,
            terms,
            phi: trial.phi,
            order,
            chi2,
            fitted: active,
            errors,
            misfit,
            block: blocks.whole as f64,
            values: vec![0.0; self.region.len() * q],
            covariances: vec![0.0; self.region.len() * q * q],
        };
        self.fill(&mut smooth, &trial.coefficients);
        Some(smooth)
    }

    /// Squares of the residuals over what the paths say of them.
    fn chi2(&self, residuals: &[f64], active: &[bool], terms: usize) -> f64 {
        let (q, count) = (self.reduced.q, self.some(active).count() as f64);
        let of = |a: usize| {
            let squares = self.some(active).map(|i| self.weights[i] * residuals[i * q + a] * residuals[i * q + a]);
            let noise = self.some(active).map(|i| self.weights[i] * self.reduced.variance(i, a)).sum::<f64>();
            if noise > 0.0 { squares.sum::<f64>() / (noise * (1.0 - terms as f64 / count)) } else { 1.0 }
        };
        (0..q).map(of).fold(0.0, f64::max)
    }

    /// Covariances of coefficients; those of the next order are scaled by how much larger than their noise their squares are.
    fn errors(&self, trial: &Trial, order: usize, terms: usize, active: &[bool], inflation: f64) -> Vec<f64> {
        let (chart, q) = (self.region.chart, self.reduced.q);
        let inside = chart.terms(order);
        let mut errors = vec![0.0; q * q * terms * terms];
        let (mut b, mut phi) = (Vec::new(), Vec::new());
        for i in self.some(active) {
            chart.basis(self.region.places[i], if terms > inside { order + 1 } else { order }, &mut b);
            trial.phi.at(&b, &mut phi);
            let square = self.weights[i] * self.weights[i];
            for (ab, &covariance) in self.reduced.covariances(i).iter().enumerate().filter(|(ab, _)| ab / q <= ab % q) {
                let block = &mut errors[ab * terms * terms..][..terms * terms];
                for (k, row) in block.chunks_exact_mut(terms).enumerate() {
                    let weight = square * covariance * phi[k];
                    // Terms of the fit and those of the next order are no errors of each other.
                    let (from, to) = if k < inside { (0, k + 1) } else { (inside, k + 1) };
                    row[from..to].iter_mut().zip(&phi[from..to]).for_each(|(sum, p)| *sum += weight * p);
                }
            }
        }
        let variances: Vec<f64> = (0..terms)
            .flat_map(|k| (0..q).map(move |a| (k, a)))
            .map(|(k, a)| errors[((a * q + a) * terms + k) * terms + k])
            .collect();
        let mut beyond = vec![0.0; q];
        for group in groups(q) {
            let next = (inside..terms).filter(|&k| trial.phi.is_new(k));
            let (excess, count) = excess(next, &group, &trial.coefficients, &variances, q);
            group.for_each(|a| beyond[a] = if count > 0.0 { (excess / count).max(0.0) } else { 0.0 });
        }
        for (a, b) in (0..q).flat_map(|a| (a..q).map(move |b| (a, b))) {
            for (k, l) in (0..terms).flat_map(|k| (0..=k).map(move |l| (k, l))) {
                let scale = if k < inside { 1.0 } else { (beyond[a] * beyond[b]).sqrt() };
                let value = inflation * scale * errors[((a * q + b) * terms + k) * terms + l];
                for (a, b) in [(a, b), (b, a)] {
                    errors[((a * q + b) * terms + k) * terms + l] = value;
                    errors[((a * q + b) * terms + l) * terms + k] = value;
                }
            }
        }
        errors
    }

    /// Values and covariances of all pixels that are fitted.
    fn fill(&self, smooth: &mut Smooth, coefficients: &[f64]) {
        let (q, inside) = (self.reduced.q, self.region.chart.terms(smooth.order));
        let (mut b, mut phi) = (Vec::new(), Vec::new());
        for i in 0..self.region.len() {
            if !smooth.fitted[i] {
                continue;
            }
            smooth.functions(self.region, i, &mut b, &mut phi);
            for a in 0..q {
                smooth.values[i * q + a] = (0..inside).map(|k| phi[k] * coefficients[k * q + a]).sum();
                for other in a..q {
                    let own = if a == other { smooth.misfit[a] } else { 0.0 };
                    let covariance = smooth.between(a, other, &phi, &phi) + own;
                    smooth.covariances[(i * q + a) * q + other] = covariance;
                    smooth.covariances[(i * q + other) * q + a] = covariance;
                }
            }
        }
    }
}

/// Responses that are alike: that to 1; re and im of each carrier.
fn groups(q: usize) -> impl Iterator<Item = std::ops::Range<usize>> {
    std::iter::once(0..1).chain((1..q).step_by(2).map(|a| a..a + 2))
}

/// By how much sum of (coefficient / standard error)^2 over terms and the responses of a group exceeds their number, and that number.
fn excess(
    terms: impl Iterator<Item = usize>,
    group: &std::ops::Range<usize>,
    coefficients: &[f64],
    variances: &[f64],
    q: usize,
) -> (f64, f64) {
    let each = terms.flat_map(|k| group.clone().map(move |a| k * q + a)).filter(|&ka| variances[ka] > 0.0);
    each.fold((0.0, 0.0), |(sum, count), ka| {
        (sum + coefficients[ka] * coefficients[ka] / variances[ka] - 1.0, count + 1.0)
    })
}

#[cfg(test)]
mod tests;
