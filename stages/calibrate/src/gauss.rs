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
///
/// The neighbours at equal distances are added before they are weighted; a row is finished while it is in the cache.
fn separable(plane: &Plane, kernel: &[f64]) -> Plane {
    if kernel.len() == 1 {
        return plane.clone();
    }
    let (columns, rows, reach) = (plane.columns, plane.pixels.len() / plane.columns, kernel.len() - 1);
    let row = |r: usize| &plane.pixels[r * columns..(r + 1) * columns];
    let mut pixels = vec![0.0; plane.pixels.len()];
    // A row with as many zeros at both ends as the kernel reaches.
    let mut down = vec![0.0; columns + 2 * reach];
    for (r, out) in pixels.chunks_mut(columns).enumerate() {
        let middle = &mut down[reach..reach + columns];
        middle.iter_mut().zip(row(r)).for_each(|(sum, x)| *sum = kernel[0] * x);
        for (k, &weight) in kernel.iter().enumerate().skip(1) {
            match (r.checked_sub(k), r + k < rows) {
                (Some(above), true) => add_both(middle, weight, row(above), row(r + k)),
                (Some(other), false) => add(middle, weight, row(other)),
                (None, true) => add(middle, weight, row(r + k)),
                (None, false) => break,
            }
        }
        out.iter_mut().zip(&down[reach..]).for_each(|(sum, x)| *sum = kernel[0] * x);
        for (k, &weight) in kernel.iter().enumerate().skip(1) {
            add_both(out, weight, &down[reach - k..], &down[reach + k..]);
        }
    }
    Plane { columns, pixels }
}

fn add(sum: &mut [f64], weight: f64, x: &[f64]) {
    sum.iter_mut().zip(x).for_each(|(sum, x)| *sum += weight * x);
}

fn add_both(sum: &mut [f64], weight: f64, x: &[f64], y: &[f64]) {
    sum.iter_mut().zip(x).zip(y).for_each(|((sum, x), y)| *sum += weight * (x + y));
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
