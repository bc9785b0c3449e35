//! Covariances of the coefficients of a fit, and of what it leaves out.

use std::ops::Range;

use crate::reduced::Reduced;
use crate::regions::Region;
use crate::trial::Fitted;

/// So many pixels at a time: each number of the errors is read once for all of them.
pub const ABREAST: usize = 8;

/// Of the responses a <= b, `[term of a][term of b]`.
struct Block {
    values: Vec<f64>,
    /// How many terms b has.
    width: usize,
    /// Those of the fit, of the next order and of the rest, but for those that are 0: they are no errors of each other.
    parts: Vec<[Range<usize>; 2]>,
}

pub struct Errors {
    q: usize,
    /// `[response][response]`; `None` where b < a.
    blocks: Vec<Option<Block>>,
}

impl Errors {
    /// Of what is fitted to some `pixels`, by the sampled covariances of their responses times `inflation`; those beyond the fit are scaled by how much larger than their
    /// noise their squares are.
    pub fn of(
        (region, reduced, weights): (&Region, &Reduced, &[f64]),
        groups: &[Fitted],
        pixels: &[usize],
        inflation: f64,
    ) -> Self {
        let q = reduced.q;
        let group = |a: usize| groups.iter().position(|g| g.responses.contains(&a)).expect("each response has a group");
        // `[group][part]`.
        let scale = |fitted: &Fitted| {
            let [_, next, rest] = fitted.functions.parts();
            let excess = |part: Range<usize>| match fitted.solved.excess(part) {
                (excess, count) if count > 0.0 => (excess / count).max(0.0),
                _ => 0.0,
            };
            [1.0, excess(next), excess(rest)]
        };
        let scales: Vec<[f64; 3]> = groups.iter().map(scale).collect();
        let of = |(a, b): (usize, usize)| {
            let (left, right) = (group(a), group(b));
            let parts = groups[left].functions.parts().into_iter().zip(groups[right].functions.parts());
            let scales = scales[left].into_iter().zip(scales[right]).map(|(l, r)| (l * r).sqrt());
            let parts = parts.zip(scales).filter(|&(_, scale)| scale > 0.0);
            let (parts, scales): (Vec<[Range<usize>; 2]>, Vec<f64>) = parts.map(|((l, r), s)| ([l, r], s)).unzip();
            let [rows, width] = [left, right].map(|group| groups[group].functions.count());
            let block = Block { values: vec![0.0; rows * width], width, parts };
            (block, [left, right], scales)
        };
        let pairs = (0..q).flat_map(|a| (a..q).map(move |b| (a, b)));
        let mut blocks: Vec<_> = pairs.clone().map(of).collect();
        let (mut phi, mut values) = (vec![vec![Vec::new(); ABREAST]; groups.len()], Vec::new());
        for pixels in pixels.chunks(ABREAST) {
            for (group, phi) in groups.iter().zip(&mut phi) {
                pixels.iter().zip(phi).for_each(|(&i, phi)| group.at(region, i, &mut values, phi));
            }
            for ((a, b), (block, [left, right], _)) in pairs.clone().zip(&mut blocks) {
                let covariance = |i: usize| weights[i] * weights[i] * reduced.covariances(i)[a * q + b];
                let covariances: Vec<f64> = pixels.iter().map(|&i| covariance(i)).collect();
                block.add(&covariances, &phi[*left], &phi[*right]);
            }
        }
        let mut blocks = blocks.into_iter().map(|(mut block, _, scales)| {
            block.scale(&scales, inflation);
            block
        });
        let all = (0..q * q).map(|ab| if ab / q <= ab % q { blocks.next() } else { None });
        Self { q, blocks: all.collect() }
    }

    /// Covariance of two sums of weight x coefficient, of responses a and b.
    pub fn between(&self, a: usize, b: usize, left: &[f64], right: &[f64]) -> f64 {
        if a > b {
            return self.between(b, a, right, left);
        }
        let block = self.block(a, b);
        let rows = block.values.chunks_exact(block.width).zip(left);
        rows.map(|(row, l)| l * row.iter().zip(right).map(|(c, r)| c * r).sum::<f64>()).sum()
    }

    /// Covariance of responses a <= b of some pixels, by what their functions are there, `[term][pixel]`.
    pub fn of_pixels(&self, a: usize, b: usize, left: &[[f64; ABREAST]], right: &[[f64; ABREAST]]) -> [f64; ABREAST] {
        let (block, mut sums) = (self.block(a, b), [0.0; ABREAST]);
        for (k, part) in block.parts.iter().flat_map(|[rows, part]| rows.clone().map(move |k| (k, part))) {
            let row = &block.values[k * block.width..][part.clone()];
            let mut along = [0.0; ABREAST];
            for (c, phi) in row.iter().zip(&right[part.clone()]) {
                (0..ABREAST).for_each(|p| along[p] += c * phi[p]);
            }
            (0..ABREAST).for_each(|p| sums[p] += left[k][p] * along[p]);
        }
        sums
    }

    fn block(&self, a: usize, b: usize) -> &Block {
        self.blocks[a * self.q + b].as_ref().expect("a is not behind b")
    }
}

impl Block {
    /// Adds covariance x phi_k phi_l of some pixels.
    fn add(&mut self, covariances: &[f64], left: &[Vec<f64>], right: &[Vec<f64>]) {
        for [rows, part] in &self.parts {
            for k in rows.clone() {
                let row = &mut self.values[k * self.width..][part.clone()];
                let mut weights = [0.0; ABREAST];
                for ((weight, covariance), phi) in weights.iter_mut().zip(covariances).zip(left) {
                    *weight = covariance * phi[k];
                }
                add_products(row, &weights, &right[..covariances.len()], part.start);
            }
        }
    }

    fn scale(&mut self, scales: &[f64], inflation: f64) {
        for ([rows, part], scale) in self.parts.iter().zip(scales) {
            for k in rows.clone() {
                let row = &mut self.values[k * self.width..][part.clone()];
                row.iter_mut().for_each(|value| *value *= inflation * scale);
            }
        }
    }
}

/// Adds weight x phi_l of some pixels, one after the other, to a row of sums over l from `first` on.
fn add_products(row: &mut [f64], weights: &[f64; ABREAST], phi: &[Vec<f64>], first: usize) {
    match phi {
        // All at once: each sum is read and written once for all of them.
        [p0, p1, p2, p3, p4, p5, p6, p7] => {
            let all = [p0, p1, p2, p3, p4, p5, p6, p7].map(|phi| &phi[first..][..row.len()]);
            for (l, sum) in row.iter_mut().enumerate() {
                *sum = (0..ABREAST).fold(*sum, |sum, p| sum + weights[p] * all[p][l]);
            }
        }
        _ => {
            for (phi, weight) in phi.iter().zip(weights) {
                row.iter_mut().zip(&phi[first..]).for_each(|(sum, phi)| *sum += weight * phi);
            }
        }
    }
}
