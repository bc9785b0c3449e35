//! Steady lights.

use glam::DVec3;
use turbid_contract::payload::Lamp;
use turbid_contract::{Length, Power, Problems, Usual};

use crate::assemble::channels::Channels;
use crate::assemble::plain;
use crate::assemble::plausible::doubt;
use crate::params::LampParams;
use turbid_contract::PerChannel;

pub fn lamp(name: &str, lamp: &LampParams, channels: Channels, problems: &mut Problems) -> Lamp {
    let at = |kind: &str, field: &str| format!("lights.{name}.{kind}.{field}");
    let powers = |kind: &str, given: &PerChannel<Power>, problems: &mut Problems| {
        let path = at(kind, "power");
        channels.values(
            &path,
            given,
            |p| p.0,
            problems,
            |path, v, problems| {
                doubt(&Usual::POWER, &path, v, problems);
                problems.require(v > 0.0, path, v, "W", "be > 0");
            },
        )
    };
    let axis = |kind: &str, position: [Length; 3], look_at: [Length; 3], problems: &mut Problems| {
        let (position, look_at) = (plain(position), plain(look_at));
        if (DVec3::from(look_at) - DVec3::from(position)).try_normalize().is_none() {
            problems.push_with_hint(
                at(kind, "look_at"),
                format!("look_at = {look_at:?} mm is the light's own position"),
                "move one of them",
            );
        }
        (position, look_at)
    };
    match lamp {
        LampParams::Point(l) => Lamp::Point { position: plain(l.position), power: powers("point", &l.power, problems) },
        LampParams::Spot(l) => {
            let (position, look_at) = axis("spot", l.position, l.look_at, problems);
            let angle = l.angle_deg.0;
            let rule = "lie in (0, 360): it is the full angle of the cone";
            problems.require(angle > 0.0 && angle < 360.0, at("spot", "angle_deg"), angle, "deg", rule);
            Lamp::Spot { position, look_at, angle_deg: angle, power: powers("spot", &l.power, problems) }
        }
        LampParams::Collimated(l) => {
            let (position, look_at) = axis("collimated", l.position, l.look_at, problems);
            let diameter = l.diameter.0;
            problems.require(diameter > 0.0, at("collimated", "diameter"), diameter, "mm", "be > 0");
            Lamp::Collimated { position, look_at, diameter, power: powers("collimated", &l.power, problems) }
        }
        LampParams::Ambient(l) => {
            let path = at("ambient", "radiance");
            let radiance = channels.values(
                &path,
                &l.radiance,
                |v| *v,
                problems,
                |path, v, problems| {
                    problems.require(v > 0.0, path, v, "W mm^-2 sr^-1", "be > 0");
                },
            );
            Lamp::Ambient { radiance }
        }
    }
}
