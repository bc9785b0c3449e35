//! Ray differentials: where a slightly turned ray would go, through smooth walls of any curvature.
//!
//! Two derivatives travel with the ray, those by the angles at which it started along two axes across it. They say how to turn it so
//! that it arrives where it should (Newton's method), and how its light has spread by then.

use glam::{DVec2, DVec3};

use crate::refraction::refract;

/// A ray that started at a point, with the derivatives of place and direction by its two starting angles.
#[derive(Clone, Copy, Debug)]
pub struct RayDifferential {
    pub r: DVec3,
    /// Unit vector along it.
    pub w: DVec3,
    /// The axes along which it may be turned at the start.
    axes: [DVec3; 2],
    /// Its direction at the start.
    from: DVec3,
    dr: [DVec3; 2],
    dw: [DVec3; 2],
}

/// What has to be done for a ray to arrive, to first order.
#[derive(Clone, Copy, Debug)]
pub struct NewtonStep {
    /// Angles by which to turn it at the start, rad.
    pub turn: DVec2,
    /// How far it misses: mm from a point, a difference of unit vectors from a direction.
    pub miss: f64,
    /// Solid angle at the start over the area across the ray at the point, mm^-2; over solid angle there for a direction.
    pub spread: f64,
}

impl RayDifferential {
    /// From `r` along the unit vector `w`.
    pub fn new(r: DVec3, w: DVec3) -> Self {
        let (a, b) = w.any_orthonormal_pair();
        Self { r, w, axes: [a, b], from: w, dr: [DVec3::ZERO; 2], dw: [a, b] }
    }

    /// Its direction at the start, a unit vector.
    pub fn start(&self) -> DVec3 {
        self.from
    }

    /// The same turned by small angles.
    pub fn turned(&self, turn: DVec2) -> DVec3 {
        (self.from + turn.x * self.axes[0] + turn.y * self.axes[1]).normalize()
    }

    /// Straight on, mm.
    pub fn fly(&mut self, distance: f64) {
        self.r += distance * self.w;
        for (dr, dw) in self.dr.iter_mut().zip(&self.dw) {
            *dr += distance * *dw;
        }
    }

    /// Is turned by a wall on which it has arrived, of unit normal `normal` on either side, which turns by `bends(d)` over the
    /// displacement d along the wall; from index `n_from` to `n_to`. The reflectance of the wall; `None` where it cannot go on that way.
    pub fn meet(
        &mut self,
        normal: DVec3,
        bends: impl Fn(DVec3) -> DVec3,
        (n_from, n_to): (f64, f64),
        reflected: bool,
    ) -> Option<f64> {
        let met = refract(self.w, normal, n_from, n_to);
        let on = if reflected { met.reflected } else { met.refracted? };
        // The normal along the ray.
        let ahead = self.w.dot(normal) > 0.0;
        let n = if ahead { normal } else { -normal };
        let (cos, cos_on, eta) = (self.w.dot(n), on.dot(n), n_from / n_to);
        for (dr, dw) in self.dr.iter_mut().zip(&mut self.dw) {
            // Neighbours meet the wall elsewhere, earlier or later.
            *dr -= dr.dot(n) / cos * self.w;
            let dn = if ahead { bends(*dr) } else { -bends(*dr) };
            let dcos = dw.dot(n) + self.w.dot(dn);
            *dw = if reflected {
                *dw - 2.0 * (dcos * n + cos * dn)
            } else {
                let dcos_on = eta * eta * cos * dcos / cos_on;
                eta * (*dw - dcos * n - cos * dn) + dcos_on * n + cos_on * dn
            };
        }
        self.w = on;
        Some(met.reflectance)
    }

    /// Straight on to a point. `None` where it goes away from it, or all neighbours meet there.
    pub fn newton_step_to(&self, point: DVec3) -> Option<NewtonStep> {
        let distance = (point - self.r).dot(self.w);
        let miss = point - self.r - distance * self.w;
        let moved = [0, 1].map(|k| self.dr[k] + distance * self.dw[k]);
        self.solve(miss, moved).filter(|_| distance > 0.0)
    }

    /// Into a direction, a unit vector.
    pub fn newton_step_along(&self, direction: DVec3) -> Option<NewtonStep> {
        self.solve(direction - self.w, self.dw).filter(|_| direction.dot(self.w) > 0.0)
    }

