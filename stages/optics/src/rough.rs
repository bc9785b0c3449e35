//! Rough dielectric boundaries: GGX microfacets, each a smooth wall, that light meets once.
//!
//! Source: Walter, Marschner, Li, Torrance, "Microfacet models for refraction through rough surfaces", EGSR (2007), with
//! Smith's shadowing of the two directions taken as independent. Light that would meet a second facet is lost;
//! `between_facets.rs` says how much.

use std::f64::consts::PI;

use glam::DVec3;

use crate::elementary::sin_cos_turns;
use crate::henyey_greenstein::turn;
use crate::refraction::refract;

/// The boundary as seen along a ray that comes out of index `n_from` towards index `n_to`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rough {
    /// Roughness, in (0, 1]: the root mean square slope of the facets is of its order.
    pub alpha: f64,
    /// Unit normal on the side from which the ray comes.
    pub normal: DVec3,
    pub n_from: f64,
    pub n_to: f64,
}

impl Rough {
    /// Facets per solid angle of normals and area.
    fn density(&self, cos: f64) -> f64 {
        let a2 = self.alpha * self.alpha;
        let q = (1.0 - cos * cos) + a2 * cos * cos;
        a2 / (PI * q * q)
    }

    /// Fraction of the facets that a direction at this cosine sees.
    pub(crate) fn unshadowed(&self, cos: f64) -> f64 {
        let tan2 = (1.0 - cos * cos).max(0.0) / (cos * cos);
        2.0 / (1.0 + (1.0 + self.alpha * self.alpha * tan2).sqrt())
    }

    /// Normal of a facet that the direction `v` (away from the surface) sees, for uniforms u and turns.
    ///
    /// Source: Dupuy, Benyoub, "Sampling visible GGX normals with spherical caps", Comput. Graph. Forum 42 (2023).
    pub(crate) fn facet(&self, v: DVec3, u: f64, turns: f64) -> DVec3 {
        let n = self.normal;
        let stretched = |x: DVec3| {
            let up = x.dot(n);
            (self.alpha * (x - up * n) + up * n).normalize()
        };
        let v = stretched(v);
        let z = (1.0 - u) * (1.0 + v.dot(n)) - v.dot(n);
        let (sin_phi, cos_phi) = sin_cos_turns(turns);
        stretched(turn(n, z, (1.0 - z * z).max(0.0).sqrt(), sin_phi, cos_phi) + v)
    }

    /// Where a ray along `w` goes on, carrying L / n^2 with weight 1; `None` where it is lost between facets. `choice` decides on
    /// reflection, `fate` on shadowing, `u` and `turns` on the facet: all uniform in (0, 1).
    pub fn sample(&self, w: DVec3, [u, turns, choice, fate]: [f64; 4]) -> Option<DVec3> {
        let facet = self.facet(-w, u, turns);
        let met = refract(w, facet, self.n_from, self.n_to);
        let (on, side) = match met.refracted {
            Some(refracted) if choice >= met.reflectance => (refracted, -1.0),
            _ => (met.reflected, 1.0),
        };
        let cos = side * on.dot(self.normal);
        (cos > 0.0 && fate < self.unshadowed(cos)).then_some(on)
    }

