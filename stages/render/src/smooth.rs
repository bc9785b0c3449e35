//! Reduced responses over a region as a smooth function of the places on its surface, where they are one.
//!
//! `docs/theory/render.md`, "Fit".

use std::collections::BTreeSet;

use crate::blocks::{Blocks, RINGS, Ring};
use crate::misfit::{Misfit, Score};
use crate::orthonormal::Orthonormal;
use crate::reduced::Reduced;
use crate::regions::{LEAST_PIXELS, Region};
use crate::trial::{Bounded, Fit, LeastSquares, Trial};
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
    /// Coefficients of those beyond the fit are 0 with errors that bound what is left out.
    functions: Bounded,
    phi: Orthonormal,
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

impl Smooth {
    /// `None` where the responses are no smooth function. `paths`: of each pixel; `inflation`: of standard errors, see [`crate::field::inflation`].
    pub fn of(region: &Region, reduced: &Reduced, paths: &[u32], inflation: f64) -> Option<Self> {
        let weights = weights(region, reduced, paths)?;
        let fit =
            Fit { region, reduced, weights, functions: region.chart.all_functions(), rest: None }.of_best_functions();
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
                return Some(fit.end(&trial, order, active, left.misfits, inflation));
            }
            active = rest;
        }
        None
    }

    /// Highest order of the functions of the fit.
    pub fn order(&self) -> usize {
        self.functions.order
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
        let m = self.functions.count();
        let mut sums = vec![0.0; self.q * m];
        let (mut b, mut phi, mut alone) = (Vec::new(), Vec::new(), 0.0);
        for i in (0..region.len()).filter(|&i| self.fitted[i]) {
            self.phi_at(region, i, &mut b, &mut phi);
            for (a, w) in weights(i) {
                sums[a * m..][..m].iter_mut().zip(&phi).for_each(|(sum, p)| *sum += w * p);
                let (variance, pixels) = self.misfit(region, i, a);
                alone += w * w * variance * pixels;
            }
        }
        let of = |a: usize, b: usize| self.between(a, b, &sums[a * m..][..m], &sums[b * m..][..m]);
        let shared: f64 = (0..self.q).flat_map(|a| (0..self.q).map(move |b| (a, b))).map(|(a, b)| of(a, b)).sum();
        shared.max(0.0) + alone
    }

    fn phi_at(&self, region: &Region, i: usize, b: &mut Vec<f64>, phi: &mut Vec<f64>) {
        self.functions.basis(region.places[i], b);
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
        let m = self.functions.count();
        let block = &self.errors[(a * self.q + b) * m * m..][..m * m];
        let rows = block.chunks_exact(m).zip(left);
        rows.map(|(row, l)| l * row.iter().zip(right).map(|(c, r)| c * r).sum::<f64>()).sum()
    }
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

    /// With the functions by which the expected error over all pixels is least, by the same rule by which orders are chosen.
    fn of_best_functions(mut self) -> Self {
        let (all, pixels) = (self.functions, vec![true; self.region.len()]);
        let (mut best, mut most, mut rest) = (all, 0.0, None);
        for functions in self.region.chart.functions() {
            self.functions = functions;
            let Some((trial, order)) = self.lowest(&pixels) else { continue };
            let gain = trial.gain(order);
            if functions == all {
                rest = Some(order);
            }
            if gain > most {
                (best, most) = (functions, gain);
            }
        }
        // Without an order of all functions that is enough nobody knows what is left out.
        self.functions = if rest.is_some() { best } else { all };
        self.rest = rest.filter(|_| self.functions != all);
        self
    }

    /// The pixels to begin with: without the rings along the edges that take functions from all others.
    ///
    /// By a fit of m functions to n pixels these gain n log(n / m) in the logarithms of their variances.
    fn start(&self) -> Vec<bool> {
        let gain = |active: &[bool]| {
            let (count, found) = (self.some(active).count() as f64, self.lowest(active));
            let terms = found.map(|(_, order)| self.functions.terms(order) as f64);
            terms.map_or(0.0, |terms| count * libm::log(count / terms))
        };
        let all = vec![true; self.region.len()];
        if Trial::of(self, &all, TERMS[0].min(all.len() / PER_TERM)).is_some_and(|trial| trial.order().is_some()) {
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
            let trial = Trial::of(self, active, most.min(count / PER_TERM))?;
            trial.order().map(|order| (trial, order))
        })
    }

    /// Blocks whose residuals are no noise, if they are among the worst.
    fn worst_blocks(&self, trial: &Trial, order: usize, active: &[bool]) -> Vec<Vec<usize>> {
        let terms = self.functions.terms(order);
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
        let (functions, q) = (self.functions, self.reduced.q);
        let (mut residuals, mut b, mut phi) = (vec![0.0; self.region.len() * q], Vec::new(), Vec::new());
        for i in self.some(active) {
            functions.basis(self.region.places[i], order, &mut b);
            trial.solved.phi.at(&b, &mut phi);
            for a in 0..q {
                let fit: f64 = phi.iter().enumerate().map(|(k, p)| p * trial.solved.coefficients[k * q + a]).sum();
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
        let (functions, q) = (self.functions, self.reduced.q);
        let weight: f64 = block.iter().map(|&i| self.weights[i]).sum();
        let (mut mean, mut sampled) = (vec![0.0; q], vec![0.0; q]);
        let (mut b, mut phi, mut along) = (Vec::new(), Vec::new(), vec![0.0; functions.terms(order)]);
        for &i in block {
            let u = self.weights[i] / weight;
            functions.basis(self.region.places[i], order, &mut b);
            trial.solved.phi.at(&b, &mut phi);
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
        let blocks = Blocks::of(self.region, active, TILES_PER_TERM * self.functions.terms(order));
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
    fn end(&self, trial: &Trial, order: usize, active: Vec<bool>, misfits: Vec<Misfit>, inflation: f64) -> Smooth {
        let q = self.reduced.q;
        let residuals = self.residuals(trial, order, &active);
        let chi2 = self.chi2(&residuals, &active, self.functions.terms(order));
        let functions = Bounded::of(self, order);
        let basis = |place: [f64; 2], into: &mut Vec<f64>| functions.basis(place, into);
        let solved = LeastSquares::of(self, &active, functions.count(), &basis);
        let errors = self.errors(&solved, functions, &active, inflation * inflation);
        let mut smooth = Smooth {
            q,
            functions,
            phi: solved.phi,
            chi2,
            fitted: active,
            errors,
            misfits,
            values: vec![0.0; self.region.len() * q],
            covariances: vec![0.0; self.region.len() * q * q],
        };
        self.fill(&mut smooth, &solved.coefficients);
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

    /// Covariances of coefficients; those beyond the fit are scaled by how much larger than their noise their squares are.
    fn errors(&self, solved: &LeastSquares, functions: Bounded, active: &[bool], inflation: f64) -> Vec<f64> {
        let (q, m) = (self.reduced.q, functions.count());
        let [next, rest] = functions.beyond();
        // Those of the fit, of the next order and of the rest are no errors of each other.
        let parts = [0..next.start, next, rest];
        let mut errors = vec![0.0; q * q * m * m];
        let (mut b, mut phi) = (Vec::new(), Vec::new());
        for i in self.some(active) {
            functions.basis(self.region.places[i], &mut b);
            solved.phi.at(&b, &mut phi);
            let square = self.weights[i] * self.weights[i];
            for (ab, &covariance) in self.reduced.covariances(i).iter().enumerate().filter(|(ab, _)| ab / q <= ab % q) {
                let block = &mut errors[ab * m * m..][..m * m];
                for (part, k) in parts.iter().flat_map(|part| part.clone().map(move |k| (part, k))) {
                    let weight = square * covariance * phi[k];
                    let row = &mut block[k * m..][part.start..=k];
                    row.iter_mut().zip(&phi[part.start..=k]).for_each(|(sum, p)| *sum += weight * p);
                }
            }
        }
        for (number, part) in parts.iter().enumerate() {
            let mut scales = vec![1.0; q];
            for group in self.reduced.groups().filter(|_| number > 0) {
                let (excess, count) = solved.excess(part.clone(), &group, q);
                group.for_each(|a| scales[a] = if count > 0.0 { (excess / count).max(0.0) } else { 0.0 });
            }
            for (a, b) in (0..q).flat_map(|a| (a..q).map(move |b| (a, b))) {
                let scale = inflation * (scales[a] * scales[b]).sqrt();
                for (k, l) in part.clone().flat_map(|k| (part.start..=k).map(move |l| (k, l))) {
                    let value = scale * errors[((a * q + b) * m + k) * m + l];
                    for (a, b) in [(a, b), (b, a)] {
                        errors[((a * q + b) * m + k) * m + l] = value;
                        errors[((a * q + b) * m + l) * m + k] = value;
                    }
                }
            }
        }
        errors
    }

    /// Values and covariances of all pixels that are fitted.
    fn fill(&self, smooth: &mut Smooth, coefficients: &[f64]) {
        let (q, inside) = (self.reduced.q, smooth.functions.inside());
        let (mut b, mut phi) = (Vec::new(), Vec::new());
        for i in 0..self.region.len() {
            if !smooth.fitted[i] {
                continue;
            }
            smooth.phi_at(self.region, i, &mut b, &mut phi);
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

#[cfg(test)]
mod tests;
