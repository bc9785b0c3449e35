//! A lens and its field: the frame that cameras and projectors share.

use glam::{DVec2, DVec3};

use crate::distortion::Distortion;
use crate::elementary::sin_cos_turns;

/// How the light of a place of the image travels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Lens {
    /// Through one point.
    #[default]
    Pinhole,
    /// Through a disc parallel to the image plane, and sharp in the plane parallel to both that cuts the axis at `focus`.
    Thin { radius: f64, focus: f64 },
    /// Parallel to the axis.
    Orthographic,
    /// Through one point, at an angle to the axis that is proportional to the distance from the image's middle.
    Fisheye,
}

/// A view whose field is the rectangle `field` (mm) centred on `look_at` in the plane z = look_at.z.
///
/// Its image plane is parallel to that plane, as behind a shift lens: equal steps in the image are equal steps there. Only the
/// fisheye's is square to the axis: there `field` over the distance of look_at is the angle seen, in rad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    pub position: DVec3,
    pub look_at: DVec3,
    pub field: DVec2,
    /// Unit vector in the plane along image x.
    pub right: DVec3,
    /// Unit vector in the plane towards image row 0.
    pub top: DVec3,
    /// Unit vector along the axis.
    pub forward: DVec3,
    pub lens: Lens,
    /// Around look_at, in units of its distance.
    pub distortion: Option<Distortion>,
}

/// Why there is no such view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ViewError {
    /// Position and look_at coincide.
    NoDirection,
    /// The line of sight runs along the up vector.
    AlongUp,
    /// The line of sight is nearly parallel to the plane in which the field is measured.
    Grazing,
    /// The distortion folds the image over.
    Folded,
}

/// The least sine of the angle between the axis and the plane of the field (0.06 degrees).
const LEAST_SINE: f64 = 1e-3;

impl View {
    /// With right = forward x up, image x runs along the horizontal part of right: seen from above with up = +y, image
    /// x is world +x and row 0 lies at +y, whatever the tilt.
    pub fn new(position: DVec3, look_at: DVec3, up: DVec3, field: DVec2) -> Result<Self, ViewError> {
        let forward = (look_at - position).try_normalize().ok_or(ViewError::NoDirection)?;
        let up = up.try_normalize().ok_or(ViewError::AlongUp)?;
        let right = forward.cross(up);
        if right.length() < 1e-6 {
            return Err(ViewError::AlongUp);
        }
        if forward.z.abs() < LEAST_SINE {
            return Err(ViewError::Grazing);
        }
        let right = DVec3::new(right.x, right.y, 0.0).normalize();
        // Upwards in the image; seen from below, the image of the plane is mirrored.
        let top = DVec3::new(right.y, -right.x, 0.0) * forward.z.signum();
        Ok(Self { position, look_at, field, right, top, forward, lens: Lens::Pinhole, distortion: None })
    }

    /// A fisheye; there is no plane along which it could look.
    pub fn fisheye(position: DVec3, look_at: DVec3, up: DVec3, field: DVec2) -> Result<Self, ViewError> {
        let forward = (look_at - position).try_normalize().ok_or(ViewError::NoDirection)?;
        let up = up.try_normalize().ok_or(ViewError::AlongUp)?;
        let right = forward.cross(up);
        if right.length() < 1e-6 {
            return Err(ViewError::AlongUp);
        }
        let right = right.normalize();
        let top = right.cross(forward);
        Ok(Self { position, look_at, field, right, top, forward, lens: Lens::Fisheye, distortion: None })
    }

    /// With the Brown-Conrady coefficients k1, k2, p1, p2, k3.
    pub fn distorted(self, coefficients: [f64; 5]) -> Result<Self, ViewError> {
        let half = 0.5 * self.field / self.distance();
        let distortion = Distortion::new(coefficients, half.to_array()).ok_or(ViewError::Folded)?;
        Ok(Self { distortion: Some(distortion), ..self })
    }