    fn solve(&self, miss: DVec3, moved: [DVec3; 2]) -> Option<NewtonStep> {
        let (x, y) = self.w.any_orthonormal_pair();
        let across = |v: DVec3| DVec2::new(v.dot(x), v.dot(y));
        let [a, b] = moved.map(across);
        let m = across(miss);
        let det = a.perp_dot(b);
        let turn = DVec2::new(m.perp_dot(b), a.perp_dot(m)) / det;
        turn.is_finite().then(|| NewtonStep { turn, miss: m.length(), spread: 1.0 / det.abs() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::refraction::{Crossing, Leg};

    /// Through a plane the closed form's spread, by reciprocity: n^2 times it is the same from either end.
    #[test]
    fn a_plane_spreads_light_as_the_closed_form_says() {
        for (n_from, n_to) in [(1.4, 1.0), (1.0, 1.4), (2.5, 1.2)] {
            for slope in [0.0, 0.2, 0.7_f64] {
                let w = DVec3::new(0.6 * slope, -0.8 * slope, 1.0 - slope * slope).normalize();
                let (depth, height) = (3.0, 40.0);
                let mut differential = RayDifferential::new(DVec3::new(1.0, 2.0, -depth), w);
                differential.fly(depth / w.z);
                let Some(_) = differential.meet(DVec3::Z, |_| DVec3::ZERO, (n_from, n_to), false) else { continue };
                let end = differential.r + height / differential.w.z * differential.w;
                let newton = differential.newton_step_to(end).unwrap();
                assert!(newton.miss < 1e-12, "{newton:?}");
                let legs = [Leg { n: n_from, depth }, Leg { n: n_to, depth: height }];
                let advance = (end - DVec3::new(1.0, 2.0, -depth)).truncate().length();
                let closed = Crossing::new(legs.into_iter(), advance).unwrap().spread(n_from, n_to);
                assert!((newton.spread / closed - 1.0).abs() < 1e-11, "{n_from} {n_to} {slope}: {newton:?} {closed}");
            }
        }
    }

    /// Where neighbours arrive against the derivatives, through two walls of an ellipsoid with a reflection between: central differences
    /// of 1e-5 rad leave 1e-10 of curvature and 1e-11 of rounding, of numbers up to a few.
    #[test]
    fn neighbours_go_where_the_derivatives_say() {
        let radii = DVec3::new(2.0, 1.5, 1.1);
        let gradient = |p: DVec3| p / (radii * radii);
        let trace = |w: DVec3| {
            let mut differential = RayDifferential::new(DVec3::new(0.2, -0.1, 0.3), w);
            for reflected in [true, true, false] {
                let (o, d) = (differential.r / radii, differential.w / radii);
                let (a, b, c) = (d.length_squared(), o.dot(d), o.length_squared() - 1.0);
                // From a point on it, the other end of the chord.
                let t = if c.abs() < 1e-9 { -2.0 * b / a } else { (-b + (b * b - a * c).sqrt()) / a };
                differential.fly(t);
                let g = gradient(differential.r);
                let bends = |d: DVec3| {
                    let n = g.normalize();
                    (d / (radii * radii) - n.dot(d / (radii * radii)) * n) / g.length()
                };
                differential.meet(g.normalize(), bends, (1.2, 1.0), reflected)?;
            }
            Some(differential)
        };
        let mut seen = 0;
        for i in 0..60 {
            let t = f64::from(i);
            let w = DVec3::new(libm::sin(t), libm::cos(1.7 * t), libm::sin(2.3 * t + 1.0)).normalize();
            let Some(here) = trace(w) else { continue };
            let (axes, h) = (here.axes, 1e-5);
            for (k, &axis) in axes.iter().enumerate() {
                let (Some(less), Some(more)) = (trace((w - h * axis).normalize()), trace((w + h * axis).normalize()))
                else {
                    continue;
                };
                if here.w.dot(gradient(here.r).normalize()) < 0.2 {
                    continue;
                }
                let (dr, dw) = ((more.r - less.r) / (2.0 * h), (more.w - less.w) / (2.0 * h));
                // Neighbours end on the wall, the derivative does, too, after it has met it.
                let off = (dr - here.dr[k]).length().max((dw - here.dw[k]).length());
                assert!(off < 1e-6 * (1.0 + dr.length() + dw.length()), "{w}: {dr} {} {dw} {}", here.dr[k], here.dw[k]);
                seen += 1;
            }
        }
        assert!(seen > 20, "{seen}");
    }
}
