//! Images of smooth surfaces: fitted over their regions where that holds, elsewhere pixels by their own paths.

use turbid_contract::Ctx;
use turbid_contract::payload::Scene;

use crate::field::{Field, Watched, inflation};
use crate::moments::{Brightness, Moments};
use crate::reduced::Reduced;
use crate::regions::Region;
use crate::rig::Rig;
use crate::smooth::Smooth;
use crate::tail::{expected_kurtosis, image_holds, is_peaked, kurtosis};
use crate::variance_smoothing::by_paths;

/// Why no part of a scene's image is fitted; `None` where parts may be.
pub fn no_surface(scene: &Scene) -> Option<String> {
    if scene.camera.is_none() || scene.projector.is_none() {
        return Some("camera or projector is missing".to_owned());
    }
    if !scene.lights.is_empty() {
        return Some("lights other than the projector shine".to_owned());
    }
    let blurred = scene.camera.as_ref().is_some_and(|camera| camera.aperture.is_some());
    blurred.then(|| "the camera's aperture blurs what it sees".to_owned())
}

/// One channel.
pub struct Surfaces<'a> {
    pixels: Box<dyn Field + 'a>,
    regions: Vec<Part<'a>>,
    /// Where each pixel is fitted: which region, and its place in there.
    place: Vec<Option<(usize, usize)>>,
}

/// A region that is fitted.
struct Part<'a> {
    region: &'a Region,
    smooth: Smooth,
    /// Whether its paths hold what is rare and bright; if not, no error is known.
    held: bool,
}

/// The images of all channels by these paths.
pub fn by_surfaces<'a>(
    ctx: Ctx<'_>,
    rig: &Rig,
    watched: &Watched,
    regions: &'a [Region],
    channels: &'a [Moments],
    paths: &'a [u32],
) -> Vec<Surfaces<'a>> {
    let pixels = by_paths(rig, watched, channels, paths);
    let of = |(moments, pixels)| Surfaces::of(ctx, rig, regions, moments, paths, pixels);
    channels.iter().zip(pixels).map(of).collect()
}

impl<'a> Surfaces<'a> {
    fn of(
        ctx: Ctx<'_>,
        rig: &Rig,
        regions: &'a [Region],
        moments: &Moments,
        paths: &[u32],
        pixels: Box<dyn Field + 'a>,
    ) -> Self {
        let expected = expected_kurtosis(rig);
        let mut place = vec![None; paths.len()];
        let mut parts: Vec<Part<'a>> = Vec::new();
        for region in regions {
            let own: Vec<u32> = region.pixels.iter().map(|&p| paths[p as usize]).collect();
            let seen: Vec<Brightness> =
                region.pixels.iter().zip(&own).map(|(&p, &n)| moments.brightness(p as usize, n)).collect();
            let all = own.iter().fold(0_u32, |sum, &n| sum.saturating_add(n));
            let inflation = inflation(all, kurtosis(seen.iter().copied(), expected) - 1.0);
            let traced = region.pixels.iter().zip(&own).enumerate();
            let traced = traced.map(|(i, (&p, &n))| (p as usize, n, region.guide(i)));
            let reduced = Reduced::of(&region.fringes, moments, traced);
            let Some(smooth) = Smooth::of(ctx, region, &reduced, &own, inflation) else { continue };
            for (i, &pixel) in region.pixels.iter().enumerate().filter(|&(i, _)| smooth.fitted[i]) {
                place[pixel as usize] = Some((parts.len(), i));
            }
            let held = !is_peaked(expected) || image_holds(&seen, expected);
            parts.push(Part { region, smooth, held });
        }
        Self { pixels, regions: parts, place }
    }

    /// Part of the pixels that are fitted.
    pub fn fraction(&self) -> f64 {
        self.place.iter().flatten().count() as f64 / self.place.len() as f64
    }

    /// How many times the variance of the mean of the sum of weight x response over `terms` exceeds that of independent pixels.
    pub fn design_effect(&self, terms: &[(usize, f64)]) -> f64 {
        let total: f64 = (0..self.pixels()).map(|p| self.variance(p, terms)).sum();
        let n = self.pixels() as f64;
        if total > 0.0 { (self.variance_of_mean(terms, total) * n * n / total).max(1.0) } else { 1.0 }
    }

    /// Of each region that is fitted its object, the order, and chi2 per degree of freedom.
    pub fn fits(&self) -> impl Iterator<Item = (&str, usize, f64)> {
        self.regions.iter().map(|part| (part.region.name.as_str(), part.smooth.order(), part.smooth.chi2))
    }
}

impl Field for Surfaces<'_> {
    fn pixels(&self) -> usize {
        self.place.len()
    }

    fn mean(&self, pixel: usize, i: usize) -> f64 {
        let Some((part, place)) = self.place[pixel] else { return self.pixels.mean(pixel, i) };
        let Part { region, smooth, .. } = &self.regions[part];
        let reduced = region.guide(place).in_reduced(i);
        reduced.into_iter().map(|(a, w)| if w == 0.0 { 0.0 } else { w * smooth.value(place, a) }).sum()
    }

    fn covariance(&self, pixel: usize, a: &[(usize, f64)], b: &[(usize, f64)]) -> f64 {
        let Some((part, place)) = self.place[pixel] else { return self.pixels.covariance(pixel, a, b) };
        let Part { region, smooth, .. } = &self.regions[part];
        let guide = region.guide(place);
        let (left, right) = (guide.collect(a), guide.collect(b));
        let pairs = left.iter().flat_map(|l| right.iter().map(move |r| (l, r)));
        pairs.map(|(&(a, wa), &(b, wb))| wa * wb * smooth.covariance(place, a, b)).sum()
    }

    fn variance(&self, pixel: usize, terms: &[(usize, f64)]) -> f64 {
        match self.place[pixel] {
            Some(_) => self.covariance(pixel, terms, terms).max(0.0),
            None => self.pixels.variance(pixel, terms),
        }
    }

    fn variance_of_mean(&self, terms: &[(usize, f64)], total: f64) -> f64 {
        let n = self.pixels() as f64;
        if self.regions.is_empty() {
            return self.pixels.variance_of_mean(terms, total);
        }
        // Pixels that are not fitted have no part in a fit: their errors are their own.
        let alone = (0..self.pixels()).filter(|&p| self.place[p].is_none());
        let alone: f64 = alone.map(|p| self.pixels.variance(p, terms)).sum();
        let of = |part: &Part<'_>| part.smooth.variance_of_sum(part.region, &|i| part.region.guide(i).collect(terms));
        (alone + self.regions.iter().map(of).sum::<f64>()) / (n * n)
    }

    fn se_unknown(&self, pixel: usize) -> bool {
        match self.place[pixel] {
            Some((part, _)) => !self.regions[part].held,
            None => self.pixels.se_unknown(pixel),
        }
    }

    fn mean_se_unknown(&self) -> bool {
        self.pixels.mean_se_unknown() || self.regions.iter().any(|part| !part.held)
    }
}
