//! Connections by one reflection: all places are known where interfaces of any shape reflect light from one point to another.

use glam::{DVec2, DVec3};
use turbid_optics::ray_differential::NewtonStep;
use turbid_optics::solid::{Ends, Far};

use super::NEAR;
use super::shot::{Shot, SurfaceNormals};
use crate::connection::Known;
use crate::lamp::Source;
use crate::walker::Walker;
use crate::world::SurfacePoint;

/// So many times as bright as in the open, light is in focus.
const FOCUSED: f64 = 1e8;
/// What a place in focus may lie off where a ray meets the interface, relative to the coordinates: rounding.
const THERE: f64 = 1e-7;
/// What a ray behind the interface may miss the source by, rad.
const LEADS: f64 = 1e-6;

impl Shot {
    /// Whether it goes to the source.
    fn leads(&self, source: Source<'_>) -> bool {
        (source.towards(self.differential.r).0 - self.differential.w).length() <= LEADS
    }
}

impl Walker<'_> {
    /// Adds the connections from a source to a place by one reflection: all that mirrors throw, and if `smooth` those that interfaces between different
    /// indices do. Where light is in focus, the irradiance is infinite.
    pub(crate) fn by_one_reflection(
        &mut self,
        source: Source<'_>,
        (r, surface_point): (DVec3, Option<SurfacePoint>),
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
            let Some(shot) = self.shoot((r, surface_point), towards, &[true], SurfaceNormals::AsTheyAre) else {
                continue;
            };
            let newton = shot.newton(source);
            let there = (shot.differential.r - p).length() <= THERE * (1.0 + p.abs().max_element());
            let open = match far {
                Far::Point(a) => 1.0 / ((p - r).length() + (a - p).length()).powi(2),
                Far::Direction(_) => 1.0,
            };
            let focused = newton.is_none_or(|newton| newton.spread > FOCUSED * open);
            if focused && there && shot.leads(source) {
                let endless = NewtonStep { turn: DVec2::ZERO, miss: 0.0, spread: f64::INFINITY };
                let connection =
                    self.arrive(source, &shot, &endless).filter(|connection| libm::exp(-connection.tau) > 0.0);
                known.extend(connection.map(|connection| Known { connection, events: 1 }));
            }
            // The manifold walk takes away the rounding of a place on a large body.
            let Some(newton) = newton.filter(|newton| !focused && newton.turn.length() < NEAR) else { continue };
            let walked =
                self.manifold_walk(source, (r, surface_point), (shot, newton), &[true], SurfaceNormals::AsTheyAre);
            // A ray that grazes an interface elsewhere hardly has to be turned to go anywhere.
            if let Some(chain) = walked.filter(|(shot, _)| shot.leads(source)) {
                self.keep(source, (r, surface_point), chain, &[true], known);
            }
        }
        self.places = places;
    }
}