    /// L / n^2 that a ray along `w` sees, over E / n^2, E the irradiance across parallel light that comes from the direction `l`
    /// (away from the surface, on either side).
    pub fn response(&self, w: DVec3, l: DVec3) -> f64 {
        let v = -w;
        let (cos_v, cos_l) = (v.dot(self.normal), l.dot(self.normal));
        if cos_v <= 0.0 || cos_l == 0.0 {
            return 0.0;
        }
        let shadows = self.unshadowed(cos_v) * self.unshadowed(cos_l.abs());
        if cos_l > 0.0 {
            let facet = (v + l).normalize();
            let reflectance = refract(w, facet, self.n_from, self.n_to).reflectance;
            return self.density(facet.dot(self.normal)) * shadows * reflectance / (4.0 * cos_v);
        }
        let facet = (self.n_from * v + self.n_to * l).normalize();
        let facet = if facet.dot(self.normal) < 0.0 { -facet } else { facet };
        let (v_h, l_h) = (v.dot(facet), l.dot(facet));
        if v_h <= 0.0 || l_h >= 0.0 {
            return 0.0;
        }
        let met = refract(w, facet, self.n_from, self.n_to);
        let q = self.n_to * l_h + self.n_from * v_h;
        let facets = self.density(facet.dot(self.normal)) * shadows;
        (1.0 - met.reflectance) * facets * v_h * -l_h * self.n_to * self.n_to / (cos_v * q * q)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::philox::{philox4x32, unit, unit_fine};

    const CASES: [(f64, f64, f64, f64); 6] = [
        (0.3, 1.0, 1.4, 0.9),
        (0.3, 1.4, 1.0, 0.9),
        (0.6, 1.0, 1.5, 0.4),
        (0.6, 1.5, 1.0, 0.3),
        (1.0, 1.0, 2.5, 0.7),
        (0.15, 1.4, 1.33, 0.6),
    ];

    fn boundary(alpha: f64, n_from: f64, n_to: f64, cos: f64) -> (Rough, DVec3) {
        let sin = f64::sqrt(1.0 - cos * cos);
        (Rough { alpha, normal: DVec3::Z, n_from, n_to }, DVec3::new(0.6 * sin, -0.8 * sin, -cos))
    }

    /// What is sampled is what is evaluated: moments of the sampled directions on either side against the midpoint rule over
    /// 600 x 600 cells of (cos, azimuth), within 5 sigma of the sampling and what 300 x 300 cells give otherwise (less than 1e-2).
    #[test]
    fn samples_follow_the_response() {
        const MOMENTS: usize = 5;
        let moments = |l: DVec3| [1.0, l.x, l.z * l.z, 1.0f64.copysign(l.z), l.y * l.z];
        for (alpha, n_from, n_to, cos) in CASES {
            let (rough, w) = boundary(alpha, n_from, n_to, cos);
            let samples = 200_000;
            let (mut sampled, mut squares) = ([0.0; MOMENTS], [0.0; MOMENTS]);
            for i in 0..samples {
                let [a, b, c, d] = philox4x32([i, 1, 2, 3], [5, 6]);
                if let Some(l) = rough.sample(w, [unit_fine(a, d), unit(b), unit(c), unit(d)]) {
                    assert!((l.length() - 1.0).abs() < 1e-14);
                    for (k, m) in moments(l).into_iter().enumerate() {
                        sampled[k] += m / f64::from(samples);
                        squares[k] += m * m / f64::from(samples);
                    }
                }
            }
            let integral = |n: u32| {
                let mut sums = [0.0; MOMENTS];
                for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
                    let z = 2.0 * (f64::from(i) + 0.5) / f64::from(n) - 1.0;
                    let (sin_phi, cos_phi) = sin_cos_turns((f64::from(j) + 0.5) / f64::from(n));
                    let sin = (1.0 - z * z).sqrt();
                    let l = DVec3::new(sin * cos_phi, sin * sin_phi, z);
                    let weight = rough.response(w, l) * 4.0 * PI / f64::from(n * n);
                    moments(l).iter().zip(&mut sums).for_each(|(m, s)| *s += weight * m);
                }
                sums
            };
            let (coarse, fine) = (integral(300), integral(600));
            for k in 0..MOMENTS {
                let sigma = ((squares[k] - sampled[k] * sampled[k]) / f64::from(samples)).sqrt();
                let cells = (fine[k] - coarse[k]).abs();
                assert!(
                    (sampled[k] - fine[k]).abs() < 5.0 * sigma + cells && cells < 1e-2,
                    "alpha {alpha}, {n_from} -> {n_to}, moment {k}: {} +- {sigma}, {} +- {cells}",
                    sampled[k],
                    fine[k]
                );
            }
            assert!(sampled[0] > 0.5 && sampled[0] <= 1.0, "{sampled:?}");
        }
    }

    /// Helmholtz: with L / n^2 the response over the cosine of the light's direction is the same with both directions exchanged, but
    /// for the n^2 of the light's side. 1e-11: cosines of 0.05 and more.
    #[test]
    fn directions_may_be_exchanged() {
        for (alpha, n_from, n_to, _) in CASES {
            for k in 1..40 {
                let z = f64::from(k) / 40.0;
                let (a, b) = (DVec3::new((1.0 - z * z).sqrt(), 0.0, z), DVec3::new(0.3, -0.4, -0.75f64.sqrt()));
                for b in [b, -b] {
                    let here = boundary(alpha, n_from, n_to, 0.5).0;
                    let there = if b.z > 0.0 {
                        here
                    } else {
                        Rough { normal: DVec3::NEG_Z, n_from: n_to, n_to: n_from, ..here }
                    };
                    let n_b = if b.z > 0.0 { n_from } else { n_to };
                    let one = here.response(-a, b) / b.z.abs() / (n_b * n_b);
                    let other = there.response(-b, a) / a.z.abs() / (n_from * n_from);
                    assert!((one - other).abs() <= 1e-11 * one.max(other), "{here:?} {a} {b}: {one} {other}");
                }
            }
        }
    }
}
