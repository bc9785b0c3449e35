//! Where light that is refracted once on its way from a source to a point comes through the surface of a solid.
//!
//! By Fermat the optical length n_b |b - p| + n_a |a - p| is stationary there. On a plane it is convex and the place has a closed form
//! but for one root (`refraction::Crossing`). On a curved surface it is least where the light has not yet met a focus: that place is found
//! by Newton's method from where the straight line meets the surface, downhill all the way. Places beyond a focus are left to others.

use glam::DVec3;

use super::Solid;
use crate::refraction::{Crossing, Leg};

/// Where light comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Far {
    Point(DVec3),
    /// From infinity; the unit vector towards it.
    Direction(DVec3),
}

/// Both ends of a way, and the refractive indices there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ends {
    pub far: Far,
    pub n_far: f64,
    pub near: DVec3,
    pub n_near: f64,
}

/// A curved surface, in coordinates in which it is simple.
#[derive(Clone, Copy)]
enum Curved {
    /// Semi-axes.
    Ellipsoid(DVec3),
    /// About the z axis.
    Cylinder(f64),
}

/// Newton's method doubles the digits; where it has to creep downhill first it takes some more steps.
const MOST_STEPS: usize = 60;

impl Far {
    /// Unit vector from `p` towards it, and one over the distance.
    pub(super) fn from(self, p: DVec3) -> (DVec3, f64) {
        match self {
            Self::Point(a) => {
                let d = a - p;
                let inverse = 1.0 / d.length();
                (d * inverse, inverse)
            }
            Self::Direction(towards) => (towards, 0.0),
        }
    }

    fn moved(self, point: impl Fn(DVec3) -> DVec3, direction: impl Fn(DVec3) -> DVec3) -> Self {
        match self {
            Self::Point(a) => Self::Point(point(a)),
            Self::Direction(w) => Self::Direction(direction(w)),
        }
    }
}

impl Ends {
    /// In other coordinates.
    pub(super) fn moved(&self, point: impl Fn(DVec3) -> DVec3, direction: impl Fn(DVec3) -> DVec3) -> Self {
        Self { far: self.far.moved(&point, direction), near: point(self.near), ..*self }
    }

    /// What is stationary, but for a constant: n_b |b - p| + n_a |a - p|, mm.
    fn length(&self, p: DVec3) -> f64 {
        let far = match self.far {
            Far::Point(a) => (a - p).length(),
            Far::Direction(towards) => -towards.dot(p),
        };
        self.n_far * far + self.n_near * (self.near - p).length()
    }

    /// Through the plane of the points at which `normal` (unit) has the product `offset`.
    pub(super) fn through_plane(&self, normal: DVec3, offset: f64) -> Option<DVec3> {
        let depth = offset - self.near.dot(normal);
        let foot = self.near + depth * normal;
        let (across, crossing) = match self.far {
            Far::Point(a) => {
                let height = a.dot(normal) - offset;
                let across = a - self.near - (height + depth) * normal;
                let legs = [Leg { n: self.n_near, depth: depth.abs() }, Leg { n: self.n_far, depth: height.abs() }];
                let crossing = (height * depth > 0.0).then(|| Crossing::new(legs.into_iter(), across.length()))??;
                (across, crossing)
            }
            Far::Direction(towards) => {
                let up = towards.dot(normal);
                let across = towards - up * normal;
                let legs = [Leg { n: self.n_near, depth: depth.abs() }, Leg { n: self.n_far, depth: 0.0 }];
                let tan = across.length() / up.abs();
                let crossing = (up * depth > 0.0).then(|| Crossing::at_slope(legs.into_iter(), self.n_far, tan))??;
                (across, crossing)
            }
        };
        let sideways = across.try_normalize().unwrap_or(DVec3::ZERO);
        Some(foot + depth.abs() * crossing.tan(self.n_near) * sideways)
    }

    /// Through a triangle.
    pub(super) fn through_facet(&self, corners: &[DVec3; 3], normal: DVec3) -> Option<DVec3> {
        let offset = normal.dot(corners[0]);
        if self.misses(corners, normal, offset) {
            return None;
        }
        self.through_plane(normal, offset).filter(|p| holds(corners, normal, *p))
    }

