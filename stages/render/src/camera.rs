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

    /// The pixel that sees light which goes through the place `eye` of the lens (the pinhole) in direction -w, and what turns the irradiance of a
    /// point light there (across the ray) into the mean radiance of that pixel, sr^-1; `None` outside the image.
    pub fn image_of(&self, eye: DVec3, w: DVec3) -> Option<(usize, f64)> {
        let (place, area) = self.view.image_of(eye, w)?;
        Some((self.pixel_at(place)?, area / self.pixel_area()))
    }

    /// Of an orthographic camera: the pixel that sees `p`, and its area across the axis, mm^2.
    pub fn seen_along_axis(&self, p: DVec3) -> Option<(usize, f64)> {
        let pixel = self.pixel_at(self.view.image_position(p)?)?;
        Some((pixel, self.pixel_area() * self.view.forward.z.abs()))
    }

    /// Of a pixel in the field's plane, mm^2.
    fn pixel_area(&self) -> f64 {
        self.view.field.x * self.view.field.y / self.pixels() as f64
    }

    fn pixel_at(&self, (x, y): (f64, f64)) -> Option<usize> {
        let inside = (0.0..1.0).contains(&x) && (0.0..1.0).contains(&y);
        let at = |x: f64, count: usize| ((x * count as f64) as usize).min(count - 1);
        inside.then(|| at(y, self.rows) * self.columns + at(x, self.columns))
    }

    #[inline]
    fn place(&self, pixel: usize, x: f64, y: f64) -> (f64, f64) {
        let (column, row) = ((pixel % self.columns) as f64, (pixel / self.columns) as f64);
        ((column + x) / self.columns as f64, (row + y) / self.rows as f64)
    }
}