    /// From the lens to look_at, mm.
    pub fn distance(&self) -> f64 {
        (self.look_at - self.position).length()
    }

    /// The point of the field's plane at image position (x, y): (0, 0) is the top left corner, (1, 1) the bottom right.
    #[inline]
    pub fn plane_point(&self, x: f64, y: f64) -> DVec3 {
        self.look_at + (x - 0.5) * self.field.x * self.right + (0.5 - y) * self.field.y * self.top
    }

    /// The point that the middle ray of an image position runs to: in the field's plane, or for a fisheye as far away as look_at.
    pub fn seen(&self, x: f64, y: f64) -> DVec3 {
        let on_plane = self.plane_point(x, y);
        if self.lens == Lens::Fisheye {
            let distance = self.distance();
            // In rad.
            let across = (on_plane - self.look_at) / distance;
            let angle = across.length();
            let (sin, cos) = sin_cos_turns(angle * (0.5 * std::f64::consts::FRAC_1_PI));
            let aside = if angle > 0.0 { across / angle } else { DVec3::ZERO };
            return self.position + distance * (cos * self.forward + sin * aside);
        }
        match self.distortion {
            None => on_plane,
            Some(lens) => {
                let (x, y) = self.image_place(on_plane);
                let (x, y) = lens.undo(x, y);
                self.look_at + self.distance() * (x * self.right - y * self.top)
            }
        }
    }

    /// Origin and unit vector of the middle ray of an image position.
    #[inline]
    pub fn ray(&self, x: f64, y: f64) -> (DVec3, DVec3) {
        match self.lens {
            Lens::Orthographic => (self.seen(x, y) - self.distance() * self.forward, self.forward),
            _ => (self.position, (self.seen(x, y) - self.position).normalize()),
        }
    }

    /// The ray through a point of the lens, uniform over it for u, v uniform in (0, 1).
    #[inline]
    pub fn ray_through(&self, x: f64, y: f64, u: f64, v: f64) -> (DVec3, DVec3) {
        let (origin, w) = self.ray(x, y);
        let Lens::Thin { radius, focus } = self.lens else { return (origin, w) };
        let (sin, cos) = sin_cos_turns(v);
        let place = origin + radius * u.sqrt() * (cos * self.right + sin * self.top);
        let sharp = origin + focus * self.forward.z / w.z * w;
        (place, (sharp - place).normalize())
    }

    /// The image position, as for [`Self::plane_point`], whose middle ray runs through `p`; `None` where none does.
    pub fn image_position(&self, p: DVec3) -> Option<(f64, f64)> {
        let ideal = match self.lens {
            Lens::Fisheye => {
                let d = p - self.position;
                let aside = d - d.dot(self.forward) * self.forward;
                let (sin, angle) = (aside.length(), libm::atan2(aside.length(), d.dot(self.forward)));
                if angle >= std::f64::consts::PI {
                    return None;
                }
                self.look_at + self.distance() * angle * if sin > 0.0 { aside / sin } else { DVec3::ZERO }
            }
            Lens::Orthographic => p + (self.look_at.z - p.z) / self.forward.z * self.forward,
            _ => self.project(p)?,
        };
        let on_plane = match self.distortion {
            None => ideal,
            Some(_) => {
                let (on_plane, _, held) = self.through_lens(ideal);
                held.then_some(on_plane)?
            }
        };
        Some(self.position_of(on_plane))
    }

