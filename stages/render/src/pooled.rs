//! Errors of pixels by their own paths where few of those see what is bright: variances are pooled over the pixels around.
//!
//! `docs/theory/render.md`, "Errors".

use crate::field::{Field, Sampled, Watched};
use crate::moments::Moments;
use crate::neighbours::around;
use crate::rig::Rig;
use crate::truth::first_hit;
use crate::world::Spans;

/// Images of all channels by these paths; pooled where the scene has hollow bodies, whose light comes by way of their other walls.
pub fn by_paths<'a>(
    rig: &Rig,
    watched: &Watched,
    channels: &'a [Moments],
    paths: &'a [u32],
) -> Vec<Box<dyn Field + 'a>> {
    let sampled = |moments, widened| Sampled { moments, paths, widened };
    let world = &rig.worlds[0];
    if !world.is_hollow() {
        return channels.iter().map(|moments| -> Box<dyn Field> { Box::new(sampled(moments, true)) }).collect();
    }
    let mut spans = Spans::default();
    let body = |pixel: usize| first_hit(world, &rig.camera, pixel, &mut spans).map(|hit| hit.body);
    let seen: Vec<Option<usize>> = (0..paths.len()).map(body).collect();
    let pooled = |moments| Pooled::new(sampled(moments, false), watched, &seen, rig.camera.columns);
    channels.iter().map(|moments| -> Box<dyn Field> { Box::new(pooled(moments)) }).collect()
}

/// A field whose covariances are scaled, pixel by pixel, so that the variance of M_DC is the mean of those of the pixels around that look at the
/// same body.
pub struct Pooled<'a> {
    sampled: Sampled<'a>,
    /// Pooled over own variance.
    scale: Vec<f64>,
}

impl<'a> Pooled<'a> {
    /// `seen`: at which body each pixel looks; pixels without noise have no say and keep it.
    pub fn new(sampled: Sampled<'a>, watched: &Watched, seen: &[Option<usize>], columns: usize) -> Self {
        // Of one path: some pixels may have more of them.
        let of_path = |pixel: usize| f64::from(sampled.paths[pixel]) * sampled.variance(pixel, &watched.dc);
        let own: Vec<f64> = (0..seen.len()).map(of_path).collect();
        let scale = |pixel: usize| {
            if own[pixel] == 0.0 {
                return 1.0;
            }
            let alike = around(pixel, columns, seen.len()).filter(|&p| seen[p] == seen[pixel] && own[p] > 0.0);
            let (sum, count) = alike.fold((0.0, 0), |(sum, count), p| (sum + own[p], count + 1));
            sum / f64::from(count) / own[pixel]
        };
        Self { scale: (0..seen.len()).map(scale).collect(), sampled }
    }
}

impl Field for Pooled<'_> {
    fn pixels(&self) -> usize {
        self.sampled.pixels()
    }

    fn mean(&self, pixel: usize, i: usize) -> f64 {
        self.sampled.mean(pixel, i)
    }

    fn covariance(&self, pixel: usize, a: &[(usize, f64)], b: &[(usize, f64)]) -> f64 {
        self.scale[pixel] * self.sampled.covariance(pixel, a, b)
    }

    fn variance_of_mean(&self, terms: &[(usize, f64)], total: f64) -> f64 {
        self.sampled.variance_of_mean(terms, total)
    }
}
