//! Rigid motions.

use glam::{DMat3, DVec3};

use crate::elementary::sin_cos_turns;

/// A frame of its own in the world: an origin and three axes at right angles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    origin: DVec3,
    /// Columns: the frame's axes in the world.
    axes: DMat3,
    /// Its transpose.
    into: DMat3,
}

impl Frame {
    /// Turned about its own origin by degrees about the world's x, then y, then z axis.
    pub fn turned(origin: DVec3, rotation_deg: [f64; 3]) -> Self {
        let [x, y, z] = rotation_deg.map(|deg| sin_cos_turns(deg / 360.0));
        let about = |(sin, cos): (f64, f64), from: usize, to: usize| {
            let mut axes = DMat3::IDENTITY.to_cols_array_2d();
            (axes[from][from], axes[from][to], axes[to][from], axes[to][to]) = (cos, sin, -sin, cos);
            DMat3::from_cols_array_2d(&axes)
        };
        Self::of(origin, about(z, 0, 1) * about(y, 2, 0) * about(x, 1, 2))
    }

    /// In which all keeps its coordinates but for the turn about `pivot`, as in [`Frame::turned`].
    pub fn turned_about(pivot: DVec3, rotation_deg: [f64; 3]) -> Self {
        let turned = Self::turned(DVec3::ZERO, rotation_deg);
        Self::of(pivot - turned.direction_out(pivot), turned.axes)
    }

    /// With its z axis along the unit vector `z` and its x axis horizontal (along the world's x if z looks up or down).
    pub fn along(origin: DVec3, z: DVec3) -> Self {
        let x = if z.x.abs().max(z.y.abs()) > 1e-9 { DVec3::Z.cross(z).normalize() } else { DVec3::X };
        Self::of(origin, DMat3::from_cols(x, z.cross(x), z))
    }

    fn of(origin: DVec3, axes: DMat3) -> Self {
        Self { origin, axes, into: axes.transpose() }
    }

    /// A point of the world, in this frame.
    #[inline]
    pub fn point_into(&self, p: DVec3) -> DVec3 {
        self.into * (p - self.origin)
    }

    #[inline]
    pub fn direction_into(&self, w: DVec3) -> DVec3 {
        self.into * w
    }

    /// A point of this frame, in the world.
    pub fn point_out(&self, p: DVec3) -> DVec3 {
        self.origin + self.axes * p
    }

    pub fn direction_out(&self, w: DVec3) -> DVec3 {
        self.axes * w
    }

    /// The box of the world around a box of this frame; infinite boxes stay infinite along every axis that they lean on.
    pub fn bounds_out(&self, low: DVec3, high: DVec3) -> (DVec3, DVec3) {
        let (mut least, mut most) = (self.origin, self.origin);
        for (axis, column) in [self.axes.x_axis, self.axes.y_axis, self.axes.z_axis].into_iter().enumerate() {
            for i in 0..3 {
                // A zero times an infinity is nothing here, not NaN.
                if column[i] != 0.0 {
                    let (a, b) = (column[i] * low[axis], column[i] * high[axis]);
                    least[i] += a.min(b);
                    most[i] += a.max(b);
                }
            }
        }
        (least, most)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// x before y before z, right-handed; a quarter turn is exact but for the last bit.
    #[test]
    fn rotations_are_right_handed_and_in_order() {
        let near = |a: DVec3, b: DVec3| (a - b).length() < 1e-15;
        let out = |rotation: [f64; 3], w: DVec3| Frame::turned(DVec3::ZERO, rotation).direction_out(w);
        assert!(near(out([90.0, 0.0, 0.0], DVec3::Y), DVec3::Z));
        assert!(near(out([0.0, 90.0, 0.0], DVec3::Z), DVec3::X));
        assert!(near(out([0.0, 0.0, 90.0], DVec3::X), DVec3::Y));
        assert!(near(out([90.0, 0.0, 90.0], DVec3::Y), DVec3::Z));
        assert!(near(out([0.0, 90.0, 90.0], DVec3::Z), DVec3::Y));
        let frame = Frame::turned(DVec3::new(1.0, 2.0, 3.0), [10.0, 20.0, 30.0]);
        let p = DVec3::new(-4.0, 0.5, 7.0);
        assert!((frame.point_out(frame.point_into(p)) - p).length() < 1e-14);
        let about = Frame::turned_about(p, [10.0, 20.0, 30.0]);
        assert!((about.point_out(p) - p).length() < 1e-14);
        assert!((about.point_out(p + DVec3::X) - p - frame.direction_out(DVec3::X)).length() < 1e-14);
        assert!(near(Frame::along(DVec3::ZERO, DVec3::Z).direction_out(DVec3::Z), DVec3::Z));
    }
}