    /// The image position, as for [`Self::plane_point`], of light that goes through the place `eye` of the lens (the pinhole) and comes along -w,
    /// and the image's area in the field's plane per solid angle of such light, mm^2/sr; `None` where there is none.
    pub fn image_of(&self, eye: DVec3, w: DVec3) -> Option<((f64, f64), f64)> {
        let distance = self.distance();
        let focus = match self.lens {
            Lens::Orthographic => return None,
            Lens::Fisheye => {
                let (sin, cos) = (w.cross(self.forward).length(), w.dot(self.forward));
                let angle = libm::atan2(sin, cos);
                let stretch = if sin > 0.0 { angle / sin } else { 1.0 };
                return Some((self.image_position(eye + w)?, distance * distance * stretch));
            }
            Lens::Thin { focus, .. } => focus,
            Lens::Pinhole => distance,
        };
        // In the plane of focus all rays of a point meet.
        let t = focus * self.forward.z / w.z;
        if !(t > 0.0 && t < f64::INFINITY) {
            return None;
        }
        let ideal = self.project(eye + t * w)?;
        let (on_plane, spread, held) = self.through_lens(ideal);
        let scale = distance / focus * t;
        held.then(|| (self.position_of(on_plane), spread * scale * scale / w.z.abs()))
    }

    /// The image position of a point of the field's plane: undoes [`Self::plane_point`].
    #[inline]
    pub fn position_of(&self, on_plane: DVec3) -> (f64, f64) {
        let d = on_plane - self.look_at;
        (0.5 + d.dot(self.right) / self.field.x, 0.5 - d.dot(self.top) / self.field.y)
    }

    /// A point of the field's plane relative to look_at, in units of its distance, to the right and down the image.
    #[inline(always)]
    fn image_place(&self, on_plane: DVec3) -> (f64, f64) {
        let d = (on_plane - self.look_at) / self.distance();
        (d.dot(self.right), -d.dot(self.top))
    }

    /// Where in the field's plane the image of its point `ideal` lies, its area over the original's, and whether there is one.
    #[inline(always)]
    pub fn through_lens(&self, ideal: DVec3) -> (DVec3, f64, bool) {
        let Some(lens) = self.distortion else { return (ideal, 1.0, true) };
        let (x, y) = self.image_place(ideal);
        let (a, b) = lens.apply(x, y);
        let on_plane = self.look_at + self.distance() * (a * self.right - b * self.top);
        (on_plane, lens.spread(x, y), lens.holds(x, y))
    }

    /// Where the line from the pinhole through `p` meets the field's plane; `None` where it does not.
    #[inline]
    pub fn project(&self, p: DVec3) -> Option<DVec3> {
        let (on_plane, ahead) = self.projects(p);
        ahead.then_some(on_plane)
    }

    /// The same without a branch: the point means nothing where the second is false.
    #[inline(always)]
    pub fn projects(&self, p: DVec3) -> (DVec3, bool) {
        let height = self.look_at.z - self.position.z;
        let t = height / (p.z - self.position.z);
        // Also false for NaN and for points beside or behind the pinhole.
        (self.position + t * (p - self.position), (t > 0.0) & (t < f64::INFINITY))
    }

    /// Whether a point of the field's plane lies inside the field.
    #[inline(always)]
    pub fn in_field(&self, on_plane: DVec3) -> bool {
        let d = on_plane - self.look_at;
        (d.dot(self.right).abs() <= 0.5 * self.field.x) & (d.dot(self.top).abs() <= 0.5 * self.field.y)
    }

    /// Distance of the pinhole from the field's plane, mm.
    pub fn height(&self) -> f64 {
        (self.position.z - self.look_at.z).abs()
    }

