//! How finely to discretise: the smallest orders that hold the absolute error below 1e-5.

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
    /// Orders for the anisotropy `g`, the index `n` and `kappa` = 2 pi f_x / mu_t.
    pub fn new(g: f64, n: f64, kappa: f64) -> Self {
        let degree = Self::degree(g, n);
        let (modes, azimuths) = if kappa == 0.0 {
            (1, 1)
        } else {
            // The Fourier series of 1 / (1 + i kappa cos phi) converges as r^m.
            let r = kappa / (1.0 + (1.0 + kappa * kappa).sqrt());
            let needed = (libm::log(1e-6) / (2.0 * libm::log(r))).ceil() as usize + 1;
            (needed.max(2).min(degree + 1), needed.max(2))
        };
        Self { degree, cosines: (degree + 4).max(20), modes, azimuths, tolerance: 1e-10 }
    }

    /// The degree alone: it sets the optical depth that `kappa` is measured in.
    pub fn degree(g: f64, n: f64) -> usize {
        if g == 0.0 {
            return 0;
        }
        let wanted: f64 = if n == 1.0 { 1.5e-2 } else { 3e-3 };
        ((libm::log(wanted) / libm::log(g.abs())).ceil() as usize).max(2)
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

/// Widths of the cells of a slab of optical thickness `tau`: doubling from both surfaces inwards.
pub fn cells(tau: f64, kappa: f64) -> Vec<f64> {
    let mut half = Vec::new();
    let (mut width, mut covered) = (0.1 / kappa.max(1.0), 0.0);
    while covered + width < 0.5 * tau {
        half.push(width);
        covered += width;
        width *= 2.0;
    }
    let rest = 0.5 * tau - covered;
    match half.last_mut() {
        // A sliver at the middle joins its neighbour.
        Some(last) if rest < 0.5 * *last => *last += rest,
        _ => half.push(rest),
    }
    half.iter().chain(half.iter().rev()).copied().collect()
}
