//! A pinhole and its field: the frame that cameras and projectors share.

use glam::{DVec2, DVec3};

/// A pinhole whose field is the rectangle `field` (mm) centred on `look_at` in the plane z = look_at.z.
///
/// Its image plane is parallel to that plane, as behind a shift lens: equal steps in the image are equal steps there.
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
        Ok(Self { position, look_at, field, right, top, forward })
    }

    /// The point of the field's plane at image position (x, y): (0, 0) is the top left corner, (1, 1) the bottom right.
    #[inline]
    pub fn plane_point(&self, x: f64, y: f64) -> DVec3 {
        self.look_at + (x - 0.5) * self.field.x * self.right + (0.5 - y) * self.field.y * self.top
    }

    /// Unit vector from the pinhole through that point.
    #[inline]
    pub fn direction(&self, x: f64, y: f64) -> DVec3 {
        (self.plane_point(x, y) - self.position).normalize()
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
            let p = v.position + 123.0 * v.direction(x, y);
            assert!((v.project(p).unwrap() - v.plane_point(x, y)).length() < 1e-12);
        }
        assert_eq!(v.project(DVec3::new(0.0, 0.0, 401.0)), None);
        assert_eq!(v.project(DVec3::new(0.0, 0.0, 400.0)), None);
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