    /// Solid angle of the field seen from the pinhole, sr: the sum over the four corners of
    /// atan(x y / (h sqrt(x^2 + y^2 + h^2))) with signs (the integral of h / r^3 over the rectangle).
    pub fn solid_angle(&self) -> f64 {
        let h = self.height();
        let foot = self.position - self.look_at;
        let (fx, fy) = (foot.dot(self.right), foot.dot(self.top));
        let corner = |x: f64, y: f64| libm::atan2(x * y, h * (x * x + y * y + h * h).sqrt());
        let (x0, x1) = (-0.5 * self.field.x - fx, 0.5 * self.field.x - fx);
        let (y0, y1) = (-0.5 * self.field.y - fy, 0.5 * self.field.y - fy);
        corner(x1, y1) - corner(x0, y1) - corner(x1, y0) + corner(x0, y0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view(position: [f64; 3], up: [f64; 3]) -> Result<View, ViewError> {
        View::new(position.into(), DVec3::ZERO, up.into(), DVec2::new(20.0, 10.0))
    }

    /// Image x is world +x and row 0 is +y for every camera above the scene with up = +y.
    #[test]
    fn image_axes_are_those_of_the_world() {
        for position in [[0.0, 0.0, 500.0], [35.0, 0.0, 500.0], [0.0, -300.0, 100.0], [200.0, 100.0, 50.0]] {
            let v = view(position, [0.0, 1.0, 0.0]).unwrap();
            assert_eq!((v.right, v.top), (DVec3::X, DVec3::Y), "{position:?}");
            assert_eq!(v.plane_point(0.0, 0.0), DVec3::new(-10.0, 5.0, 0.0));
        }
        let v = view([0.0, -300.0, 300.0], [0.0, 0.0, 1.0]).unwrap();
        assert_eq!((v.right, v.top), (DVec3::X, DVec3::Y));
        // Seen from below, left and right change places.
        let v = view([0.0, 0.0, -500.0], [0.0, 1.0, 0.0]).unwrap();
        assert_eq!((v.right, v.top), (DVec3::NEG_X, DVec3::Y));
    }

    #[test]
    fn impossible_views_are_named() {
        assert_eq!(view([0.0; 3], [0.0, 1.0, 0.0]), Err(ViewError::NoDirection));
        assert_eq!(view([0.0, 0.0, 9.0], [0.0, 0.0, 1.0]), Err(ViewError::AlongUp));
        assert_eq!(view([9.0, 0.0, 0.0], [0.0, 1.0, 0.0]), Err(ViewError::Grazing));
    }

    /// Projecting a point on the ray through an image position gives that position's point; 1e-12 is rounding.
    #[test]
    fn project_undoes_direction() {
        let v = view([35.0, 10.0, 400.0], [0.0, 1.0, 0.0]).unwrap();
        for (x, y) in [(0.0, 0.0), (0.3, 0.9), (1.0, 0.5)] {
            let p = v.position + 123.0 * v.ray(x, y).1;
            assert!((v.project(p).unwrap() - v.plane_point(x, y)).length() < 1e-12);
        }
        assert_eq!(v.project(DVec3::new(0.0, 0.0, 401.0)), None);
        assert_eq!(v.project(DVec3::new(0.0, 0.0, 400.0)), None);
    }

    /// Where the ray of an image position runs, that position is found again, for every lens; 1e-12 of the field is rounding (a
    /// pixel of 1e4 would be 1e-4).
    #[test]
    fn image_positions_are_found_again() {
        let (look_at, up, field) = (DVec3::new(1.0, -2.0, 5.0), DVec3::Y, DVec2::new(300.0, 200.0));
        for position in [DVec3::new(1.0, -2.0, 400.0), DVec3::new(80.0, 40.0, 250.0), DVec3::new(0.0, 90.0, -300.0)] {
            let plain = View::new(position, look_at, up, field).unwrap();
            let views = [
                plain,
                plain.distorted([-0.2, 0.05, 1e-3, -2e-3, 0.01]).unwrap(),
                plain.distorted([0.3, 0.1, 0.0, 0.0, 0.0]).unwrap(),
                View { lens: Lens::Thin { radius: 2.0, focus: 300.0 }, ..plain },
                View { lens: Lens::Orthographic, ..plain },
                View::fisheye(position, look_at, up, 4.0 * field).unwrap(),
            ];
            for view in views {
                for (x, y) in [(0.0, 0.0), (0.5, 0.5), (0.3, 0.9), (1.0, 0.5), (0.999, 0.001)] {
                    let (origin, w) = view.ray(x, y);
                    assert!((w.length() - 1.0).abs() < 1e-15);
                    for far in [30.0, 700.0] {
                        let (a, b) = view.image_position(origin + far * w).unwrap();
                        assert!((a - x).abs() + (b - y).abs() < 1e-12, "{view:?}: ({x}, {y}), {far}: {a} {b}");
                    }
                }
            }
        }
    }

    /// Light along the ray of an image position is imaged there, and the area per solid angle is that of neighbouring rays: central
    /// differences of 1e-5 of the field leave 1e-9 of it, rounding of 1e-16 / 1e-5^2 twice as many digits less.
    #[test]
    fn images_of_rays() {
        let (look_at, up, field) = (DVec3::new(1.0, -2.0, 5.0), DVec3::Y, DVec2::new(300.0, 200.0));
        let plain = View::new(DVec3::new(80.0, 40.0, 250.0), look_at, up, field).unwrap();
        let views = [
            plain,
            plain.distorted([-0.2, 0.05, 1e-3, -2e-3, 0.01]).unwrap(),
            View { lens: Lens::Thin { radius: 9.0, focus: 180.0 }, ..plain },
            View::fisheye(plain.position, look_at, up, 4.0 * field).unwrap(),
        ];
        for (view, (x, y)) in views.iter().flat_map(|v| [(0.5, 0.5), (0.1, 0.2), (0.9, 0.6)].map(|at| (v, at))) {
            let ray = |x: f64, y: f64| view.ray_through(x, y, 0.7, 0.3);
            let (eye, w) = ray(x, y);
            let ((a, b), area) = view.image_of(eye, w).unwrap();
            assert!((a - x).abs() + (b - y).abs() < 1e-12, "{view:?}: ({x}, {y}), {a} {b}");
            let h = 1e-5;
            let along_x = (ray(x + h, y).1 - ray(x - h, y).1) / (2.0 * h);
            let along_y = (ray(x, y + h).1 - ray(x, y - h).1) / (2.0 * h);
            let expected = view.field.x * view.field.y / along_x.cross(along_y).length();
            assert!((area / expected - 1.0).abs() < 1e-6, "{view:?}: ({x}, {y}), {area} {expected}");
        }
        let away = View { lens: Lens::Orthographic, ..plain }.image_of(plain.position, plain.forward);
        assert!(away.is_none() && plain.image_of(plain.position, -plain.forward).is_none());
    }

    /// Scale and sign of the distortion: a corner of the image at r_d sees the ideal radius r with r (1 + k1 r^2) = r_d, all in units
    /// of the distance; barrel (k1 < 0) sees more.
    #[test]
    fn barrel_sees_more() {
        let v = View::new(DVec3::new(0.0, 0.0, 100.0), DVec3::ZERO, DVec3::Y, DVec2::new(80.0, 60.0)).unwrap();
        let lens = v.distorted([-0.3, 0.0, 0.0, 0.0, 0.0]).unwrap();
        let r = lens.seen(1.0, 0.0).length() / 100.0;
        assert!((r * (1.0 - 0.3 * r * r) - 0.5).abs() < 1e-14 && r > 0.5, "{r}");
        // p1 > 0 sees rows lower down in the middle column: y_d = y + 3 p1 y^2, y down.
        let lens = v.distorted([0.0, 0.0, 0.02, 0.0, 0.0]).unwrap();
        let y = -lens.seen(0.5, 1.0).y / 100.0;
        assert!((y + 0.06 * y * y - 0.3).abs() < 1e-14, "{y}");
        assert_eq!(v.distorted([-3.0, 0.0, 0.0, 0.0, 0.0]).unwrap_err(), ViewError::Folded);
    }

    /// Equidistant: the angle to the axis is the image radius over the distance; 90 degrees is no limit.
    #[test]
    fn fisheye_angles_are_image_radii() {
        let v = View::fisheye(DVec3::new(3.0, 0.0, 50.0), DVec3::new(3.0, 0.0, 40.0), DVec3::Y, DVec2::splat(40.0))
            .unwrap();
        for x in [0.5, 0.6, 0.9, 1.0] {
            let (_, w) = v.ray(x, 0.5);
            let angle = (x - 0.5) * 4.0;
            assert!((w - DVec3::new(f64::sin(angle), 0.0, -f64::cos(angle))).length() < 1e-14, "{x}: {w}");
        }
        let (_, w) = v.ray(0.5, 0.4);
        assert!((w - DVec3::new(0.0, f64::sin(0.4), -f64::cos(0.4))).length() < 1e-14, "row 0 is up: {w}");
    }

    /// Orthographic rays are parallel and meet the field's plane where a pinhole's do.
    #[test]
    fn orthographic_rays_are_parallel() {
        let plain = view([35.0, 10.0, 400.0], [0.0, 1.0, 0.0]).unwrap();
        let v = View { lens: Lens::Orthographic, ..plain };
        for (x, y) in [(0.0, 0.0), (0.3, 0.9)] {
            let (origin, w) = v.ray(x, y);
            assert_eq!(w, v.forward);
            assert!((origin + v.distance() * w - plain.plane_point(x, y)).length() < 1e-12);
        }
    }

    /// All rays of an image position meet in the plane of focus; behind it they spread over the disc of confusion: its radius is
    /// the lens's times (distance - focus) / focus along the axis of a level view, and the lens is used evenly.
    #[test]
    fn thin_lens_is_sharp_in_its_plane_only() {
        let plain = view([20.0, 10.0, 300.0], [0.0, 1.0, 0.0]).unwrap();
        let level = view([0.0, 0.0, 300.0], [0.0, 1.0, 0.0]).unwrap();
        let (radius, focus) = (4.0, 200.0);
        let at = |w: DVec3, origin: DVec3, z: f64| origin + (z - origin.z) / w.z * w;
        for v in [plain, level] {
            let v = View { lens: Lens::Thin { radius, focus }, ..v };
            let sharp_z = v.position.z + focus * v.forward.z;
            let (chief, w) = v.ray(0.2, 0.7);
            let (mut mean, n) = (DVec3::ZERO, 64);
            let mut square = 0.0;
            for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
                let (u, t) = ((f64::from(i) + 0.5) / f64::from(n), f64::from(j) / f64::from(n));
                let (origin, ray) = v.ray_through(0.2, 0.7, u, t);
                assert!((at(ray, origin, sharp_z) - at(w, chief, sharp_z)).length() < 1e-11);
                let blur = at(ray, origin, 0.0) - at(w, chief, 0.0);
                let depth = v.position.z / (v.position.z - sharp_z);
                assert!(blur.length() <= radius * (depth - 1.0) * (1.0 + 1e-12));
                mean += blur / f64::from(n * n);
                square += blur.length_squared() / f64::from(n * n) / (radius * (depth - 1.0)).powi(2);
            }
            // Mean square radius of an even disc is half the square of its own.
            assert!(mean.length() < 1e-12 && (square - 0.5).abs() < 1e-12, "{mean} {square}");
        }
    }

    /// Against the integral of h / r^3 by the midpoint rule on 400 x 400 cells, whose relative error at this distance
    /// is below (cell / h)^2 = 3e-5.
    #[test]
    fn solid_angle_is_the_integral_over_the_field() {
        for position in [[0.0, 0.0, 9.0], [30.0, -7.0, 12.0]] {
            let v = view(position, [0.0, 1.0, 0.0]).unwrap();
            let n = 400;
            let cell = v.field.x * v.field.y / f64::from(n * n);
            let mut sum = 0.0;
            for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
                let p = v.plane_point((f64::from(i) + 0.5) / f64::from(n), (f64::from(j) + 0.5) / f64::from(n));
                let r = (p - v.position).length();
                sum += cell * v.height() / (r * r * r);
            }
            assert!((v.solid_angle() / sum - 1.0).abs() < 3e-5, "{} {sum}", v.solid_angle());
        }
    }
}
