//! Gaussian smoothing of an image with holes: normalised convolution, its noise, and its transpose.

use fearless_simd::{Level, Simd, dispatch};
use turbid_contract::Error;

use crate::plane::{Plane, Room};

/// A separable Gaussian of standard deviation `sigma_px`, cut at 4 sigma; sigma 0 leaves the image alone.
#[derive(Clone, Debug)]
pub struct Gauss {
    /// exp(-k^2 / (2 sigma^2)) for k = 0, 1, .., symmetric; not normalised, the mask does that.
    kernel: Vec<f64>,
    squares: Vec<f64>,
}

impl Gauss {
    pub fn new(sigma_px: f64) -> Self {
        let reach = libm::ceil(4.0 * sigma_px) as usize;
        let weight = |k: usize| if k == 0 { 1.0 } else { libm::exp(-0.5 * (k as f64 / sigma_px).powi(2)) };
        let kernel: Vec<f64> = (0..=reach).map(weight).collect();
        Self { squares: kernel.iter().map(|w| w * w).collect(), kernel }
    }

    /// Weights of an image's neighbours, added up: `end` of the pixel and of sum_j w_ij x_j.
    pub fn sum<'r>(
        &self,
        room: &'r Room<'_>,
        x: impl Fn(usize) -> f64 + Sync,
        end: impl Fn(usize, f64) -> f64 + Sync,
    ) -> Result<Plane<'r>, Error> {
        separable(room, &self.kernel, x, end)
    }

    /// The same of sum_j w_ij^2 x_j: what variances of independent pixels take part with.
    pub fn sum_of_squares<'r>(
        &self,
        room: &'r Room<'_>,
        x: impl Fn(usize) -> f64 + Sync,
        end: impl Fn(usize, f64) -> f64 + Sync,
    ) -> Result<Plane<'r>, Error> {
        separable(room, &self.squares, x, end)
    }
}

/// Convolution with `kernel` along columns, then rows; beyond the border nothing takes part.
///
/// The neighbours at equal distances are added before they are weighted. Rows of `x` are made as they come within reach, and stay in the cache
/// as long as they are.
fn separable<'r>(
    room: &'r Room<'_>,
    kernel: &[f64],
    x: impl Fn(usize) -> f64 + Sync,
    end: impl Fn(usize, f64) -> f64 + Sync,
) -> Result<Plane<'r>, Error> {
    let (rows, columns, reach) = (room.rows, room.columns, kernel.len() - 1);
    let fill = |row: usize, to: &mut [f64]| to.iter_mut().zip(row * columns..).for_each(|(to, i)| *to = x(i));
    room.fill(|block, pixels| {
        let mut window = Window::new(columns, kernel.len());
        let mut next = block.start.saturating_sub(reach);
        for (r, out) in block.zip(pixels.chunks_mut(columns)) {
            if reach == 0 {
                fill(r, out);
            } else {
                while next < (r + reach + 1).min(rows) {
                    fill(next, window.row_mut(next));
                    next += 1;
                }
                window.convolve(room.level, kernel, r, rows, out);
            }
            out.iter_mut().zip(r * columns..).for_each(|(out, i)| *out = end(i, *out));
        }
    })
}

/// The rows within reach of one.
struct Window {
    columns: usize,
    /// Row r in the place of r modulo how many there are.
    rows: Vec<f64>,
    /// A row with as many zeros at both ends as the kernel reaches.
    down: Vec<f64>,
}

impl Window {
    fn new(columns: usize, kernel: usize) -> Self {
        let reach = kernel - 1;
        let rows = if reach == 0 { 0 } else { 2 * reach + 1 };
        Self { columns, rows: vec![0.0; rows * columns], down: vec![0.0; columns + 2 * reach] }
    }

    fn start(&self, row: usize) -> usize {
        let rows = self.rows.len() / self.columns;
        row % rows * self.columns
    }

    fn row_mut(&mut self, row: usize) -> &mut [f64] {
        let start = self.start(row);
        &mut self.rows[start..start + self.columns]
    }

