//! The plane that the scene is cut along.

use glam::{DVec2, DVec3};
use turbid_optics::view::View;

/// Sideways steps below this share of the distance are none.
const LEAST: f64 = 1e-3;
/// Sine of the least angle between the plane and the ground.
const LEAST_RISE: f64 = 0.3;

/// A plane that holds a horizontal line.
pub struct Cut {
    pub through: DVec3,
    /// Horizontal unit vector, to the right in the section.
    along: DVec3,
    /// Unit vector upwards in the section.
    up: DVec3,
    /// Whether it runs along the line from camera to projector.
    baseline: bool,
}

impl Cut {
    /// Through camera, projector and what the camera looks at. Where these stand in a line, or in a plane that hardly rises, the vertical plane through
    /// what the camera looks at along the line from camera to projector; where these stand one above the other along the tilt of the first that is
    /// tilted, else along x.
    pub fn of(camera: Option<&View>, projector: Option<&View>) -> Self {
        let first = camera.or(projector);
        let through = first.map_or(DVec3::ZERO, |view| view.look_at);
        let apart = camera.zip(projector).map(|(c, p)| (p.position - c.position, c.distance()));
        let tilts = [camera, projector].into_iter().flatten().map(|v| (v.look_at - v.position, v.distance()));
        let sideways = |(step, distance): (DVec3, f64)| {
            let step = DVec3 { z: 0.0, ..step };
            (step.length() > LEAST * distance).then(|| step.normalize())
        };
        let baseline = apart.and_then(sideways);
        let normal = camera.zip(projector).map(|(c, p)| {
            let (to_projector, ahead) = (p.position - c.position, c.look_at - c.position);
            (to_projector.cross(ahead) / ahead.length_squared()).clamp_length_max(1.0)
        });
        let normal = normal.filter(|n| n.length() > LEAST).map(DVec3::normalize);
        let spanned =
            normal.map(|n| n.cross(DVec3::Z)).filter(|along| along.length() > LEAST_RISE && baseline.is_some());
        let along = spanned.map(DVec3::normalize).or(baseline);
        let along = along.or_else(|| tilts.into_iter().find_map(sideways)).unwrap_or(DVec3::X);
        // To the right is along +x or +y, as in the view from above.
        let turned = if along.x.abs() >= along.y.abs() { along.x < 0.0 } else { along.y < 0.0 };
        let along = if turned { -along } else { along };
        let up = spanned.zip(normal).map(|(_, n)| along.cross(n)).unwrap_or(DVec3::Z);
        // Rounding is no tilt.
        let up = if up.z.abs() > 1.0 - LEAST * LEAST { DVec3::Z } else { up * up.z.signum() };
        Self { through, along, up, baseline: baseline.is_some() }
    }

    /// A point as the section shows it, without its distance from the plane.
    pub fn flatten(&self, p: DVec3) -> DVec2 {
        DVec2::new((p - self.through).dot(self.along), self.through.z + (p - self.through).dot(self.up))
    }

    /// The point of the plane that the section shows there.
    pub fn point(&self, at: DVec2) -> DVec3 {
        self.through + at.x * self.along + (at.y - self.through.z) * self.up
    }

    /// Across the plane.
    pub fn normal(&self) -> DVec3 {
        self.along.cross(self.up)
    }

    /// `y (camera to projector), z up`.
    pub fn said(&self) -> String {
        let axis = [("x", DVec3::X), ("y", DVec3::Y)].into_iter().find(|(_, axis)| self.along.dot(*axis) > 1.0 - 1e-9);
        let (x, y) = (self.along.x, self.along.y);
        let along = axis.map_or_else(|| format!("({x:.2}, {y:.2})"), |(name, _)| name.to_owned());
        let tilt = libm::acos(self.up.z.clamp(-1.0, 1.0)).to_degrees();
        match (self.baseline, axis) {
            // Only a plane that camera and projector span is tilted.
            _ if tilt >= 0.5 => format!("{along}, tilted by {tilt:.0}°"),
            (true, Some(_)) => format!("{along} (camera to projector), z up"),
            (true, None) => format!("{along} (camera to projector)"),
            (false, _) => format!("{along}, z up"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view(position: [f64; 3], look_at: [f64; 3]) -> View {
        View::new(position.into(), look_at.into(), DVec3::Y, DVec2::splat(64.0)).unwrap()
    }

    /// The plane holds camera and projector wherever they stand, and points come back.
    #[test]
    fn the_cut_runs_from_camera_to_projector() {
        let camera = view([0.0, 0.0, 500.0], [0.0; 3]);
        for (position, said) in [
            ([0.0, 35.0, 500.0], "y (camera to projector), z up"),
            ([0.0, -35.0, 400.0], "y (camera to projector), z up"),
            ([35.0, 0.0, 500.0], "x (camera to projector), z up"),
            ([-30.0, 30.0, 500.0], "(0.71, -0.71) (camera to projector)"),
            ([0.0, 0.0, 400.0], "x, z up"),
        ] {
            let projector = view(position, [0.0; 3]);
            let cut = Cut::of(Some(&camera), Some(&projector));
            assert_eq!(cut.said(), said, "{position:?}");
            for p in [camera.position, projector.position] {
                assert!((cut.point(cut.flatten(p)) - p).length() < 1e-9, "{p} is not in the cut of {position:?}");
            }
        }
        let tilted = view([0.0, 300.0, 400.0], [0.0; 3]);
        assert_eq!(Cut::of(Some(&tilted), Some(&tilted)).said(), "y, z up", "along the tilt where both coincide");
        assert_eq!(Cut::of(None, None).said(), "x, z up");
        let beside = view([40.0, 300.0, 400.0], [0.0; 3]);
        let cut = Cut::of(Some(&tilted), Some(&beside));
        assert_eq!(cut.said(), "x, tilted by 37°");
        for p in [tilted.position, beside.position, DVec3::ZERO, DVec3::new(30.0, 3.0, 4.0)] {
            assert!((cut.point(cut.flatten(p)) - p).length() < 1e-9, "{p} is not in the cut");
        }
        assert!(cut.flatten(tilted.position).y > 499.0, "up is up");
        let level = [view([500.0, 0.0, 60.0], [0.0; 3]), view([500.0, 40.0, 60.0], [0.0; 3])];
        assert_eq!(Cut::of(Some(&level[0]), Some(&level[1])).said(), "y (camera to projector), z up", "not the ground");
    }
}
