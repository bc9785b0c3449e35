//! A port: where the wall of a sphere is cut away.

use std::f64::consts::PI;

use glam::DVec3;
use turbid_optics::elementary::sin_cos_turns;
use turbid_optics::quadrature::gauss_legendre_on;

use crate::direction::in_cap;
use crate::stream::Stream;

/// Outline of a port, seen along its axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Outline {
    Round { radius: f64 },
    Square { half: f64 },
}

/// The part of a sphere about the origin that a cylinder or a square prism about `axis` cuts out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Opening {
    /// Unit vector from the centre of the sphere.
    pub axis: DVec3,
    /// Unit vectors along the sides of a square.
    pub across: [DVec3; 2],
    pub outline: Outline,
    /// Radius of the sphere, mm.
    pub sphere: f64,
    /// Share of the sphere's surface.
    pub fraction: f64,
}

impl Opening {
    /// The port at the polar angle `turns` (of a full turn) from the point (0, 0, -1), towards +x. It must fit: every point of the
    /// outline closer to the axis than the radius of the sphere.
    pub fn new(outline: Outline, turns: f64, sphere: f64) -> Self {
        let (sin, cos) = sin_cos_turns(turns);
        let axis = DVec3::new(sin, 0.0, -cos);
        let across = [DVec3::Y, axis.cross(DVec3::Y)];
        let fraction = match outline {
            // 1 - cos, without its cancellation for small ports.
            Outline::Round { radius } => {
                let sin = radius / sphere;
                0.5 * sin * sin / (1.0 + (1.0 - sin * sin).sqrt())
            }
            // The area of the sphere over dx dy is R / z; smooth, so 24 points leave rounding only.
            Outline::Square { half } => {
                let mut area = 0.0;
                for (x, wx) in gauss_legendre_on(0.0, half, 24) {
                    for (y, wy) in gauss_legendre_on(0.0, half, 24) {
                        area += 4.0 * wx * wy * sphere / (sphere * sphere - x * x - y * y).sqrt();
                    }
                }
                area / (4.0 * PI * sphere * sphere)
            }
        };
        Self { axis, across, outline, sphere, fraction }
    }

    /// Radius of the circle about the outline, mm.
    pub fn reach(outline: Outline) -> f64 {
        match outline {
            Outline::Round { radius } => radius,
            Outline::Square { half } => half * std::f64::consts::SQRT_2,
        }
    }

    /// Whether the point `r` of the sphere lies in the port.
    #[inline]
    pub fn holds(&self, r: DVec3) -> bool {
        r.dot(self.axis) > 0.0 && self.frames(r)
    }

    /// Whether `r` lies inside the cylinder or prism.
    #[inline]
    pub fn frames(&self, r: DVec3) -> bool {
        match self.outline {
            Outline::Round { radius } => {
                let along = r.dot(self.axis);
                r.length_squared() - along * along < radius * radius
            }
            Outline::Square { half } => self.across.iter().all(|e| r.dot(*e).abs() < half),
        }
    }

    /// A point of the sphere in the port, uniform over its area.
    pub fn point(&self, random: &mut Stream) -> DVec3 {
        let radius = self.sphere;
        match self.outline {
            Outline::Round { radius: rim } => {
                in_cap(self.axis, (1.0 - (rim / radius) * (rim / radius)).sqrt(), random) * radius
            }
            Outline::Square { half } => {
                let lowest = (radius * radius - 2.0 * half * half).sqrt();
                loop {
                    let [x, y] = [0, 1].map(|_| half * (2.0 * random.uniform() - 1.0));
                    let height = (radius * radius - x * x - y * y).sqrt();
                    // The density over dx dy is 1 / height; close to even.
                    if random.uniform() * height < lowest {
                        return height * self.axis + x * self.across[0] + y * self.across[1];
                    }
                }
            }
        }
    }

