//! Gaussian smoothing of an image with holes: normalised convolution, its noise, and its transpose.

/// A separable Gaussian of standard deviation `sigma_px`, cut at 4 sigma; sigma 0 leaves the image alone.
#[derive(Clone, Debug)]
pub struct Gauss {
    /// exp(-k^2 / (2 sigma^2)) for k = 0, 1, .., symmetric; not normalised, the mask does that.
    kernel: Vec<f64>,
}

/// A row-major image of f64.
#[derive(Clone, Debug, PartialEq)]
pub struct Plane {
    pub columns: usize,
    pub pixels: Vec<f64>,
}

impl Gauss {
    pub fn new(sigma_px: f64) -> Self {
        let reach = libm::ceil(4.0 * sigma_px) as usize;
        let weight = |k: usize| if k == 0 { 1.0 } else { libm::exp(-0.5 * (k as f64 / sigma_px).powi(2)) };
        Self { kernel: (0..=reach).map(weight).collect() }
    }

    /// Weights of a plane's neighbours, added up: sum_j w_ij x_j.
    pub fn sum(&self, plane: &Plane) -> Plane {
        separable(plane, &self.kernel)
    }

    /// sum_j w_ij^2 x_j: what variances of independent pixels take part with.
    pub fn sum_of_squares(&self, plane: &Plane) -> Plane {
        let squares: Vec<f64> = self.kernel.iter().map(|w| w * w).collect();
        separable(plane, &squares)
    }
}

/// Convolution with `kernel` along columns, then rows; beyond the border nothing takes part.
fn separable(plane: &Plane, kernel: &[f64]) -> Plane {
    if kernel.len() == 1 {
        return plane.clone();
    }
    let (columns, rows) = (plane.columns, plane.pixels.len() / plane.columns);
    let mut down = vec![0.0; plane.pixels.len()];
    for (r, out) in down.chunks_mut(columns).enumerate() {
        for other in r.saturating_sub(kernel.len() - 1)..(r + kernel.len()).min(rows) {
            let weight = kernel[r.abs_diff(other)];
            let from = &plane.pixels[other * columns..(other + 1) * columns];
            out.iter_mut().zip(from).for_each(|(out, x)| *out += weight * x);
        }
    }
    let mut pixels = vec![0.0; down.len()];
    for (out, row) in pixels.chunks_mut(columns).zip(down.chunks(columns)) {
        for (c, out) in out.iter_mut().enumerate() {
            for other in c.saturating_sub(kernel.len() - 1)..(c + kernel.len()).min(columns) {
                *out += kernel[c.abs_diff(other)] * row[other];
            }
        }
    }
    Plane { columns, pixels }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(columns: usize, pixels: Vec<f64>) -> Plane {
        Plane { columns, pixels }
    }

    /// The convolution is symmetric: <a, G b> = <G a, b>, on every shape, to rounding.
    #[test]
    fn smoothing_is_its_own_transpose() {
        for (rows, columns) in [(1, 1), (7, 5), (3, 40)] {
            let wave = |k: f64| plane(columns, (0..rows * columns).map(|i| (k * i as f64).sin()).collect());
            let (a, b) = (wave(1.3), wave(0.7));
            let gauss = Gauss::new(2.5);
            let dot = |a: &Plane, b: &Plane| a.pixels.iter().zip(&b.pixels).map(|(a, b)| a * b).sum::<f64>();
            let (left, right) = (dot(&a, &gauss.sum(&b)), dot(&gauss.sum(&a), &b));
            assert!((left - right).abs() < 1e-11, "{rows} x {columns}: {left} {right}");
        }
    }

    /// A point spreads as exp(-r^2 / (2 sigma^2)); squared weights spread with sigma / sqrt 2.
    #[test]
    fn a_point_spreads_as_a_gaussian() {
        let mut point = plane(21, vec![0.0; 21 * 21]);
        point.pixels[10 * 21 + 10] = 1.0;
        let gauss = Gauss::new(2.0);
        let (sum, squares) = (gauss.sum(&point), gauss.sum_of_squares(&point));
        for (i, (sum, square)) in sum.pixels.iter().zip(&squares.pixels).enumerate() {
            let (dr, dc) = ((i / 21).abs_diff(10) as f64, (i % 21).abs_diff(10) as f64);
            let want = if dr.max(dc) <= 8.0 { (-(dr * dr + dc * dc) / 8.0).exp() } else { 0.0 };
            assert!((sum - want).abs() < 1e-15 && (square - want * want).abs() < 1e-15);
        }
        assert_eq!(Gauss::new(0.0).sum(&point), point);
    }
}
