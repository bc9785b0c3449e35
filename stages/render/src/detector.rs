//! Integrating detectors: flat areas that count the light which comes through them from the front.

use glam::DVec3;
use turbid_contract::payload::{self, Outline, Scene};
use turbid_optics::elementary::sin_cos_turns;

/// Ends of flights within this distance (mm) of a detector's plane lie in it: they are on the side from which they came.
const IN_PLANE: f64 = 1e-9;

/// An area, and which light it counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detector {
    center: DVec3,
    /// Unit vector towards its front.
    facing: DVec3,
    area: Area,
    /// Of the angle between the light and the axis, at least.
    cos_least: f64,
    /// Whether what it counts ends there.
    pub absorbs: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Area {
    Disc {
        radius: f64,
    },
    /// Half of its sides, as vectors.
    Rectangle {
        half: [DVec3; 2],
    },
}

/// On which side of each detector a photon is: the signed distance from its plane when it was last off it, mm.
pub type Sides = Vec<f64>;

impl Detector {
    /// The detectors of a checked scene, in the order of their names.
    pub fn all(scene: &Scene) -> Vec<Self> {
        scene.detectors.values().map(Self::of).collect()
    }

    fn of(d: &payload::Detector) -> Self {
        let facing = DVec3::from(d.facing);
        let area = match d.outline {
            Outline::Disc { diameter } => Area::Disc { radius: 0.5 * diameter },
            Outline::Rectangle { up, size } => {
                let right = DVec3::from(up).cross(facing).normalize();
                Area::Rectangle { half: [0.5 * size[0] * right, 0.5 * size[1] * facing.cross(right)] }
            }
        };
        // 0 for 90 degrees, to the last bit: light along the plane does not come through it.
        let (_, cos) = sin_cos_turns(d.half_angle_deg / 360.0);
        let cos_least = if d.half_angle_deg == 90.0 { 0.0 } else { cos };
        Self { center: d.position.into(), facing, area, cos_least, absorbs: d.absorbs }
    }

    fn height(&self, p: DVec3) -> f64 {
        (p - self.center).dot(self.facing)
    }

    /// How far along the stretch from r over `length` mm along w light comes through from the front, inside the area and the angle;
    /// `side` is kept up to date.
    fn crossing(&self, r: DVec3, w: DVec3, length: f64, side: &mut f64) -> Option<f64> {
        let slope = w.dot(self.facing);
        let end = if length == f64::INFINITY { slope * f64::INFINITY } else { self.height(r + length * w) };
        // Along the plane nothing changes; NaN for a ray to infinity along it.
        if end.is_nan() || end.abs() <= IN_PLANE {
            return None;
        }
        let before = std::mem::replace(side, end);
        if !(before > 0.0 && end < 0.0) {
            return None;
        }
        let t = (-self.height(r) / slope).clamp(0.0, length);
        (-slope >= self.cos_least && self.holds(r + t * w)).then_some(t)
    }

    fn holds(&self, p: DVec3) -> bool {
        let off = p - self.center;
        match self.area {
            Area::Disc { radius } => off.length_squared() <= radius * radius,
            Area::Rectangle { half } => half.iter().all(|h| off.dot(*h).abs() <= h.length_squared()),
        }
    }
}

/// The sides of a photon at its start.
pub fn sides(detectors: &[Detector], r: DVec3) -> Sides {
    detectors.iter().map(|d| d.height(r)).collect()
}

/// Counts what comes through on a straight stretch; the detector that takes the photon, if one does.
///
/// `counts` has a place for each detector. What lies behind the place where the photon is taken does not count.
pub fn pass(
    detectors: &[Detector],
    (r, w, length): (DVec3, DVec3, f64),
    sides: &mut Sides,
    counts: &mut [u32],
) -> Option<usize> {
    let mut crossings: Vec<(f64, usize)> = Vec::new();
    for (i, (detector, side)) in detectors.iter().zip(sides).enumerate() {
        crossings.extend(detector.crossing(r, w, length, side).map(|t| (t, i)));
    }
    crossings.sort_by(|a, b| a.0.total_cmp(&b.0));
    for (_, i) in crossings {
        counts[i] += 1;
        if detectors[i].absorbs {
            return Some(i);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plate(absorbs: bool) -> Detector {
        Detector { center: DVec3::ZERO, facing: DVec3::Z, area: Area::Disc { radius: 1.0 }, cos_least: 0.5, absorbs }
    }

    /// From the front, inside area and angle, once for each passage; ends of stretches in the plane count for what follows.
    #[test]
    fn what_comes_through_from_the_front_counts() {
        let plates = [plate(false)];
        let mut counts = [0];
        let mut walk = |points: &[[f64; 3]], expected: u32| {
            counts[0] = 0;
            let points: Vec<DVec3> = points.iter().map(|&p| p.into()).collect();
            let mut sides = sides(&plates, points[0]);
            for pair in points.windows(2) {
                let step = pair[1] - pair[0];
                pass(&plates, (pair[0], step.normalize(), step.length()), &mut sides, &mut counts);
            }
            assert_eq!(counts[0], expected, "{points:?}");
        };
        walk(&[[0.2, 0.0, 1.0], [0.2, 0.0, -1.0]], 1);
        walk(&[[0.2, 0.0, -1.0], [0.2, 0.0, 1.0]], 0);
        walk(&[[1.2, 0.0, 1.0], [1.2, 0.0, -1.0]], 0);
        // More oblique than 60 degrees.
        walk(&[[-0.5, 0.0, 0.25], [0.5, 0.0, -0.25]], 0);
        // Stopped in the plane: through, and turned back.
        for off in [-1e-12, 0.0, 1e-12] {
            walk(&[[0.0, 0.0, 1.0], [0.0, 0.0, off], [0.0, 0.0, -1.0]], 1);
            walk(&[[0.0, 0.0, 1.0], [0.0, 0.0, off], [0.0, 0.0, 1.0]], 0);
        }
        walk(
            &[[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [3.0, 0.0, -1.0], [3.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.0, 0.0, -2.0]],
            2,
        );
    }

    /// The first of two that absorbs takes the photon; to infinity, too.
    #[test]
    fn the_nearest_takes_it() {
        let below = Detector { center: -DVec3::Z, ..plate(true) };
        let detectors = [below, plate(true), Detector { center: DVec3::Z, ..plate(false) }];
        let (r, mut counts) = (DVec3::new(0.1, 0.0, 5.0), [0; 3]);
        let mut sides = sides(&detectors, r);
        let taken = pass(&detectors, (r, DVec3::NEG_Z, f64::INFINITY), &mut sides, &mut counts);
        assert_eq!((taken, counts), (Some(1), [0, 1, 1]));
    }
}
