//! Weight windows towards the light: where a phase function has a narrow peak, paths are split as they turn towards the light near the surface, and play
//! roulette as they turn away again.
//!
//! `docs/theory/render.md`, "Weight windows". Weight windows: Booth and Hendricks, "Importance estimation in forward Monte Carlo calculations", Nucl. Technol. Fusion 5 (1984).

use glam::DVec3;
use turbid_optics::PhaseFunction;
use turbid_optics::elementary::ln;
use turbid_optics::henyey_greenstein::{denominator, density, sample};

use crate::setting::{Nee, Setting};
use crate::strata::Bending;
use crate::world::{Material, World};

/// Least g of a medium for which they are taken; they then hold in all media of the world. Below it the copies cost more than they save.
pub(crate) const PEAKED: f64 = 0.875;
/// Largest g of a scattering medium up to which there are any: f32 holds no narrower lobe.
pub(crate) const NARROWEST: f64 = 0.998;
/// Least g of media in which copies are also sent towards the light: there a path that turns into the lobe around it by chance would bring too much at once.
pub(crate) const NARROW: f64 = 0.97;
/// Copies of a kind that one collision makes, at most.
pub(crate) const MOST_COPIES: u32 = 64;
/// Width of the lobe around the light, in scatterings: so many at the surface, and so many more for each mean free path to it. Measured, as the power of
/// [`importance`]: the least variance x flights for g from 0.8 to 0.98.
pub(crate) const SCATTERINGS: f64 = 2.0;
/// -ln of the lobe's g from which on [`importance`] is less than 2: no path is split.
pub(crate) const WIDE: f64 = 2.2;

/// The directions around the light that lead to it soon, seen from a place: those spread by Henyey and Greenstein's function of `wide`.
///
/// After k scatterings by the function of g directions are spread by that of g^k.
#[derive(Clone, Copy, Debug)]
pub struct Lobe {
    towards: DVec3,
    wide: f64,
}

impl Lobe {
    /// Around the unit vector `towards`, `tau` scattering mean free paths from the surface.
    pub fn of(g: f64, tau: f64, towards: DVec3) -> Self {
        Self { towards, wide: if g > 0.0 { libm::exp(exponent(g, tau)) } else { 0.0 } }
    }

    /// What a path along the unit vector `w` is worth beside one that does not see the light soon, at least 1.
    ///
    /// With G = `wide`, P = (1 - G^2) / (1 + G^2 - 2 G cos) falls to 1 where cos = G; it is P^3.
    pub fn importance(&self, w: DVec3) -> f64 {
        let wide = self.wide;
        let peak = (1.0 - wide) * (1.0 + wide) / denominator(wide, w.dot(self.towards));
        (peak * peak * peak).max(1.0)
    }

    /// p / (p + l) of a scattering from `w` to `e`, p the phase function and l the density of [`Lobe::sample`]: the MIS weight of both.
    pub fn mis_weight(&self, phase: &PhaseFunction, w: DVec3, e: DVec3) -> f64 {
        let cos = e.dot(self.towards);
        if cos <= self.wide {
            return 1.0;
        }
        let p = phase.density(w.dot(e));
        p / (p + density(self.wide.sqrt(), cos))
    }

    /// A direction towards the light: half as many scatterings wide. `None` where the lobe is left, from where nothing is sent.
    pub fn sample(&self, u: f64, turns: f64) -> Option<DVec3> {
        let e = sample(self.wide.sqrt(), self.towards, u, turns);
        (e.dot(self.towards) > self.wide).then_some(e)
    }
}

/// Whether a place is so near to the surface that paths are split there, `tau` scattering mean free paths from it.
pub fn is_near(g: f64, tau: f64) -> bool {
    g > 0.0 && -exponent(g, tau) < WIDE
}

/// ln G.
fn exponent(g: f64, tau: f64) -> f64 {
    (SCATTERINGS * (1.0 + tau) * ln(g)).max(-80.0)
}

