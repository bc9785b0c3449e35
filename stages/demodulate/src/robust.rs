//! The second opinion on a weak signal: by medians, which one bright neighbour does not move.
//!
//! One path that brings much light makes a pixel bright and its standard error as large. In sums over 24 neighbours it is a 24th of the
//! signal but nearly all of the noise, and 24 good pixels would be called weak for its sake. Half of the neighbours would have
//! to be of that kind before medians saw them.

/// Neighbours on each side of a pixel.
pub const REACH: usize = 2;

/// A quantity and its standard error, row by row; both 0 at masked pixels.
pub type Noisy<'a> = [&'a [f32]; 2];

/// Variance over the median of its estimates. An estimate of nu degrees of freedom has a median of (1 - 2 / (9 nu))^3 of its mean (Wilson and
/// Hilferty, Proc. Natl. Acad. Sci. 17, 684, 1931): at nu = 8, a renderer's smallest number of batches, 1 / 1.088. With more degrees of freedom the
/// ratio goes to 1, and the limit on the signal is up to 4 % too strict.
const OVER_MEDIAN: f64 = 1.088;

/// Whether the median of the good neighbours of a pixel is not above `limit` times the square root of `OVER_MEDIAN` times the median
/// of their variances; a pixel without good neighbours is judged by itself.
pub fn weak_by_medians([value, se]: &Noisy<'_>, mask: &[f32], columns: usize, pixel: usize, limit: f64) -> bool {
    let (row, column, rows) = (pixel / columns, pixel % columns, mask.len() / columns);
    let (mut values, mut errors) = ([0.0_f32; AROUND], [0.0_f32; AROUND]);
    let mut n = 0;
    for r in row.saturating_sub(REACH)..(row + REACH + 1).min(rows) {
        for c in column.saturating_sub(REACH)..(column + REACH + 1).min(columns) {
            let i = r * columns + c;
            if i != pixel && mask[i] == 0.0 {
                (values[n], errors[n]) = (value[i], se[i]);
                n += 1;
            }
        }
    }
    if n == 0 {
        return f64::from(value[pixel]) <= limit * f64::from(se[pixel]);
    }
    // The median of squares is the square of the median, but for the mean of two.
    median(&mut values[..n]) <= limit * OVER_MEDIAN.sqrt() * median(&mut errors[..n])
}

/// Neighbours of a pixel.
const AROUND: usize = (2 * REACH + 1) * (2 * REACH + 1) - 1;

/// The middle one, or the mean of the two in the middle.
fn median(values: &mut [f32]) -> f64 {
    values.sort_unstable_by(f32::total_cmp);
    let half = values.len() / 2;
    let upper = f64::from(values[half]);
    if values.len() % 2 == 1 { upper } else { 0.5 * (upper + f64::from(values[half - 1])) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_are_the_middle() {
        assert_eq!(median(&mut [3.0, 1.0, 9.0]), 3.0);
        assert_eq!(median(&mut [3.0, 1.0, 9.0, 4.0]), 3.5);
    }

    /// Eleven of 24 neighbours may be as bright as they like; a signal of 3.1 standard errors is weak, one of 3.2 not, if the limit is 3.
    #[test]
    fn outliers_have_no_say() {
        let (columns, n) = (5, 25);
        for (signal, want) in [(3.1_f32, true), (3.2, false)] {
            let (mut value, mut se) = (vec![signal; n], vec![1.0_f32; n]);
            for i in 0..11 {
                (value[i], se[i]) = (1e6, 1e6);
            }
            assert_eq!(weak_by_medians(&[&value, &se], &vec![0.0; n], columns, 12, 3.0), want, "{signal}");
        }
        assert!(weak_by_medians(&[&[2.0], &[1.0]], &[0.0], 1, 0, 3.0), "alone");
    }

    /// Variances of 8 degrees of freedom: the factor brings their median to their mean, to 2 % (the mean of 20,000 of them is
    /// known to 0.35 %, their median to 0.45 %: 3.5 standard errors).
    #[test]
    fn the_factor_is_that_of_eight_batches() {
        let mut state = 7_u64;
        let mut normal = || {
            let mut uniform = || {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                ((state >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
            };
            libm::sqrt(-2.0 * libm::log(uniform())) * libm::cos(std::f64::consts::TAU * uniform())
        };
        let mut variances: Vec<f32> =
            (0..20_000).map(|_| ((0..8).map(|_| normal()).map(|x| x * x).sum::<f64>() / 8.0) as f32).collect();
        let mean = variances.iter().map(|&v| f64::from(v)).sum::<f64>() / 20_000.0;
        let ratio = mean / median(&mut variances);
        assert!((ratio / OVER_MEDIAN - 1.0).abs() < 0.02, "{ratio}");
    }
}
