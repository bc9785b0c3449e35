//! Patterns that are images: what the projector shows at a place of its field.

/// Images of one size that cover the projector's field, row 0 at its upper side; values in [0, 1], linear between pixel centres,
/// beyond the outermost centres as there.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ProjectedImages {
    rows: usize,
    columns: usize,
    layers: usize,
    /// Pixel by pixel, all layers together.
    texels: Vec<f32>,
}

/// The pixels around a place: where their values start, and their weights.
#[derive(Clone, Copy, Debug)]
pub struct Around {
    starts: [usize; 4],
    weights: [f64; 4],
}

impl ProjectedImages {
    pub const NONE: Self = Self { rows: 0, columns: 0, layers: 0, texels: Vec::new() };

    /// `value(layer, row, column)` of each.
    pub fn new(layers: usize, rows: usize, columns: usize, value: impl Fn(usize, usize, usize) -> f32) -> Self {
        let mut texels = Vec::with_capacity(layers * rows * columns);
        for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
            texels.extend((0..layers).map(|layer| value(layer, row, column)));
        }
        Self { rows, columns, layers, texels }
    }

    pub fn layers(&self) -> usize {
        self.layers
    }

    /// Rows and columns.
    pub fn size(&self) -> [usize; 2] {
        [self.rows, self.columns]
    }

    /// Values of all layers in a pixel.
    pub fn texel(&self, row: usize, column: usize) -> &[f32] {
        &self.texels[(row * self.columns + column) * self.layers..][..self.layers]
    }

    /// Values of all layers, for lanes: between the pixel of a column and a row and those to the right of it and below, by their shares `x` and `y`.
    #[inline(always)]
    pub fn blend(&self, column: f32, row: f32, x: f32, y: f32) -> impl Iterator<Item = f32> {
        let (column, row) = (column as usize, row as usize);
        let (right, below) = ((column + 1).min(self.columns - 1), (row + 1).min(self.rows - 1));
        let pixel =
            |row: usize, column: usize| &self.texels[(row * self.columns + column) * self.layers..][..self.layers];
        let (above_left, above_right) = (pixel(row, column), pixel(row, right));
        let (below_left, below_right) = (pixel(below, column), pixel(below, right));
        let (p, q, r, s) = ((1.0 - x) * (1.0 - y), x * (1.0 - y), (1.0 - x) * y, x * y);
        let above = above_left.iter().zip(above_right).map(move |(a, b)| p * a + q * b);
        let below = below_left.iter().zip(below_right).map(move |(a, b)| r * a + s * b);
        above.zip(below).map(|(above, below)| above + below)
    }

    /// The surroundings of the place (x, y) of the field: (0, 0) its upper left corner, (1, 1) its lower right.
    #[inline]
    pub fn around(&self, x: f64, y: f64) -> Around {
        let (column, right, fx) = between(x, self.columns);
        let (row, below, fy) = between(y, self.rows);
        let start = |row: usize, column: usize| (row * self.columns + column) * self.layers;
        Around {
            starts: [start(row, column), start(row, right), start(below, column), start(below, right)],
            weights: [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy],
        }
    }

    /// Value of a layer there.
    #[inline]
    pub fn value(&self, layer: usize, around: &Around) -> f64 {
        let parts = around.starts.iter().zip(&around.weights);
        parts.map(|(start, weight)| weight * f64::from(self.texels[start + layer])).sum()
    }
}

/// The two pixels around a place in (0, 1), and the share of the second.
#[inline]
fn between(x: f64, pixels: usize) -> (usize, usize, f64) {
    let last = pixels - 1;
    let at = (x * pixels as f64 - 0.5).clamp(0.0, last as f64);
    let first = at as usize;
    (first, (first + 1).min(last), at - first as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Linear functions of the place are kept, to rounding of the f32 values; pixel centres are exact; corners are their pixels'.
    #[test]
    fn planes_are_kept() {
        let (rows, columns) = (5, 8);
        let p = ProjectedImages::new(2, rows, columns, |layer, row, column| (layer * 100 + row * 10 + column) as f32);
        for (x, y) in [(0.3, 0.4), (0.0625, 0.1), (0.9, 0.9), (0.5, 0.5)] {
            let around = p.around(x, y);
            let expected = (y * 5.0 - 0.5) * 10.0 + x * 8.0 - 0.5;
            for layer in 0..2 {
                let off = p.value(layer, &around) - (expected + 100.0 * layer as f64);
                assert!(off.abs() < 1e-12, "({x}, {y}), layer {layer}: off by {off}");
            }
        }
        assert_eq!(p.value(1, &p.around(0.0, 0.0)), 100.0);
        assert_eq!(p.value(1, &p.around(1.0, 1.0)), 147.0);
        let one = ProjectedImages::new(1, 1, 1, |_, _, _| 0.25);
        assert_eq!(one.value(0, &one.around(0.99, 0.01)), 0.25);
    }
}