    /// Distance along a ray from inside the cylinder or prism to its wall, and the normal there, pointing inwards.
    pub fn wall(&self, r: DVec3, u: DVec3) -> (f64, DVec3) {
        match self.outline {
            Outline::Round { radius } => {
                let (p, v) = (r - r.dot(self.axis) * self.axis, u - u.dot(self.axis) * self.axis);
                let (a, b, c) = (v.length_squared(), p.dot(v), p.length_squared() - radius * radius);
                if a == 0.0 {
                    return (f64::INFINITY, self.axis);
                }
                let distance = ((-b + (b * b - a * c).max(0.0).sqrt()) / a).max(0.0);
                (distance, -(p + distance * v).normalize())
            }
            Outline::Square { half } => {
                let mut nearest = (f64::INFINITY, self.axis);
                for e in self.across {
                    let (x, v) = (r.dot(e), u.dot(e));
                    let distance = ((half - x * 1f64.copysign(v)) / v.abs()).max(0.0);
                    if distance < nearest.0 {
                        nearest = (distance, -1f64.copysign(v) * e);
                    }
                }
                nearest
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::direction::anywhere;

    /// Areas: closed form for a cap and, for a square, the share of a million points spread over the sphere (4 sigma). Points drawn in a
    /// port lie in it, and their mean is that of the points that fall in it by chance (4 sigma).
    #[test]
    fn area_and_points() {
        for outline in [Outline::Round { radius: 20.0 }, Outline::Square { half: 18.0 }] {
            let port = Opening::new(outline, 0.3, 50.0);
            let n = 1_000_000u64;
            let (mut inside, mut along, mut along2) = (0.0, 0.0, 0.0);
            for i in 0..n {
                let r = 50.0 * anywhere(&mut Stream::new(1, 2, i));
                if port.holds(r) {
                    inside += 1.0;
                    along += r.dot(port.axis);
                    along2 += r.dot(port.axis) * r.dot(port.axis);
                }
            }
            let share = inside / n as f64;
            let sigma = (share * (1.0 - share) / n as f64).sqrt();
            assert!((share - port.fraction).abs() < 4.0 * sigma, "{outline:?}: {share} {}", port.fraction);
            let mean = along / inside;
            let variance = along2 / inside - mean * mean;
            let m = 50_000u64;
            let mut drawn = 0.0;
            for i in 0..m {
                let r = port.point(&mut Stream::new(1, 3, i));
                assert!(port.holds(r * (1.0 - 1e-12)) && (r.length() - 50.0).abs() < 1e-11);
                drawn += r.dot(port.axis) / m as f64;
            }
            let sigma = (variance * (1.0 / m as f64 + 1.0 / inside)).sqrt();
            assert!((drawn - mean).abs() < 4.0 * sigma, "{outline:?}: {drawn} {mean} +- {sigma}");
        }
        let cap = Opening::new(Outline::Round { radius: 10.0 }, 0.0, 50.0);
        assert!((cap.fraction - 0.5 * (1.0 - (1.0f64 - 0.04).sqrt())).abs() < 1e-16);
    }

    /// From any point inside, the wall is where the ray says, and the normal looks back.
    #[test]
    fn walls_are_met() {
        for outline in [Outline::Round { radius: 5.0 }, Outline::Square { half: 5.0 }] {
            let port = Opening::new(outline, 0.0, 50.0);
            for i in 0..1000 {
                let mut random = Stream::new(4, 4, i);
                let r = DVec3::new(3.0 * random.uniform(), -3.0 * random.uniform(), -52.0);
                let u = anywhere(&mut random);
                let (distance, normal) = port.wall(r, u);
                let met = r + distance * u;
                assert!(port.frames(met - 1e-9 * u) && !port.frames(met + 1e-9 * u), "{outline:?} {r} {u}");
                assert!(normal.dot(u) < 0.0 && (normal.length() - 1.0).abs() < 1e-12);
            }
        }
    }
}
