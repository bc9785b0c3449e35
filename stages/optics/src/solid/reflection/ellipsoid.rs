//! All places where an ellipsoid reflects light from one point to another.
//!
//! The surface is that of a cube, blown up to the unit sphere and stretched. A patch of it is left out where a + b cannot be along the normal,
//! by cones that hold a, b and the normal all over the patch, and where both ends are on different sides. What is left is quartered until the optical
//! length |a| + |b| bends all over a patch much as in its middle: then there is one place at most, and Newton's method finds it.

use glam::{DMat2, DVec2, DVec3};

use super::super::crossing::{Ends, Far};

/// Patches that small are not divided any more: light is nearly in focus there, and every patch is tried.
const SMALLEST: f64 = 1e-5;
/// Patches of one search at most; the others are tried as they are.
const MOST_PATCHES: usize = 200_000;
/// By how much of itself the second derivative may change between the middle of a patch and its corners.
const EVEN: f64 = 0.25;
/// Of patches that are smaller than this, rad.
const LOCAL: f64 = 0.4;
const MOST_STEPS: usize = 40;
/// After a step of so much, rad, Newton's method has arrived.
const SETTLED: f64 = 1e-10;
/// What rounding makes of a slope of 0.
const FLAT: f64 = 1e-15;
/// rad; more than the directions are rounded by.
const ROUNDING: f64 = 1e-14;

/// A square on a side of the cube from -1 to 1.
#[derive(Clone, Copy)]
struct Square {
    /// The axis across the side.
    out: DVec3,
    x: DVec3,
    y: DVec3,
    middle: DVec2,
    half: f64,
}

/// An ellipsoid about the origin, along the axes.
struct Search<'a> {
    ends: &'a Ends,
    radii: DVec3,
}

/// What is needed to move on the unit sphere about a point of it.
struct Chart {
    x: DVec3,
    y: DVec3,
    /// First and second derivatives of the optical length by the way along x and y.
    slope: DVec2,
    bend: DMat2,
}

/// What a patch may hold.
enum Holds {
    Nothing,
    /// At most one place, and that not far from its middle.
    One,
    Several,
}

/// As [`super::Solid::reflections`], for an ellipsoid about the origin.
pub(super) fn reflections(ends: &Ends, radii: DVec3, found: &mut dyn FnMut(DVec3)) {
    let search = Search { ends, radii };
    let mut squares = Vec::with_capacity(64);
    for (out, x) in [(DVec3::X, DVec3::Y), (DVec3::Y, DVec3::Z), (DVec3::Z, DVec3::X)] {
        for out in [out, -out] {
            let y = out.cross(x);
            squares.push(Square { out, x, y, middle: DVec2::ZERO, half: 1.0 });
        }
    }
    let (mut patches, mut places): (usize, Vec<DVec3>) = (0, Vec::new());
    while let Some(square) = squares.pop() {
        patches += 1;
        let (s, size) = (square.at(0.0, 0.0), square.size());
        match search.holds(&square, s, size) {
            Holds::Nothing => {}
            Holds::Several if size > SMALLEST && patches < MOST_PATCHES => squares.extend(square.quarters()),
            Holds::One | Holds::Several => {
                // Those that several patches lead to come once.
                let place = search.settle(s, size);
                places.extend(place.filter(|p| places.iter().all(|q| (*p - *q).length() > 1e-9)));
            }
        }
    }
    let one_side = |p: &DVec3| {
        let normal = *p / (radii * radii);
        ends.far.from(*p).0.dot(normal) * (ends.near - *p).dot(normal) > 0.0
    };
    places.into_iter().map(|s| radii * s).filter(one_side).for_each(found);
}

impl Square {
    /// A point of the unit sphere, by coordinates in it from -1 to 1.
    fn at(&self, x: f64, y: f64) -> DVec3 {
        let (x, y) = (self.middle.x + self.half * x, self.middle.y + self.half * y);
        (self.out + x * self.x + y * self.y).normalize()
    }

    fn corners(&self) -> [DVec3; 4] {
        [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)].map(|(x, y)| self.at(x, y))
    }

    /// Of the patch on the unit sphere, its corners are this far from its middle at most.
    fn size(&self) -> f64 {
        let middle = self.at(0.0, 0.0);
        self.corners().into_iter().map(|corner| (corner - middle).length()).fold(0.0, f64::max)
    }

    fn quarters(&self) -> [Self; 4] {
        let half = 0.5 * self.half;
        [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)].map(|(x, y)| Self {
            middle: self.middle + half * DVec2::new(x, y),
            half,
            ..*self
        })
    }
}

