//! What a fit leaves of the responses, and where that is no noise.

use std::collections::BTreeSet;

use crate::blocks::{Blocks, Ring};
use crate::group_fits::{GroupFits, Trials};
use crate::misfit::{Misfit, Score};
use crate::parallel::each;

/// A block whose mean residual exceeds its standard error by this is not fitted. Of a thousand blocks of noise less than one in ten does.
const MOST_SCORE: f64 = 4.0;
/// The same of a whole ring along the edge, where misfits are to be expected.
const MOST_SCORE_OF_RING: f64 = 2.5;
/// In one go only blocks that are off by at least this part of the worst are given up: they pull at their neighbours.
const WORST: f64 = 0.5;
/// Tiles for each function of the fit, so that the fit does not take up what they could show.
const TILES_PER_TERM: usize = 4;
/// Pixels that one thread takes at a time.
const LINE: usize = 256;
/// A tile's variance is known from so few paths that it counts as no less than this part of what the fit leaves it.
const LEAST_LEFT: f64 = 0.1;

/// Of a trial of each group over the active pixels.
pub struct Residuals<'a> {
    fits: &'a GroupFits<'a>,
    trials: &'a Trials,
    /// The active pixels, and value less fit, `[active pixel][response]`.
    pixels: Vec<usize>,
    values: Vec<f64>,
    blocks: Blocks,
    /// Of each of the blocks, `[block][response]`.
    of_tiles: Vec<Vec<Score>>,
    of_larger: Vec<Vec<Score>>,
    of_rings: Vec<Vec<Score>>,
    of_quarters: Vec<Vec<Score>>,
}

impl<'a> Residuals<'a> {
    pub fn of(fits: &'a GroupFits<'a>, trials: &'a Trials, active: &[bool]) -> Self {
        let blocks = Blocks::of(fits.region, active, TILES_PER_TERM * fits.terms(trials));
        let pixels: Vec<usize> = (0..fits.region.len()).filter(|&i| active[i]).collect();
        let lines = each(fits.ctx, pixels.len().div_ceil(LINE), |line| {
            values(fits, trials, &pixels[line * LINE..pixels.len().min((line + 1) * LINE)])
        });
        let values: Vec<f64> = lines.concat();
        let scale = scale(fits, &pixels);
        let mut place = vec![0; active.len()];
        pixels.iter().enumerate().for_each(|(number, &i)| place[i] = number);
        let rings = |rings: &'_ [Ring]| rings.iter().map(|ring| ring.pixels.clone()).collect::<Vec<_>>();
        let scores = |blocks: &[Vec<usize>]| {
            each(fits.ctx, blocks.len(), |i| scores(fits, trials, &blocks[i], (&values, &place), &scale))
        };
        let (of_tiles, of_larger) = (scores(&blocks.tiles), scores(&blocks.larger));
        let (of_rings, of_quarters) = (scores(&rings(&blocks.rings)), scores(&rings(&blocks.quarters)));
        Self { fits, trials, pixels, values, blocks, of_tiles, of_larger, of_rings, of_quarters }
    }

    /// Blocks whose residuals are no noise, if they are among the worst.
    pub fn worst_blocks(&self) -> Vec<Vec<usize>> {
        let blocks = &self.blocks;
        let score = |scores: &Vec<Score>| most(scores).sqrt();
        let tiles = blocks.tiles.iter().zip(&self.of_tiles).chain(blocks.larger.iter().zip(&self.of_larger));
        let squares = tiles.map(|(block, scores)| (score(scores) / MOST_SCORE, block, false));
        // What is off at the edge is so up to there.
        let at_edge = |rings: &'_ [Ring], of: &[Vec<Score>], most: f64| -> Vec<(f64, usize)> {
            let own = rings.iter().zip(of).enumerate().filter(|(_, (ring, _))| ring.is_edge);
            own.map(|(number, (_, scores))| (score(scores) / most, number)).collect()
        };
        let quarters = at_edge(&blocks.quarters, &self.of_quarters, MOST_SCORE);
        let quarters = quarters.into_iter().map(|(score, number)| (score, &blocks.quarters[number].outside, true));
        let rings = at_edge(&blocks.rings, &self.of_rings, MOST_SCORE_OF_RING);
        let rings = rings.into_iter().map(|(score, number)| (score, &blocks.rings[number].outside, true));
        let scores: Vec<(f64, &Vec<usize>, bool)> = squares.chain(quarters).chain(rings).collect();
        let most = scores.iter().map(|s| s.0).fold(1.0, f64::max);
        let worst = scores.into_iter().filter(|s| s.0 > (WORST * most).max(1.0));
        worst.map(|(_, block, edge)| if edge { block.clone() } else { self.with_border(block) }).collect()
    }

    /// The tile that is off the most, and the pixels that touch it.
    pub fn worst_tile(&self) -> Vec<usize> {
        let worst =
            (0..self.of_tiles.len()).max_by(|&i, &j| most(&self.of_tiles[i]).total_cmp(&most(&self.of_tiles[j])));
        worst.map_or_else(Vec::new, |i| self.with_border(&self.blocks.tiles[i]))
    }

    /// What is left beyond noise over all tiles and over each ring along the edge; and the mean square of the scores of all tiles, of the response that has the most.
    pub fn misfits(&self) -> (Vec<Misfit>, f64) {
        let (groups, blocks) = (self.fits.reduced.groups(), &self.blocks);
        let (everywhere, chi2) = Misfit::of(groups.clone(), None, blocks.whole as f64, &self.of_tiles);
        let ring = |number: u32| {
            // Around the edge misfits may cancel, so its quarters are looked at, too.
            let of = |rings: &[Ring], scores: &[Vec<Score>]| {
                let own = || rings.iter().zip(scores).filter(|(ring, _)| ring.number == number);
                let pixels = own().map(|(ring, _)| ring.pixels.len()).sum::<usize>() as f64;
                let scores: Vec<&Vec<Score>> = own().map(|(_, scores)| scores).collect();
                Misfit::of(groups.clone(), Some(number), pixels / scores.len().max(1) as f64, &scores).0
            };
            of(&blocks.rings, &self.of_rings).or(of(&blocks.quarters, &self.of_quarters))
        };
        (std::iter::once(everywhere).chain(blocks.rings.iter().map(|r| ring(r.number))).collect(), chi2)
    }

    /// Squares of the residuals over what the paths say of them, per degree of freedom, of the response that has the most.
    pub fn chi2(&self) -> f64 {
        let (fits, count) = (self.fits, self.pixels.len() as f64);
        let of = |(a, terms): (usize, usize)| {
            let squares = |(number, &i): (usize, &usize)| {
                let off = self.values[number * fits.reduced.q + a];
                fits.weights[i] * off * off
            };
            let squares: f64 = self.pixels.iter().enumerate().map(squares).sum();
            let noise = self.pixels.iter().map(|&i| fits.weights[i] * fits.reduced.variance(i, a)).sum::<f64>();
            if noise > 0.0 { squares / (noise * (1.0 - terms as f64 / count)) } else { 1.0 }
        };
        let terms = fits.groups.iter().zip(self.trials).flat_map(|(fit, &(_, order))| {
            let terms = fit.functions.terms(order);
            fit.responses.clone().map(move |a| (a, terms))
        });
        terms.map(of).fold(0.0, f64::max)
    }

    /// A block and the active pixels that touch it: what is off does not end where a tile does.
    fn with_border(&self, block: &[usize]) -> Vec<usize> {
        let cells: BTreeSet<[usize; 2]> = block.iter().map(|&i| self.fits.region.cells[i]).collect();
        let touches = |i: &usize| {
            let [column, row] = self.fits.region.cells[*i];
            let around = |at: usize| at.saturating_sub(1)..=at + 1;
            around(column).any(|c| around(row).any(|r| cells.contains(&[c, r])))
        };
        self.pixels.iter().copied().filter(touches).collect()
    }
}