/// The medium for which paths have weight windows: of those that scatter with a peak the most peaked. `None` where there is none, where light comes to it otherwise
/// than straight or through horizontal planes, and in worlds with bores or hollows: light grazes their walls, and there are light-directed branches.
pub fn most_peaked<'a>(world: &'a World, bending: &Bending) -> Option<&'a Material> {
    let known = matches!(bending, Bending::Nowhere | Bending::AtPlanes(_)) && !world.is_hollow();
    let filling = world.bodies.iter().map(|body| &world.materials[body.material]);
    let peaked = filling.filter(|m| known && m.mu_s > 0.0 && m.phase.g_forward() >= PEAKED);
    peaked
        .max_by(|a, b| a.phase.g_forward().total_cmp(&b.phase.g_forward()))
        .filter(|most| most.phase.g_forward() <= NARROWEST)
}

/// Its refractive index, where paths are connected one scattering ahead to a light with a place or a direction.
pub fn peaked_index(setting: &Setting<'_>, bending: &Bending) -> Option<f64> {
    let shines = setting.light.shines() || !setting.steady.lamps.is_empty();
    most_peaked(setting.world, bending).filter(|_| setting.nee == Nee::Line && shines).map(|medium| medium.n)
}

#[cfg(test)]
mod tests {
    use super::*;
    use turbid_optics::philox::{philox4x32, unit, unit_fine};

    /// A path that keeps its share of its own direction, and the copy that is sent, bring together what the phase function does: its integral 1, its mean cosine g, and the part in the lobe,
    /// from inside and outside the lobe; 5 sigma.
    #[test]
    fn path_and_copy_are_the_phase_function() {
        for (g, tau, tilt) in [(0.97, 0.0, 0.02), (0.97, 3.0, 0.3), (0.99, 5.0, 1.0), (0.995, 0.5, 0.01)] {
            let (came, n) = (DVec3::new(f64::sin(tilt), 0.0, f64::cos(tilt)), 200_000);
            let (lobe, phase) = (Lobe::of(g, tau, DVec3::Z), PhaseFunction::henyey_greenstein(g));
            let moments = |e: DVec3, weight: f64| {
                [weight, weight * e.dot(came), if e.z > lobe.wide { weight } else { 0.0 }, weight * e.x]
            };
            let (mut shared, mut squares, mut alone) = ([0.0; 4], [0.0; 4], [0.0; 4]);
            for i in 0..n {
                let [a, b, c, _] = philox4x32([i, 1, 2, 3], [5, 6]);
                let [d, e, _, _] = philox4x32([i, 2, 2, 3], [5, 6]);
                let own = sample(g, came, unit_fine(a, b), unit(c));
                let sent = lobe.sample(unit(d), unit(e));
                let of_sent = sent.map_or([0.0; 4], |e| moments(e, lobe.mis_weight(&phase, came, e)));
                let of_own = moments(own, lobe.mis_weight(&phase, came, own));
                for (k, plain) in moments(own, 1.0).into_iter().enumerate() {
                    let difference = of_own[k] + of_sent[k] - plain;
                    shared[k] += difference;
                    squares[k] += difference * difference;
                    alone[k] += plain;
                }
            }
            for k in 0..4 {
                assert!(shared[k].abs() <= 5.0 * squares[k].sqrt(), "g = {g}, {k}: {} beside {}", shared[k], alone[k]);
            }
        }
    }

    /// It is 1 away from the light and from the surface, and falls steadily from the light to where cos = G.
    #[test]
    fn importance_falls_from_the_light() {
        let worth = |g: f64, tau: f64, cos: f64| {
            Lobe::of(g, tau, DVec3::Z).importance(DVec3::new((1.0 - cos * cos).sqrt(), 0.0, cos))
        };
        let falling = [1.0, 0.999, 0.99, 0.97, 0.9, 0.0, -1.0].map(|cos| worth(0.98, 0.0, cos));
        assert!(falling.windows(2).all(|pair| pair[0] >= pair[1]) && falling[0] > 1e4, "{falling:?}");
        assert_eq!([worth(0.98, 0.0, 0.98 * 0.98 - 1e-9), worth(-0.5, 0.0, 1.0)], [1.0, 1.0]);
        assert!(worth(0.9, 20.0, 1.0) < 2.0 && !is_near(0.9, 20.0) && is_near(0.9, 1.0));
    }
}
