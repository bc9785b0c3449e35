//! What a pixel of a pattern that is made for a surface shall show, before phases and flattening.

/// A pixel whose light meets the surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// Coordinate along the surface at the pixel's centre, mm.
    pub s: f64,
    /// Mean over the pixel of (cos, sin)(2 pi f s) for each f_x.
    pub phasors: Vec<(f64, f64)>,
    /// Of the coordinate over the pixel, mm: the larger of both sides.
    pub slope: f64,
    /// Whether all of the pixel's light meets one face of the surface.
    pub whole: bool,
    /// On the surface at pattern value 1, in a unit common to all pixels.
    pub irradiance: f64,
}

impl Sample {
    /// Cycles of a fringe over the pixel.
    pub fn cycles(&self, f_x: f64) -> f64 {
        f_x * self.slope
    }
}