/// Of the response that is off the most.
fn most(scores: &[Score]) -> f64 {
    scores.iter().map(Score::squared).fold(0.0, f64::max)
}

/// Value less fit of some pixels, `[pixel][response]`.
fn values(fits: &GroupFits<'_>, trials: &Trials, pixels: &[usize]) -> Vec<f64> {
    let q = fits.reduced.q;
    let (mut values, mut b) = (vec![0.0; pixels.len() * q], Vec::new());
    for (fit, (trial, order)) in fits.groups.iter().zip(trials) {
        let terms = fit.functions.terms(*order);
        let coefficients: Vec<Vec<f64>> =
            (0..fit.responses.len()).map(|a| trial.solved.of_functions(a, terms)).collect();
        for (&i, values) in pixels.iter().zip(values.chunks_exact_mut(q)) {
            fit.functions.basis(fit.place(i), *order, &mut b);
            for (a, coefficients) in fit.responses.clone().zip(&coefficients) {
                let value: f64 = b.iter().zip(coefficients).map(|(b, c)| b * c).sum();
                values[a] = fits.reduced.value(i, a) - value;
            }
        }
    }
    values
}

/// Variance x weight of each response, over all `pixels`.
fn scale(fits: &GroupFits<'_>, pixels: &[usize]) -> Vec<f64> {
    let of =
        |a| pixels.iter().map(|&i| fits.weights[i] * fits.reduced.variance(i, a)).sum::<f64>() / pixels.len() as f64;
    (0..fits.reduced.q).map(of).collect()
}

/// Of each response over a block, by the residuals and where each pixel's are.
fn scores(
    fits: &GroupFits<'_>,
    trials: &Trials,
    block: &[usize],
    (residuals, place_of): (&[f64], &[usize]),
    scale: &[f64],
) -> Vec<Score> {
    let q = fits.reduced.q;
    let weight: f64 = block.iter().map(|&i| fits.weights[i]).sum();
    let parts: Vec<f64> = block.iter().map(|&i| fits.weights[i] / weight).collect();
    let (mut b, mut phi, mut scores) = (Vec::new(), Vec::new(), Vec::with_capacity(q));
    for (fit, (trial, order)) in fits.groups.iter().zip(trials) {
        let mut mean = vec![0.0; fit.functions.terms(*order)];
        for (&i, u) in block.iter().zip(&parts) {
            fit.functions.basis(fit.place(i), *order, &mut b);
            mean.iter_mut().zip(&b).for_each(|(sum, b)| *sum += u * b);
        }
        // What the fit has taken of the noise.
        trial.solved.phi.at(&mean, &mut phi);
        let taken: f64 = phi.iter().map(|p| p * p).sum();
        for a in fit.responses.clone() {
            let left = |variance: f64| (variance - scale[a] * taken).max(LEAST_LEFT * variance);
            let sampled = block.iter().zip(&parts).map(|(&i, u)| u * u * fits.reduced.variance(i, a)).sum();
            scores.push(Score {
                mean: block.iter().zip(&parts).map(|(&i, u)| u * residuals[place_of[i] * q + a]).sum(),
                sampled: left(sampled),
                expected: left(scale[a] / weight),
                weight,
            });
        }
    }
    scores
}
