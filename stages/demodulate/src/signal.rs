//! Whether a signal stands above its noise around a pixel: judged by the pixel's neighbours, never by the pixel itself.
//!
//! A limit on the pixel's own signal keeps those that noise has lifted and drops those that it has lowered: at 27 % of noise
//! per pixel a limit of 3 standard errors raises the mean of what is left by 6 %. Neighbours know as much about the
//! signal and nothing about the pixel's own noise, so what they drop leaves the mean alone.

/// Neighbours on each side of a pixel.
const REACH: usize = 2;

/// A quantity and its standard error, row by row; both 0 at masked pixels.
pub type Noisy<'a> = [&'a [f32]; 2];

/// Whether the good pixels among the 24 neighbours of each pixel of `row` have a mean of some quantity that is not above
/// `limit` times the root mean square of its standard errors; a pixel without good neighbours is judged by itself.
pub fn weak_in_row(quantities: &[Noisy<'_>], mask: &[f32], columns: usize, row: usize, limit: f64) -> Vec<bool> {
    let good = neighbours(|i| f64::from(u8::from(mask[i] == 0.0)), mask.len(), columns, row);
    let mut weak = vec![false; columns];
    for [value, se] in quantities {
        let squared = |i: usize| f64::from(se[i]) * f64::from(se[i]);
        let signals = neighbours(|i| f64::from(value[i]), mask.len(), columns, row);
        let variances = neighbours(squared, mask.len(), columns, row);
        for (c, weak) in weak.iter_mut().enumerate() {
            let own = row * columns + c;
            let (n, signal, variance) = match good[c] > 0.0 {
                true => (good[c], signals[c], variances[c]),
                false => (1.0, f64::from(value[own]), squared(own)),
            };
            // The difference of window and own pixel may leave a variance below 0 by a rounding error, that is 0.
            *weak |= signal <= limit * (n * variance.max(0.0)).sqrt();
        }
    }
    weak
}

/// Sum of `of` over the neighbours of each pixel of `row`, the pixel itself left out, in an image of `count` pixels.
fn neighbours(of: impl Fn(usize) -> f64, count: usize, columns: usize, row: usize) -> Vec<f64> {
    let mut column_sums = vec![0.0; columns];
    for r in row.saturating_sub(REACH)..(row + REACH + 1).min(count / columns) {
        column_sums.iter_mut().enumerate().for_each(|(c, sum)| *sum += of(r * columns + c));
    }
    let window = |c: usize| &column_sums[c.saturating_sub(REACH)..(c + REACH + 1).min(columns)];
    (0..columns).map(|c| window(c).iter().sum::<f64>() - of(row * columns + c)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weak(value: &[f32], se: &[f32], mask: &[f32], columns: usize) -> Vec<bool> {
        (0..value.len() / columns).flat_map(|row| weak_in_row(&[[value, se]], mask, columns, row, 3.0)).collect()
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
        assert!(weak(&value, &se, &mask, columns)[own + 2] && !weak(&value, &se, &mask, columns)[own + 3]);
        (value[own], se[own], mask[own]) = (0.0, 0.0, 1.0);
        assert!(weak(&value, &se, &mask, columns).iter().all(|weak| !weak), "a masked pixel has no say");
    }
}
