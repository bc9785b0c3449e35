//! The vertical plane that the scene is cut along.

use glam::{DVec2, DVec3};
use turbid_optics::view::View;

/// Sideways steps below this share of the distance are none.
const LEAST: f64 = 1e-3;

/// A vertical plane.
pub struct Cut {
    pub through: DVec3,
    /// Horizontal unit vector, to the right in the section.
    along: DVec3,
    /// Whether it runs along the line from camera to projector.
    baseline: bool,
}

impl Cut {
    /// Through what the camera looks at, along the line from camera to projector; where these stand one above the other along the tilt of
    /// the first that is tilted, else along x.
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
        let along = baseline.or_else(|| tilts.into_iter().find_map(sideways)).unwrap_or(DVec3::X);
        // To the right is along +x or +y, as in the view from above.
        let turned = if along.x.abs() >= along.y.abs() { along.x < 0.0 } else { along.y < 0.0 };
        Self { through, along: if turned { -along } else { along }, baseline: baseline.is_some() }
    }

    /// A point as the section shows it, without its distance from the plane.
    pub fn flatten(&self, p: DVec3) -> DVec2 {
        DVec2::new((p - self.through).dot(self.along), p.z)
    }

    /// The point of the plane that the section shows there.
    pub fn point(&self, at: DVec2) -> DVec3 {
        let across = self.through + at.x * self.along;
        DVec3 { z: at.y, ..across }
    }

    /// `y (camera to projector)`.
    pub fn said(&self) -> String {
        let axis = [("x", DVec3::X), ("y", DVec3::Y)].into_iter().find(|(_, axis)| self.along.dot(*axis) > 1.0 - 1e-9);
        let (x, y) = (self.along.x, self.along.y);
        let along = axis.map_or_else(|| format!("({x:.2}, {y:.2})"), |(name, _)| name.to_owned());
        if self.baseline { format!("{along} (camera to projector)") } else { along }
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
            ([0.0, 35.0, 500.0], "y (camera to projector)"),
            ([0.0, -35.0, 400.0], "y (camera to projector)"),
            ([35.0, 0.0, 500.0], "x (camera to projector)"),
            ([-30.0, 30.0, 500.0], "(0.71, -0.71) (camera to projector)"),
            ([0.0, 0.0, 400.0], "x"),
        ] {
            let projector = view(position, [0.0; 3]);
            let cut = Cut::of(Some(&camera), Some(&projector));
            assert_eq!(cut.said(), said, "{position:?}");
            for p in [camera.position, projector.position] {
                assert!((cut.point(cut.flatten(p)) - p).length() < 1e-9, "{p} is not in the cut of {position:?}");
            }
        }
        let tilted = view([0.0, 300.0, 400.0], [0.0; 3]);
        assert_eq!(Cut::of(Some(&tilted), Some(&tilted)).said(), "y", "along the tilt where both coincide");
        assert_eq!(Cut::of(None, None).said(), "x");
    }
}
