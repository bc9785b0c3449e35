//! How finely to discretise: the smallest orders that hold the absolute error below 1e-5.

use super::angles::Azimuths;
use crate::PhaseFunction;

/// Orders of the discretisation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orders {
    /// Largest Legendre degree of the scattering source; the rest of the phase function is taken as forward.
    pub degree: usize,
    /// Directions per hemisphere by their cosine.
    pub cosines: usize,
    /// Azimuthal modes.
    pub modes: usize,
    /// Azimuths per quarter turn.
    pub azimuths: usize,
    /// Relative residual of the iteration over the orders of scattering.
    pub tolerance: f64,
}

impl Orders {
    /// Orders for the phase function, the index `n` and `kappa` = 2 pi f_x / mu_t.
    ///
    /// Fitted to the measured errors of `benches/rte.rs --orders`; they do not depend on the albedo, so that a table
    /// over mu_a is smooth.
    pub fn new(phase: &PhaseFunction, n: f64, kappa: f64) -> Self {
        let degree = Self::degree(phase, n);
        let tolerance = 1e-9;
        // Products of two Legendre functions must not alias: half a node per degree over the hemisphere, more where the
        // nodes crowd at the critical angle.
        let cosines = if n == 1.0 { 12 + 3 * degree / 5 } else { 18 + 6 * degree / 5 };
        if kappa == 0.0 {
            return Self { degree, cosines, modes: 1, azimuths: 1, tolerance };
        }
        let cosines = cosines + (8.0 * libm::log(1.0 + kappa).min(3.0)) as usize;
        // 1 / (removal + i kappa cos phi), removal = 1 - moment m of mode m, hands on a share `ratio` to the next mode.
        let ratio = |removal: f64| kappa / (removal + (removal * removal + kappa * kappa).sqrt());
        let (mut modes, mut returned) = (1, 1.0);
        let mut powers = phase.terms().map(|(share, _)| share);
        while modes <= degree && returned > 1e-4 {
            for (power, (_, g)) in powers.iter_mut().zip(phase.terms()) {
                *power *= g.abs();
            }
            let handed_on = ratio(1.0 - (powers[0] + powers[1]));
            returned *= handed_on * handed_on;
            modes += 1;
        }
        Self { degree, cosines, modes, azimuths: Azimuths::needed(modes, kappa), tolerance }
    }

    /// The degree alone: it sets the optical depth that `kappa` is measured in.
    ///
    /// The smaller of where |g|^l is negligible and where what is cut no longer shows in the reflectance: beyond the
    /// second, single scattering is exact anyhow and multiple scattering is blind to detail. Of several terms the largest.
    pub fn degree(phase: &PhaseFunction, n: f64) -> usize {
        phase.terms().map(|(_, g)| Self::degree_of(g, n)).into_iter().fold(0, usize::max)
    }

    /// The same of Henyey and Greenstein's function.
    fn degree_of(g: f64, n: f64) -> usize {
        if g == 0.0 {
            return 0;
        }
        let (negligible, factor, exponent) = match (g > 0.0, n > 1.0) {
            (true, false) => (3e-3, 14.0, -0.36),
            (true, true) => (3e-4, 12.0, -0.6),
            (false, false) => (2e-3, 11.5, -0.6),
            (false, true) => (1e-3, 8.6, -0.85),
        };
        let by_power = libm::log(negligible) / libm::log(g.abs());
        let by_detail = factor * libm::pow(1.0 - g.abs(), exponent);
        (by_power.min(by_detail).ceil() as usize).max(2)
    }
}

/// Decay rates for the depth basis of a half-space: the slowest mode and the beam exactly, the continuum from `next` on
/// by a geometric series.
pub fn rates(slowest: f64, next: f64, kappa: f64) -> Vec<f64> {
    let (first, last) = (0.8 * next, 30.0 * kappa.max(1.0));
    let steps = (1.4 * libm::log(last / first)).ceil().max(1.0) as usize;
    let series = (0..=steps).map(|i| first * libm::pow(last / first, i as f64 / steps as f64));
    [slowest, 1.0].into_iter().chain(series).collect()
}

/// Widths of the cells of a slab of optical thickness `tau`: growing by 2.5 from both surfaces inwards.
pub fn cells(tau: f64, kappa: f64) -> Vec<f64> {
    let mut half = Vec::new();
    let (mut width, mut covered) = (0.2 / kappa.max(1.0), 0.0);
    while covered + width < 0.5 * tau {
        half.push(width);
        covered += width;
        width *= 2.5;
    }
    let rest = 0.5 * tau - covered;
    match half.last_mut() {
        // A sliver at the middle joins its neighbour.
        Some(last) if rest < 0.5 * *last => *last += rest,
        _ => half.push(rest),
    }
    half.iter().chain(half.iter().rev()).copied().collect()
}
