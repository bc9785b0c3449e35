//! Where light that is reflected once on its way from a source to a point meets the surface of a solid.
//!
//! With the unit vectors a and b from the place to both ends, a + b is along the normal there, and both ends are on one side of it. On a plane that
//! is where the line to the mirror image of an end meets it. Around a sphere or a cylinder it is Alhazen's problem, a trigonometric polynomial of degree
//! two, of which all roots are found; on other ellipsoids bounds leave out what cannot hold a place (`ellipsoid.rs`).

mod ellipsoid;

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};

use super::Solid;
use super::crossing::{Ends, Far, holds};
use crate::elementary::sin_cos_turns;

/// Angles closer than this are one, rad: between two places so close light is in focus.
const SMALLEST: f64 = 1e-9;
/// Newton's method in a bracket doubles the digits, after some halvings at most.
const MOST_STEPS: usize = 100;

impl Ends {
    /// Of light that is reflected, so that the index is the same at both.
    pub fn alike(far: Far, near: DVec3) -> Self {
        Self { far, n_far: 1.0, near, n_near: 1.0 }
    }

    /// By the plane of the points at which `normal` (unit) has the product `offset`; `None` where the ends are on different sides.
    pub(super) fn by_plane(&self, normal: DVec3, offset: f64) -> Option<DVec3> {
        let height = self.near.dot(normal) - offset;
        let foot = self.near - height * normal;
        // What the light advances along the plane, over the height from which it does.
        let slope = match self.far {
            Far::Point(a) => {
                let up = a.dot(normal) - offset;
                (up * height > 0.0).then(|| (a - self.near - (up - height) * normal) / (up + height))?
            }
            Far::Direction(towards) => {
                let up = towards.dot(normal);
                (up * height > 0.0).then(|| (towards - up * normal) / up)?
            }
        };
        Some(foot + height * slope)
    }

    /// By a triangle.
    pub(super) fn by_facet(&self, corners: &[DVec3; 3], normal: DVec3) -> Option<DVec3> {
        self.by_plane(normal, normal.dot(corners[0])).filter(|p| holds(corners, normal, *p))
    }
}

impl Solid {
    /// Points of the surface at which the law of reflection takes light from the far end to the near one, both on either side of it: all of them, some
    /// perhaps twice; where there is a whole ring of them, in which light is in focus, some of it. What stands in the way does not count. The indices of the ends are the same.
    pub fn reflections(&self, ends: &Ends, found: &mut dyn FnMut(DVec3)) {
        self.flat_faces(&mut |axis, offset, on_face| {
            if let Some(p) = ends.by_plane(axis, offset).filter(|p| on_face(*p)) {
                found(p);
            }
        });
        match *self {
            Self::Slab { .. } | Self::Box { .. } => {}
            Self::Cylinder { axis, radius, bottom, top } => {
                let local = ends.moved(|p| p - axis.extend(0.0), |w| w);
                by_cylinder(&local, radius, &mut |p| {
                    if bottom <= p.z && p.z <= top {
                        found(p + axis.extend(0.0));
                    }
                });
            }
            Self::Ellipsoid { center, radii } => {
                let local = ends.moved(|p| p - center, |w| w);
                if radii == DVec3::splat(radii.x) {
                    by_sphere(&local, radii.x, &mut |p| found(p + center));
                } else {
                    ellipsoid::reflections(&local, radii, &mut |p| found(p + center));
                }
            }
            Self::Turned(ref turned) => {
                let frame = &turned.frame;
                let local = ends.moved(|p| frame.point_into(p), |w| frame.direction_into(w));
                turned.solid.reflections(&local, &mut |p| found(frame.point_out(p)));
            }
            Self::Carved(ref carved) => {
                carved.whole.reflections(ends, found);
                carved.holes.iter().for_each(|hole| hole.reflections(ends, found));
            }
            Self::Mesh(ref mesh) => mesh.reflections(ends, found),
        }
    }
}

/// About the origin: every place lies in the plane of both ends and the middle.
fn by_sphere(ends: &Ends, radius: f64, found: &mut dyn FnMut(DVec3)) {
    let far = match ends.far {
        Far::Point(p) | Far::Direction(p) => p,
    };
    let x = ends.near.try_normalize().or(far.try_normalize()).unwrap_or(DVec3::X);
    // On one line with the middle any plane through it will do.
    let y = (far - far.dot(x) * x).try_normalize().unwrap_or(x.any_orthonormal_vector());
    let flat = |p: DVec3| DVec2::new(p.dot(x), p.dot(y));
    around(ends, flat, radius, &mut |p| found(p.x * x + p.y * y));
}

