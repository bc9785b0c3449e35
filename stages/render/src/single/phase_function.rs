//! Phase functions in lanes, as `turbid_optics::PhaseFunction`.
//!
//! A path carries the g of the forward term. The second term is looked up by the medium, and only in frames where a medium has one: others pay nothing.

use fearless_simd::prelude::*;
use turbid_optics::PhaseFunction;

use super::lane::{F, M, V, choose, hg_denominator, hg_sample, splat};
use crate::world::Material;

/// The second term of a medium: its g and its share, and the share of the first; of media of one term 0, 0, 1.
pub type Second = [f32; 3];

/// For each material its second term; empty where none has any.
pub fn second_terms(materials: &[Material]) -> Vec<Second> {
    let of = |material: &Material| match material.phase {
        PhaseFunction::HenyeyGreenstein { .. } => [0.0, 0.0, 1.0],
        PhaseFunction::TwoTermHenyeyGreenstein { g_backward, forward, .. } => {
            [g_backward as f32, (1.0 - forward) as f32, forward as f32]
        }
    };
    let any = materials.iter().any(|m| !m.phase.has_one_term());
    if any { materials.iter().map(of).collect() } else { Vec::new() }
}

/// Of sixteen paths.
#[derive(Clone, Copy)]
pub struct Phase<S: Simd> {
    /// Of the forward term.
    pub g: F<S>,
    second: Option<[F<S>; 3]>,
}

/// Henyey and Greenstein's function, per steradian.
#[inline(always)]
fn hg_density<S: Simd>(g: F<S>, cos: F<S>) -> F<S> {
    let q = hg_denominator(g, cos);
    (1.0 - g) * (1.0 + g) * (0.25 * std::f32::consts::FRAC_1_PI) / (q * q.sqrt())
}

impl<S: Simd> Phase<S> {
    /// With the second term that `is` says, by its number among `seconds`; `None` where no medium has one. `g` of the forward term.
    #[inline(always)]
    pub fn of(simd: S, g: F<S>, seconds: Option<impl Iterator<Item = Second>>, is: impl Fn(u32) -> M<S>) -> Self {
        let Some(seconds) = seconds else { return Self { g, second: None } };
        let mut second = [0.0, 0.0, 1.0].map(|x| splat(simd, x));
        for (i, of) in (0..).zip(seconds) {
            let here = is(i);
            for (x, y) in second.iter_mut().zip(of) {
                *x = choose(here, splat(simd, y), *x);
            }
        }
        Self { g, second: Some(second) }
    }

    /// That of one path.
    pub fn of_lane(&self, lane: usize) -> PhaseFunction {
        let of = |x: F<S>| f64::from(x.as_slice()[lane]);
        match self.second {
            Some([g_backward, share, forward]) if of(share) > 0.0 => PhaseFunction::TwoTermHenyeyGreenstein {
                g_forward: of(self.g),
                g_backward: of(g_backward),
                forward: of(forward),
            },
            _ => PhaseFunction::henyey_greenstein(of(self.g)),
        }
    }

    /// See `turbid_optics::PhaseFunction::sample`.
    #[inline(always)]
    pub fn sample(&self, w: V<S>, u: F<S>, turns: F<S>) -> V<S> {
        let Some([g, share, forward]) = self.second else { return hg_sample(self.g, w, u, turns) };
        let backward = u.simd_lt(share);
        let left = choose(backward, u / share, 1.0 - (1.0 - u) / forward);
        hg_sample(choose(backward, g, self.g), w, left, turns)
    }

    #[inline(always)]
    pub fn density(&self, cos: F<S>) -> F<S> {
        let first = hg_density(self.g, cos);
        let Some([g, share, forward]) = self.second else { return first };
        forward * first + share * hg_density(g, cos)
    }

    /// 2 p(a) / (p(a) + p(b)) of two cosines; see `turbid_optics::PhaseFunction::balance`.
    #[inline(always)]
    pub fn twice_balance(&self, a: F<S>, b: F<S>) -> F<S> {
        if self.second.is_none() {
            let ratio = hg_denominator(self.g, a) / hg_denominator(self.g, b);
            return 2.0 / (1.0 + ratio * ratio.sqrt());
        }
        2.0 / (1.0 + self.density(b) / self.density(a))
    }

    /// p(a) / (p(a) + l(b)), l Henyey and Greenstein's function of g `lobe`, and `constants` (1 - lobe^2) / (1 - g^2).
    #[inline(always)]
    pub fn mis_weight(&self, a: F<S>, (lobe, b): (F<S>, F<S>), constants: F<S>) -> F<S> {
        if self.second.is_none() {
            let ratio = hg_denominator(self.g, a) / hg_denominator(lobe, b);
            return 1.0 / (1.0 + constants * ratio * ratio.sqrt());
        }
        1.0 / (1.0 + hg_density(lobe, b) / self.density(a))
    }
}
