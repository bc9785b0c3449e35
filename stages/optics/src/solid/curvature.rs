//! How surfaces curve.

use glam::DVec3;

use super::Solid;

impl Solid {
    /// How the outward unit normal at a point of a face changes over a displacement along the surface, to first order: what
    /// the shape operator makes of it. mm^-1 times mm; 0 where the surface is flat, as triangles are.
    pub fn bends(&self, face: u32, p: DVec3, displacement: DVec3) -> DVec3 {
        match *self {
            Self::Slab { .. } | Self::Box { .. } | Self::Mesh(_) => DVec3::ZERO,
            Self::Ellipsoid { center, radii } => {
                let gradient = (p - center) / (radii * radii);
                let size = gradient.length();
                let (n, change) = (gradient / size, displacement / (radii * radii));
                (change - n.dot(change) * n) / size
            }
            Self::Cylinder { axis, radius, .. } => {
                let n = self.normal(face, p);
                if n.z != 0.0 {
                    return DVec3::ZERO;
                }
                let around = DVec3::new(-(p.y - axis.y), p.x - axis.x, 0.0).normalize();
                displacement.dot(around) / radius * around
            }
            Self::Turned(ref turned) => {
                let frame = &turned.frame;
                let bends = turned.solid.bends(face, frame.point_into(p), frame.direction_into(displacement));
                frame.direction_out(bends)
            }
            Self::Carved(ref carved) => match face.checked_sub(1) {
                None => carved.whole.bends(0, p, displacement),
                Some(hole) => -carved.holes[hole as usize].bends(0, p, displacement),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;
    use crate::solid::{Chord, Frame, Start};

    /// Normals of neighbouring points, met by neighbouring lines, against the derivative: central differences of 1e-5 mm leave
    /// 1e-10 of curvature and 1e-11 of rounding.
    #[test]
    fn normals_turn_as_the_shape_operator_says() {
        let frame = Frame::turned(DVec3::new(0.5, -0.3, 0.2), [25.0, -40.0, 70.0]);
        let solids = [
            Solid::Ellipsoid { center: DVec3::new(0.3, -0.2, 0.1), radii: DVec3::splat(1.7) },
            Solid::Ellipsoid { center: DVec3::new(0.3, -0.2, 0.1), radii: DVec3::new(0.6, 1.7, 2.5) },
            Solid::Cylinder { axis: DVec2::new(0.3, -0.4), radius: 1.5, bottom: -2.0, top: 1.0 },
            Solid::Ellipsoid { center: DVec3::ZERO, radii: DVec3::new(0.8, 1.7, 2.5) }.turned(frame),
            Solid::tube(1.0, 3.0, DVec2::new(0.1, 0.2), -2.0, 2.0),
            Solid::sphere_shell(2.0, 3.0, DVec3::ZERO, Vec::new()),
        ];
        for solid in &solids {
            let mut seen = 0;
            for i in 0..100 {
                let t = f64::from(i);
                let at = |k: f64| libm::sin(t * k + k);
                let (origin, w) =
                    (DVec3::new(at(1.1), at(1.7), at(2.3)), DVec3::new(at(3.1), at(4.3), at(0.7)).normalize());
                let first = |origin: DVec3| {
                    let mut chords: Vec<Chord> = Vec::new();
                    solid.cut(origin - 9.0 * w, w, None::<Start>, &mut chords);
                    chords.first().map(|s| (origin + (s.enter - 9.0) * w, s.into))
                };
                let across = w.any_orthonormal_vector();
                let h = 1e-5;
                let (Some((p, face)), Some((a, _)), Some((b, _))) =
                    (first(origin), first(origin - h * across), first(origin + h * across))
                else {
                    continue;
                };
                // Not over an edge, and not at grazing incidence, where neighbours lie far apart.
                if (b - a).length() > 8.0 * h || solid.normal(face, p).dot(w).abs() < 0.3 {
                    continue;
                }
                let found = (solid.normal(face, b) - solid.normal(face, a)) / (2.0 * h);
                let expected = solid.bends(face, p, (b - a) / (2.0 * h));
                assert!((found - expected).length() < 1e-6, "{solid:?} {p}: {found}, {expected}");
                seen += 1;
            }
            assert!(seen > 20, "{solid:?}: {seen}");
        }
    }
}
