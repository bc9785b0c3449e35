//! Two levels in place of grey: thresholds and dithering, as for projectors whose mirrors are on or off.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How grey becomes black and white.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Dither {
    /// Not at all.
    #[default]
    None,
    /// White from 1/2 on.
    Threshold,
    /// The error of a pixel goes to its neighbours in the ratio 7 : 3 : 5 : 1, line by line from the left (Floyd, Steinberg 1976).
    FloydSteinberg,
    /// Against the 8 x 8 matrix of Bayer (1973).
    Ordered,
}

/// The pixels of `columns` values a row, in [0, 1], as 0 and 1.
pub fn dither(how: Dither, values: &mut [f32], columns: usize) {
    match how {
        Dither::None => {}
        Dither::Threshold => values.iter_mut().for_each(|v| *v = f32::from(*v >= 0.5)),
        Dither::FloydSteinberg => floyd_steinberg(values, columns),
        Dither::Ordered => {
            for (i, v) in values.iter_mut().enumerate() {
                let (row, column) = (i / columns, i % columns);
                *v = f32::from(f64::from(*v) > threshold(row, column));
            }
        }
    }
}

fn floyd_steinberg(values: &mut [f32], columns: usize) {
    // Of this line and the next, with one place beyond each end.
    let (mut here, mut below) = (vec![0.0_f64; columns + 2], vec![0.0_f64; columns + 2]);
    for line in values.chunks_mut(columns) {
        for (i, v) in line.iter_mut().enumerate() {
            let wanted = f64::from(*v) + here[i + 1];
            let shown = if wanted >= 0.5 { 1.0 } else { 0.0 };
            let error = (wanted - shown) / 16.0;
            here[i + 2] += 7.0 * error;
            below[i] += 3.0 * error;
            below[i + 1] += 5.0 * error;
            below[i + 2] += error;
            *v = shown as f32;
        }
        std::mem::swap(&mut here, &mut below);
        below.fill(0.0);
    }
}

/// In (0, 1), all 64 multiples of 1/64 less a half: bits of column xor row and row, interleaved from the lowest.
fn threshold(row: usize, column: usize) -> f64 {
    let mut rank = 0;
    for bit in 0..3 {
        let (r, c) = (row >> bit & 1, column >> bit & 1);
        rank = rank << 2 | (r ^ c) << 1 | r;
    }
    (rank as f64 + 0.5) / 64.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Both keep the mean of an even grey: ordered exactly for multiples of 1/64 over whole tiles, error diffusion up to what runs out
    /// at the edges.
    #[test]
    fn dithering_keeps_the_mean() {
        let (rows, columns) = (256, 256);
        for level in [0.0, 0.125, 0.5, 0.703_125, 1.0] {
            for how in [Dither::Ordered, Dither::FloydSteinberg] {
                let mut values = vec![level as f32; rows * columns];
                dither(how, &mut values, columns);
                assert!(values.iter().all(|&v| v == 0.0 || v == 1.0));
                let mean = values.iter().map(|&v| f64::from(v)).sum::<f64>() / values.len() as f64;
                // An error of at most 1/2 is lost at each pixel of three edges, 3/16 to 9/16 of it.
                let lost = if how == Dither::Ordered { 0.0 } else { 0.5 * (2.0 + 1.0) / columns as f64 };
                assert!((mean - level).abs() <= lost + 1e-12, "{how:?} {level}: {mean}");
            }
        }
        let mut ranks: Vec<u32> = (0..64).map(|i| (threshold(i / 8, i % 8) * 64.0) as u32).collect();
        ranks.sort_unstable();
        assert!(ranks.iter().copied().eq(0..64));
    }

    /// The noise of error diffusion lies at high frequencies: over blocks of 8 x 8 pixels its mean is nearer to the grey than that
    /// of a coin with the same mean would be (deviation 1/2 over 8), by more than four times.
    #[test]
    fn error_diffusion_is_quiet_over_blocks() {
        let n = 256;
        let mut values: Vec<f32> = (0..n * n).map(|i| 0.3 + 0.3 * (i % n) as f32 / n as f32).collect();
        let grey = values.clone();
        dither(Dither::FloydSteinberg, &mut values, n);
        let mut square = 0.0;
        for (row, column) in (0..n / 8).flat_map(|r| (0..n / 8).map(move |c| (8 * r, 8 * c))) {
            let block = (0..64).map(|k| (row + k / 8) * n + column + k % 8);
            square += block.map(|i| f64::from(values[i] - grey[i])).sum::<f64>().powi(2) / 64.0 / 64.0;
        }
        let deviation = (square / (n * n / 64) as f64).sqrt();
        assert!(deviation < 0.5 / 8.0 / 4.0, "{deviation}");
    }
}
