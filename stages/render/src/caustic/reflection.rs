//! Ways by one reflection: all places are known where walls of any shape reflect light from one point to another.

use glam::{DVec2, DVec3};
use turbid_optics::pencil::Aim;
use turbid_optics::solid::{Ends, Far};

use super::NEAR;
use super::shot::{Shot, Walls};
use crate::lamp::Source;
use crate::walker::Walker;
use crate::way::Known;
use crate::world::Skin;

/// So many times as bright as in the open, light is in focus.
const FOCUSED: f64 = 1e8;
/// What a place in focus may lie off where a ray meets the wall, relative to the coordinates: rounding.
const THERE: f64 = 1e-7;
/// What a ray behind the wall may miss the source by, rad.
const LEADS: f64 = 1e-6;

impl Shot {
    /// Whether it goes to the source.
    fn leads(&self, source: Source<'_>) -> bool {
        (source.towards(self.pencil.r).0 - self.pencil.w).length() <= LEADS
    }
}

impl Walker<'_> {
    /// Adds the ways from a source to a place by one reflection: all that mirrors throw, and if `smooth` those that walls between different
    /// indices do. Where light is in focus, the irradiance is infinite.
    pub(crate) fn by_one_reflection(
        &mut self,
        source: Source<'_>,
        (r, skin): (DVec3, Option<Skin>),
        smooth: bool,
        known: &mut Vec<Known>,
    ) {
        let world = self.setting.world;
        let (origin, along) = source.origin();
        let far = along.map_or(Far::Point(origin), |along| Far::Direction(-along));
        let mut places = std::mem::take(&mut self.places);
        places.clear();
        for (i, body) in world.bodies.iter().enumerate() {
            let clear = !world.materials[body.material].is_opaque();
            if (smooth && clear) || self.mirrors.bodies.contains(&i) {
                body.solid.reflections(&Ends::alike(far, r), &mut |p| places.push(p));
            }
        }
        for &p in &places {
            let Some(towards) = (p - r).try_normalize() else { continue };
            let Some(shot) = self.shoot((r, skin), towards, &[true], Walls::AsTheyAre) else { continue };
            let aim = shot.aim(source);
            let there = (shot.pencil.r - p).length() <= THERE * (1.0 + p.abs().max_element());
            let open = match far {
                Far::Point(a) => 1.0 / ((p - r).length() + (a - p).length()).powi(2),
                Far::Direction(_) => 1.0,
            };
            let focused = aim.is_none_or(|aim| aim.spread > FOCUSED * open);
            if focused && there && shot.leads(source) {
                let endless = Aim { turn: DVec2::ZERO, miss: 0.0, spread: f64::INFINITY };
                let link = self.arrive(source, &shot, &endless).filter(|link| libm::exp(-link.tau) > 0.0);
                known.extend(link.map(|link| Known { link, events: 1 }));
            }
            // Rounding of a place on a large body is steered away.
            let Some(aim) = aim.filter(|aim| !focused && aim.turn.length() < NEAR) else { continue };
            let steered = self.steer(source, (r, skin), (shot, aim), &[true], Walls::AsTheyAre);
            // A ray that grazes a wall elsewhere hardly has to be turned to go anywhere.
            if let Some(way) = steered.filter(|(shot, _)| shot.leads(source)) {
                self.keep(source, (r, skin), way, &[true], known);
            }
        }
        self.places = places;
    }
}
