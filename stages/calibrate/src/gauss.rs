//! Gaussian smoothing of an image with holes: normalised convolution, its noise, and its transpose.

use std::ops::Range;

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

    /// Whether it leaves the image alone.
    pub fn is_none(&self) -> bool {
        self.kernel.len() == 1
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

/// Columns that are worked on at a time: what of the rows within reach belongs to them stays in the cache of a core.
const TILE: usize = 256;
/// Columns whose sums are in registers at a time.
const STRIP: usize = 16;

/// Convolution with `kernel` along columns, then rows; beyond the border nothing takes part.
///
/// The neighbours at equal distances are added before they are weighted. Rows of `x` are made as they come within reach.
fn separable<'r>(
    room: &'r Room<'_>,
    kernel: &[f64],
    x: impl Fn(usize) -> f64 + Sync,
    end: impl Fn(usize, f64) -> f64 + Sync,
) -> Result<Plane<'r>, Error> {
    let (rows, columns, reach) = (room.rows, room.columns, kernel.len() - 1);
    room.fill(|block, pixels| {
        if reach == 0 {
            pixels.iter_mut().zip(block.start * columns..).for_each(|(out, i)| *out = end(i, x(i)));
            return;
        }
        for first in (0..columns).step_by(TILE) {
            let tile = first..(first + TILE).min(columns);
            let mut window = Window::new(tile.clone(), columns, reach);
            let mut next = block.start.saturating_sub(reach);
            for (r, out) in block.clone().zip(pixels.chunks_mut(columns)) {
                while next < (r + reach + 1).min(rows) {
                    window.fill(next, |column| x(next * columns + column));
                    next += 1;
                }
                let out = &mut out[tile.clone()];
                window.convolve(room.level, kernel, r, rows, out);
                out.iter_mut().zip(r * columns + first..).for_each(|(out, i)| *out = end(i, *out));
            }
        }
    })
}

/// The rows within reach of one, as far as a tile of columns reaches.
struct Window {
    reach: usize,
    /// The columns that the image has of them, and how many stand before these.
    columns: Range<usize>,
    before: usize,
    /// Numbers of a row: a whole number of strips.
    stride: usize,
    /// Row r in the place of r modulo how many there are; 0 beyond the border.
    rows: Vec<f64>,
    /// A row convolved along columns.
    down: Vec<f64>,
}

impl Window {
    fn new(tile: Range<usize>, columns: usize, reach: usize) -> Self {
        let stride = (tile.len().next_multiple_of(STRIP) + 2 * reach).next_multiple_of(STRIP);
        let before = reach - reach.min(tile.start);
        let columns = tile.start - reach.min(tile.start)..(tile.end + reach).min(columns);
        Self { reach, columns, before, stride, rows: vec![0.0; (2 * reach + 1) * stride], down: vec![0.0; stride] }
    }

    fn start(&self, row: usize) -> usize {
        row % (2 * self.reach + 1) * self.stride
    }

    fn fill(&mut self, row: usize, x: impl Fn(usize) -> f64) {
        let start = self.start(row) + self.before;
        self.rows[start..].iter_mut().zip(self.columns.clone()).for_each(|(to, column)| *to = x(column));
    }

    fn convolve(&mut self, level: Level, kernel: &[f64], r: usize, rows: usize, out: &mut [f64]) {
        let (stride, reach) = (self.stride, self.reach);
        let mut down = std::mem::take(&mut self.down);
        let row = |r: usize| &self.rows[self.start(r)..][..stride];
        dispatch!(level, simd => simd.vectorize(#[inline(always)] || {
            for (strip, to) in down.chunks_exact_mut(STRIP).enumerate() {
                let part = |r: usize| &row(r)[strip * STRIP..][..STRIP];
                let mut sum = [0.0; STRIP];
                sum.iter_mut().zip(part(r)).for_each(|(sum, x)| *sum = kernel[0] * x);
                for (k, &weight) in kernel.iter().enumerate().skip(1) {
                    match (r.checked_sub(k), r + k < rows) {
                        (Some(above), true) => add_both(&mut sum, weight, part(above), part(r + k)),
                        (Some(other), false) => add(&mut sum, weight, part(other)),
                        (None, true) => add(&mut sum, weight, part(r + k)),
                        (None, false) => break,
                    }
                }
                to.copy_from_slice(&sum);
            }
        }));
        dispatch!(level, simd => simd.vectorize(#[inline(always)] || {
            for (strip, to) in out.chunks_mut(STRIP).enumerate() {
                let part = |shift: usize| &down[strip * STRIP + shift..][..STRIP];
                let mut sum = [0.0; STRIP];
                sum.iter_mut().zip(part(reach)).for_each(|(sum, x)| *sum = kernel[0] * x);
                for (k, &weight) in kernel.iter().enumerate().skip(1) {
                    add_both(&mut sum, weight, part(reach - k), part(reach + k));
                }
                to.copy_from_slice(&sum[..to.len()]);
            }
        }));
        self.down = down;
    }
}

#[inline(always)]
fn add(sum: &mut [f64; STRIP], weight: f64, x: &[f64]) {
    sum.iter_mut().zip(x).for_each(|(sum, x)| *sum += weight * x);
}

#[inline(always)]
fn add_both(sum: &mut [f64; STRIP], weight: f64, x: &[f64], y: &[f64]) {
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
