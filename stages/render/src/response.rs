//! What the numbers are that a path brings home.

/// In this order: the response to the pattern 1; re and im of that to each carrier; that to each projected image; that to steady light, where
/// there is any.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Carriers with f_x > 0.
    pub carriers: usize,
    /// Patterns that are images.
    pub projected_images: usize,
    /// Whether there is light that no pattern modulates.
    pub steady: bool,
}

/// Of the response to the pattern 1.
pub const ONE: usize = 0;

impl Layout {
    /// How many numbers a path has.
    pub fn width(&self) -> usize {
        1 + 2 * self.carriers + self.projected_images + usize::from(self.steady)
    }

    /// Place of re of a carrier; im follows.
    pub fn re(&self, carrier: usize) -> usize {
        1 + 2 * carrier
    }

    /// Place of the response to a projected image.
    pub fn projected_image(&self, projected_image: usize) -> usize {
        1 + 2 * self.carriers + projected_image
    }

    /// Place of the response to steady light.
    pub fn steady(&self) -> Option<usize> {
        self.steady.then(|| self.width() - 1)
    }
}
