//! Weight windows towards the light: where a phase function has a narrow peak, paths are split as they turn towards the light near the surface, and play
//! roulette as they turn away again.
//!
//! `docs/theory/render.md`, "Weight windows". Weight windows: Booth and Hendricks, "Importance estimation in forward Monte Carlo calculations", Nucl. Technol. Fusion 5 (1984).

use std::ops::Range;

use glam::DVec3;
use turbid_optics::elementary::ln;
use turbid_optics::henyey_greenstein::{denominator, density, sample};
use turbid_optics::philox::{unit, unit_fine};

use crate::path::deep_weight;
use crate::random::{COPY, Purpose, Stream};
use crate::setting::{Nee, Place, Setting};
use crate::strata::Bending;
use crate::walker::Walker;
use crate::world::{Material, World};

/// Least g of a medium for which they are taken; they then hold in all media of the world. Below it the copies cost more than they save.
pub(crate) const PEAKED: f64 = 0.875;
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
    pub fn mis_weight(&self, g: f64, w: DVec3, e: DVec3) -> f64 {
        let cos = e.dot(self.towards);
        if cos <= self.wide {
            return 1.0;
        }
        let p = density(g, w.dot(e));
        p / (p + density(self.wide.sqrt(), cos))
    }

    /// A direction towards the light: half as many scatterings wide. `None` where the lobe is left, from where nothing is sent.
    pub fn sample(&self, u: f64, turns: f64) -> Option<DVec3> {
        let e = sample(self.wide.sqrt(), self.towards, u, turns);
        (e.dot(self.towards) > self.wide).then_some(e)
    }
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
    let peaked = filling.filter(|m| known && m.mu_s > 0.0 && m.g >= PEAKED);
    peaked.max_by(|a, b| a.g.total_cmp(&b.g))
}

/// Its refractive index, where paths are connected one scattering ahead to a light with a place or a direction.
pub fn peaked_index(setting: &Setting<'_>, bending: &Bending) -> Option<f64> {
    let shines = setting.light.shines() || !setting.steady.lamps.is_empty();
    most_peaked(setting.world, bending).filter(|_| setting.nee == Nee::Line && shines).map(|medium| medium.n)
}

/// The direction against the light in a medium of index `n`, as horizontal planes between it and air turn it.
fn refracted(towards: DVec3, n: f64) -> DVec3 {
    let (x, y) = (towards.x / n, towards.y / n);
    DVec3::new(x, y, (1.0 - x * x - y * y).max(0.0).sqrt().copysign(towards.z))
}

impl Walker<'_> {
    /// Walks a path to its end, and all copies into which it is split.
    pub(crate) fn finish(&mut self, mut at: Place) {
        while self.step(&mut at) {}
        self.finish_copies();
    }

    /// Walks those that wait, the last first.
    pub(crate) fn finish_copies(&mut self) {
        while let Some(mut copy) = self.copies.pop() {
            while self.step(&mut copy) {}
        }
    }

    /// Splits a path that goes on from a collision, to which it came along `came`, or ends it by roulette: false. Copies wait in [`Walker::copies`].
    pub(crate) fn keep_in_window(&mut self, at: &mut Place, came: DVec3, stream: &Stream) -> bool {
        let world = self.setting.world;
        let material = world.materials[at.material];
        let window = self.windows[at.material];
        let near = |clear: f64| material.g > 0.0 && -exponent(material.g, material.mu_s * clear) < WIDE;
        if window > 0.0 {
            at.clear = world.clearance(at.r);
        }
        if !near(at.clear) && at.weight >= 0.5 * deep_weight(window, at.clear) {
            return true;
        }
        at.clear = at.clear.max(world.clearance(at.r));
        let (Some(source), Some(n)) = (self.sources().next(), self.peaked_index) else { return true };
        let lobe = Lobe::of(material.g, material.mu_s * at.clear, refracted(source.towards(at.r).0, n));
        let deep = deep_weight(window, at.clear);
        let [random, b, c, d] = stream.block(Purpose::WeightWindow(at.flight()));
        if material.g >= NARROW && near(at.clear) {
            if let Some(e) = lobe.sample(unit(b), unit(c)) {
                let weight = at.weight * lobe.mis_weight(material.g, came, e);
                let parts = weight * lobe.importance(e) / deep;
                let sent = Place { w: e, weight: weight / parts.min(f64::from(MOST_COPIES)), ..*at };
                let count = ((parts + unit(d)) as u32).min(MOST_COPIES);
                self.push_copies(&sent, MOST_COPIES..MOST_COPIES + count, stream);
            }
            at.weight *= lobe.mis_weight(material.g, came, at.w);
        }
        let least = deep / lobe.importance(at.w);
        if at.weight < 0.5 * least {
            let survives = unit(random) * least < at.weight;
            at.weight = least;
            return survives;
        }
        let parts = (at.weight / least).min(f64::from(MOST_COPIES)) as u32;
        if parts > 1 {
            at.weight /= f64::from(parts);
            self.push_copies(at, 1..parts, stream);
        }
        true
    }

    /// Copies of `numbers`, whose random numbers are their own from here on.
    fn push_copies(&mut self, of: &Place, numbers: Range<u32>, stream: &Stream) {
        for number in numbers {
            let [sample, a, b, _] = stream.block(Purpose::Copy(of.flight(), number));
            // Absorption has no memory: theirs is drawn anew.
            let absorption_depth = -ln(unit_fine(a, b));
            self.copies.push(Place { sample: sample | COPY, absorption_depth, ..*of });
        }
    }
}
