//! Integrating detectors.

use glam::DVec3;
use turbid_contract::payload::{Detector, Outline};
use turbid_contract::{AngleDeg, Length, Problems};

use crate::assemble::plain;
use crate::params::DetectorParams;

/// sin of the least angle between a rectangle's axis and its `up`.
const LEAST_SINE: f64 = 1e-3;

pub fn detector(name: &str, detector: &DetectorParams, problems: &mut Problems) -> Detector {
    match detector {
        DetectorParams::Disc(d) => {
            let place = Place { at: format!("detectors.{name}.disc"), position: d.position, look_at: d.look_at };
            let diameter = d.diameter.0;
            problems.require(diameter > 0.0, format!("{}.diameter", place.at), diameter, "mm", "be > 0");
            place.detector(Outline::Disc { diameter }, d.half_angle_deg, d.absorbs, problems)
        }
        DetectorParams::Rectangle(d) => {
            let place = Place { at: format!("detectors.{name}.rectangle"), position: d.position, look_at: d.look_at };
            let size = plain(d.size);
            for (i, &side) in size.iter().enumerate() {
                problems.require(side > 0.0, format!("{}.size.{i}", place.at), side, "mm", "be > 0");
            }
            let up = d.up.map(|x| x + 0.0);
            let detector = place.detector(Outline::Rectangle { up, size }, d.half_angle_deg, d.absorbs, problems);
            let upright = DVec3::from(up).try_normalize();
            if upright.is_none_or(|up| up.cross(detector.facing.into()).length() <= LEAST_SINE) {
                problems.push_with_hint(
                    format!("{}.up", place.at),
                    format!("the detector looks along its up vector {up:?}, so that its sides have no direction"),
                    "choose an `up` across the line of sight, such as [0, 0, 1]",
                );
            }
            detector
        }
    }
}

struct Place {
    /// The path of its fields.
    at: String,
    position: [Length; 3],
    look_at: [Length; 3],
}

impl Place {
    fn detector(&self, outline: Outline, half_angle: AngleDeg, absorbs: bool, problems: &mut Problems) -> Detector {
        let (position, look_at) = (plain(self.position), plain(self.look_at));
        let facing = (DVec3::from(look_at) - DVec3::from(position)).try_normalize();
        if facing.is_none() {
            problems.push_with_hint(
                format!("{}.look_at", self.at),
                format!("look_at = {look_at:?} mm is the detector's own position"),
                "move one of them",
            );
        }
        let angle = half_angle.0;
        let rule = "lie in (0, 90]: only what comes from the front is counted";
        problems.require(angle > 0.0 && angle <= 90.0, format!("{}.half_angle_deg", self.at), angle, "deg", rule);
        let facing = facing.unwrap_or(DVec3::Z).to_array().map(|x| x + 0.0);
        Detector { outline, position, facing, half_angle_deg: angle, absorbs }
    }
}
