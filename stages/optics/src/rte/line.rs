//! Lines of light and of view: along the normal, or oblique.

use std::f64::consts::PI;

use super::angles::legendre;
use super::{Optical, over_isotropic};
use crate::fresnel;

/// A direction in the medium, towards the light or the camera.
pub struct Line {
    /// Cosine to the normal, inside.
    pub cos: f64,
    /// Fresnel reflectance of the surface.
    pub rho: f64,
    /// P_l0 of the cosine, normalised to int_-1^1 P^2 = 1.
    pub moments: Vec<f64>,
}

impl Line {
    /// `cos_outside` in (0, 1], `degree` the largest l.
    pub fn new(n: f64, degree: usize, cos_outside: f64) -> Self {
        if cos_outside == 1.0 {
            // P_l0(1) = sqrt(l + 1/2)
            let moments = (0..=degree).map(|l| (l as f64 + 0.5).sqrt()).collect();
            return Self { cos: 1.0, rho: fresnel::normal_reflectance(n), moments };
        }
        let cos = (1.0 - (1.0 - cos_outside * cos_outside) / (n * n)).sqrt();
        let moments = legendre(degree, 0, &[cos]).into_iter().map(|row| row[0]).collect();
        Self { cos, rho: fresnel::reflectance(n, cos), moments }
    }
}

/// Azimuths over half a turn.
const AZIMUTHS: usize = 256;

/// Exact less truncated phase function between two lines, times the albedo, forward and backward; its mean over azimuth.
pub fn excess(optical: &Optical, light: &Line, view: &Line) -> [f64; 2] {
    if light.cos == 1.0 && view.cos == 1.0 {
        return optical.excess;
    }
    let sin = |line: &Line| ((1.0 - line.cos) * (1.0 + line.cos)).sqrt();
    [1.0, -1.0].map(|sign: f64| {
        let exact = |p: usize| {
            let phi = (p as f64 + 0.5) * PI / AZIMUTHS as f64;
            let cos = sign * light.cos * view.cos + sin(light) * sin(view) * libm::cos(phi);
            over_isotropic(&optical.phase, cos)
        };
        let exact = (0..AZIMUTHS).map(exact).sum::<f64>() / AZIMUTHS as f64;
        let each = optical.beta.iter().zip(&light.moments).zip(&view.moments).enumerate();
        let truncated: f64 = each.map(|(l, ((b, p), q))| 2.0 * b * p * q * if l % 2 == 0 { 1.0 } else { sign }).sum();
        optical.albedo * (exact / (1.0 - optical.peak) - truncated)
    })
}
