//! Coordinates on a smooth surface, and the functions of them that are fitted to images of it.

use std::f64::consts::TAU;

use glam::DVec3;
use turbid_optics::solid::Solid;

/// Around an axis are harmonics where at least this part of the full turn is seen.
const LEAST_TURN: f64 = 0.75;
/// Steps around, in which it is looked for what is seen of a turn.
const STEPS: usize = 32;
/// A wall runs along its axis where its normal's part along it is below this.
const ACROSS: f64 = 0.5;
/// Points of a sphere are mapped where none is nearer than this to the antipode of the middle (1 + cos of the angle).
const LEAST_FROM_ANTIPODE: f64 = 0.05;

/// What the functions are made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Chart {
    /// Polynomials in two coordinates in [-1, 1]: order L has those of total degree L.
    Plane,
    /// Along an axis polynomials in a coordinate in [-1, 1], around it harmonics of an angle in rad: order L has the products of degree i and
    /// harmonic h with i + steepness h = L.
    Axis,
}

/// Where a pixel looks at.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    /// By the chart.
    pub at: [f64; 2],
    /// (sin, cos) of the phase of the fringe there, over its contrast; zeros of what has no fringe.
    pub carrier: (f64, f64),
}

/// Functions of the places of a chart, order by order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Functions {
    chart: Chart,
    /// So many orders along an axis come with each harmonic around it; 0: none has any.
    steepness: usize,
    /// Whether there are those of light from elsewhere, too.
    ///
    /// Light that comes by way of other places has not the phase of the fringe at this one, but a smooth one: freed from the phase of this one it is a smooth
    /// function times the carrier's sine and cosine. Order L has those of order L - [`LATER`] times both.
    elsewhere: bool,
}

/// Light from elsewhere is smoother than what is scattered here.
const LATER: usize = 2;

impl Chart {
    /// Sets of functions that an image may be made of, the one with the most first: what is round has few harmonics, or none, and in a bore light comes by way of all
    /// walls. `is_fringe`: of re and im of a fringe.
    pub fn functions(self, is_fringe: bool) -> impl Iterator<Item = Functions> {
        let (steepness, elsewhere): (&[usize], &[bool]) = match self {
            Self::Plane => (&[1], &[false]),
            Self::Axis if is_fringe => (&[1, 2, 4, 0], &[true, false]),
            Self::Axis => (&[1, 2, 4, 0], &[false]),
        };
        let all = elsewhere.iter().flat_map(move |&elsewhere| steepness.iter().map(move |&s| (elsewhere, s)));
        all.map(move |(elsewhere, steepness)| Functions { chart: self, steepness, elsewhere })
    }

    /// All harmonics, without light from elsewhere.
    pub fn own_functions(self) -> Functions {
        Functions { chart: self, steepness: 1, elsewhere: false }
    }
}

impl Functions {
    /// How many harmonics an order of them has, each by cosine and sine.
    fn harmonics(self, order: usize) -> usize {
        order.checked_div(self.steepness).unwrap_or(0)
    }

    /// Whether no harmonic is left out that belongs to an order.
    pub fn has_all_harmonics(self) -> bool {
        self.steepness == 1
    }

    /// How many there are of a degree, but for those of light from elsewhere.
    fn of_degree(self, degree: usize) -> usize {
        match self.chart {
            Chart::Plane => degree + 1,
            Chart::Axis => 1 + 2 * self.harmonics(degree),
        }
    }

    /// How many functions there are up to an order.
    pub fn terms(self, order: usize) -> usize {
        let up_to = |order: usize| (0..=order).map(|degree| self.of_degree(degree)).sum::<usize>();
        let later = order.checked_sub(LATER).filter(|_| self.elsewhere);
        up_to(order) + later.map_or(0, |order| 2 * up_to(order))
    }

    /// All functions up to an order at a place, order ascending.
    pub fn basis(self, Place { at: [u, v], carrier: (sine, cosine) }: Place, order: usize, into: &mut Vec<f64>) {
        into.clear();
        let along = chebyshev(u, order);
        let across = if self.chart == Chart::Plane { chebyshev(v, order) } else { Vec::new() };
        let around = if self.chart == Chart::Axis { harmonics(v, self.harmonics(order)) } else { Vec::new() };
        // Where those of each degree begin.
        let mut begin = Vec::with_capacity(order + 1);
        for degree in 0..=order {
            begin.push(into.len());
            match self.chart {
                Chart::Plane => into.extend((0..=degree).map(|i| along[i] * across[degree - i])),
                Chart::Axis => {
                    for harmonic in (0..=self.harmonics(degree)).rev() {
                        let ((s, c), along) = (around[harmonic], along[degree - self.steepness * harmonic]);
                        into.push(along * c);
                        into.extend((harmonic > 0).then_some(along * s));
                    }
                }
            }
            if let Some(lower) = degree.checked_sub(LATER).filter(|_| self.elsewhere) {
                for k in begin[lower]..begin[lower] + self.of_degree(lower) {
                    let function = into[k];
                    into.extend([function * sine, function * cosine]);
                }
            }
        }
    }
}

