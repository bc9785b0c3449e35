//! The stopping criterion: how good an image is while its paths are walked, its error, where more are needed, and where control variates are worth their time.

use turbid_contract::Ctx;

use crate::allocation::needs;
use crate::control_variate::ControlVariates;
use crate::controlled::{Controlled, Images};
use crate::field::{Field, Sampled, Watched, relative_error};
use crate::fit::{FIT_PATHS, Fitted, Lattice};
use crate::moments::Moments;
use crate::params::Allocate;
use crate::projected::Projected;
use crate::regions::Region;
use crate::rig::Rig;
use crate::stopping_criterion::StoppingCriterion;
use crate::surfaces::by_surfaces;
use crate::tail::{expected_kurtosis, kurtosis, of_pixels};
use crate::variance_smoothing::by_paths;

/// Terms of a fit of the least order.
const TERMS: f64 = 6.0;
/// What starting a path and its next-event estimation cost, in flights (160 ns against 5; see `plan.rs`).
const START: f64 = 32.0;

/// Of an image fitted to a lattice of pixels.
pub struct OfFit<'a> {
    pub rig: &'a Rig,
    pub projected: &'a Projected,
    pub lattice: &'a Lattice,
}

impl StoppingCriterion for OfFit<'_> {
    fn error(&self, sums: &[Moments], paths: &[u32], _: Option<&[bool]>) -> Option<f64> {
        let (watched, n) = (Watched::of(self.projected), paths.first().copied().unwrap_or_default());
        let of = |moments| {
            let fitted = Fitted::new(self.rig, &self.projected.carriers, self.lattice, moments, n);
            fitted.and_then(|f| relative_error(&f, &watched))
        };
        sums.iter().filter_map(of).max_by(f64::total_cmp)
    }
}

/// Of pixels by their own paths, and of what is fitted to them.
pub struct OfSurfaces<'a> {
    pub ctx: Ctx<'a>,
    pub rig: &'a Rig,
    pub projected: &'a Projected,
    pub regions: &'a [Region],
}

impl StoppingCriterion for OfSurfaces<'_> {
    fn error(&self, sums: &[Moments], paths: &[u32], _: Option<&[bool]>) -> Option<f64> {
        let watched = Watched::of(self.projected);
        let fields = by_surfaces(self.ctx, self.rig, &watched, self.regions, sums, paths);
        fields.iter().filter_map(|field| relative_error(field, &watched)).max_by(f64::total_cmp)
    }
}

/// Of pixels by their own paths, perhaps with control variates.
pub struct OfPixels<'a> {
    rig: &'a Rig,
    projected: &'a Projected,
    controls: Option<&'a ControlVariates>,
    allocate: Allocate,
    watched: Watched,
    /// Pixels that a control variate's image is fitted to.
    lattice: usize,
}

impl<'a> OfPixels<'a> {
    pub fn new(
        rig: &'a Rig,
        projected: &'a Projected,
        controls: Option<&'a ControlVariates>,
        allocate: Allocate,
    ) -> Self {
        let lattice = Lattice::over(rig.camera.columns, rig.camera.rows);
        let lattice = lattice.columns.len() * lattice.rows.len();
        Self { rig, projected, controls, allocate, watched: Watched::of(projected), lattice }
    }

    fn spread(&self, moments: &Moments, paths: &[u32]) -> f64 {
        kurtosis(of_pixels(moments, paths), expected_kurtosis(self.rig)) - 1.0
    }

    fn direct<'b>(&self, sums: &'b [Moments], paths: &'b [u32]) -> Vec<Box<dyn Field + 'b>> {
        let of =
            |moments| -> Box<dyn Field> { Box::new(Sampled { moments, paths, spread: self.spread(moments, paths) }) };
        sums[..self.rig.worlds.len()].iter().map(of).collect()
    }

