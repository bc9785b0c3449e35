//! Speckle: the intensity of a random field, as coherent light or a seeded mask makes it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use turbid_contract::{Length, Ratio};
use turbid_optics::philox;

/// Fully developed speckle over an even background.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Speckle {
    /// Distance (mm, in the pattern's plane) over which the autocovariance of the pattern falls to 1/e; it is a Gaussian.
    pub correlation_length: Length,
    /// Standard deviation over mean, in (0, 1].
    #[serde(default = "full")]
    pub contrast: Ratio,
    /// Patterns, independent of each other.
    #[serde(default = "one")]
    pub count: u32,
}

fn full() -> Ratio {
    Ratio(1.0)
}

fn one() -> u32 {
    1
}

/// Standard deviations of the Gaussian at which its kernel ends: what is cut off is 6e-7.
const CUT: f64 = 5.0;

/// Number `index` of the patterns of `key`, row by row, scaled so that its brightest pixel is 1.
///
/// |E|^2 of a complex Gaussian field E: white noise smoothed by a Gaussian of the deviation l / sqrt 2, whose autocorrelation is
/// exp(-d^2 / 2 l^2), that of |E|^2 its square. Mean and deviation of |E|^2 are equal, so 1 - C + C |E|^2 has the contrast C. (Goodman,
/// Speckle Phenomena in Optics, 2007, chapters 3 and 4.)
pub fn speckle(speckle: &Speckle, pitch: [f64; 2], columns: usize, rows: usize, key: [u32; 2], index: u32) -> Vec<f32> {
    let kernels = pitch.map(|pitch| kernel(speckle.correlation_length.0 / pitch * std::f64::consts::FRAC_1_SQRT_2));
    // Noise also beyond the edges, so that they are like the middle.
    let reach = [kernels[0].len() / 2, kernels[1].len() / 2];
    let (wide, high) = (columns + 2 * reach[0], rows + 2 * reach[1]);
    let mut intensity = vec![0.0_f64; rows * columns];
    for part in 0..2 {
        let noise: Vec<f64> = (0..wide * high).map(|i| normal(key, i as u64, index, part)).collect();
        let mut smooth = vec![0.0_f64; columns * high];
        for (line, out) in noise.chunks(wide).zip(smooth.chunks_mut(columns)) {
            for (column, out) in out.iter_mut().enumerate() {
                *out = kernels[0].iter().zip(&line[column..]).map(|(k, v)| k * v).sum();
            }
        }
        let mut line = vec![0.0; columns];
        for (row, out) in intensity.chunks_mut(columns).enumerate() {
            line.fill(0.0);
            for (k, from) in kernels[1].iter().zip(smooth[row * columns..].chunks(columns)) {
                line.iter_mut().zip(from).for_each(|(l, v)| *l += k * v);
            }
            // Each part has half of the mean.
            out.iter_mut().zip(&line).for_each(|(o, v)| *o += 0.5 * v * v);
        }
    }
    let contrast = speckle.contrast.0;
    intensity.iter_mut().for_each(|v| *v = 1.0 - contrast + contrast * *v);
    let most = intensity.iter().copied().fold(0.0, f64::max);
    intensity.iter().map(|v| (v / most) as f32).collect()
}

/// Gaussian of this deviation (pixels) whose squares add up to 1: it keeps the variance of white noise.
fn kernel(deviation: f64) -> Vec<f64> {
    let reach = (CUT * deviation).ceil() as i64;
    let mut kernel: Vec<f64> = (-reach..=reach).map(|i| libm::exp(-0.5 * (i as f64 / deviation).powi(2))).collect();
    let norm = kernel.iter().map(|k| k * k).sum::<f64>().sqrt();
    kernel.iter_mut().for_each(|k| *k /= norm);
    kernel
}

/// A normal deviate for each place, by Box and Muller.
fn normal(key: [u32; 2], place: u64, index: u32, part: u32) -> f64 {
    let bits = philox::philox4x32([place as u32, (place >> 32) as u32, index, part], key);
    let (u, v) = (philox::unit_fine(bits[0], bits[1]), philox::unit(bits[2]));
    (-2.0 * libm::log(u)).sqrt() * turbid_optics::elementary::sin_cos_turns(v).1
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Contrast and autocovariance are what was asked for. The 240^2 mm hold about 240^2 / (2 pi l^2) independent speckles (l = 2 mm: 2290),
    /// so that the mean and the deviation are known to 1 / sqrt(2290) and, as the fourth moment of an exponential has it, to
    /// sqrt(8) / 2 / sqrt(2290) relative: 4 sigma.
    #[test]
    fn contrast_and_size_are_what_was_asked_for() {
        let (columns, rows, pitch) = (480, 240, [0.5, 1.0]);
        for contrast in [1.0, 0.4] {
            let wanted = Speckle { correlation_length: Length(2.0), contrast: Ratio(contrast), count: 1 };
            let v = speckle(&wanted, pitch, columns, rows, [7, 9], 0);
            let n = v.len() as f64;
            let mean = v.iter().map(|&v| f64::from(v)).sum::<f64>() / n;
            let covariance = |dx: usize, dy: usize| {
                let (mut sum, mut count) = (0.0, 0.0);
                for (row, column) in (0..rows - dy).flat_map(|r| (0..columns - dx).map(move |c| (r, c))) {
                    let (a, b) = (v[row * columns + column], v[(row + dy) * columns + column + dx]);
                    sum += (f64::from(a) - mean) * (f64::from(b) - mean);
                    count += 1.0;
                }
                sum / count
            };
            let variance = covariance(0, 0);
            let speckles = 240.0 * 240.0 / (std::f64::consts::TAU * 4.0);
            let sigma = 2.0_f64.sqrt() / f64::sqrt(speckles);
            assert!(
                (variance.sqrt() / mean / contrast - 1.0).abs() < 4.0 * sigma,
                "{} {contrast}",
                variance.sqrt() / mean
            );
            // Four pixels along x and two along y are both the correlation length.
            for (dx, dy) in [(4, 0), (0, 2)] {
                let ratio = covariance(dx, dy) / variance;
                assert!((ratio - (-1.0_f64).exp()).abs() < 4.0 * sigma, "{dx} {dy}: {ratio}");
            }
            assert!(v.iter().all(|&v| (0.0..=1.0).contains(&v)) && v.contains(&1.0));
        }
    }

    /// Patterns of one key are independent: their correlation is 0 within 4 / sqrt(number of speckles).
    #[test]
    fn patterns_are_independent() {
        let wanted = Speckle { correlation_length: Length(2.0), contrast: Ratio(1.0), count: 2 };
        let [a, b] = [0, 1].map(|i| speckle(&wanted, [1.0, 1.0], 128, 128, [1, 2], i));
        let mean = |v: &[f32]| v.iter().map(|&v| f64::from(v)).sum::<f64>() / v.len() as f64;
        let (ma, mb) = (mean(&a), mean(&b));
        let product = |a: &[f32], ma: f64, b: &[f32], mb: f64| {
            a.iter().zip(b).map(|(&a, &b)| (f64::from(a) - ma) * (f64::from(b) - mb)).sum::<f64>()
        };
        let r = product(&a, ma, &b, mb) / (product(&a, ma, &a, ma) * product(&b, mb, &b, mb)).sqrt();
        let speckles = 128.0 * 128.0 / (std::f64::consts::TAU * 4.0);
        assert!(r.abs() < 4.0 / f64::sqrt(speckles), "{r}");
    }
}
