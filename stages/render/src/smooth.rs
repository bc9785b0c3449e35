//! Reduced responses over a region as a smooth function of the places on its surface, where they are one.
//!
//! `docs/theory/render.md`, "Fit".

use std::collections::BTreeSet;

use crate::blocks::{Blocks, RINGS, Ring};
use crate::misfit::{Misfit, Score};
use crate::orthonormal::Orthonormal;
use crate::reduced::Reduced;
use crate::regions::{LEAST_PIXELS, Region};
use crate::variance_model::weights;

/// So many functions are tried, and more where that is not enough; there are [`PER_TERM`] pixels for each.
const TERMS: [usize; 4] = [36, 66, 144, 256];
const PER_TERM: usize = 4;
/// A block whose mean residual exceeds its standard error by this is not fitted. Of a thousand blocks of noise less than one in ten does.
const MOST_SCORE: f64 = 4.0;
/// The same of a whole ring along the edge, where misfits are to be expected.
const MOST_SCORE_OF_RING: f64 = 2.5;
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
    /// What is left over all tiles, and over each ring along the edge.
    misfits: Vec<Misfit>,
    /// `[pixel][response]` and `[pixel][response][response]`; zeros where it is not fitted.
    values: Vec<f64>,
    covariances: Vec<f64>,
}

/// What a trial leaves beyond noise.
struct Left {
    misfits: Vec<Misfit>,
    /// Mean square of the scores of all tiles, of the response that has the most.
    chi2: f64,
    /// The tile that is off the most.
    worst: Vec<usize>,
}

/// A fit to the active pixels.
struct Trial {
    phi: Orthonormal,
    top: usize,
    /// `[term][response]`.
    coefficients: Vec<f64>,
    /// The order by which the expected error is least.
    needed: usize,
}

