//! Random heights with a Gaussian covariance.

use turbid_draw::normal_quantile;
use turbid_optics::philox::{key, philox4x32, unit_fine};

/// Nodes of white noise for each correlation length: the covariance is off by a share of 4e-10.
const NODES: f64 = 3.0;
/// Correlation lengths to either side from which noise reaches: what lies beyond has weights below 2e-8.
const REACH: f64 = 3.0;

/// A Gaussian random field of mean 0 with the covariance amplitude^2 exp(-(r / correlation_length)^2), at the crossings of lines along y
/// at `x` and lines along x at `y`, mm; those of one `y` side by side.
///
/// It is white noise on a lattice, smoothed by exp(-2 (r / correlation_length)^2): the kernel whose correlation with itself is the
/// covariance. Each node's noise is a function of the seed and its place, so that the same seed gives the same hills on any lattice of
/// lines, however far it reaches.
pub fn heights(x: &[f64], y: &[f64], amplitude: f64, correlation_length: f64, seed: u64) -> Vec<f64> {
    let node = correlation_length / NODES;
    let (along_x, along_y) =
        (Smoothing::onto(x, node, correlation_length), Smoothing::onto(y, node, correlation_length));
    let key = key(seed);
    let noise = |i: i64, j: i64| {
        let bits = philox4x32([i as u32, j as u32, 0, 0], key);
        normal_quantile(unit_fine(bits[0], bits[1]))
    };
    // First along x, for each row of nodes that any y asks for.
    let rows = along_y.nodes();
    let smoothed: Vec<Vec<f64>> = rows.clone().map(|j| along_x.of(|i| noise(i, j))).collect();
    let columns = (0..x.len()).map(|column| along_y.of(|j| smoothed[(j - rows.start) as usize][column]));
    let mut heights = vec![0.0; x.len() * y.len()];
    for (column, values) in columns.enumerate() {
        for (row, value) in values.into_iter().enumerate() {
            heights[row * x.len() + column] = amplitude * value;
        }
    }
    heights
}

/// Weights of nodes along one axis, for each place.
struct Smoothing {
    /// The first node, and the weights from there on.
    weights: Vec<(i64, Vec<f64>)>,
}

impl Smoothing {
    /// Their squares sum to 1: the integral of exp(-4 u^2), node by node.
    fn onto(places: &[f64], node: f64, length: f64) -> Self {
        let norm = libm::sqrt(2.0 * node / (length * libm::sqrt(std::f64::consts::PI)));
        let reach = REACH * length;
        let weights = |&at: &f64| {
            let (first, last) = (((at - reach) / node).ceil() as i64, ((at + reach) / node).floor() as i64);
            let weight = |i: i64| {
                let u = (at - i as f64 * node) / length;
                norm * libm::exp(-2.0 * u * u)
            };
            (first, (first..=last).map(weight).collect())
        };
        Self { weights: places.iter().map(weights).collect() }
    }

    fn nodes(&self) -> std::ops::Range<i64> {
        let first = self.weights.iter().map(|w| w.0).min().unwrap_or(0);
        let last = self.weights.iter().map(|w| w.0 + w.1.len() as i64).max().unwrap_or(0);
        first..last
    }

    /// The sum over nodes, at each place.
    fn of(&self, noise: impl Fn(i64) -> f64) -> Vec<f64> {
        let nodes = self.nodes();
        let noise: Vec<f64> = nodes.clone().map(noise).collect();
        let sum = |(first, weights): &(i64, Vec<f64>)| {
            let from = (first - nodes.start) as usize;
            weights.iter().zip(&noise[from..]).map(|(w, n)| w * n).sum()
        };
        self.weights.iter().map(sum).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Over seeds the products of heights at two places have the covariance as their mean, with the standard deviation
    /// sqrt(1 + C^2) of a Gaussian pair (Isserlis); within 4.5 of its standard errors: 60 comparisons raise one false alarm in 2500.
    #[test]
    fn covariance_is_gaussian() {
        const SEEDS: u64 = 4000;
        let (amplitude, length) = (1.5, 8.0);
        // Off the nodes, at steps of 0, 1/4, 1/2, 1 and 2 correlation lengths.
        let x = [0.37, 2.37, 4.37, 8.37, 16.37];
        let y = [-3.1, 4.9];
        let mut sums = vec![0.0; 100];
        let mut means = [0.0; 10];
        for seed in 0..SEEDS {
            let h = heights(&x, &y, amplitude, length, seed);
            for a in 0..10 {
                means[a] += h[a];
                for b in a..10 {
                    sums[10 * a + b] += h[a] * h[b];
                }
            }
        }
        let (n, variance) = (SEEDS as f64, amplitude * amplitude);
        for a in 0..10 {
            assert!((means[a] / n).abs() < 4.5 * amplitude / n.sqrt(), "mean at {a}: {}", means[a] / n);
            for b in a..10 {
                let (dx, dy) = (x[a % 5] - x[b % 5], y[a / 5] - y[b / 5]);
                let share = (-(dx * dx + dy * dy) / (length * length)).exp();
                let (found, se) = (sums[10 * a + b] / n, variance * ((1.0 + share * share) / n).sqrt());
                assert!((found - variance * share).abs() < 4.5 * se, "{dx}, {dy}: {found}, not {}", variance * share);
            }
        }
    }

    /// The covariance as the weights give it, without noise: at every place the same, 1 and 1/e.
    #[test]
    fn weights_give_the_covariance() {
        for at in [0.0, 0.1, 1.0, 1.37, -51.3] {
            let both = Smoothing::onto(&[at, at + 8.0], 8.0 / NODES, 8.0);
            let product = |a: usize, b: usize| {
                let ((first, one), (second, other)) = (&both.weights[a], &both.weights[b]);
                let of = |i: i64| other.get(usize::try_from(i - second).ok()?).copied();
                one.iter().enumerate().filter_map(|(i, w)| Some(w * of(first + i as i64)?)).sum::<f64>()
            };
            // The cut at 3 correlation lengths takes exp(-36) of the variance, and exp(-2 * 3^2 - 2 * 2^2) of the covariance at 1.
            assert!((product(0, 0) - 1.0).abs() < 1e-9, "{}", product(0, 0));
            assert!((product(0, 1) - (-1f64).exp()).abs() < 1e-9, "{}", product(0, 1));
        }
    }

    /// The same hills on a larger lattice, to the bit.
    #[test]
    fn a_larger_lattice_has_the_same_hills() {
        let few = heights(&[0.0, 1.0], &[0.5], 1.0, 4.0, 7);
        let many = heights(&[-90.0, 0.0, 1.0, 60.0], &[-33.0, 0.5, 80.0], 1.0, 4.0, 7);
        assert_eq!(few, many[5..7]);
        assert_ne!(few, heights(&[0.0, 1.0], &[0.5], 1.0, 4.0, 8));
    }
}
