//! Images made of a control variate's smooth image and the mean difference from it, where that is better than the mean itself.

use crate::field::{Field, Sampled};
use crate::fit::Fitted;
use crate::neighbours::around;
use crate::response::Layout;

/// What is known of the control variates' images.
pub enum Images {
    /// They will be made with this part of the variance that the scene's pixels have by their own paths.
    Expected(f64),
    /// One for each control variate.
    Known(Vec<Fitted>),
}

/// One channel.
pub struct Controlled<'a> {
    direct: Sampled<'a>,
    /// Scene - control variate.
    differences: Sampled<'a>,
    images: Images,
    /// For each pixel the control variate that is better there than none.
    chosen: Vec<Option<usize>>,
    layout: Layout,
    /// `[pixel][group]`: variance of the differences of the responses of a group, pooled over the pixels around.
    ///
    /// Far from what makes the difference few paths know of it: what one pixel's own paths say of their variance is mostly too little.
    pooled: Vec<f64>,
}

impl<'a> Controlled<'a> {
    /// Of `of_pixel`, takes the control variates of those pixels around which the difference varies less than the mean.
    ///
    /// A pixel's own paths have no say in it: choosing by them the estimate that happens to look better would bias it.
    pub fn new(
        direct: Sampled<'a>,
        differences: Sampled<'a>,
        images: Images,
        of_pixel: &[Option<usize>],
        columns: usize,
        layout: Layout,
    ) -> Self {
        let groups = groups(layout);
        let own: Vec<f64> = (0..of_pixel.len())
            .flat_map(|pixel| (0..groups).map(move |group| (pixel, group)))
            .map(|(pixel, group)| variance_in(&differences, layout, pixel, group))
            .collect();
        let all = |pixel: usize| (0..layout.width()).map(move |i| (pixel, i));
        let mean: Vec<f64> = (0..of_pixel.len())
            .map(|pixel| all(pixel).map(|(pixel, i)| direct.variance(pixel, &[(i, 1.0)])).sum())
            .collect();
        let total = |pixel: usize, k: usize| -> f64 {
            let of_image: f64 = all(pixel).map(|(p, i)| images.variance(&direct, p, k, &[(i, 1.0)])).sum();
            let of_difference = (0..groups).map(|g| members(layout, g).count() as f64 * own[pixel * groups + g]);
            of_image + of_difference.sum::<f64>()
        };
        let difference: Vec<f64> = (0..of_pixel.len()).map(|p| of_pixel[p].map_or(0.0, |k| total(p, k))).collect();
        let mut pooled = vec![0.0; own.len()];
        let mut chosen = vec![None; of_pixel.len()];
        for (pixel, control) in of_pixel.iter().enumerate().filter(|(_, k)| k.is_some()) {
            let around: Vec<usize> =
                around(pixel, columns, of_pixel.len()).filter(|&p| of_pixel[p] == *control).collect();
            let (mut ours, mut theirs) = (0.0, 0.0);
            for &other in &around {
                // As if they had as many paths as this pixel.
                let scale = f64::from(differences.paths[other]) / f64::from(differences.paths[pixel]);
                for group in 0..groups {
                    pooled[pixel * groups + group] += scale * own[other * groups + group] / around.len() as f64;
                }
                if other != pixel {
                    (ours, theirs) = (ours + difference[other], theirs + mean[other]);
                }
            }
            chosen[pixel] = control.filter(|_| ours < theirs);
        }
        Self { direct, differences, images, chosen, layout, pooled }
    }

    /// Part of the pixels that are differences.
    pub fn fraction(&self) -> f64 {
        self.chosen.iter().flatten().count() as f64 / self.chosen.len() as f64
    }

    /// How many times the variance of the mean of the sum of weight x response over `terms` exceeds that of independent pixels.
    pub fn design_effect(&self, terms: &[(usize, f64)]) -> f64 {
        let total: f64 = (0..self.pixels()).map(|p| self.variance(p, terms)).sum();
        let n = self.pixels() as f64;
        if total > 0.0 { (self.variance_of_mean(terms, total) * n * n / total).max(1.0) } else { 1.0 }
    }

