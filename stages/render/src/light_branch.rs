//! Light-directed branches: single flights towards the light, besides those of the path, so that what the path would rarely find there does not weigh alone.
//!
//! `docs/theory/render.md`, "Light-directed branches".

use glam::DVec3;
use turbid_optics::PhaseFunction;
use turbid_optics::henyey_greenstein as hg;
use turbid_optics::philox::unit;

use crate::random::{LIGHT_BRANCH, Purpose};
use crate::setting::Place;
use crate::walker::Walker;

/// Light-directed branches start nearer to an interface than so many mean free paths: grazing light does not come further.
pub(crate) const NEAR: f64 = 1.0;
/// A light-directed branch is followed with this times its MIS weight, or 1, as probability: most weights are some per cent.
pub(crate) const KEPT: f64 = 8.0;

/// g of the lobe around the light from which light-directed branches are drawn: half as wide as the phase function, or as its forward term.
fn lobe(g: f64) -> f64 {
    0.5 * (1.0 + g)
}

/// (1 - lobe(g)^2) / (1 - g^2).
pub(crate) fn narrower(g: f64) -> f64 {
    0.25 * (3.0 + g) / (1.0 + g)
}

/// p(w . e) / (p(w . e) + lobe(e . L)), the balance heuristic: the part that a path going from w along e has of the light that it sees next.
fn mis_weight(phase: &PhaseFunction, w: DVec3, e: DVec3, towards: DVec3) -> f64 {
    match *phase {
        PhaseFunction::HenyeyGreenstein { g } => {
            let ratio = hg::denominator(g, w.dot(e)) / hg::denominator(lobe(g), e.dot(towards));
            1.0 / (1.0 + narrower(g) * ratio * ratio.sqrt())
        }
        PhaseFunction::TwoTermHenyeyGreenstein { g_forward, .. } => {
            let (own, around) = (phase.density(w.dot(e)), hg::density(lobe(g_forward), e.dot(towards)));
            own / (own + around)
        }
    }
}

impl Walker<'_> {
    /// Starts a light-directed branch from the collision where a path stands, which came there along `at.w` and goes on along `next`; leaves the path its MIS weight.
    pub(crate) fn send_light_branch(&mut self, at: &mut Place, next: DVec3) {
        let world = self.setting.world;
        let here = world.materials[at.material];
        if here.mu_t() * at.clear >= NEAR {
            return;
        }
        at.clear = at.clear.max(world.clearance(at.r));
        if here.mu_t() * at.clear >= NEAR {
            return;
        }
        let towards = self.setting.light.towards(at.r).0;
        at.mis_weight = mis_weight(&here.phase, at.w, next, towards);
        let number = at.flight() | u64::from(LIGHT_BRANCH);
        let [b, c, d, _] = self.stream(at).block(Purpose::LightBranch(number));
        let w = hg::sample(lobe(here.phase.g_forward()), towards, unit(b), unit(c));
        let part = mis_weight(&here.phase, at.w, w, towards);
        let kept = (KEPT * part).min(1.0);
        if unit(d) < kept {
            let (weight, response) = (at.weight * part / kept, at.response + self.paths);
            self.sent.push_back(Place { w, weight, number, response, mis_weight: 1.0, light_branch: true, ..*at });
        }
    }
}
