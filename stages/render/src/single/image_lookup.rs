//! Lookup of projected images, for lanes.

use fearless_simd::prelude::*;
use glam::DVec3;

use super::lane::{F, splat};
use crate::light::Light;
use crate::projected_images::ProjectedImages;

/// Beyond so many pixels along a side a place in an image is less sure than 1e-3 of a pixel.
pub const MOST_PIXELS: usize = 4096;

/// Projected images over the field of a projector.
#[derive(Clone, Debug)]
pub struct ImageLookup<'a> {
    pub projected_images: &'a ProjectedImages,
    /// Columns along x and y of the pattern's plane, and at the local origin; the same of rows.
    columns: [f32; 3],
    rows: [f32; 3],
    /// Of the last pixel.
    last: [f32; 2],
}

impl<'a> ImageLookup<'a> {
    /// `None` where there are none, or they are too fine for f32.
    pub fn over(light: &Light, projected_images: &'a ProjectedImages, origin: DVec3) -> Option<Self> {
        let (view, [rows, columns]) = (&light.view, projected_images.size());
        if projected_images.layers() == 0 || rows.max(columns) > MOST_PIXELS {
            return None;
        }
        let center = view.look_at - origin;
        // From `View::position_of`, a pixel's centre being half a pixel from its edge.
        let along = |side: DVec3, field: f64, pixels: usize| {
            let step = pixels as f64 / field * side;
            let start = 0.5 * (pixels as f64 - 1.0) - center.dot(step);
            [step.x as f32, step.y as f32, start as f32]
        };
        Some(Self {
            projected_images,
            columns: along(view.right, view.field.x, columns),
            rows: along(-view.top, view.field.y, rows),
            last: [columns, rows].map(|pixels| (pixels - 1) as f32),
        })
    }

    /// At points of the pattern's plane: the column to the left and the share of the one beside it; the row above and the share of the one
    /// below.
    #[inline(always)]
    pub fn place<S: Simd>(&self, simd: S, x: F<S>, y: F<S>) -> [(F<S>, F<S>); 2] {
        let at = |[along_x, along_y, start]: [f32; 3], last: f32| {
            let at = (x * along_x + y * along_y + start).max(splat(simd, 0.0)).min(splat(simd, last));
            let first = at.trunc();
            (first, at - first)
        };
        [at(self.columns, self.last[0]), at(self.rows, self.last[1])]
    }
}