impl Smooth {
    /// `None` where the responses are no smooth function. `paths`: of each pixel; `inflation`: of standard errors, see [`crate::field::inflation`].
    pub fn of(region: &Region, reduced: &Reduced, paths: &[u32], inflation: f64) -> Option<Self> {
        let weights = weights(region, reduced, paths)?;
        let fit = Fit { region, reduced, weights };
        let mut active = fit.start();
        for round in 1..=ROUNDS {
            if !fit.is_enough(&active) {
                return None;
            }
            let (trial, order) = fit.lowest(&active)?;
            let left = fit.left(&trial, order, &active);
            let is_smooth = left.chi2 <= MOST_CHI2;
            let mut worst = fit.worst_blocks(&trial, order, &active);
            if worst.is_empty() && !is_smooth {
                // No block is off by itself, but all together are.
                worst.push(left.worst);
            }
            let mut rest = active.clone();
            worst.iter().flatten().for_each(|&i| rest[i] = false);
            // What cannot be given up, for too little would stay, is in the errors as a misfit.
            let is_last = round == ROUNDS || !fit.is_enough(&rest);
            if is_smooth && (worst.is_empty() || is_last) {
                return Some(fit.end(trial, order, active, left.misfits, inflation));
            }
            active = rest;
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
                let (variance, pixels) = self.misfit(region, i, a);
                alone += w * w * variance * pixels;
            }
        }
        let m = self.terms;
        let of = |a: usize, b: usize| self.between(a, b, &sums[a * m..][..m], &sums[b * m..][..m]);
        let shared: f64 = (0..self.q).flat_map(|a| (0..self.q).map(move |b| (a, b))).map(|(a, b)| of(a, b)).sum();
        shared.max(0.0) + alone
    }

    fn functions(&self, region: &Region, i: usize, b: &mut Vec<f64>, phi: &mut Vec<f64>) {
        region.chart.basis(region.places[i], self.order + 1, b);
        self.phi.at(b, phi);
    }

    /// What is left of response a in a pixel, and how many pixels share it: the largest of all that it has a part in, which see one misfit.
    fn misfit(&self, region: &Region, i: usize, a: usize) -> (f64, f64) {
        let ring = region.rings[i];
        let own = self.misfits.iter().filter(|misfit| misfit.ring.is_none_or(|r| r == ring));
        own.map(|m| (m.variances[a], m.pixels)).fold((0.0, 1.0), |most, this| if this.0 > most.0 { this } else { most })
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
    /// Two more than are needed, so that what is left out is well below the noise: after many paths one more is off by as much, beside edges by twice that; `None` where there is none beyond to tell.
    fn order(&self) -> Option<usize> {
        let order = (self.needed + 2).max(2);
        (order < self.top).then_some(order)
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

    /// Whether there are pixels enough for a fit to stand for the region.
    fn is_enough(&self, active: &[bool]) -> bool {
        let count = self.some(active).count();
        count >= LEAST_PIXELS && count as f64 >= LEAST_PART * self.region.len() as f64
    }

    /// The pixels to begin with: without the rings along the edges that take functions from all others.
    ///
    /// By a fit of m functions to n pixels these gain n log(n / m) in the logarithms of their variances.
    fn start(&self) -> Vec<bool> {
        let gain = |active: &[bool]| {
            let (count, found) = (self.some(active).count() as f64, self.lowest(active));
            let terms = found.map(|(_, order)| self.region.chart.terms(order) as f64);
            terms.map_or(0.0, |terms| count * libm::log(count / terms))
        };
        let all = vec![true; self.region.len()];
        if self.trial(&all, TERMS[0].min(all.len() / PER_TERM)).is_some_and(|trial| trial.order().is_some()) {
            return all;
        }
        let mut best = (gain(&all), all);
        for edge in 1..=RINGS {
            let inside: Vec<bool> = self.region.rings.iter().map(|&ring| ring >= edge).collect();
            if !self.is_enough(&inside) {
                break;
            }
            let gain = gain(&inside);
            if gain > best.0 {
                best = (gain, inside);
            }
        }
        best.1
    }

    /// The first trial that has functions enough, and its order.
    fn lowest(&self, active: &[bool]) -> Option<(Trial, usize)> {
        let count = self.some(active).count();
        TERMS.into_iter().find_map(|most| {
            let trial = self.trial(active, most.min(count / PER_TERM))?;
            trial.order().map(|order| (trial, order))
        })
    }

    /// Least squares of all orders up to `most` functions.
    fn trial(&self, active: &[bool], most: usize) -> Option<Trial> {
        let (chart, q) = (self.region.chart, self.reduced.q);
        let top = (2..).take_while(|&order| chart.terms(order) <= most).last()?;
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
        let needed = self.reduced.groups().map(|group| {
            let terms = |order: usize| (chart.terms(order - 1)..chart.terms(order)).filter(|&k| phi.is_new(k));
            let gain = |order: usize| {
                let (excess, count) = excess(terms(order), &group, &coefficients, &variances, q);
                excess - count
            };
            // Mallows: the squares that an order takes away, less twice the noise that it brings.
            let gains = (1..=top).scan(0.0, |sum, order| {
                *sum += gain(order);
                Some((*sum, order))
            });
            gains.fold((0.0, 0), |best, this| if this.0 > best.0 { this } else { best }).1
        });
        let needed = needed.max();
        Some(Trial { phi, top, coefficients, needed: needed.unwrap_or(0) })
    }

    /// Blocks whose residuals are no noise, if they are among the worst.
    fn worst_blocks(&self, trial: &Trial, order: usize, active: &[bool]) -> Vec<Vec<usize>> {
        let terms = self.region.chart.terms(order);
        let blocks = Blocks::of(self.region, active, TILES_PER_TERM * terms);
        let residuals = self.residuals(trial, order, active);
        let scale = self.scale(active);
        let score = |block: &Vec<usize>| {
            let scores = self.scores(trial, order, block, &residuals, &scale);
            scores.iter().map(Score::squared).fold(0.0, f64::max).sqrt()
        };
        let squares = blocks.tiles.iter().chain(&blocks.larger).map(|block| (score(block) / MOST_SCORE, block, false));
        // What is off at the edge is so up to there.
        let quarters = blocks
            .quarters
            .iter()
            .filter(|ring| ring.is_edge)
            .map(|ring| (score(&ring.pixels) / MOST_SCORE, &ring.outside, true));
        let rings = blocks
            .rings
            .iter()
            .filter(|ring| ring.is_edge)
            .map(|ring| (score(&ring.pixels) / MOST_SCORE_OF_RING, &ring.outside, true));
        let scores: Vec<(f64, &Vec<usize>, bool)> = squares.chain(quarters).chain(rings).collect();
        let most = scores.iter().map(|s| s.0).fold(1.0, f64::max);
        let worst = scores.into_iter().filter(|s| s.0 > (WORST * most).max(1.0));
        worst.map(|(_, block, edge)| if edge { block.clone() } else { self.with_border(block, active) }).collect()
    }

    /// A block and the active pixels that touch it: what is off does not end where a tile does.
    fn with_border(&self, block: &[usize], active: &[bool]) -> Vec<usize> {
        let cells: BTreeSet<[usize; 2]> = block.iter().map(|&i| self.region.cells[i]).collect();
        let touches = |i: &usize| {
            let [column, row] = self.region.cells[*i];
            let around = |at: usize| at.saturating_sub(1)..=at + 1;
            around(column).any(|c| around(row).any(|r| cells.contains(&[c, r])))
        };
        self.some(active).filter(touches).collect()
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

    /// What the residuals of a trial say beyond noise.
    fn left(&self, trial: &Trial, order: usize, active: &[bool]) -> Left {
        let blocks = Blocks::of(self.region, active, TILES_PER_TERM * self.region.chart.terms(order));
        let (residuals, scale) = (self.residuals(trial, order, active), self.scale(active));
        let scores = |block: &Vec<usize>| self.scores(trial, order, block, &residuals, &scale);
        let tiles: Vec<Vec<Score>> = blocks.tiles.iter().map(scores).collect();
        let most = |scores: &Vec<Score>| scores.iter().map(Score::squared).fold(0.0, f64::max);
        let worst = (0..tiles.len()).max_by(|&i, &j| most(&tiles[i]).total_cmp(&most(&tiles[j])));
        let worst = worst.map_or_else(Vec::new, |i| self.with_border(&blocks.tiles[i], active));
        let (everywhere, chi2) = Misfit::of(self.reduced.groups(), None, blocks.whole as f64, &tiles);
        let ring = |number: u32| {
            // Around the edge misfits may cancel, so its quarters are looked at, too.
            let of = |rings: &[Ring]| {
                let rings: Vec<&Ring> = rings.iter().filter(|ring| ring.number == number).collect();
                let pixels =
                    rings.iter().map(|ring| ring.pixels.len()).sum::<usize>() as f64 / rings.len().max(1) as f64;
                let scores: Vec<Vec<Score>> = rings.iter().map(|ring| scores(&ring.pixels)).collect();
                Misfit::of(self.reduced.groups(), Some(number), pixels, &scores).0
            };
            of(&blocks.rings).or(of(&blocks.quarters))
        };
        let misfits = std::iter::once(everywhere).chain(blocks.rings.iter().map(|r| ring(r.number))).collect();
        Left { misfits, chi2, worst }
    }

    /// Of the last trial.
    fn end(&self, trial: Trial, order: usize, active: Vec<bool>, misfits: Vec<Misfit>, inflation: f64) -> Smooth {
        let (chart, q) = (self.region.chart, self.reduced.q);
        let residuals = self.residuals(&trial, order, &active);
        let chi2 = self.chi2(&residuals, &active, chart.terms(order));
        let terms = chart.terms(order + 1);
        let errors = self.errors(&trial, order, terms, &active, inflation * inflation);
        let mut smooth = Smooth {
            q,
            terms,
            phi: trial.phi,
            order,
            chi2,
            fitted: active,
            errors,
            misfits,
            values: vec![0.0; self.region.len() * q],
            covariances: vec![0.0; self.region.len() * q * q],
        };
        self.fill(&mut smooth, &trial.coefficients);
        smooth
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
            chart.basis(self.region.places[i], order + 1, &mut b);
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
        for group in self.reduced.groups() {
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
                    let own = if a == other { smooth.misfit(self.region, i, a).0 } else { 0.0 };
                    let covariance = smooth.between(a, other, &phi, &phi) + own;
                    smooth.covariances[(i * q + a) * q + other] = covariance;
                    smooth.covariances[(i * q + other) * q + a] = covariance;
                }
            }
        }
    }
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
