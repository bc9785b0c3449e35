//! What is fitted over a region: groups of responses, each by its own functions.

use std::ops::Range;

use turbid_contract::Ctx;

use crate::blocks::RINGS;
use crate::chart::Functions;
use crate::parallel::each;
use crate::reduced::Reduced;
use crate::regions::{LEAST_PIXELS, Region};
use crate::trial::{Fit, PER_TERM, TERMS, Trial};

/// A fit to less than this part of a region does not stand for it.
const LEAST_PART: f64 = 0.5;

/// What is fitted, by groups of responses.
pub struct GroupFits<'a> {
    pub ctx: Ctx<'a>,
    pub region: &'a Region,
    pub reduced: &'a Reduced,
    pub weights: &'a [f64],
    pub groups: Vec<Fit<'a>>,
}

/// Of each group a trial, and its order.
pub type Trials = Vec<(Trial, usize)>;

impl<'a> GroupFits<'a> {
    /// Each group with the functions by which its expected error over the pixels to begin with is least, by the same rule by which orders are chosen; and these pixels.
    pub fn of(ctx: Ctx<'a>, region: &'a Region, reduced: &'a Reduced, weights: &'a [f64]) -> (Self, Vec<bool>) {
        let all = vec![true; region.len()];
        let fits = Self::over(ctx, region, reduced, weights, &all);
        let start = fits.start();
        // What the edges ask for is not what is best without them.
        if start == all { (fits, all) } else { (Self::over(ctx, region, reduced, weights, &start), start) }
    }

    fn over(ctx: Ctx<'a>, region: &'a Region, reduced: &'a Reduced, weights: &'a [f64], pixels: &[bool]) -> Self {
        let with = |responses: &Range<usize>, functions| Fit {
            region,
            reduced,
            responses: responses.clone(),
            weights,
            functions,
            rest: None,
        };
        let sets = |responses: &Range<usize>| region.chart.functions(reduced.fringe(responses).is_some());
        let all: Vec<Fit<'_>> = reduced
            .groups()
            .flat_map(|responses| sets(&responses).map(|set| with(&responses, set)).collect::<Vec<_>>())
            .collect();
        let mut found = each(ctx, all.len(), |i| {
            let found = all[i].lowest(pixels);
            found.map(|(trial, order)| (trial.gain(order), order))
        })
        .into_iter();
        let best = |responses: Range<usize>| {
            let (mut best, mut whole): (Option<(Functions, f64)>, _) = (None, None);
            for functions in sets(&responses) {
                let Some((gain, order)) = found.next().flatten() else { continue };
                if functions.has_all_harmonics() && whole.is_none() {
                    whole = Some((functions, order));
                }
                if best.is_none_or(|best| gain > best.1) {
                    best = Some((functions, gain));
                }
            }
            // Where no order of all functions is enough nobody knows what others leave out.
            let best = best.filter(|_| whole.is_some()).map(|best| best.0);
            let functions = best.or(sets(&responses).next()).expect("there are functions");
            Fit { rest: whole.filter(|&(whole, _)| whole != functions), ..with(&responses, functions) }
        };
        let groups = reduced.groups().map(best).collect();
        Self { ctx, region, reduced, weights, groups }
    }

    pub fn some(&self, active: &[bool]) -> impl Iterator<Item = usize> + Clone {
        (0..self.region.len()).filter(|&i| active[i])
    }

    /// Whether there are pixels enough for a fit to stand for the region.
    pub fn is_enough(&self, active: &[bool]) -> bool {
        let count = self.some(active).count();
        count >= LEAST_PIXELS && count as f64 >= LEAST_PART * self.region.len() as f64
    }

    /// The pixels to begin with: without the rings along the edges that take functions from all others.
    ///
    /// By a fit of m functions to n pixels these gain n log(n / m) in the logarithms of their variances; by the group that takes the most.
    fn start(&self) -> Vec<bool> {
        let gain = |active: &[bool]| {
            let (count, found) = (self.some(active).count() as f64, self.lowest(active));
            found.map_or(0.0, |trials| count * libm::log(count / self.terms(&trials) as f64))
        };
        let all = vec![true; self.region.len()];
        let few = TERMS[0].min(all.len() / PER_TERM);
        if self.groups.iter().all(|fit| Trial::of(fit, &all, few).is_some_and(|trial| trial.order().is_some())) {
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

    /// Of each group the first trial that has functions enough, and its order.
    pub fn lowest(&self, active: &[bool]) -> Option<Trials> {
        each(self.ctx, self.groups.len(), |group| self.groups[group].lowest(active)).into_iter().collect()
    }

    /// The most functions that a group has.
    pub fn terms(&self, trials: &Trials) -> usize {
        let terms = self.groups.iter().zip(trials).map(|(fit, &(_, order))| fit.functions.terms(order));
        terms.max().unwrap_or(1)
    }
}