    /// Covariance of two sums of weight x difference: as the pixel's own paths have it, with the pooled variances.
    fn of_difference(&self, pixel: usize, a: &[(usize, f64)], b: &[(usize, f64)]) -> f64 {
        let groups = groups(self.layout);
        let scale: Vec<(f64, f64)> = (0..groups)
            .map(|group| {
                let (own, pooled) =
                    (variance_in(&self.differences, self.layout, pixel, group), self.pooled[pixel * groups + group]);
                // Paths that know nothing of it: as large, without correlation.
                if own > 0.0 { ((pooled / own).sqrt(), 0.0) } else { (0.0, pooled) }
            })
            .collect();
        let group = |i: usize| scale[group_of(self.layout, i)];
        let scaled = |terms: &[(usize, f64)]| terms.iter().map(|&(i, w)| (i, w * group(i).0)).collect::<Vec<_>>();
        let pairs = a.iter().flat_map(|a| b.iter().map(move |b| (a, b)));
        let alone: f64 = pairs.filter(|(a, b)| a.0 == b.0).map(|(a, b)| a.1 * b.1 * group(a.0).1).sum();
        self.differences.covariance(pixel, &scaled(a), &scaled(b)) + alone
    }
}

impl Field for Controlled<'_> {
    fn pixels(&self) -> usize {
        self.chosen.len()
    }

    fn mean(&self, pixel: usize, i: usize) -> f64 {
        match self.chosen[pixel] {
            Some(k) => match &self.images {
                Images::Known(images) => images[k].mean(pixel, i) + self.differences.mean(pixel, i),
                Images::Expected(_) => self.direct.mean(pixel, i),
            },
            None => self.direct.mean(pixel, i),
        }
    }

    fn covariance(&self, pixel: usize, a: &[(usize, f64)], b: &[(usize, f64)]) -> f64 {
        match self.chosen[pixel] {
            // By other random numbers: independent.
            Some(k) => self.images.covariance(&self.direct, pixel, k, a, b) + self.of_difference(pixel, a, b),
            None => self.direct.covariance(pixel, a, b),
        }
    }

    fn variance_of_mean(&self, terms: &[(usize, f64)], total: f64) -> f64 {
        // What pixels have for themselves, and what they share with all that have the same control variate.
        let n = self.pixels() as f64;
        let Images::Known(images) = &self.images else { return total / (n * n) };
        let of_image = |pixel: usize| self.chosen[pixel].map_or(0.0, |k| images[k].variance(pixel, terms));
        let alone = (total - (0..self.pixels()).map(of_image).sum::<f64>()).max(0.0);
        let shared = |(k, image): (usize, &Fitted)| image.variance_of_sum(terms, &|p| self.chosen[p] == Some(k));
        let shared: f64 = images.iter().enumerate().map(shared).sum();
        (alone + shared) / (n * n)
    }
}

impl Images {
    fn covariance(&self, direct: &Sampled<'_>, pixel: usize, k: usize, a: &[(usize, f64)], b: &[(usize, f64)]) -> f64 {
        match self {
            Self::Expected(part) => part * direct.covariance(pixel, a, b),
            Self::Known(images) => images[k].covariance(pixel, a, b),
        }
    }

    fn variance(&self, direct: &Sampled<'_>, pixel: usize, k: usize, terms: &[(usize, f64)]) -> f64 {
        self.covariance(direct, pixel, k, terms, terms).max(0.0)
    }
}

/// Responses that are alike: that to 1; re and im of each carrier, which change places along a fringe; that to steady light.
fn groups(layout: Layout) -> usize {
    1 + layout.carriers + usize::from(layout.steady)
}

fn group_of(layout: Layout, i: usize) -> usize {
    if i <= 2 * layout.carriers { i.div_ceil(2) } else { 1 + layout.carriers }
}

fn members(layout: Layout, group: usize) -> impl Iterator<Item = usize> {
    (0..layout.width()).filter(move |&i| group_of(layout, i) == group)
}

/// Mean variance of a group's responses in a pixel.
fn variance_in(field: &dyn Field, layout: Layout, pixel: usize, group: usize) -> f64 {
    let sum: f64 = members(layout, group).map(|i| field.variance(pixel, &[(i, 1.0)])).sum();
    sum / members(layout, group).count() as f64
}