    /// The fields of all channels, with control variates where they are walked.
    fn fields<'b>(
        &self,
        sums: &'b [Moments],
        paths: &'b [u32],
        with_control: Option<&[bool]>,
    ) -> Vec<Box<dyn Field + 'b>> {
        let Some(controls) = self.controls else { return self.direct(sums, paths) };
        let of_pixel: Vec<Option<usize>> = match with_control {
            Some(with_control) => controls.of_pixel.iter().zip(with_control).map(|(of, &b)| of.filter(|_| b)).collect(),
            None => controls.of_pixel.clone(),
        };
        let expected = TERMS / (f64::from(FIT_PATHS) * self.lattice as f64);
        let (direct, differences) = sums.split_at(self.rig.worlds.len());
        let of = |(direct, difference)| -> Box<dyn Field> {
            let spread = self.spread(direct, paths);
            let sampled = |moments, spread| Sampled { moments, paths, spread };
            // Variances of differences are pooled over pixels.
            let (direct, difference) = (sampled(direct, spread), sampled(difference, 0.0));
            let (images, columns) = (Images::Expected(expected), self.rig.camera.columns);
            Box::new(Controlled::new(direct, difference, images, &of_pixel, columns, self.projected.layout))
        };
        direct.iter().zip(differences).map(of).collect()
    }
}

impl StoppingCriterion for OfPixels<'_> {
    fn error(&self, sums: &[Moments], paths: &[u32], with_control: Option<&[bool]>) -> Option<f64> {
        let errors = match self.controls {
            // As the frames will say it.
            None => by_paths(self.rig, &self.watched, sums, paths),
            Some(_) => self.fields(sums, paths, with_control),
        };
        errors.iter().filter_map(|field| relative_error(field.as_ref(), &self.watched)).max_by(f64::total_cmp)
    }

    fn needs(&self, sums: &[Moments], paths: &[u32], with_control: Option<&[bool]>) -> Vec<f64> {
        needs(&self.fields(sums, paths, with_control), &self.watched, self.rig.camera.columns, paths)
    }

    fn with_control(&self, sums: &[Moments], paths: &[u32], flights: [f64; 2]) -> Vec<bool> {
        let controls = self.controls.expect("asked only where there are stand-ins");
        let columns = self.rig.camera.columns;
        let alone = needs(&self.direct(sums, paths), &self.watched, columns, paths);
        let together = needs(&self.fields(sums, paths, None), &self.watched, columns, paths);
        let candidates = controls.of_pixel.iter().map(Option::is_some);
        let pixels: Vec<Choice> = candidates
            .zip(alone.iter().zip(&together))
            .map(|(may, (&alone, &together))| Choice { may, alone, together })
            .collect();
        let [scene, control] = flights.map(|flights| flights + START);
        let images = f64::from(FIT_PATHS) * (controls.variates.len() * self.lattice) as f64 * control;
        match self.allocate {
            Allocate::Even => worth_evenly(&pixels, [scene, control], images),
            Allocate::Adaptive => worth_adaptively(&pixels, [scene, control], images),
        }
    }

    fn part(&self, with_control: Option<&[bool]>) -> f64 {
        let Some(controls) = self.controls else { return 1.0 };
        let pixels = paths_of(controls, with_control);
        if pixels == 0 {
            return 1.0;
        }
        let paths = (self.rig.camera.pixels() + pixels) as f64;
        paths / (paths + f64::from(FIT_PATHS) * (controls.variates.len() * self.lattice) as f64)
    }
}

/// Pixels whose paths are walked in their control variate, too.
fn paths_of(controls: &ControlVariates, with_control: Option<&[bool]>) -> usize {
    with_control.map_or_else(|| controls.of_pixel.iter().flatten().count(), |b| b.iter().filter(|&&b| b).count())
}

/// Relative variances of a path in a pixel alone, and with its control variate.
#[derive(Clone, Copy, Debug)]
struct Choice {
    /// Whether it has one.
    may: bool,
    alone: f64,
    together: f64,
}

impl Choice {
    /// Logarithm of what the control variate takes off the variance; 0 where there is none.
    fn gain(&self) -> f64 {
        if self.may && self.together > 0.0 { libm::log(self.alone / self.together) } else { 0.0 }
    }
}

