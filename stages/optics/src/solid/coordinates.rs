//! Coordinates along surfaces.

use glam::{DVec2, DVec3};

use super::{Carved, Solid};

impl Solid {
    /// Coordinates (mm) of a point of a face, for what is laid along surfaces: patterns, textures, sections.
    ///
    /// The first is a distance along the surface, so that its gradient there has length 1: in x on horizontal faces, the depth below the
    /// upper end on the side of a cylinder and in the bore of a tube, the meridian's arc from the upper pole on spheres and on spheroids
    /// whose z axis is that of revolution. The second runs across it: y, or the azimuth times the (equatorial) radius, from +x towards
    /// +y, in (-pi, pi] radii. Faces of a box that look along x or y have (y, z) and (x, z). All in the solid's own frame.
    ///
    /// `None` on meshes and on ellipsoids of three different axes.
    pub fn coordinates(&self, face: u32, p: DVec3) -> Option<DVec2> {
        match *self {
            Self::Slab { .. } => Some(p.truncate()),
            Self::Box { .. } => {
                let normal = self.normal(face, p).abs();
                Some(if normal.z > 0.5 {
                    p.truncate()
                } else if normal.x > 0.5 {
                    DVec2::new(p.y, p.z)
                } else {
                    DVec2::new(p.x, p.z)
                })
            }
            Self::Ellipsoid { center, radii } => {
                let d = p - center;
                (radii.x == radii.y).then(|| DVec2::new(meridian(radii.x, radii.z, d), radii.x * azimuth(d.truncate())))
            }
            Self::Cylinder { axis, radius, top, .. } => {
                let on_a_cap = self.normal(face, p).z.abs() > 0.5;
                Some(if on_a_cap { p.truncate() - axis } else { side(axis, radius, top, p) })
            }
            Self::Turned(ref turned) => turned.solid.coordinates(face, turned.frame.point_into(p)),
            Self::Carved(ref carved) => carved.coordinates(face, p),
            Self::Mesh(_) => None,
        }
    }
}

impl Carved {
    /// On the walls of holes those of the holes, but that the depth in an upright hole counts from the upper end of the whole.
    fn coordinates(&self, face: u32, p: DVec3) -> Option<DVec2> {
        let Some(hole) = (face as usize).checked_sub(1).map(|k| &self.holes[k]) else {
            return self.whole.coordinates(0, p);
        };
        match *hole {
            Solid::Cylinder { axis, radius, .. } => Some(side(axis, radius, self.whole.bounds().1.z, p)),
            _ => hole.coordinates(0, p),
        }
    }
}

/// Depth below `top` and arc around the axis; without an upper end the depth counts from z = 0.
fn side(axis: DVec2, radius: f64, top: f64, p: DVec3) -> DVec2 {
    let top = if top < f64::INFINITY { top } else { 0.0 };
    DVec2::new(top - p.z, radius * azimuth(p.truncate() - axis))
}

/// Nodes (with their mirror images) and weights of the Gauss-Legendre rule of 8 points on [-1, 1].
const GAUSS_8: [(f64, f64); 4] = [
    (0.183_434_642_495_649_8, 0.362_683_783_378_362),
    (0.525_532_409_916_329, 0.313_706_645_877_887_3),
    (0.796_666_477_413_626_7, 0.222_381_034_453_374_5),
    (0.960_289_856_497_536_3, 0.101_228_536_290_376_3),
];

/// Angle from +x towards +y, in (-pi, pi].
fn azimuth(out: DVec2) -> f64 {
    libm::atan2(out.y, out.x)
}

/// Arc length of the meridian from the upper pole of a spheroid of the semi-axes a (across) and c (along z) to the point d from its center.
///
/// With x = a sin t, z = c cos t: the integral of sqrt(a^2 cos^2 t + c^2 sin^2 t), by 8 Gauss-Legendre panels of 8 nodes; its error is
/// below 1e-10 of the arc for axes up to 1 : 4.
fn meridian(a: f64, c: f64, d: DVec3) -> f64 {
    let t = libm::atan2(d.truncate().length() / a, d.z / c);
    if a == c {
        return a * t;
    }
    let panel = t / 8.0;
    let mut arc = 0.0;
    for k in 0..8 {
        let middle = (f64::from(k) + 0.5) * panel;
        for (x, weight) in GAUSS_8 {
            for angle in [middle - 0.5 * panel * x, middle + 0.5 * panel * x] {
                let (sin, cos) = (libm::sin(angle), libm::cos(angle));
                arc += 0.5 * panel * weight * (a * a * cos * cos + c * c * sin * sin).sqrt();
            }
        }
    }
    arc
}

#[cfg(test)]
mod tests {
    use super::super::Frame;
    use super::*;

