//! The ratio of two noisy numbers that share their noise.

/// Variances of M_DC and M_AC of a pixel, and their covariance; the square of their unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    pub m_dc: f64,
    pub m_ac: f64,
    pub covariance: f64,
}

/// M_AC / M_DC, and its standard error to first order:
///
/// var(d) = (var(M_AC) + d^2 var(M_DC) - 2 d cov(M_AC, M_DC)) / M_DC^2
///
/// `None` where M_DC is not above 0. Relative noise of M_DC of s raises the mean of d by s^2, which is left in. Source: Kendall and Stuart, The
/// Advanced Theory of Statistics, vol. 1, 10.6.
pub fn modulation_depth(m_dc: f64, m_ac: f64, noise: Noise) -> Option<[f64; 2]> {
    let d = m_ac / m_dc;
    let variance = (noise.m_ac + d * d * noise.m_dc - 2.0 * d * noise.covariance) / (m_dc * m_dc);
    // Of noise that cancels, f32 images leave a rounding error of either sign.
    (m_dc > 0.0).then(|| [d, variance.max(0.0).sqrt()])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Noise that scales both cancels; noise of M_AC alone is that over M_DC; independent relative noise adds in quadrature.
    #[test]
    fn errors_are_those_of_a_ratio() {
        let of = |m_dc: f64, m_ac: f64, covariance: f64| {
            let [d, se] = modulation_depth(4.0, 1.0, Noise { m_dc, m_ac, covariance }).expect("4 is above 0");
            assert_eq!(d, 0.25);
            se
        };
        assert_eq!(of(0.04 * 16.0, 0.04, 0.04 * 4.0), 0.0);
        assert_eq!(of(0.0, 0.01, 0.0), 0.1 / 4.0);
        // 3 % of M_DC, 4 % of M_AC: 5 % of the ratio; two roundings.
        assert!((of((0.03_f64 * 4.0).powi(2), 0.04_f64.powi(2), 0.0) / (0.05 * 0.25) - 1.0).abs() < 1e-12);
        let none = Noise { m_dc: 0.0, m_ac: 0.0, covariance: 0.0 };
        assert_eq!([0.0, -1.0, f64::NAN].map(|m_dc| modulation_depth(m_dc, 1.0, none)), [None; 3]);
    }
}
