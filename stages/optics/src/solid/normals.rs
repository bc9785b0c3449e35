//! Where a surface of facets may refract or reflect light from one point to another: bounds for boxes full of facets, and for single ones.
//!
//! Light goes from the far end to the near one through a point p of a facet of unit normal m, if with the unit vectors a, b from p to both
//!
//! ```text
//! n_far a + n_near b = h  is along m,  and a . m and b . m have opposite signs;
//! ```
//!
//! it is reflected there if n_far = n_near and both have the same sign.
//!
//! Over a box a, b and m stay in cones, so h stays in one: where it does not meet that of the normals, or both ends are on one side of all facets, or
//! the light would have to turn by more than refraction can, nothing in the box refracts it (Walter, Zhao, Holzschuch and Bala 2009).

use glam::DVec3;

use super::crossing::{Ends, Far};

/// A cone of directions around unit normals: cosine and sine of half its opening; -1 and 0 where it is open to all of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Normals {
    axis: DVec3,
    cos: f64,
    sin: f64,
}

/// rad; cosines near 1 are rounded by less than its square.
const ROUNDING: f64 = 1e-7;

impl Normals {
    /// Around all of these.
    pub fn around(normals: &[DVec3]) -> Self {
        let all = Self { axis: DVec3::Z, cos: -1.0, sin: 0.0 };
        let Some(axis) = normals.iter().sum::<DVec3>().try_normalize() else { return all };
        let cos = normals.iter().map(|m| m.dot(axis)).fold(1.0, f64::min);
        if cos <= 0.0 {
            return all;
        }
        Self { axis, cos: cos - ROUNDING, sin: (1.0 - cos * cos).max(0.0).sqrt() + ROUNDING }
    }
}

/// Light that is looked for among facets.
#[derive(Clone, Copy, Debug)]
pub struct Search<'a> {
    ends: &'a Ends,
    /// Cosine and sine of the largest angle by which refraction turns light: where it grazes the side of less index. `None` of reflection, which may turn it
    /// by any.
    turns: Option<(f64, f64)>,
    /// Of h . m, where a . m is positive.
    sign: f64,
    /// Of b . m, where a . m is positive.
    side: f64,
    /// mm; the near end may be anywhere in a ball of this radius.
    near_radius: f64,
}

impl<'a> Search<'a> {
    pub fn refracting(ends: &'a Ends) -> Self {
        let (less, more) = (ends.n_far.min(ends.n_near), ends.n_far.max(ends.n_near));
        let cos = less / more;
        let turns = Some((cos, (1.0 - cos * cos).max(0.0).sqrt()));
        Self { ends, turns, sign: (ends.n_far - ends.n_near).signum(), side: -1.0, near_radius: 0.0 }
    }

    /// Between ends of the same index.
    pub fn reflecting(ends: &'a Ends) -> Self {
        Self { ends, turns: None, sign: 1.0, side: 1.0, near_radius: 0.0 }
    }

    /// For all near ends within `radius` mm of this one together.
    pub fn around_near(self, radius: f64) -> Self {
        Self { near_radius: radius, ..self }
    }

    /// False only if no facet in the box between two corners, its normal among `normals`, takes light from one end to the other.
    #[inline]
    pub fn may_be_in(&self, low: DVec3, high: DVec3, normals: &Normals) -> bool {
        let middle = 0.5 * (low + high);
        let radius = 0.5 * (high - low).length();
        let ((a, a_inverse), (b, b_inverse)) = (self.ends.far.from(middle), Far::Point(self.ends.near).from(middle));
        // Sines of the cones of a and b, from the points of the ball around the box.
        let (a_sin, b_sin) = (radius * a_inverse + ROUNDING, (radius + self.near_radius) * b_inverse + ROUNDING);
        // Written so that an end in the middle of the box, with no direction to it, is near.
        let far_off = a_sin < 1.0 && b_sin < 1.0;
        if !far_off || normals.cos <= 0.0 {
            return true;
        }
        // A chord of a cone is less than this for sines up to 1.
        let chord = |sin: f64| sin * (1.0 + 0.415 * sin * sin);
        let h = self.ends.n_far * a + self.ends.n_near * b;
        let length = h.length();
        let sin = (self.ends.n_far * chord(a_sin) + self.ends.n_near * chord(b_sin)) / length;
        // The cone of h and that of the normals, opened by each other.
        let along = if sin < 1.0 { (1.0 - sin * sin).sqrt() * normals.cos - sin * normals.sin } else { -1.0 };
        let least = (along - ROUNDING) * length;
        let faces = |m: DVec3| {
            // sin x + sin y is no less than sin(x + y), and below 1 only for x + y below a right angle.
            let across = |product: f64, sin: f64| sin + normals.sin >= 1.0 || product >= -(sin + normals.sin);
            self.sign * h.dot(m) >= least && across(a.dot(m), a_sin) && across(self.side * b.dot(m), b_sin)
        };
        (faces(normals.axis) || faces(-normals.axis)) && self.may_turn(-a.dot(b), a_sin, b_sin)
    }

    /// Whether light may turn by an angle of that cosine, known up to two others.
    fn may_turn(&self, cos: f64, a_sin: f64, b_sin: f64) -> bool {
        let Some(mut limit) = self.turns else { return true };
        for sin in [a_sin, b_sin] {
            let with = (1.0 - sin * sin).sqrt();
            limit = (limit.0 * with - limit.1 * sin, limit.1 * with + limit.0 * sin);
            // Beyond two right angles.
            if limit.1 < 0.0 {
                return true;
            }
        }
        cos >= limit.0 - ROUNDING
    }

    /// False only if a facet takes no light from one end to the other: over it the part of h along it changes by less than that at its middle.
    #[inline]
    pub fn may_be_on(&self, [p, q, r]: &[DVec3; 3], normal: DVec3) -> bool {
        let middle = (p + q + r) * (1.0 / 3.0);
        let square = [p, q, r].into_iter().map(|corner| (corner - middle).length_squared()).fold(0.0, f64::max);
        let radius = square.sqrt() * (1.0 + ROUNDING);
        let ((a, a_inverse), (b, b_inverse)) = (self.ends.far.from(middle), Far::Point(self.ends.near).from(middle));
        let (a_near, b_near) = (radius * a_inverse, (radius + self.near_radius) * b_inverse);
        let far_off = a_near < 1.0 && b_near < 1.0;
        if !far_off {
            return true;
        }
        let h = self.ends.n_far * a + self.ends.n_near * b;
        let off = self.ends.n_far * a_near / (1.0 - a_near) + self.ends.n_near * b_near / (1.0 - b_near) + ROUNDING;
        (h - h.dot(normal) * normal).length_squared() <= off * off
    }
}