/// Chebyshev's polynomials of x up to a degree (and 1 at least).
fn chebyshev(x: f64, degree: usize) -> Vec<f64> {
    let mut values = vec![1.0, x];
    for k in 1..degree.max(1) {
        values.push(2.0 * x * values[k] - values[k - 1]);
    }
    values
}

/// Sine and cosine of 0, 1, .. `most` times an angle in rad.
fn harmonics(angle: f64, most: usize) -> Vec<(f64, f64)> {
    let (sin, cos) = (libm::sin(angle), libm::cos(angle));
    let mut around = vec![(0.0, 1.0)];
    for k in 0..most {
        let (s, c) = around[k];
        around.push((s * cos + c * sin, c * cos - s * sin));
    }
    around
}

/// Where points of a surface are on it.
pub struct Places {
    pub chart: Chart,
    pub at: Vec<[f64; 2]>,
}

impl Places {
    /// Of `points` on a face of a solid, with their normals, seen from `eye`: around a sphere the equal-area map about the middle of what is seen, along and around a wall
    /// about an axis; elsewhere, as for graphs over the image plane, `pixels`, the places in the image.
    pub fn of(solid: &Solid, face: u32, points: &[DVec3], normals: &[DVec3], eye: DVec3, pixels: &[[f64; 2]]) -> Self {
        let on = match solid {
            Solid::Turned(turned) => {
                let into: Vec<DVec3> = points.iter().map(|&p| turned.frame.point_into(p)).collect();
                let normals: Vec<DVec3> = normals.iter().map(|&m| turned.frame.direction_into(m)).collect();
                return Self::of(&turned.solid, face, &into, &normals, turned.frame.point_into(eye), pixels);
            }
            Solid::Carved(carved) => {
                let part = face.checked_sub(1).map_or(&carved.whole, |k| &carved.holes[k as usize]);
                return Self::of(part, 0, points, normals, eye, pixels);
            }
            Solid::Ellipsoid { center, radii } => around_sphere(points.iter().map(|p| (p - center) / radii)),
            Solid::Cylinder { axis, radius, .. } if normals.iter().all(|m| m.z.abs() < ACROSS) => {
                let from = points.iter().map(|p| p - axis.extend(eye.z));
                Some(along_axis(from.map(|p| p / *radius)))
            }
            _ => None,
        };
        let (chart, at) = on.unwrap_or_else(|| (Chart::Plane, pixels.to_vec()));
        Self { at: scaled(chart, at), chart }
    }
}

/// Lambert's azimuthal equal-area map of points of the unit sphere, about their mean: smooth up to the rim, where places in the image are not.
fn around_sphere(points: impl Iterator<Item = DVec3> + Clone) -> Option<(Chart, Vec<[f64; 2]>)> {
    let middle = points.clone().sum::<DVec3>().try_normalize()?;
    let (right, top) = middle.any_orthonormal_pair();
    let of = |p: DVec3| {
        let from_antipode = 1.0 + p.dot(middle);
        let stretch = (2.0 / from_antipode).sqrt();
        (from_antipode > LEAST_FROM_ANTIPODE).then(|| [stretch * p.dot(right), stretch * p.dot(top)])
    };
    Some((Chart::Plane, points.map(of).collect::<Option<_>>()?))
}

/// Along the z axis and around it, of points from a place on it, in units of the radius. Where only a part of the turn is seen it is rolled out.
///
/// Along: asinh, so that far away equal steps are equal ratios of distances, by which light falls off.
fn along_axis(points: impl Iterator<Item = DVec3>) -> (Chart, Vec<[f64; 2]>) {
    let mut at: Vec<[f64; 2]> = points.map(|p| [libm::asinh(p.z), libm::atan2(p.y, p.x)]).collect();
    let mut seen = [false; STEPS];
    let step = |angle: f64| ((angle / TAU + 0.5) * STEPS as f64) as usize;
    at.iter().for_each(|p| seen[step(p[1]).min(STEPS - 1)] = true);
    let turn = seen.iter().filter(|&&s| s).count() as f64 / STEPS as f64;
    if turn >= LEAST_TURN {
        return (Chart::Axis, at);
    }
    // How many steps behind each one nothing is seen: the cut is in the middle of the longest such part.
    let unseen = |from: usize| (0..STEPS).take_while(|k| !seen[(from + k) % STEPS]).count();
    let from = (0..STEPS).rev().max_by_key(|&from| unseen(from)).unwrap_or(0);
    let cut = ((from as f64 + 0.5 * unseen(from) as f64) / STEPS as f64 - 0.5) * TAU;
    at.iter_mut().for_each(|p| p[1] = (p[1] - cut).rem_euclid(TAU));
    (Chart::Plane, at)
}