    /// True only if light comes through the plane of a triangle beside it: both ends of a stretch that holds the place are beyond one edge.
    fn misses(&self, corners: &[DVec3; 3], normal: DVec3, offset: f64) -> bool {
        let depth = offset - self.near.dot(normal);
        let foot = self.near + depth * normal;
        // Both ends of the stretch from the foot of the near end, towards that of the far one.
        let [p, q] = match self.far {
            Far::Point(a) => {
                let height = a.dot(normal) - offset;
                if height * depth <= 0.0 {
                    return true;
                }
                let across = a - self.near - (height + depth) * normal;
                if self.n_near < self.n_far {
                    [depth / (height + depth), 1.0].map(|part| foot + part * across)
                } else {
                    // The light comes down on the plane at an angle between that of the straight line and that towards the foot; by Snell's law of the
                    // tangents t_near = t_far sqrt(r / (1 + (1 - r) t_far^2)), r = (n_far / n_near)^2, which grows with t_far.
                    let (r, square) = ((self.n_far / self.n_near).powi(2), across.length_squared());
                    [height + depth, height].map(|h| {
                        let tangent = square / (h * h);
                        foot + depth / h * (r / (1.0 + (1.0 - r) * tangent)).sqrt() * across
                    })
                }
            }
            Far::Direction(towards) => {
                let up = towards.dot(normal);
                if up * depth <= 0.0 {
                    return true;
                }
                if self.n_near < self.n_far {
                    return false;
                }
                [foot, self.near + depth / up * towards]
            }
        };
        let size = p.abs().max(q.abs()).max(corners[0].abs()).max_element();
        (0..3).any(|k| {
            let (from, edge) = (corners[k], corners[(k + 1) % 3] - corners[k]);
            let inwards = normal.cross(edge);
            // More than rounding, and than what `holds` takes in.
            let beside = -1e-9 * size * edge.abs().max_element();
            inwards.dot(p - from) < beside && inwards.dot(q - from) < beside
        })
    }

    /// The place of least optical length on a curved surface, downhill from `p` on it; `None` where the two ends are on the same side.
    fn through_curved(&self, surface: Curved, mut p: DVec3) -> Option<DVec3> {
        for _ in 0..MOST_STEPS {
            let n = surface.normal(p);
            let ((a, a_inverse), (b, b_inverse)) = (self.far.from(p), Far::Point(self.near).from(p));
            let sum = self.n_far * a + self.n_near * b;
            let (u, v) = n.any_orthonormal_pair();
            // Downhill, and the second derivatives along the surface.
            let (down_u, down_v) = (sum.dot(u), sum.dot(v));
            let second = |x: DVec3, y: DVec3| {
                self.n_far * a_inverse * (x.dot(y) - a.dot(x) * a.dot(y))
                    + self.n_near * b_inverse * (x.dot(y) - b.dot(x) * b.dot(y))
                    + sum.dot(n) * x.dot(surface.bends(p, y))
            };
            let (uu, uv, vv) = (second(u, u), second(u, v), second(v, v));
            let det = uu * vv - uv * uv;
            let mut step = if uu > 0.0 && det > 0.0 {
                ((vv * down_u - uv * down_v) * u + (uu * down_v - uv * down_u) * v) / det
            } else {
                // Not convex here: downhill, by no more than its curvature allows.
                (down_u * u + down_v * v) / (uu.abs() + 2.0 * uv.abs() + vv.abs())
            };
            let near = 1.0 / (a_inverse + b_inverse);
            if !step.is_finite() {
                return None;
            }
            // By so little the second derivatives are right, and the length no longer tells.
            let mut small = step.length() <= 1e-4 * near;
            let here = self.length(p);
            let mut next = surface.drop(p + step);
            while !small && self.length(next) >= here {
                step *= 0.5;
                small = step.length() <= 1e-9 * near;
                next = surface.drop(p + step);
            }
            let settled = step.length() <= 4.0 * f64::EPSILON * p.abs().max_element();
            p = next;
            if settled || (down_u * down_u + down_v * down_v).sqrt() <= 1e-15 * (self.n_far + self.n_near) {
                let n = surface.normal(p);
                let through = self.far.from(p).0.dot(n) * (self.near - p).dot(n) < 0.0;
                return through.then_some(p);
            }
        }
        None
    }
}

