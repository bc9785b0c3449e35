//! Decay rates of the transport equation's modes: where the depth basis has to look.

/// The `count` slowest decay rates per optical depth, below 1, of the azimuthally symmetric modes of a medium whose
/// phase function has the Legendre moments `beta` (beta_0 = 1, none beyond the last); rates of 1 or more are left out.
///
/// The modes exp(-k z) obey the tridiagonal recursion h_l phi_l = k (l phi_{l-1} + (l + 1) phi_{l+1}) with
/// h_l = (2l + 1) (1 - albedo beta_l). H - k J has as many negative pivots as there are rates below k (Sturm), so
/// each rate is bisected; the first one to relative precision even where the albedo is 1 - 1e-15.
pub fn slow_rates(albedo: f64, beta: &[f64], count: usize) -> Vec<f64> {
    // Beyond the moments h_l = 2l + 1: a free-streaming tail, long enough to place the rates near 1 to 1e-3.
    let h: Vec<f64> =
        (0..beta.len() + 60).map(|l| (2 * l + 1) as f64 * (1.0 - albedo * beta.get(l).unwrap_or(&0.0))).collect();
    let below = |k: f64| {
        let mut negative = 0;
        let mut pivot = h[0];
        for (l, &h) in h.iter().enumerate() {
            if l > 0 {
                let coupling = k * l as f64;
                // A vanishing pivot means that k is a rate of the leading block; either sign counts right.
                pivot = h - coupling * coupling / if pivot == 0.0 { f64::MIN_POSITIVE } else { pivot };
            }
            negative += usize::from(pivot < 0.0);
        }
        negative
    };
    let within = below(1.0).min(count);
    (0..within)
        .map(|i| {
            // Bisect in k^2: the diffusion rate sqrt(3 h_0 (1 - albedo beta_1)) may be as small as 1e-8.
            let (mut low, mut high) = (0.0, 1.0);
            for _ in 0..1100 {
                let middle = if low > 0.0 { libm::sqrt(low * high) } else { high * 1e-6 };
                if middle <= low || middle >= high || high <= 1e-300 {
                    break;
                }
                if below(middle) > i {
                    high = middle
                } else {
                    low = middle
                }
                if high - low <= 1e-14 * high {
                    break;
                }
            }
            if h[0] == 0.0 && i == 0 { 0.0 } else { 0.5 * (low + high) }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Isotropic scattering: k solves albedo artanh(k) / k = 1 (Case); the tail of 60 moments holds it to 1e-9.
    #[test]
    fn isotropic_rate_is_cases() {
        for albedo in [0.5, 0.9, 0.99, 1.0 - 1e-9] {
            let k = slow_rates(albedo, &[1.0], 1)[0];
            let residual = albedo * libm::atanh(k) / k - 1.0;
            assert!(residual.abs() < 1e-8, "albedo {albedo}: k = {k}, residual {residual}");
        }
        assert_eq!(slow_rates(1.0, &[1.0, 0.5], 1), [0.0]);
    }

    /// Near albedo 1 the rate is sqrt(3 (1 - albedo) (1 - g)) to first order in the rate squared.
    #[test]
    fn diffusive_rate() {
        let beta: Vec<f64> = (0..30).map(|l| libm::pow(0.8, l as f64)).collect();
        let k = slow_rates(1.0 - 1e-10, &beta, 2);
        let diffusive = (3.0 * 1e-10 * 0.2f64).sqrt();
        assert!((k[0] / diffusive - 1.0).abs() < 1e-6, "{k:?} {diffusive}");
        assert!(k[1] > 0.3 && k[1] < 1.0);
    }
}
