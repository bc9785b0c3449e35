//! The camera: rays through the pixels.

use glam::DVec3;
use turbid_optics::view::View;

/// A pinhole camera with square-lattice pixels.
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

    /// Unit vector through a point of a pixel: (0, 0) its top left corner, (1, 1) its bottom right.
    #[inline]
    pub fn ray(&self, pixel: usize, x: f64, y: f64) -> DVec3 {
        let (column, row) = ((pixel % self.columns) as f64, (pixel / self.columns) as f64);
        self.view.direction((column + x) / self.columns as f64, (row + y) / self.rows as f64)
    }
}