/// Whether a point of its plane is in a triangle, its edges and what rounding puts beside them included.
pub(super) fn holds(corners: &[DVec3; 3], normal: DVec3, p: DVec3) -> bool {
    let size = corners.iter().fold(0.0, |size: f64, corner| size.max(corner.abs().max_element()));
    (0..3).all(|k| {
        let (from, edge) = (corners[k], corners[(k + 1) % 3] - corners[k]);
        edge.cross(p - from).dot(normal) >= -1e-12 * size * edge.length()
    })
}

impl Curved {
    fn normal(self, p: DVec3) -> DVec3 {
        match self {
            Self::Ellipsoid(radii) => (p / (radii * radii)).normalize(),
            Self::Cylinder(_) => p.with_z(0.0).normalize(),
        }
    }

    /// As `Solid::bends`.
    fn bends(self, p: DVec3, d: DVec3) -> DVec3 {
        match self {
            Self::Ellipsoid(radii) => {
                let gradient = p / (radii * radii);
                let (n, change) = (gradient.normalize(), d / (radii * radii));
                (change - n.dot(change) * n) / gradient.length()
            }
            Self::Cylinder(radius) => {
                let n = p.with_z(0.0).normalize();
                (d - d.dot(n) * n).with_z(0.0) / radius
            }
        }
    }

    /// A point near the surface, on it.
    fn drop(self, p: DVec3) -> DVec3 {
        match self {
            Self::Ellipsoid(radii) => p / (p / radii).length(),
            Self::Cylinder(radius) => (p.truncate() * (radius / p.truncate().length())).extend(p.z),
        }
    }
}

/// Whether a point of a plane is on the face that lies in it.
type OnFace<'a> = dyn Fn(DVec3) -> bool + 'a;

impl Solid {
    /// Slabs', boxes' and cylinders' own plane faces, as far as they are in reach: axis, offset along it, and whether a point of that plane is on the face.
    pub(super) fn flat_faces(&self, face: &mut dyn FnMut(DVec3, f64, &OnFace<'_>)) {
        let mut ends = |axis: DVec3, [low, high]: [f64; 2], on_face: &OnFace<'_>| {
            for offset in [low, high].into_iter().filter(|offset| offset.is_finite()) {
                face(axis, offset, on_face);
            }
        };
        match *self {
            Self::Slab { bottom, top } => ends(DVec3::Z, [bottom, top], &|_| true),
            Self::Box { low, high } => {
                for (axis, unit) in DVec3::AXES.into_iter().enumerate() {
                    let others = || (0..3).filter(|&other| other != axis);
                    ends(unit, [low[axis], high[axis]], &|p| others().all(|i| low[i] <= p[i] && p[i] <= high[i]));
                }
            }
            Self::Cylinder { axis, radius, bottom, top } => {
                ends(DVec3::Z, [bottom, top], &|p| (p.truncate() - axis).length_squared() <= radius * radius);
            }
            _ => {}
        }
    }

