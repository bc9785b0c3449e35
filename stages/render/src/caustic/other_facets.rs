//! Connections by one refraction among facets beside the one that lanes have found.

use glam::DVec3;
use turbid_optics::solid::Solid;

use super::manifold_sampling::WEAK;
use crate::connect::Draws;
use crate::connection::Connection;
use crate::lamp::Source;
use crate::walker::Walker;
use crate::world::Material;

impl Walker<'_> {
    /// Adds the lit connections by one refraction among facets beside the one that lanes have found, of that `strength`; see [`Walker::find_beside`]. They are few: tried
    /// as other connections are, and by roulette where even the nearest facet lies so deep that they bring next to nothing.
    pub(crate) fn reach_beside(
        &mut self,
        source: Source<'_>,
        r: DVec3,
        (about, strength): (Option<DVec3>, f64),
        draws: &Draws<'_>,
        connections: &mut Vec<Connection>,
    ) {
        let [whether, _, deep, _] = draws.whether(source);
        if whether >= draws.others {
            return;
        }
        let chance = if about.is_some() { 1.0 } else { self.chance_of_facets(source, r, strength) };
        if deep >= chance {
            return;
        }
        self.find_beside(source, r, about);
        let lit = self.known.iter().map(|known| known.connection).filter(|connection| connection.lit);
        let heavier = |c: Connection| Connection { irradiance: c.irradiance / (draws.others * chance), ..c };
        connections.extend(lit.map(heavier));
    }

    /// With which probability facets are searched for light beside a connection that brings `strength`: less where the medium up to the nearest of them leaves less than
    /// `WEAK` of that.
    fn chance_of_facets(&self, source: Source<'_>, r: DVec3, strength: f64) -> f64 {
        let world = self.setting.world;
        // At least: exactly it costs more than it is worth.
        let clear_of = |solid: &Solid| match solid {
            Solid::Mesh(mesh) => Some(mesh.cells()?.clearance((r - mesh.center()).as_vec3().to_array()).into()),
            _ => None,
        };
        let clear = world.bodies.iter().filter_map(|body| clear_of(&body.solid)).fold(f64::INFINITY, f64::min);
        let mu_t =
            world.materials.iter().skip(1).filter(|m| !m.is_opaque()).map(Material::mu_t).fold(f64::INFINITY, f64::min);
        let unattenuated = source.arrival(r).map_or(0.0, |arrival| arrival.irradiance);
        let left = libm::exp(-mu_t * clear) * unattenuated;
        if strength > 0.0 { (left / (WEAK * strength)).min(1.0) } else { 1.0 }
    }

    /// Fills `self.known` with the connections by one refraction that lanes have not found. They have found one facet's, which begins along about the unit vector
    /// `about`; or, where that is `None`, those of all that has no facets.
    fn find_beside(&mut self, source: Source<'_>, r: DVec3, about: Option<DVec3>) {
        let mut known = std::mem::take(&mut self.known);
        known.clear();
        let n = self.index_around(r);
        let through = |solid: &Solid| about.is_some() || matches!(solid, Solid::Mesh(_));
        self.by_one_refraction(source, (r, None), n, through, false, &mut known);
        known.retain(|known| !about.is_some_and(|about| known.is_about(about)));
        self.known = known;
    }
}
