//! Reduced responses over a region as a smooth function of the places on its surface, where they are one.
//!
//! `docs/theory/render.md`, "Fit".

use turbid_contract::Ctx;

use crate::coefficient_errors::{ABREAST, Errors};
use crate::group_fits::{GroupFits, Trials};
use crate::misfit::Misfit;
use crate::parallel::each;
use crate::reduced::Reduced;
use crate::regions::Region;
use crate::residuals::Residuals;
use crate::trial::Fitted;
use crate::variance_model::weights;

/// Rounds in which blocks are given up; what has misfits after that, or too few of its pixels left, is not smooth.
const ROUNDS: usize = 8;
/// Mean square of the scores of all blocks beyond which a region is not smooth.
const MOST_CHI2: f64 = 2.0;

/// One channel over a region: response = gain x (carrier) x sum over k of coefficient_k phi_k(place).
pub struct Smooth {
    q: usize,
    groups: Vec<Fitted>,
    /// Of the residuals over all pixels that are fitted, per degree of freedom.
    pub chi2: f64,
    /// For each pixel of the region whether it is.
    pub fitted: Vec<bool>,
    errors: Errors,
    /// What is left over all tiles, and over each ring along the edge.
    misfits: Vec<Misfit>,
    /// `[pixel][response]` and `[pixel][response][response]`; zeros where it is not fitted.
    values: Vec<f64>,
    covariances: Vec<f64>,
}

impl Smooth {
    /// `None` where the responses are no smooth function. `paths`: of each pixel; `inflation`: of standard errors, see [`crate::field::inflation`].
    pub fn of(ctx: Ctx<'_>, region: &Region, reduced: &Reduced, paths: &[u32], inflation: f64) -> Option<Self> {
        let weights = weights(region, reduced, paths)?;
        let (fits, mut active) = GroupFits::of(ctx, region, reduced, &weights);
        for round in 1..=ROUNDS {
            if !fits.is_enough(&active) {
                return None;
            }
            let trials = fits.lowest(&active)?;
            let residuals = Residuals::of(&fits, &trials, &active);
            let (misfits, chi2) = residuals.misfits();
            let is_smooth = chi2 <= MOST_CHI2;
            let mut worst = residuals.worst_blocks();
            if worst.is_empty() && !is_smooth {
                // No block is off by itself, but all together are.
                worst.push(residuals.worst_tile());
            }
            let mut rest = active.clone();
            worst.iter().flatten().for_each(|&i| rest[i] = false);
            // What cannot be given up, for too little would stay, is in the errors as a misfit.
            let is_last = round == ROUNDS || !fits.is_enough(&rest);
            if is_smooth && (worst.is_empty() || is_last) {
                let chi2 = residuals.chi2();
                return Some(Self::by(&fits, &trials, active, (misfits, chi2), inflation));
            }
            active = rest;
        }
        None
    }

    /// Highest order of the functions of the fit.
    pub fn order(&self) -> usize {
        self.groups.iter().map(|group| group.functions.order).max().unwrap_or(0)
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
        let terms = self.groups.iter().flat_map(|g| g.responses.clone().map(|_| g.functions.count()));
        let mut sums: Vec<Vec<f64>> = terms.map(|m| vec![0.0; m]).collect();
        let (mut b, mut phi, mut alone) = (Vec::new(), Vec::new(), 0.0);
        for i in (0..region.len()).filter(|&i| self.fitted[i]) {
            let weights = weights(i);
            for group in &self.groups {
                let mut own = weights.iter().filter(|(a, _)| group.responses.contains(a)).peekable();
                if own.peek().is_some() {
                    group.at(region, i, &mut b, &mut phi);
                }
                own.for_each(|&(a, w)| sums[a].iter_mut().zip(&phi).for_each(|(sum, p)| *sum += w * p));
            }
            for (a, w) in weights {
                let (variance, pixels) = self.misfit(region, i, a);
                alone += w * w * variance * pixels;
            }
        }
        let of = |a: usize, b: usize| self.errors.between(a, b, &sums[a], &sums[b]);
        let shared: f64 = (0..self.q).flat_map(|a| (0..self.q).map(move |b| (a, b))).map(|(a, b)| of(a, b)).sum();
        shared.max(0.0) + alone
    }

    /// Values and covariances of all `pixels` that are fitted.
    fn fill(&mut self, region: &Region, pixels: &[usize]) {
        let (q, mut b, mut phi) = (self.q, Vec::new(), Vec::new());
        let group_of: Vec<usize> =
            self.groups.iter().enumerate().flat_map(|(g, group)| group.responses.clone().map(move |_| g)).collect();
        let mut abreast: Vec<_> = self.groups.iter().map(|g| vec![[0.0; ABREAST]; g.functions.count()]).collect();
        for pixels in pixels.chunks(ABREAST) {
            for (place, &i) in pixels.iter().enumerate() {
                for (group, abreast) in self.groups.iter().zip(&mut abreast) {
                    group.at(region, i, &mut b, &mut phi);
                    abreast.iter_mut().zip(&phi).for_each(|(abreast, &phi)| abreast[place] = phi);
                    group.responses.clone().for_each(|a| self.values[i * q + a] = group.value(a, &phi));
                }
            }
            for (a, other) in (0..q).flat_map(|a| (a..q).map(move |other| (a, other))) {
                let [left, right] = [a, other].map(|a| &abreast[group_of[a]]);
                let shared = self.errors.of_pixels(a, other, left, right);
                for (&i, shared) in pixels.iter().zip(shared) {
                    let own = if a == other { self.misfit(region, i, a).0 } else { 0.0 };
                    self.covariances[(i * q + a) * q + other] = shared + own;
                    self.covariances[(i * q + other) * q + a] = shared + own;
                }
            }
        }
    }

    /// What is left of response a in a pixel, and how many pixels share it: the largest of all that it has a part in, which see one misfit.
    fn misfit(&self, region: &Region, i: usize, a: usize) -> (f64, f64) {
        let ring = region.rings[i];
        let own = self.misfits.iter().filter(|misfit| misfit.ring.is_none_or(|r| r == ring));
        own.map(|m| (m.variances[a], m.pixels)).fold((0.0, 1.0), |most, this| if this.0 > most.0 { this } else { most })
    }

    /// By the last trials.
    fn by(
        fits: &GroupFits<'_>,
        trials: &Trials,
        active: Vec<bool>,
        (misfits, chi2): (Vec<Misfit>, f64),
        inflation: f64,
    ) -> Self {
        let (q, pixels): (usize, Vec<usize>) = (fits.reduced.q, fits.some(&active).collect());
        let groups = each(fits.ctx, trials.len(), |group| Fitted::of(&fits.groups[group], trials[group].1, &active));
        let errors = Errors::of((fits.region, fits.reduced, fits.weights), &groups, &pixels, inflation * inflation);
        let mut smooth = Self {
            q,
            groups,
            chi2,
            fitted: active,
            errors,
            misfits,
            values: vec![0.0; fits.region.len() * q],
            covariances: vec![0.0; fits.region.len() * q * q],
        };
        smooth.fill(fits.region, &pixels);
        smooth
    }
}

#[cfg(test)]
mod tests;