    /// Points of the surface at which Snell's law takes light from the far end to the near one: all of them on planes and facets, on each
    /// curved part the one of least time, if the straight line meets it. What stands in the way does not count.
    pub fn crossings(&self, ends: &Ends, found: &mut dyn FnMut(DVec3)) {
        self.flat_faces(&mut |axis, offset, on_face| {
            if let Some(p) = ends.through_plane(axis, offset).filter(|p| on_face(*p)) {
                found(p);
            }
        });
        match *self {
            Self::Slab { .. } | Self::Box { .. } => {}
            Self::Cylinder { axis, radius, bottom, top } => {
                let endless = Self::Cylinder { axis, radius, bottom: f64::NEG_INFINITY, top: f64::INFINITY };
                let p = endless.round(ends, Curved::Cylinder(radius), axis.extend(0.0));
                p.filter(|p| bottom <= p.z && p.z <= top).into_iter().for_each(found);
            }
            Self::Ellipsoid { center, radii } => {
                self.round(ends, Curved::Ellipsoid(radii), center).into_iter().for_each(found);
            }
            Self::Turned(ref turned) => {
                let frame = &turned.frame;
                let local = ends.moved(|p| frame.point_into(p), |w| frame.direction_into(w));
                turned.solid.crossings(&local, &mut |p| found(frame.point_out(p)));
            }
            Self::Carved(ref carved) => {
                carved.whole.crossings(ends, found);
                carved.holes.iter().for_each(|hole| hole.crossings(ends, found));
            }
            Self::Mesh(ref mesh) => mesh.refractions(ends, found),
        }
    }

    /// The plane of the facet about a point that comes nearest to it: its unit normal outwards, and its height (mm) above the point along that; `None` of
    /// other surfaces, and where no facet is about.
    pub fn facets_near(&self, p: DVec3) -> Option<(DVec3, f64)> {
        match self {
            Self::Mesh(mesh) => mesh.plane_near(p),
            Self::Turned(turned) => {
                let (normal, height) = turned.solid.facets_near(turned.frame.point_into(p))?;
                Some((turned.frame.direction_out(normal), height))
            }
            _ => None,
        }
    }

