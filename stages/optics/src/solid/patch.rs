//! Pieces of a surface: what a picture that is wrapped around a solid covers.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use super::Solid;

/// A place on a piece of a surface, by the surface's [coordinates](Solid::coordinates), mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch {
    pub at: DVec2,
    /// Where the piece begins and ends; infinite where it is.
    pub low: DVec2,
    pub high: DVec2,
    /// Whether it is wrapped around an axis: then the first coordinate runs down it, the second around and into itself. Pieces that are
    /// not lie flat, the first coordinate to the right and the second upwards.
    pub is_round: bool,
}

impl Solid {
    /// `None` where the solid has no coordinates.
    pub fn patch(&self, face: u32, p: DVec3) -> Option<Patch> {
        let at = match self {
            Self::Turned(turned) => return turned.solid.patch(face, turned.frame.point_into(p)),
            _ => self.coordinates(face, p)?,
        };
        let flat = |low, high| Patch { at, low, high, is_round: false };
        let round = |length: f64, radius: f64| {
            let half = PI * radius;
            Patch { at, low: DVec2::new(0.0, -half), high: DVec2::new(length, half), is_round: true }
        };
        Some(match *self {
            Self::Slab { .. } => flat(DVec2::NEG_INFINITY, DVec2::INFINITY),
            // The corners have the coordinates of the face on which p is.
            Self::Box { low, high } => {
                let normal = self.normal(face, p).abs();
                let of = |corner: DVec3| {
                    if normal.z > 0.5 {
                        corner.truncate()
                    } else if normal.x > 0.5 {
                        DVec2::new(corner.y, corner.z)
                    } else {
                        DVec2::new(corner.x, corner.z)
                    }
                };
                flat(of(low), of(high))
            }
            Self::Ellipsoid { center, radii } => round(self.coordinates(face, center - radii.z * DVec3::Z)?.x, radii.x),
            Self::Cylinder { radius, .. } if self.normal(face, p).z.abs() > 0.5 => {
                flat(DVec2::splat(-radius), DVec2::splat(radius))
            }
            Self::Cylinder { radius, bottom, top, .. } => round(top - bottom, radius),
            Self::Carved(ref carved) => match face.checked_sub(1).map(|k| &carved.holes[k as usize]) {
                None => carved.whole.patch(0, p)?,
                // What goes through ends where the body does.
                Some(&Self::Cylinder { radius, bottom, top, .. }) => {
                    let (low, high) = carved.whole.bounds();
                    round(top.min(high.z) - bottom.max(low.z), radius)
                }
                Some(hole) => hole.patch(0, p)?,
            },
            Self::Turned(_) | Self::Mesh(_) => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solid::Frame;

    fn at(solid: &Solid, face: u32, p: [f64; 3]) -> Patch {
        solid.patch(face, p.into()).expect("it has coordinates")
    }

    /// Ends and seams are where they are said to be, and every place lies between them.
    #[test]
    fn pieces_have_ends() {
        let tube = Solid::tube(4.0, 9.0, DVec2::ZERO, -5.0, 3.0);
        let bore = at(&tube, 1, [2.0, 0.0, -1.0]);
        assert_eq!((bore.at, bore.is_round), (DVec2::new(4.0, 0.0), true));
        assert_eq!((bore.low, bore.high), (DVec2::new(0.0, -2.0 * PI), DVec2::new(8.0, 2.0 * PI)));
        let end = at(&tube, 0, [3.0, 1.0, 3.0]);
        assert_eq!((end.at, end.high, end.is_round), (DVec2::new(3.0, 1.0), DVec2::splat(4.5), false));
        let ball = Solid::Ellipsoid { center: DVec3::Z, radii: DVec3::splat(2.0) };
        let pole = at(&ball, 0, [0.0, 0.0, -1.0]);
        assert!((pole.high.x - 2.0 * PI).abs() < 1e-14 && pole.high.x == pole.at.x);
        let block = Solid::Box { low: DVec3::new(-1.0, -2.0, -3.0), high: DVec3::new(2.0, 4.0, 6.0) };
        let side = at(&block, 0, [2.0, 1.0, 5.0]);
        assert_eq!(
            (side.at, side.low, side.high),
            (DVec2::new(1.0, 5.0), DVec2::new(-2.0, -3.0), DVec2::new(4.0, 6.0))
        );
        // Turned solids carry their pieces with them.
        let frame = Frame::turned(DVec3::new(1.0, 2.0, 3.0), [20.0, -30.0, 40.0]);
        let p = DVec3::new(1.2, -1.6, 0.7);
        let (there, here) =
            (tube.clone().turned(frame).patch(1, frame.point_out(p)).unwrap(), tube.patch(1, p).unwrap());
        assert!((there.at - here.at).length() < 1e-14 && there.high == here.high);
        let triaxial = Solid::Ellipsoid { center: DVec3::ZERO, radii: DVec3::new(1.0, 2.0, 3.0) };
        assert_eq!(triaxial.patch(0, DVec3::X), None);
    }
}