impl Search<'_> {
    /// What the patch around `s`, a point of the unit sphere, may hold.
    fn holds(&self, square: &Square, s: DVec3, size: f64) -> Holds {
        let radii = self.radii;
        let (p, gradient) = (radii * s, s / radii);
        let normal = gradient.normalize();
        let corners = square.corners();
        // A point of the patch is one of the corners' hull, moved outwards by the square of the size over two at most.
        let bulge = 0.5 * size * size;
        let farthest = |scale: DVec3| corners.into_iter().map(|c| (scale * (c - s)).length()).fold(0.0, f64::max);
        let radius = farthest(radii) + bulge * radii.max_element();
        let turns = (farthest(1.0 / radii) + bulge / radii.min_element()) / gradient.length();
        let ((a, a_inverse), (b, b_inverse)) = (self.ends.far.from(p), Far::Point(self.ends.near).from(p));
        // Sines of the cones of a, b and the normal.
        let sines = [radius * a_inverse, radius * b_inverse, turns];
        // Written so that an end in the middle of the patch, with no direction to it, is near.
        let narrow = sines.iter().all(|&sin| sin < 1.0);
        if !narrow {
            return Holds::Several;
        }
        let [a_sin, b_sin, sin] = sines;
        // A chord of a cone is less than this for sines up to 1.
        let chord = |sin: f64| sin * (1.0 + 0.415 * sin * sin);
        let sum = a + b;
        let along = sum - sum.dot(normal) * normal;
        if along.length() > chord(a_sin) + chord(b_sin) + sum.length() * sin + ROUNDING {
            return Holds::Nothing;
        }
        // Which side an end is on, where it is the same all over the patch.
        let side = |to: DVec3, to_sin: f64| {
            let (height, slack) = (to.dot(normal), to_sin + sin + ROUNDING);
            if slack < 1.0 && height.abs() > slack { height.signum() } else { 0.0 }
        };
        if side(a, a_sin) * side(b, b_sin) < 0.0 {
            return Holds::Nothing;
        }
        if size > LOCAL {
            return Holds::Several;
        }
        let chart = self.chart(s, None);
        let inverse = chart.bend.inverse();
        let even = |corner: DVec3| {
            let change = inverse * (self.chart(corner, Some(&chart)).bend - chart.bend);
            let square = change.x_axis.length_squared() + change.y_axis.length_squared();
            square <= EVEN * EVEN
        };
        if corners.into_iter().all(even) { Holds::One } else { Holds::Several }
    }

    /// At a point of the unit sphere; with axes like those of another.
    fn chart(&self, s: DVec3, like: Option<&Chart>) -> Chart {
        let (x, y) = match like {
            None => s.any_orthonormal_pair(),
            Some(chart) => {
                let x = (chart.x - chart.x.dot(s) * s).normalize();
                let y = s.cross(x);
                (x, if y.dot(chart.y) < 0.0 { -y } else { y })
            }
        };
        let p = self.radii * s;
        let ((a, a_inverse), (b, b_inverse)) = (self.ends.far.from(p), Far::Point(self.ends.near).from(p));
        let (sum, along) = (a + b, [self.radii * x, self.radii * y]);
        // Along a great circle p falls back by p itself.
        let falls = sum.dot(p);
        let second = |i: usize, j: usize| {
            let (u, v) = (along[i], along[j]);
            let straight = a_inverse * (u.dot(v) - a.dot(u) * a.dot(v)) + b_inverse * (u.dot(v) - b.dot(u) * b.dot(v));
            if i == j { straight + falls } else { straight }
        };
        let (xx, xy, yy) = (second(0, 0), second(0, 1), second(1, 1));
        Chart {
            x,
            y,
            slope: -DVec2::new(sum.dot(along[0]), sum.dot(along[1])),
            bend: DMat2::from_cols(DVec2::new(xx, xy), DVec2::new(xy, yy)),
        }
    }

    /// The place to which Newton's method leads from `s`, on the unit sphere; `None` where that is far off.
    fn settle(&self, s: DVec3, size: f64) -> Option<DVec3> {
        let mut at = s;
        for _ in 0..MOST_STEPS {
            let chart = self.chart(at, None);
            // Where light is in focus, no step would tell.
            if chart.slope.length() <= FLAT * self.radii.max_element() {
                return Some(at);
            }
            let step = -(chart.bend.inverse() * chart.slope);
            let length = step.length();
            // False for what is no number.
            let leads = (at - s).length() <= 3.0 * size && length < f64::INFINITY;
            if !leads {
                return None;
            }
            let step = step * (2.0 * size / length).min(1.0);
            at = (at + step.x * chart.x + step.y * chart.y).normalize();
            if length <= SETTLED {
                return Some(at);
            }
        }
        None
    }
}
