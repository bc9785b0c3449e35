//! Where a surface of facets may refract light from one point to another: bounds for boxes full of facets.
//!
//! Light goes from the far end to the near one through a point p of a facet of unit normal m, if with the unit vectors a, b from p to both
//!
//!     n_far a + n_near b = h  is along m,  and a . m and b . m have opposite signs.
//!
//! Over a box a, b and m stay in cones, so h stays in one: where it does not meet that of the normals, or both ends are on one side of all facets, or
//! the light would have to turn by more than refraction can, nothing in the box refracts it (Walter, Zhao, Holzschuch and Bala 2009).

use glam::DVec3;

use super::crossing::{Ends, Far};

/// An angle in [0, pi], by cosine and sine.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Angle {
    cos: f64,
    sin: f64,
}

/// A cone of directions around unit normals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Normals {
    axis: DVec3,
    within: Angle,
}

impl Angle {
    const ALL: Self = Self { cos: -1.0, sin: 0.0 };
    /// 1e-7 rad: cosines near 1 are rounded by so much.
    const ROUNDING: Self = Self { cos: 1.0 - 5e-15, sin: 1e-7 };

    /// Of that cosine; a little more than it.
    fn of_cos(cos: f64) -> Self {
        let cos = cos.clamp(-1.0, 1.0);
        Self { cos, sin: (1.0 - cos * cos).sqrt() } + Self::ROUNDING
    }

    /// At most a right angle; any angle for sines that there are not.
    fn of_sin(sin: f64) -> Self {
        if sin < 1.0 { Self { cos: (1.0 - sin * sin).sqrt(), sin } } else { Self::ALL }
    }

    /// Distance of the ends of unit vectors that differ by it.
    fn chord(self) -> f64 {
        (2.0 - 2.0 * self.cos).max(0.0).sqrt()
    }

    /// Whether unit vectors of this product differ by no more.
    fn holds(self, product: f64) -> bool {
        self == Self::ALL || product >= self.cos
    }

    /// Whether unit vectors of this product differ by no more than it and a right angle.
    fn holds_across(self, product: f64) -> bool {
        self.cos <= 0.0 || product >= -self.sin
    }
}

impl std::ops::Add for Angle {
    type Output = Self;

    /// At most pi.
    fn add(self, other: Self) -> Self {
        if self.cos + other.cos <= 0.0 {
            return Self::ALL;
        }
        Self { cos: self.cos * other.cos - self.sin * other.sin, sin: self.sin * other.cos + self.cos * other.sin }
    }
}

impl Normals {
    /// Around all of these.
    pub fn around(normals: &[DVec3]) -> Self {
        let Some(axis) = normals.iter().sum::<DVec3>().try_normalize() else {
            return Self { axis: DVec3::Z, within: Angle::ALL };
        };
        let least = normals.iter().map(|m| m.dot(axis)).fold(1.0, f64::min);
        Self { axis, within: Angle::of_cos(least) }
    }
}

impl Ends {
    /// False only if no facet in the box between two corners, its normal among `normals`, refracts light from one end to the other.
    pub(super) fn may_be_refracted(&self, low: DVec3, high: DVec3, normals: &Normals) -> bool {
        let middle = 0.5 * (low + high);
        let radius = 0.5 * (high - low).length();
        // From all points of the ball around the box.
        let cone = |far: Far| {
            let (towards, inverse) = far.from(middle);
            (towards, Angle::of_sin(radius * inverse) + Angle::ROUNDING)
        };
        let ((a, a_within), (b, b_within)) = (cone(self.far), cone(Far::Point(self.near)));
        // Most where it grazes the side of less index.
        let (less, more) = (self.n_far.min(self.n_near), self.n_far.max(self.n_near));
        let turns = Angle::of_cos(less / more);
        if !(a_within + b_within + turns).holds(-a.dot(b)) {
            return false;
        }
        let sum = self.n_far * a + self.n_near * b;
        let off = self.n_far * a_within.chord() + self.n_near * b_within.chord();
        let length = sum.length();
        let along = Angle::of_sin(off / length) + normals.within;
        let sign = (self.n_far - self.n_near).signum() / length;
        [normals.axis, -normals.axis].into_iter().any(|m| {
            (a_within + normals.within).holds_across(a.dot(m))
                && (b_within + normals.within).holds_across(-b.dot(m))
                && along.holds(sign * sum.dot(m))
        })
    }
}
