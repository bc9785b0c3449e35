//! Scouts: single flights beside a path, towards the light, so that what the path would find there by chance does not weigh alone.
//!
//! `docs/theory/render.md`, "Light-directed branches".

use glam::DVec3;
use turbid_optics::henyey_greenstein as hg;
use turbid_optics::philox::unit;

use crate::random::{Purpose, SCOUT};
use crate::setting::Place;
use crate::walker::Walker;

/// Scouts are sent nearer to a wall than so many mean free paths: grazing light does not come further.
pub(crate) const NEAR: f64 = 1.0;
/// A scout goes with this times its share of the light, or 1, as probability: most shares are some per cent.
pub(crate) const KEPT: f64 = 8.0;

/// g of the lobe around the light from which scouts are drawn: half as wide as the phase function.
fn lobe(g: f64) -> f64 {
    0.5 * (1.0 + g)
}

/// (1 - lobe(g)^2) / (1 - g^2).
pub(crate) fn narrower(g: f64) -> f64 {
    0.25 * (3.0 + g) / (1.0 + g)
}

/// p(w . e) / (p(w . e) + lobe(e . L)), the balance heuristic: the part that a path going from w along e has of the light that it sees next.
fn share(g: f64, w: DVec3, e: DVec3, towards: DVec3) -> f64 {
    let ratio = hg::denominator(g, w.dot(e)) / hg::denominator(lobe(g), e.dot(towards));
    1.0 / (1.0 + narrower(g) * ratio * ratio.sqrt())
}

impl Walker<'_> {
    /// Sends a scout from the collision where a path stands, which came there along `at.w` and goes on along `next`; leaves the path its share.
    pub(crate) fn send_scout(&mut self, at: &mut Place, next: DVec3) {
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
        at.share = share(here.g, at.w, next, towards);
        let number = at.flight() | u64::from(SCOUT);
        let [b, c, d, _] = self.stream(at).block(Purpose::Scout(number));
        let w = hg::sample(lobe(here.g), towards, unit(b), unit(c));
        let part = share(here.g, at.w, w, towards);
        let kept = (KEPT * part).min(1.0);
        if unit(d) < kept {
            let (weight, response) = (at.weight * part / kept, at.response + self.paths);
            self.sent.push_back(Place { w, weight, number, response, share: 1.0, scout: true, ..*at });
        }
    }
}