    /// Steps of h along the surface in two directions square to each other change the first coordinate by h times the components of
    /// a unit vector. Curvature bends a step by h^2 / 2 R, central differences cancel that; what is left is below (h / R)^2.
    #[test]
    fn the_first_coordinate_is_a_distance() {
        let ball = Solid::Ellipsoid { center: DVec3::new(0.3, -0.2, 0.1), radii: DVec3::splat(1.7) };
        let oblate = Solid::Ellipsoid { center: DVec3::ZERO, radii: DVec3::new(2.0, 2.0, 0.7) };
        let prolate = Solid::Ellipsoid { center: DVec3::ZERO, radii: DVec3::new(1.0, 1.0, 4.0) };
        let tube = Solid::tube(2.0, 8.0, DVec2::new(0.5, 0.2), -25.0, 3.0);
        let turned = tube.clone().turned(Frame::turned(DVec3::new(1.0, 2.0, 3.0), [20.0, -30.0, 50.0]));
        let cylinder = Solid::cylinder(3.0, 5.0, DVec3::ZERO, DVec3::new(0.6, 0.0, 0.8));
        let block = Solid::Box { low: DVec3::splat(-1.0), high: DVec3::splat(1.0) };
        let slab = Solid::Slab { bottom: -1.0, top: 0.5 };
        let h = 1e-4;
        for solid in [ball, oblate, prolate, tube, turned, cylinder, block, slab] {
            let mut tested = 0;
            for (i, j) in (0..9).flat_map(|i| (0..9).map(move |j| (i, j))) {
                let at = |k: i32| 0.37 * f64::from(k) - 1.4;
                let (origin, w) = (DVec3::new(at(i), at(j), 9.0), DVec3::new(0.05, 0.1, -1.0).normalize());
                let mut chords = Vec::new();
                solid.cut(origin, w, None, &mut chords);
                for chord in &chords {
                    for (t, face) in [(chord.enter, chord.into), (chord.leave, chord.out_of)] {
                        let p = origin + t * w;
                        let n = solid.normal(face, p);
                        // Onto the surface from a point beside it, along the normal; `None` across an edge.
                        let on = |q: DVec3| {
                            let (mut chords, start) = (Vec::new(), q + 1e-3 * n);
                            solid.cut(start, -n, None, &mut chords);
                            let ends = chords.iter().flat_map(|s| [(s.enter, s.into), (s.leave, s.out_of)]);
                            let (t, face) = ends.min_by(|a, b| (a.0 - 1e-3).abs().total_cmp(&(b.0 - 1e-3).abs()))?;
                            let near = (t - 1e-3).abs() < 1e-6;
                            near.then(|| solid.coordinates(face, start - t * n)).flatten()
                        };
                        let a = n.any_orthonormal_vector();
                        let b = n.cross(a);
                        let ends = [on(p + h * a), on(p - h * a), on(p + h * b), on(p - h * b)];
                        let [Some(a0), Some(a1), Some(b0), Some(b1)] = ends else { continue };
                        let gradient = DVec2::new(a0.x - a1.x, b0.x - b1.x) / (2.0 * h);
                        let off = gradient.length() - 1.0;
                        assert!(off.abs() < 1e-6, "{solid:?}, {p}: off by {off:e}");
                        tested += 1;
                    }
                }
            }
            assert!(tested > 20, "{solid:?}: {tested} places");
        }
    }

    /// From pole to pole of a spheroid: half the perimeter of the ellipse, by the trapezoidal rule over the whole turn, which converges
    /// like 0.6^n for 1 : 4 and faster for rounder ones.
    #[test]
    fn a_meridian_is_half_an_ellipse() {
        for (a, c) in [(1.0_f64, 1.0_f64), (1.0, 4.0), (3.0, 1.0), (20.0, 40.0)] {
            let solid = Solid::Ellipsoid { center: DVec3::ZERO, radii: DVec3::new(a, a, c) };
            let n = 256;
            let turn = (0..n).map(|i| f64::from(i) / f64::from(n) * std::f64::consts::TAU);
            let half: f64 = turn.map(|t| (a * t.cos()).hypot(c * t.sin()) * std::f64::consts::PI / f64::from(n)).sum();
            let u = solid.coordinates(0, DVec3::new(0.0, 0.0, -c)).unwrap().x;
            assert!((u / half - 1.0).abs() < 1e-10, "{a} {c}: {u} {half}");
        }
        let triaxial = Solid::Ellipsoid { center: DVec3::ZERO, radii: DVec3::new(1.0, 2.0, 3.0) };
        assert_eq!(triaxial.coordinates(0, DVec3::X), None);
    }

    /// The depth in a bore counts from the mouth, and the way around it is radius times angle.
    #[test]
    fn a_bore_is_measured_from_its_mouth() {
        let tube = Solid::tube(20.0, 80.0, DVec2::new(1.0, 2.0), -250.0, 5.0);
        let at = tube.coordinates(1, DVec3::new(1.0, 12.0, -95.0)).unwrap();
        assert!((at - DVec2::new(100.0, 5.0 * std::f64::consts::PI)).length() < 1e-12, "{at}");
    }
}