/// About the z axis: along it light goes on as it came, across it is reflected as in a circle.
fn by_cylinder(ends: &Ends, radius: f64, found: &mut dyn FnMut(DVec3)) {
    if let Far::Direction(towards) = ends.far
        && towards.truncate() == DVec2::ZERO
    {
        return;
    }
    around(ends, DVec3::truncate, radius, &mut |p| {
        let advance = (ends.near.truncate() - p).length();
        let slope = match ends.far {
            Far::Point(a) => (a.z - ends.near.z) / (advance + (a.truncate() - p).length()),
            Far::Direction(towards) => towards.z / towards.truncate().length(),
        };
        found(p.extend(ends.near.z + advance * slope));
    });
}

/// In the plane, where a circle about the origin reflects light. As complex numbers ends A and B are seen from p = R e^{i phi} at opposite angles to the normal
/// if (A - p) (B - p) / p^2 is real, which is Im(A B e^{-2 i phi} - R (A + B) e^{-i phi}) = 0 (for a direction A: Im(A B e^{-2 i phi} - R A e^{-i phi})). If it is negative,
/// they are on different sides.
fn around(ends: &Ends, flat: impl Fn(DVec3) -> DVec2, radius: f64, found: &mut dyn FnMut(DVec2)) {
    let near = flat(ends.near);
    let (far, sum) = match ends.far {
        Far::Point(p) => (flat(p), flat(p) + near),
        Far::Direction(w) => (flat(w), flat(w)),
    };
    let (double, single) = (far.rotate(near), radius * sum);
    let at = |turns: f64| {
        let (sin, cos) = sin_cos_turns(turns);
        let once = single.rotate(DVec2::new(cos, -sin));
        let twice = double.rotate(DVec2::new(cos * cos - sin * sin, -2.0 * sin * cos));
        // And its derivative by phi.
        (twice.y - once.y, once.x - 2.0 * twice.x)
    };
    let bend = 4.0 * double.length() + single.length();
    let one_side = |turns: f64| {
        let (sin, cos) = sin_cos_turns(turns);
        let p = radius * DVec2::new(cos, sin);
        let to_far = match ends.far {
            Far::Point(_) => far - p,
            Far::Direction(_) => far,
        };
        (to_far.dot(p) * (near - p).dot(p) > 0.0).then_some(p)
    };
    // Both in the middle: the whole circle is in focus.
    let whole = matches!(ends.far, Far::Point(_)) && bend <= 1e-13 * radius * radius;
    if whole {
        one_side(0.0).into_iter().for_each(found);
        return;
    }
    // Three sectors, so that no root that symmetry makes likely stands at an edge.
    for third in 0..3 {
        let low = 0.01 + f64::from(third) / 3.0;
        roots(&at, bend, (low, low + 1.0 / 3.0), &mut |turns| one_side(turns).into_iter().for_each(&mut *found));
    }
}

/// Every root of a function in (low, high), turns; it says value and derivative by the angle in rad, the second derivative is at most `bend`.
fn roots(at: &impl Fn(f64) -> (f64, f64), bend: f64, (low, high): (f64, f64), found: &mut dyn FnMut(f64)) {
    let (middle, half) = (0.5 * (low + high), 0.5 * TAU * (high - low));
    let (value, slope) = at(middle);
    if value.abs() > slope.abs() * half + 0.5 * bend * half * half {
        return;
    }
    if half < SMALLEST {
        found(middle);
    } else if slope.abs() > bend * half {
        // It rises or falls all the way.
        if at(low).0 * at(high).0 <= 0.0 {
            found(settle(at, low, high));
        }
    } else {
        roots(at, bend, (low, middle), found);
        roots(at, bend, (middle, high), found);
    }
}

/// The only root between two places at which the function has different signs.
fn settle(at: &impl Fn(f64) -> (f64, f64), mut low: f64, mut high: f64) -> f64 {
    let rises = at(high).0 > at(low).0;
    let mut turns = 0.5 * (low + high);
    for _ in 0..MOST_STEPS {
        let (value, slope) = at(turns);
        if (value > 0.0) == rises {
            high = turns;
        } else {
            low = turns;
        }
        let newton = turns - value / slope / TAU;
        let next = if low < newton && newton < high { newton } else { 0.5 * (low + high) };
        if (next - turns).abs() <= f64::EPSILON {
            return next;
        }
        turns = next;
    }
    turns
}

#[cfg(test)]
mod tests;
