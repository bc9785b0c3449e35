//! One exposure of one pixel: light to electrons to a number, and back to the light that the number stands for.

use crate::noise::{Draws, poisson};

/// What a camera is, every part of it optional.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Radiance that fills the range above black, exposure counted in, W mm^-2 sr^-1.
    pub full_scale: f64,
    /// Level of darkness, share of the range.
    pub black: f64,
    /// Electrons that fill the range; none: light without shot noise.
    pub full_well: Option<f64>,
    /// Standard deviation, electrons.
    pub read_noise: f64,
    pub gamma: f64,
    /// Whether the numbers are turned back through the gamma.
    pub linearise: bool,
    /// Numbers 0 to 2^bits - 1; none: not rounded.
    pub bits: Option<u32>,
}

/// A pixel as the camera tells it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposed {
    /// Radiance, W mm^-2 sr^-1.
    pub value: f64,
    /// Variance that the camera adds: shot noise, read noise, rounding.
    pub variance: f64,
    /// As the camera writes it: 0 to 2^bits - 1, or a share of the range where it does not round.
    pub number: f64,
    pub saturated: bool,
}

impl Camera {
    /// Whether anything random happens.
    pub fn draws(&self) -> bool {
        self.full_well.is_some()
    }

    /// A pixel that reads darkness at `dark` (share of the range) from the nominal black level, under `radiance`, which is
    /// what it would be without noise.
    pub fn expose(&self, radiance: f64, dark: f64, draws: &mut Draws) -> Exposed {
        // Less than no light is what the noise of a render or of an earlier camera may say; no electron comes of it.
        let light = (radiance / self.full_scale).max(0.0);
        let mut level = radiance / self.full_scale;
        let mut variance = 0.0;
        if let Some(full_well) = self.full_well {
            let electrons = poisson(light * full_well, draws) + self.read_noise * draws.normal();
            level = electrons / full_well;
            variance = (light * full_well + self.read_noise * self.read_noise) / (full_well * full_well);
        }
        let level = self.black + dark + (1.0 - self.black) * level;
        // The ends of the range are physics, not repair: 1 is marked, and 0 is what darkness reads without a black level.
        let clipped = level.clamp(0.0, 1.0);
        let encoded = libm::pow(clipped, 1.0 / self.gamma);
        let steps = self.bits.map(|bits| f64::from((1_u32 << bits) - 1));
        let number = steps.map_or(encoded, |steps| (encoded * steps).round() / steps);
        // Rounding spreads evenly over a step: its square over 12, as long as other noise or the scene dithers it.
        let slope = |at: f64| self.gamma * libm::pow(at, self.gamma - 1.0);
        let rounding = steps.map_or(0.0, |steps| slope(number.max(0.5 / steps)) / steps);
        let range = 1.0 - self.black;
        variance += rounding * rounding / (12.0 * range * range);
        let read = if self.linearise { libm::pow(number, self.gamma) } else { number };
        Exposed {
            value: (read - self.black) / range * self.full_scale,
            variance: variance * self.full_scale * self.full_scale,
            number: steps.map_or(number, |steps| (number * steps).round()),
            saturated: number >= 1.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const IDEAL: Camera = Camera {
        full_scale: 2e-5,
        black: 0.0,
        full_well: None,
        read_noise: 0.0,
        gamma: 1.0,
        linearise: true,
        bits: None,
    };

    fn one(camera: &Camera, radiance: f64, pixel: usize) -> Exposed {
        camera.expose(radiance, 0.0, &mut Draws::new([1, 2], 0, pixel))
    }

    /// Without any of its parts a camera is transparent; 8 bits round to the nearest 255th, with the variance of an even
    /// spread; what fills the range is marked.
    #[test]
    fn plain_cameras() {
        let e = one(&IDEAL, 1.234e-5, 0);
        assert!((e.value / 1.234e-5 - 1.0).abs() < 1e-15 && e.variance == 0.0 && !e.saturated);
        let eight = Camera { bits: Some(8), black: 0.1, ..IDEAL };
        let (mut sum, mut claimed) = (0.0, 0.0);
        for i in 0..10_000 {
            let radiance = 1.9e-5 * (f64::from(i) + 0.5) / 10_000.0;
            let e = one(&eight, radiance, 0);
            sum += (e.value - radiance).powi(2);
            claimed += e.variance;
        }
        // A ramp over 228 steps whose ends are not whole: within 2 %.
        assert!((sum / claimed - 1.0).abs() < 0.02, "{}", sum / claimed);
        assert!(one(&eight, 2.0e-5, 0).saturated && one(&eight, 3.0e-5, 0).value == one(&eight, 2.0e-5, 0).value);
        assert!(!one(&eight, 1.95e-5, 0).saturated);
    }

    /// Mean and variance of 20,000 exposures are those claimed, with and without gamma; a black level keeps the mean of darkness at 0.
    #[test]
    fn noise_is_what_it_says() {
        const N: usize = 20_000;
        for gamma in [1.0, 2.2] {
            for light in [0.0, 0.003, 0.4, 0.9] {
                let camera =
                    Camera { full_well: Some(5000.0), read_noise: 12.0, bits: Some(12), black: 0.05, gamma, ..IDEAL };
                let radiance = light * camera.full_scale;
                let all: Vec<Exposed> = (0..N).map(|i| one(&camera, radiance, i)).collect();
                let mean = all.iter().map(|e| e.value).sum::<f64>() / N as f64;
                let variance = all.iter().map(|e| (e.value - mean).powi(2)).sum::<f64>() / (N - 1) as f64;
                let claimed = all.iter().map(|e| e.variance).sum::<f64>() / N as f64;
                let z = (mean - radiance) / (claimed / N as f64).sqrt();
                assert!(z.abs() < 4.0, "gamma {gamma}, light {light}: mean off by {z} standard errors");
                // The variance of a sampled variance is 2 / N.
                let z = (variance / claimed - 1.0) / (2.0 / N as f64).sqrt();
                assert!(z.abs() < 4.0, "gamma {gamma}, light {light}: variance off by {z}, {}", variance / claimed);
            }
        }
    }

    /// A gamma that is left in the frames bends them; turned back, it is gone.
    #[test]
    fn gamma_is_undone_unless_it_is_wanted() {
        let camera = Camera { gamma: 2.2, ..IDEAL };
        let half = 0.5 * camera.full_scale;
        assert!((one(&camera, half, 0).value / half - 1.0).abs() < 1e-14);
        let bent = Camera { linearise: false, ..camera };
        assert!((one(&bent, half, 0).value / (0.5_f64.powf(1.0 / 2.2) * 2e-5) - 1.0).abs() < 1e-14);
    }
}
