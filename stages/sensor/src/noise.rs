//! Random numbers of one pixel of one frame: shot noise and read noise.

use turbid_optics::philox::{philox4x32, unit_fine};

/// Numbers in (0, 1), a function of key, frame and pixel and of how many were taken.
pub struct Draws {
    key: [u32; 2],
    counter: [u32; 4],
}

impl Draws {
    pub fn new(key: [u32; 2], frame: usize, pixel: usize) -> Self {
        Self { key, counter: [pixel as u32, (pixel >> 32) as u32, frame as u32, 0] }
    }

    /// Two numbers with 52 bits.
    fn pair(&mut self) -> [f64; 2] {
        let [a, b, c, d] = philox4x32(self.counter, self.key);
        self.counter[3] += 1;
        [unit_fine(a, b), unit_fine(c, d)]
    }

    /// Normal with mean 0 and variance 1 (Box-Muller).
    pub fn normal(&mut self) -> f64 {
        let [u, v] = self.pair();
        (-2.0 * libm::log(u)).sqrt() * libm::cos(2.0 * std::f64::consts::PI * v)
    }
}

/// A Poisson number of the given mean: products of uniforms below 10, else transformed rejection (Hoermann, "The transformed rejection
/// method for generating Poisson random variables", Insurance: Mathematics and Economics 12, 39 (1993), algorithm PTRS). Both are exact.
pub fn poisson(mean: f64, draws: &mut Draws) -> f64 {
    if mean < 10.0 {
        let end = libm::exp(-mean);
        let (mut product, mut count) = (1.0, -1.0);
        loop {
            for u in draws.pair() {
                product *= u;
                count += 1.0;
                if product <= end {
                    return count;
                }
            }
        }
    }
    let b = 0.931 + 2.53 * mean.sqrt();
    let a = -0.059 + 0.02483 * b;
    let inverse_alpha = 1.1239 + 1.1328 / (b - 3.4);
    let v_r = 0.9277 - 3.6224 / (b - 2.0);
    loop {
        let [u, v] = draws.pair();
        let u = u - 0.5;
        let us = 0.5 - u.abs();
        let k = ((2.0 * a / us + b) * u + mean + 0.43).floor();
        if us >= 0.07 && v <= v_r {
            return k;
        }
        if k < 0.0 || (us < 0.013 && v > us) {
            continue;
        }
        let accept = libm::log(v * inverse_alpha / (a / (us * us) + b));
        if accept <= k * libm::log(mean) - mean - libm::lgamma(k + 1.0) {
            return k;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Chi-square of counts against the Poisson law, bins of at least 20: below the 99.99 % quantile (Wilson-Hilferty).
    #[test]
    fn poisson_numbers_follow_the_law() {
        const N: usize = 200_000;
        for mean in [0.3, 4.0, 9.9, 10.1, 55.0, 4000.0] {
            let mut counts = std::collections::BTreeMap::new();
            for i in 0..N {
                *counts.entry(poisson(mean, &mut Draws::new([7, mean as u32], 3, i)) as i64).or_insert(0_u32) += 1;
            }
            let law = |k: i64| libm::exp(k as f64 * libm::log(mean) - mean - libm::lgamma(k as f64 + 1.0)) * N as f64;
            let (low, high) = (*counts.keys().next().unwrap(), *counts.keys().last().unwrap());
            let (mut chi, mut bins, mut expected, mut seen) = (0.0, 0.0, 0.0, 0.0);
            for k in low..=high {
                expected += law(k);
                seen += f64::from(*counts.get(&k).unwrap_or(&0));
                if expected >= 20.0 {
                    chi += (seen - expected) * (seen - expected) / expected;
                    bins += 1.0;
                    (expected, seen) = (0.0, 0.0);
                }
            }
            let spread = 2.0 / (9.0 * (bins - 1.0));
            let z = ((chi / (bins - 1.0)).cbrt() - (1.0 - spread)) / spread.sqrt();
            assert!(z < 3.72, "mean {mean}: chi-square {chi} in {bins} bins, z {z}");
        }
    }

    #[test]
    fn normal_numbers_have_their_moments() {
        const N: usize = 100_000;
        let mut sums = [0.0; 4];
        for i in 0..N {
            let z = Draws::new([1, 2], 0, i).normal();
            sums.iter_mut().zip([z, z * z, z * z * z, z * z * z * z]).for_each(|(s, v)| *s += v / N as f64);
        }
        // Standard errors: 1, sqrt 2, sqrt 15, sqrt 96 over sqrt N.
        let errors = [1.0, 2.0, 15.0, 96.0].map(|v: f64| (v / N as f64).sqrt());
        for ((sum, truth), error) in sums.into_iter().zip([0.0, 1.0, 0.0, 3.0]).zip(errors) {
            assert!((sum - truth).abs() < 4.0 * error, "{sums:?}");
        }
    }
}
