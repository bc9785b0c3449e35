//! Light-directed branches in lanes: `Walker::send_light_branch`, sixteen abreast.

use fearless_simd::prelude::*;

use super::frame::Frame;
use super::lane::{F, LANES, M, U, V, choose, hg_sample, philox, splat, unit_short};
use super::phase_function::Phase;
use super::rows::{PathLanes, Paths};
use crate::light_branch::{KEPT, NEAR};
use crate::random::{LIGHT_BRANCH, SENT};
use crate::walker::Walker;

/// p(w . e) / (p(w . e) + lobe(e . L)); see `crate::light_branch`.
#[inline(always)]
fn mis_weight<S: Simd>(phase: &Phase<S>, w: V<S>, e: V<S>, towards: V<S>) -> F<S> {
    let g = phase.g;
    let (lobe, narrower) = ((g + 1.0) * 0.5, (g + 3.0) * 0.25 / (g + 1.0));
    phase.mis_weight(w.dot(e), (lobe, e.dot(towards)), narrower)
}

/// Of the paths in `asked`, at `r`, those from which light-directed branches may go, and what is left to each of the light that its next flight along `own` sees.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "columns")]
pub fn sends<S: Simd>(
    simd: S,
    frame: &Frame<'_>,
    asked: M<S>,
    material: U<S>,
    (r, came, own): (V<S>, V<S>, V<S>),
    g: F<S>,
    least: F<S>,
) -> (M<S>, F<S>) {
    let (one, mut hollow) = (splat(simd, 1.0), M::splat(simd, false));
    for (m, _) in frame.light_branches.iter().enumerate().filter(|(_, sends)| **sends) {
        hollow |= material.simd_eq(m as u32);
    }
    let sends = asked & hollow & least.simd_lt(NEAR as f32);
    if sends.all_false() {
        return (sends, one);
    }
    let (towards, _) = frame.sources[0].towards(r);
    let phase = frame.phase_of_media(simd, g, material);
    (sends, choose(sends, mis_weight(&phase, came, own, towards), one))
}

/// What is to become light-directed branches, and those that wait: rows of paths that stand there; all of a path in its own order.
#[derive(Clone, Debug)]
pub struct LightBranches {
    /// From which they may go, with the direction in which the path came.
    pub collisions: Paths,
    pub waiting: Paths,
}

impl LightBranches {
    pub fn new(counted: bool) -> Self {
        Self { collisions: Paths::new(counted), waiting: Paths::new(counted) }
    }

    pub fn is_empty(&self) -> bool {
        self.collisions.len() + self.waiting.len() == 0
    }

    /// Gathers those of lanes and of the scalar walker. Whether they are to fly: sixteen, or the last ones. If not, there is room for sixteen
    /// collisions more.
    #[inline(always)]
    pub fn muster<S: Simd>(&mut self, simd: S, walker: &mut Walker<'_>, frame: &Frame<'_>, last: bool) -> bool {
        // The walker's are younger than those of lanes, and older than what lanes come to next.
        let wanted = if last || !walker.sent.is_empty() { 1 } else { LANES };
        while self.collisions.len() >= wanted && self.waiting.len() < LANES {
            self.send(simd, frame);
        }
        if !walker.sent.is_empty() && self.collisions.len() == 0 {
            self.enlist(walker, frame);
        }
        self.waiting.len() >= if last { 1 } else { LANES }
    }

    /// Those of the first 16 collisions, or of as many as there are.
    #[inline(always)]
    fn send<S: Simd>(&mut self, simd: S, frame: &Frame<'_>) {
        let at = M::from_bitmask(simd, (1 << self.collisions.len().min(LANES)) - 1);
        let mut collision = PathLanes::zeros(simd);
        self.collisions.load(simd, &mut collision);
        let PathLanes { r, w: came, weight, g, number, sample, pixel, material, .. } = collision;
        let (towards, _) = frame.sources[0].towards(r);
        let number = number | LIGHT_BRANCH;
        let [b, c, d, _] = philox(simd, number, U::splat(simd, frame.channel | SENT), sample, pixel, &frame.keys);
        let along = hg_sample((g + 1.0) * 0.5, towards, unit_short(b), unit_short(c));
        let part = mis_weight(&frame.phase_of_media(simd, g, material), came, along, towards);
        let kept = (part * KEPT as f32).min(splat(simd, 1.0));
        let light_branch = PathLanes { w: along, weight: weight * (part / kept), number, ..collision };
        self.waiting.pack(at & unit_short(d).simd_lt(kept), &light_branch);
        self.collisions.drop_first(simd);
    }

    /// Takes over those that the walker has sent, while less than sixteen wait.
    #[inline(never)]
    fn enlist(&mut self, walker: &mut Walker<'_>, frame: &Frame<'_>) {
        while self.waiting.len() < LANES
            && let Some(mut light_branch) = walker.sent.pop_front()
        {
            if frame.body_at(&light_branch).is_some() {
                self.waiting.push(&frame.row(&light_branch));
            } else {
                // Rounding: it stands on the interface.
                walker.step(&mut light_branch);
            }
        }
    }
}
