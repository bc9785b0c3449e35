//! Whether a signal stands above its noise around a pixel: judged by the pixel's neighbours, never by the pixel itself.
//!
//! A limit on the pixel's own signal keeps those that noise has lifted and drops those that it has lowered: at 27 % of noise
//! per pixel a limit of 3 standard errors raises the mean of what is left by 6 %. Neighbours know as much about the
//! signal and nothing about the pixel's own noise, so what they drop leaves the mean alone.

use fearless_simd::{Level, Simd, dispatch};

use crate::robust::{Noisy, REACH, weak_by_medians};

/// Whether the good pixels among the 24 neighbours of each pixel of `row` have a mean of some quantity that is not above
/// `limit` times the root mean square of its standard errors, nor above it by medians, which a bright neighbour does not move; a
/// pixel without good neighbours is judged by itself.
pub fn weak_in_row(
    level: Level,
    quantities: &[Noisy<'_>],
    mask: &[f32],
    columns: usize,
    row: usize,
    limit: f64,
) -> Vec<bool> {
    let good = |m: f32| if m == 0.0 { 1.0 } else { 0.0 };
    let mut weak = vec![false; columns];
    dispatch!(level, simd => simd.vectorize(#[inline(always)] || {
        let counts = neighbours(good, mask, columns, row);
        for [value, se] in quantities {
            let signals = neighbours(f64::from, value, columns, row);
            let variances = neighbours(squared, se, columns, row);
            let own = row * columns..(row + 1) * columns;
            let alone = value[own.clone()].iter().zip(&se[own]);
            let around = signals.iter().zip(&variances).zip(&counts);
            for ((weak, (&value, &se)), ((&signal, &variance), &n)) in weak.iter_mut().zip(alone).zip(around) {
                let lone = n <= 0.0;
                let (n, signal) = (if lone { 1.0 } else { n }, if lone { f64::from(value) } else { signal });
                let variance = if lone { squared(se) } else { variance };
                // The difference of window and own pixel may leave a variance below 0 by a rounding error, that is 0.
                *weak |= signal <= limit * (n * variance.max(0.0)).sqrt();
            }
        }
    }));
    for (column, weak) in weak.iter_mut().enumerate().filter(|(_, weak)| **weak) {
        let pixel = row * columns + column;
        *weak = quantities.iter().any(|quantity| weak_by_medians(quantity, mask, columns, pixel, limit));
    }
    weak
}

#[inline(always)]
fn squared(se: f32) -> f64 {
    f64::from(se) * f64::from(se)
}

/// Sum of `of` over the neighbours of each pixel of `row`, the pixel itself left out.
#[inline(always)]
fn neighbours(of: impl Fn(f32) -> f64, plane: &[f32], columns: usize, row: usize) -> Vec<f64> {
    let line = |r: usize| &plane[r * columns..(r + 1) * columns];
    // Two zeros on each side: every window has five columns.
    let mut column_sums = vec![0.0; columns + 2 * REACH];
    for r in row.saturating_sub(REACH)..(row + REACH + 1).min(plane.len() / columns) {
        column_sums[REACH..].iter_mut().zip(line(r)).for_each(|(sum, &v)| *sum += of(v));
    }
    let mut out = vec![0.0; columns];
    for (c, (out, &own)) in out.iter_mut().zip(line(row)).enumerate() {
        let window: &[f64; 2 * REACH + 1] = column_sums[c..].first_chunk().expect("padded on both sides");
        *out = window.iter().fold(0.0, |sum, v| sum + v) - of(own);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weak(value: &[f32], se: &[f32], mask: &[f32], columns: usize) -> Vec<bool> {
        (0..value.len() / columns)
            .flat_map(|row| weak_in_row(Level::new(), &[[value, se]], mask, columns, row, 3.0))
            .collect()
    }

    /// A uniform field is weak as a whole or not at all, up to its borders; a lone pixel is judged by itself.
    #[test]
    fn uniform_fields_are_judged_alike() {
        for (rows, columns) in [(1, 1), (1, 9), (7, 6)] {
            let n = rows * columns;
            for (signal, want) in [(2.9_f32, true), (3.1, false), (0.0, true), (-1.0, true)] {
                let found = weak(&vec![signal; n], &vec![1.0; n], &vec![0.0; n], columns);
                assert_eq!(found, vec![want; n], "{rows} x {columns}, signal {signal}");
            }
        }
    }

    /// A pixel's own value has no say, masked neighbours have none either, and beyond two pixels nobody has.
    #[test]
    fn neighbours_decide() {
        let (rows, columns) = (7, 7);
        let n = rows * columns;
        let mut value = vec![4.0; n];
        let (mut se, mut mask) = (vec![1.0; n], vec![0.0; n]);
        let own = 3 * columns + 3;
        value[own] = -50.0;
        assert!(!weak(&value, &se, &mask, columns)[own], "what noise did to the pixel does not matter");
        assert!(weak(&value, &se, &mask, columns).iter().all(|weak| !weak), "nor does it to its neighbours");
        let dark: Vec<usize> = (0..n).filter(|i| i % columns >= 3).collect();
        dark.iter().for_each(|&i| value[i] = 0.5);
        let found = weak(&value, &se, &mask, columns);
        assert!(!found[2 * columns] && found[2 * columns + 6], "what most neighbours show counts");
        dark.iter().for_each(|&i| value[i] = 4.0);
        (value[own], se[own], mask[own]) = (0.0, 0.0, 1.0);
        assert!(weak(&value, &se, &mask, columns).iter().all(|weak| !weak), "a masked pixel has no say");
    }
}
