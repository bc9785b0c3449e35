//! The camera: rays through the pixels.

use glam::DVec3;
use turbid_optics::view::{Lens, View};

/// A camera with square-lattice pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    pub view: View,
    pub columns: usize,
    pub rows: usize,
}

impl Camera {
    pub fn pixels(&self) -> usize {
        self.columns * self.rows
    }

    /// Origin and unit vector of the middle ray of a point of a pixel: (0, 0) its top left corner, (1, 1) its bottom right.
    #[inline]
    pub fn ray(&self, pixel: usize, x: f64, y: f64) -> (DVec3, DVec3) {
        let (x, y) = self.place(pixel, x, y);
        self.view.ray(x, y)
    }

    /// The same through a point of the lens, uniform over it for u, v uniform in (0, 1).
    #[inline]
    pub fn ray_through(&self, pixel: usize, x: f64, y: f64, u: f64, v: f64) -> (DVec3, DVec3) {
        let (x, y) = self.place(pixel, x, y);
        self.view.ray_through(x, y, u, v)
    }

    /// Whether rays start all over a lens.
    #[inline]
    pub fn has_aperture(&self) -> bool {
        matches!(self.view.lens, Lens::Thin { .. })
    }

    #[inline]
    fn place(&self, pixel: usize, x: f64, y: f64) -> (f64, f64) {
        let (column, row) = ((pixel % self.columns) as f64, (pixel / self.columns) as f64);
        ((column + x) / self.columns as f64, (row + y) / self.rows as f64)
    }
}