    fn convolve(&mut self, level: Level, kernel: &[f64], r: usize, rows: usize, out: &mut [f64]) {
        let (columns, reach) = (self.columns, kernel.len() - 1);
        let mut down = std::mem::take(&mut self.down);
        let row = |r: usize| &self.rows[self.start(r)..][..columns];
        let middle = &mut down[reach..reach + columns];
        dispatch!(level, simd => simd.vectorize(#[inline(always)] || {
            middle.iter_mut().zip(row(r)).for_each(|(sum, x)| *sum = kernel[0] * x);
            for (k, &weight) in kernel.iter().enumerate().skip(1) {
                match (r.checked_sub(k), r + k < rows) {
                    (Some(above), true) => add_both(middle, weight, row(above), row(r + k)),
                    (Some(other), false) => add(middle, weight, row(other)),
                    (None, true) => add(middle, weight, row(r + k)),
                    (None, false) => break,
                }
            }
        }));
        dispatch!(level, simd => simd.vectorize(#[inline(always)] || {
            out.iter_mut().zip(&down[reach..]).for_each(|(sum, x)| *sum = kernel[0] * x);
            for (k, &weight) in kernel.iter().enumerate().skip(1) {
                add_both(out, weight, &down[reach - k..], &down[reach + k..]);
            }
        }));
        self.down = down;
    }
}

#[inline(always)]
fn add(sum: &mut [f64], weight: f64, x: &[f64]) {
    sum.iter_mut().zip(x).for_each(|(sum, x)| *sum += weight * x);
}

#[inline(always)]
fn add_both(sum: &mut [f64], weight: f64, x: &[f64], y: &[f64]) {
    sum.iter_mut().zip(x).zip(y).for_each(|((sum, x), y)| *sum += weight * (x + y));
}

#[cfg(test)]
mod tests {
    use turbid_contract::Ctx;
    use turbid_contract::kit::MemoryHost;

    use super::*;

    /// The convolution is symmetric: <a, G b> = <G a, b>, on every shape, to rounding; blocks of rows do not show.
    #[test]
    fn smoothing_is_its_own_transpose() {
        let host = MemoryHost::default();
        for (rows, columns) in [(1, 1), (7, 5), (3, 40), (300, 3)] {
            let room = Room::new(rows, columns, Ctx::new(&host));
            let gauss = Gauss::new(2.5);
            let wave = |k: f64| move |i: usize| (k * i as f64).sin();
            let smooth = |k: f64| gauss.sum(&room, wave(k), |_, x| x).expect("nobody cancels");
            let dot = |k: f64, b: &[f64]| b.iter().enumerate().map(|(i, b)| wave(k)(i) * b).sum::<f64>();
            let (left, right) = (dot(1.3, &smooth(0.7).pixels), dot(0.7, &smooth(1.3).pixels));
            assert!((left - right).abs() < 1e-11, "{rows} x {columns}: {left} {right}");
        }
    }

    /// A point spreads as exp(-r^2 / (2 sigma^2)); squared weights spread with sigma / sqrt 2.
    #[test]
    fn a_point_spreads_as_a_gaussian() {
        let host = MemoryHost::default();
        let room = Room::new(21, 21, Ctx::new(&host));
        let point = |i: usize| if i == 10 * 21 + 10 { 1.0 } else { 0.0 };
        let gauss = Gauss::new(2.0);
        let sum = gauss.sum(&room, point, |_, x| x).expect("nobody cancels");
        let squares = gauss.sum_of_squares(&room, point, |_, x| x).expect("nobody cancels");
        for (i, (sum, square)) in sum.pixels.iter().zip(&squares.pixels).enumerate() {
            let (dr, dc) = ((i / 21).abs_diff(10) as f64, (i % 21).abs_diff(10) as f64);
            let want = if dr.max(dc) <= 8.0 { (-(dr * dr + dc * dc) / 8.0).exp() } else { 0.0 };
            assert!((sum - want).abs() < 1e-15 && (square - want * want).abs() < 1e-15);
        }
        let alone = Gauss::new(0.0).sum(&room, point, |_, x| x).expect("nobody cancels");
        assert!(alone.pixels.iter().enumerate().all(|(i, x)| *x == point(i)));
    }
}