/// With the same number of paths everywhere: the pixels for which the geometric mean over the image of relative variance x cost becomes
/// least. `cost` of a path in the scene and in a control variate, that of the control variates' `images` per path of every pixel.
///
/// The geometric mean counts what any pixel gains alike; a plain one would be that of the few worst.
fn worth_evenly(pixels: &[Choice], cost: [f64; 2], images: f64) -> Vec<bool> {
    let gains: Vec<f64> = pixels.iter().map(Choice::gain).collect();
    let mut order: Vec<usize> = (0..pixels.len()).filter(|&i| gains[i] > 0.0).collect();
    order.sort_by(|&a, &b| gains[b].total_cmp(&gains[a]).then(a.cmp(&b)));
    let count = pixels.len() as f64;
    let alone = count * cost[0];
    let (mut total, mut gained) = (alone + images, 0.0);
    let (mut least, mut taken) = (0.0, 0);
    for (i, &pixel) in order.iter().enumerate() {
        gained += gains[pixel] / count;
        total += cost[1];
        let change = libm::log(total / alone) - gained;
        if change < least {
            (least, taken) = (change, i + 1);
        }
    }
    let mut worth = vec![false; pixels.len()];
    order[..taken].iter().for_each(|&i| worth[i] = true);
    worth
}

/// With as many paths in each pixel as it takes to the same relative error everywhere: those that it costs less to bring there, if it
/// makes up for the images.
fn worth_adaptively(pixels: &[Choice], [scene, control]: [f64; 2], images: f64) -> Vec<bool> {
    let both = |p: &Choice| p.together * (scene + control);
    let worth: Vec<bool> = pixels.iter().map(|p| p.may && both(p) < p.alone * scene).collect();
    let alone: f64 = pixels.iter().map(|p| p.alone * scene).sum();
    let chosen = || pixels.iter().zip(&worth);
    let paths: f64 = chosen().map(|(p, &worth)| if worth { p.together } else { p.alone }).sum();
    let walks: f64 = chosen().map(|(p, &worth)| if worth { both(p) } else { p.alone * scene }).sum();
    let pays = walks + paths / pixels.len() as f64 * images < alone;
    if pays { worth } else { vec![false; pixels.len()] }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pixels(gains: &[(bool, f64, usize)]) -> Vec<Choice> {
        let of = |&(may, gain, n): &(bool, f64, usize)| vec![Choice { may, alone: 4.0, together: 4.0 / gain }; n];
        gains.iter().flat_map(of).collect()
    }

    /// 100 pixels, a path costs the same everywhere, images as much as all pixels: with all of them by differences the cost is 3 times, so
    /// a gain of 2 in all is not worth it and one of 4 is; one of 30 in 20 of them is not (30^0.2 = 2.0 against 2.2 times), one of 100 is (2.5).
    #[test]
    fn control_variates_are_weighed_against_their_cost() {
        let count = |gains: &[(bool, f64, usize)]| {
            let worth = worth_evenly(&pixels(gains), [1.0, 1.0], 100.0);
            worth.iter().filter(|&&w| w).count()
        };
        assert_eq!(count(&[(true, 2.0, 100)]), 0);
        assert_eq!(count(&[(true, 4.0, 100)]), 100);
        assert_eq!(count(&[(true, 100.0, 20), (false, 1.0, 80)]), 20);
        assert_eq!(count(&[(true, 30.0, 20), (false, 1.0, 80)]), 0);
        // What gains less than the cost of its walk is left out.
        assert_eq!(count(&[(true, 100.0, 60), (true, 1.2, 40)]), 60);
        assert_eq!(count(&[(false, 100.0, 100)]), 0);
    }

    /// To one error everywhere a pixel alone costs 4, with its control variate 2 x 4 / gain, and the images the mean number of paths.
    #[test]
    fn adaptive_paths_take_what_costs_less() {
        let worth = |gains: &[(bool, f64, usize)]| {
            let worth = worth_adaptively(&pixels(gains), [1.0, 1.0], 100.0);
            worth.iter().filter(|&&w| w).count()
        };
        assert_eq!(worth(&[(true, 1.9, 100)]), 0);
        // 400 alone; 100 x 2 + 100 for the images.
        assert_eq!(worth(&[(true, 4.0, 100)]), 100);
        // 80 x 4 + 20 x 0.8 + 100 x 3.3 of 400.
        assert_eq!(worth(&[(true, 10.0, 20), (false, 1.0, 80)]), 0);
    }
}
