//! Sums over the paths of each pixel, from which means, variances and covariances follow.

/// Relative variance below which fourth moments, of which 1e-16 is rounding, say nothing.
const ROUNDING: f64 = 1e-6;

/// For each of `pixels` pixels: the sum of the `q` responses, then the sums of their products (i <= j, row by row), then those of the third and
/// fourth powers of the brightness.
#[derive(Clone, Debug, PartialEq)]
pub struct Moments {
    q: usize,
    /// Weights of the first and the last response in the brightness.
    weights: [f64; 2],
    sums: Vec<f64>,
}

impl Moments {
    pub fn new(pixels: usize, q: usize) -> Self {
        Self { q, weights: [0.5, 0.0], sums: vec![0.0; pixels * stride(q)] }
    }

    /// The brightness is M_DC: half the first response, and the last one where that is to steady light.
    #[must_use]
    pub fn with_steady(mut self, steady: bool) -> Self {
        self.weights[1] = f64::from(u8::from(steady && self.q > 1));
        self
    }

    pub fn sums(&self) -> &[f64] {
        &self.sums
    }

    pub fn sums_mut(&mut self) -> &mut [f64] {
        &mut self.sums
    }

    /// How many numbers a pixel holds.
    pub fn stride(&self) -> usize {
        stride(self.q)
    }

    /// Adds one path.
    #[inline]
    pub fn add(&mut self, pixel: usize, response: &[f64]) {
        let sums = &mut self.sums[pixel * stride(self.q)..][..stride(self.q)];
        // Most paths see nothing: neither the projector nor, at the end where there is any, steady light.
        if response[0] == 0.0 && response[self.q - 1] == 0.0 {
            return;
        }
        let (values, mut products) = sums.split_at_mut(self.q);
        for (i, (sum, &x)) in values.iter_mut().zip(response).enumerate() {
            *sum += x;
            let (row, rest) = products.split_at_mut(self.q - i);
            for (product, &y) in row.iter_mut().zip(&response[i..]) {
                *product += x * y;
            }
            products = rest;
        }
        let bright = self.weights[0] * response[0] + self.weights[1] * response[self.q - 1];
        let cube = bright * bright * bright;
        products[0] += cube;
        products[1] += cube * bright;
    }

    /// Adds the sums of pixels `first ..` in `other`.
    pub fn fold(&mut self, first: usize, other: &Moments) {
        let place = first * self.stride();
        for (sum, &part) in self.sums[place..].iter_mut().zip(&other.sums) {
            *sum += part;
        }
    }

    /// Adds the sums of the pixel `from` in `other` to those of `pixel`.
    pub fn fold_one(&mut self, pixel: usize, other: &Moments, from: usize) {
        let stride = self.stride();
        let part = &other.sums[from * stride..][..stride];
        self.sums[pixel * stride..][..stride].iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
    }

    /// Mean response i of a pixel over n paths.
    pub fn mean(&self, pixel: usize, i: usize, n: u32) -> f64 {
        self.sums[pixel * self.stride() + i] / f64::from(n)
    }

    /// Covariance of the means i and j of a pixel over n >= 2 paths.
    pub fn covariance(&self, pixel: usize, i: usize, j: usize, n: u32) -> f64 {
        let (i, j) = (i.min(j), i.max(j));
        let sums = &self.sums[pixel * self.stride()..][..self.stride()];
        let product = sums[self.q + i * self.q - i * (i + 1) / 2 + j];
        let n = f64::from(n);
        (product - sums[i] * sums[j] / n) / (n * (n - 1.0))
    }

    /// Of a path in a pixel that has had `n` >= 2.
    pub fn brightness(&self, pixel: usize, n: u32) -> Brightness {
        let sums = &self.sums[pixel * self.stride()..][..self.stride()];
        let (last, paths) = (self.q - 1, f64::from(n));
        let terms = [(0, self.weights[0]), (last, self.weights[1])];
        let mean = terms.iter().map(|&(i, w)| w * sums[i]).sum::<f64>() / paths;
        let pairs = terms.iter().flat_map(|a| terms.iter().map(move |b| (a, b)));
        let variance = paths * pairs.map(|(a, b)| a.1 * b.1 * self.covariance(pixel, a.0, b.0, n)).sum::<f64>();
        let [.., third, fourth] = *sums else { unreachable!("both stand at the end") };
        let second = variance * (paths - 1.0) / paths + mean * mean;
        let about = fourth / paths - 4.0 * mean * third / paths + 6.0 * mean * mean * second - 3.0 * mean.powi(4);
        let variance = variance.max(0.0);
        // Where paths hardly differ the fourth moment is lost in rounding: as of a normal variable. There is none below the square of the variance.
        let lost = variance < ROUNDING * mean * mean;
        let least = (variance * (paths - 1.0) / paths).powi(2);
        let fourth = if lost { 3.0 * variance * variance } else { about.max(least) };
        Brightness { mean, variance, fourth, paths }
    }
}

/// What is known of the brightness of a pixel's paths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Brightness {
    pub mean: f64,
    /// Of one path.
    pub variance: f64,
    /// Fourth central moment of one path.
    pub fourth: f64,
    pub paths: f64,
}

fn stride(q: usize) -> usize {
    q + q * (q + 1) / 2 + 2
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against the definition, on responses whose sums are exact in binary.
    #[test]
    fn means_and_covariances_are_those_of_the_paths() {
        let paths = [[1.0, -2.0, 0.5], [0.0, 0.0, 0.0], [3.0, 0.25, -1.0], [2.0, 2.0, 8.0]];
        let mut moments = Moments::new(3, 3);
        for half in paths.chunks(2) {
            let mut part = Moments::new(1, 3);
            half.iter().for_each(|path| part.add(0, path));
            moments.fold(1, &part);
        }
        let mean = |i: usize| paths.iter().map(|p| p[i]).sum::<f64>() / 4.0;
        for i in 0..3 {
            assert_eq!(moments.mean(1, i, 4), mean(i));
            assert_eq!(moments.mean(0, i, 4), 0.0);
            for j in 0..3 {
                let cov = paths.iter().map(|p| (p[i] - mean(i)) * (p[j] - mean(j))).sum::<f64>() / 3.0 / 4.0;
                assert!((moments.covariance(1, i, j, 4) - cov).abs() < 1e-15, "{i} {j}");
            }
        }
    }

    /// Moments about the mean of half the first response, and of that with the last, against the definition: 1e-13 of numbers of some 10^2.
    #[test]
    fn brightness_is_that_of_the_paths() {
        let paths = [[1.0, -2.0, 0.5], [0.0, 0.0, 0.0], [3.0, 0.25, 1.0], [2.0, 2.0, 8.0]];
        for steady in [false, true] {
            let mut moments = Moments::new(1, 3).with_steady(steady);
            paths.iter().for_each(|path| moments.add(0, path));
            let bright = paths.map(|path| 0.5 * path[0] + if steady { path[2] } else { 0.0 });
            let mean = bright.iter().sum::<f64>() / 4.0;
            let central = |power: i32| bright.iter().map(|b| (b - mean).powi(power)).sum::<f64>();
            let found = moments.brightness(0, 4);
            assert_eq!(found.mean, mean);
            assert!(
                (found.variance - central(2) / 3.0).abs() < 1e-13 && (found.fourth - central(4) / 4.0).abs() < 1e-13
            );
        }
    }
}