    /// On a curved surface, from where the straight line meets it first.
    fn round(&self, ends: &Ends, surface: Curved, center: DVec3) -> Option<DVec3> {
        let (towards, inverse) = ends.far.from(ends.near);
        let (enter, leave) = self.chord(ends.near, towards);
        let t = if enter > 0.0 { enter } else { leave };
        let met = enter < leave && t > 0.0 && t * inverse < 1.0;
        let start = met.then(|| surface.drop(ends.near + t * towards - center))?;
        let ends = ends.moved(|p| p - center, |w| w);
        ends.through_curved(surface, start).map(|p| p + center)
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;
    use crate::philox::{philox4x32, unit};
    use crate::solid::Frame;

    /// Random numbers in (-1, 1).
    fn cube(i: u32) -> DVec3 {
        let [a, b, c, _] = philox4x32([i, 0, 0, 0], [3, 4]);
        2.0 * DVec3::new(unit(a), unit(b), unit(c)) - 1.0
    }

    fn solids() -> Vec<Solid> {
        let frame = Frame::turned(DVec3::new(0.5, -0.3, 0.2), [25.0, -40.0, 70.0]);
        let axis = DVec2::new(0.3, -0.4);
        vec![
            Solid::Slab { bottom: -3.0, top: 0.5 },
            Solid::Box { low: DVec3::new(-1.0, -2.0, -3.0), high: DVec3::new(2.0, 0.5, 1.0) },
            Solid::Ellipsoid { center: DVec3::new(0.3, -0.2, 0.1), radii: DVec3::splat(1.7) },
            Solid::Ellipsoid { center: DVec3::new(0.3, -0.2, 0.1), radii: DVec3::new(1.0, 1.7, 2.5) },
            Solid::Cylinder { axis, radius: 1.5, bottom: -2.0, top: 1.0 },
            Solid::Box { low: DVec3::new(-1.0, -0.5, -2.0), high: DVec3::new(1.0, 1.5, 1.0) }.turned(frame),
            Solid::Ellipsoid { center: DVec3::ZERO, radii: DVec3::new(0.8, 1.7, 2.5) }.turned(frame),
            Solid::tube(2.0, 4.0, axis, -2.0, 2.0),
        ]
    }

    /// Snell's law in vectors at every point found, to 1e-12; the ends on opposite sides; and a point of the surface.
    #[test]
    fn light_obeys_snell_where_it_crosses() {
        for solid in solids() {
            let mut seen = 0;
            for i in 0..2000 {
                let (near, place) = (1.6 * cube(2 * i), cube(2 * i + 1));
                let far = if i % 3 == 0 { Far::Direction(place.normalize()) } else { Far::Point(30.0 * place) };
                let (n_far, n_near) = [(1.0, 1.4), (1.4, 1.0), (1.0, 2.5)][i as usize % 3];
                solid.crossings(&Ends { far, n_far, near, n_near }, &mut |p| {
                    assert!(solid.clearance(p) < 1e-13 * 30.0 || matches!(solid, Solid::Carved(_)), "{solid:?} {p}");
                    if solid.clearance(p) > 1e-12 {
                        return;
                    }
                    // The face: that whose surface holds it.
                    let face = match &solid {
                        Solid::Carved(carved) => u32::from(carved.holes[0].clearance(p) < 1e-12),
                        _ => 0,
                    };
                    let n = solid.normal(face, p);
                    let (a, b) = (far.from(p).0, (near - p).normalize());
                    let off = (n_far * a + n_near * b).cross(n).length();
                    // A direction from p has as many digits as the distance.
                    assert!(off < 1e-12 + 1e-15 / (near - p).length(), "{solid:?} {near} {far:?}: {off}");
                    assert!(a.dot(n) * b.dot(n) < 0.0);
                    seen += 1;
                });
            }
            assert!(seen > 200, "{solid:?}: {seen}");
        }
    }

    /// On a sphere all places lie in the plane of its centre and the ends: there they are counted where Snell's residual changes its sign
    /// along 20,000 points of the circle. The one found is a place of least length among them, and where there is only one, and it is such a place (the
    /// light has met no focus), it is found.
    #[test]
    fn a_sphere_is_crossed_where_a_dense_scan_says() {
        let (mut several, mut single, mut beyond, mut missed) = (0, 0, 0, 0);
        let sphere = Solid::Ellipsoid { center: DVec3::ZERO, radii: DVec3::ONE };
        for i in 0..400 {
            let near = 0.99 * cube(7 * i).normalize() * cube(7 * i + 3).x.abs().sqrt();
            let far = cube(7 * i + 1).normalize() * (1.5 + 20.0 * cube(7 * i + 2).x.abs());
            let (n_far, n_near) = (1.0, [1.33, 1.4, 2.0][i as usize % 3]);
            let x = far.normalize();
            let y = (near - near.dot(x) * x).normalize();
            let residual = |phi: f64| {
                let p = phi.cos() * x + phi.sin() * y;
                let (a, b) = ((far - p).normalize(), (near - p).normalize());
                let along = phi.cos() * y - phi.sin() * x;
                ((n_far * a + n_near * b).dot(along), a.dot(p) > 0.0)
            };
            let n = 20_000;
            let mut places = Vec::new();
            for k in 0..n {
                let at = |k: i32| 2.0 * std::f64::consts::PI * f64::from(k) / f64::from(n);
                let ((r0, out0), (r1, out1)) = (residual(at(k)), residual(at(k + 1)));
                if out0 && out1 && r0 * r1 < 0.0 {
                    // The residual points downhill: towards a place of least length, away from one beyond a focus.
                    places.push((at(k), r0 > 0.0));
                }
            }
            let mut found = Vec::new();
            let ends = Ends { far: Far::Point(far), n_far, near, n_near };
            sphere.crossings(&ends, &mut |p| {
                found.push(libm::atan2(p.dot(y), p.dot(x)).rem_euclid(2.0 * std::f64::consts::PI))
            });
            assert!(found.len() <= 1);
            for phi in &found {
                let near_one = places.iter().any(|(place, least)| *least && (place - phi).abs() < 1e-3);
                assert!(near_one, "{near} {far}: {phi} is not among {places:?}");
            }
            let only = places.len() == 1;
            single += usize::from(only && places[0].1);
            beyond += usize::from(only && !places[0].1);
            several += usize::from(places.len() > 1);
            missed += usize::from(only && places[0].1 && found.is_empty());
        }
        let counts = format!("{single} single, {beyond} beyond a focus, {several} several, {missed} missed");
        assert!(single > 250 && beyond > 0 && several > 5 && missed == 0, "{counts}");
    }
}