/// With lengths mapped to [-1, 1]; angles stay.
fn scaled(chart: Chart, mut at: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    let lengths = if chart == Chart::Plane { 2 } else { 1 };
    for i in 0..lengths {
        let (low, high) =
            at.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| (low.min(p[i]), high.max(p[i])));
        let scale = if high > low { 2.0 / (high - low) } else { 0.0 };
        at.iter_mut().for_each(|p| p[i] = (p[i] - 0.5 * (low + high)) * scale);
    }
    at
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;

    /// As many functions as are said, the first ones those of the lower orders; Chebyshev's are cos(i arccos x), 1e-13 is rounding.
    #[test]
    fn functions_come_order_by_order() {
        let (u, v) = (0.3_f64, -0.7_f64);
        let place = Place { at: [u, v], carrier: (0.6, -0.8) };
        for functions in [Chart::Plane, Chart::Axis].into_iter().flat_map(|chart| chart.functions(true)) {
            let (mut all, mut some) = (Vec::new(), Vec::new());
            functions.basis(place, 9, &mut all);
            assert_eq!(all.len(), functions.terms(9));
            for order in 0..9 {
                functions.basis(place, order, &mut some);
                assert_eq!(some[..], all[..functions.terms(order)], "{functions:?} {order}");
            }
        }
        let mut values = Vec::new();
        let chebyshev = |i: f64| (i * u.acos()).cos();
        let of = |chart, steepness, elsewhere| Functions { chart, steepness, elsewhere };
        for (functions, order, number, expected) in [
            // Degree 1 stands behind the pair of degree 0.
            (of(Chart::Axis, 1, false), 3, 3, chebyshev(1.0) * (2.0 * v).sin()),
            // Harmonics 2, 1 and 0 with degrees 1, 3 and 5.
            (of(Chart::Axis, 2, false), 5, 2, chebyshev(3.0) * v.cos()),
            (of(Chart::Axis, 0, false), 5, 0, chebyshev(5.0)),
            // Behind nine of degree 4 the sine and cosine of the carrier with each of degree 2, the last of which is of u alone.
            (of(Chart::Axis, 1, true), 4, 9 + 9, -0.8 * chebyshev(2.0)),
        ] {
            functions.basis(place, order, &mut values);
            let found = values[functions.terms(order - 1) + number];
            assert!((found - expected).abs() < 1e-13, "{functions:?}: {found} {expected}");
        }
    }

    /// The bore of a tube is seen all around; a ball keeps its rim at a finite slope; what is neither has the places of the image.
    #[test]
    fn surfaces_have_their_coordinates() {
        let tube = Solid::tube(4.0, 9.0, DVec2::ZERO, -50.0, 0.0);
        let wall = |k: usize| {
            let angle = k as f64;
            DVec3::new(2.0 * angle.cos(), 2.0 * angle.sin(), -(k as f64) / 3.0)
        };
        let points: Vec<DVec3> = (0..90).map(wall).collect();
        let normals: Vec<DVec3> = points.iter().map(|p| tube.normal(1, *p)).collect();
        let pixels = vec![[0.0, 0.0]; 90];
        let places = Places::of(&tube, 1, &points, &normals, 10.0 * DVec3::Z, &pixels);
        assert_eq!(places.chart, Chart::Axis);
        assert!((places.at[0][0] - 1.0).abs() < 1e-12 || (places.at[0][0] + 1.0).abs() < 1e-12);
        let half: Vec<DVec3> = points.iter().copied().filter(|p| p.x > 0.0).collect();
        let places = Places::of(&tube, 1, &half, &normals[..half.len()], 10.0 * DVec3::Z, &pixels);
        assert_eq!(places.chart, Chart::Plane);
        // Rolled out: along it as above, around it by the angle, also where the half is cut by the angle's jump at -x.
        let spread = |places: &Places| places.at.iter().fold(0.0, |most: f64, p| most.max(p[1].abs()));
        assert!((spread(&places) - 1.0).abs() < 1e-12);
        let left: Vec<DVec3> = points.iter().copied().filter(|p| p.x < 0.0).collect();
        let places = Places::of(&tube, 1, &left, &normals[..left.len()], 10.0 * DVec3::Z, &pixels);
        let angle = |p: &DVec3| p.y.atan2(-p.x);
        for pair in 1..left.len() {
            let (turned, before) = (angle(&left[pair]) - angle(&left[pair - 1]), places.at[pair - 1][1]);
            // Half a turn is 2; angles of (-x, y) run the other way round.
            let scale = (places.at[pair][1] - before) / -turned;
            assert!((scale - 2.0 / std::f64::consts::PI).abs() < 0.05, "{scale}");
        }
        let ball = Solid::Ellipsoid { center: DVec3::ZERO, radii: DVec3::new(3.0, 3.0, 5.0) };
        let at = |angle: f64| DVec3::new(3.0 * angle.sin(), 0.0, 5.0 * angle.cos());
        let points: Vec<DVec3> = (-10..=10).map(|k| at(f64::from(k) * 0.15)).collect();
        let places = Places::of(&ball, 0, &points, &points, 50.0 * DVec3::Z, &pixels[..21]);
        let steps: Vec<f64> = places.at.windows(2).map(|w| (w[1][0] - w[0][0]).hypot(w[1][1] - w[0][1])).collect();
        // From the middle it is 2 sin(angle / 2): near the rim, at 1.425 rad, steps are those of the middle times cos(angle / 2).
        assert!((steps[19] / steps[10] - 0.7125_f64.cos() / 0.075_f64.cos()).abs() < 0.01, "{steps:?}");
    }
}
