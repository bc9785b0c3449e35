//! Weight windows towards the light in lanes: `Walker::keep_in_window`, sixteen abreast.

use fearless_simd::prelude::*;

use super::frame::Frame;
use super::in_flight::Packet;
use super::lane::{F, LANES, M, U, V, choose, exp, hg_denominator, hg_sample, ln, philox, splat, unit};
use super::phase_function::Phase;
use super::rows::{PathLanes, PathRow};
use super::source::Source;
use crate::random::WINDOW;
use crate::walker::Walker;
use crate::weight_window::{MOST_COPIES, NARROW, SCATTERINGS, WIDE};

/// Of the exponent of what is as good as nothing.
const LEAST_EXPONENT: f32 = -80.0;

/// ln G; see `crate::weight_window`.
#[inline(always)]
fn exponent<S: Simd>(simd: S, g: F<S>, tau: F<S>) -> F<S> {
    let g = g.max(splat(simd, f32::MIN_POSITIVE));
    ((tau + 1.0) * SCATTERINGS as f32 * ln(g)).max(splat(simd, LEAST_EXPONENT))
}

/// `weight_window::Lobe`, sixteen abreast.
struct Lobe<S: Simd> {
    towards: V<S>,
    wide: F<S>,
    /// Whether it is narrow enough to split for.
    near: M<S>,
}

impl<S: Simd> Lobe<S> {
    #[inline(always)]
    fn importance(&self, simd: S, w: V<S>) -> F<S> {
        // Rounding must not make a cosine larger than 1: the lobe is as narrow as a few of its last digits.
        let (wide, cos) = (self.wide, w.dot(self.towards).min(splat(simd, 1.0)));
        let peak = (1.0 - wide) * (wide + 1.0) / hg_denominator(wide, cos);
        (peak * peak * peak).max(splat(simd, 1.0))
    }

    #[inline(always)]
    fn mis_weight(&self, simd: S, phase: &Phase<S>, came: V<S>, e: V<S>) -> F<S> {
        let one = splat(simd, 1.0);
        let (narrow, cos) = (self.wide.sqrt(), e.dot(self.towards).min(one));
        let constants = (1.0 - narrow) * (narrow + 1.0) / ((1.0 - phase.g) * (phase.g + 1.0));
        let shared = phase.mis_weight(came.dot(e).min(one), (narrow, cos), constants);
        choose(cos.simd_gt(self.wide), shared, one)
    }
}

impl<S: Simd> Packet<'_, S> {
    /// Splits the paths `at` a collision, to which they came along `came` and whose nearest surface is `clear` mm away, or ends them by roulette.
    #[inline(always)]
    pub(super) fn keep_in_windows(&mut self, at: M<S>, came: V<S>, clear: F<S>, about: &(Source, f32)) {
        let simd = self.simd;
        let PathLanes { r, weight, mu_s, g, window, .. } = self.path;
        let deep = clear * window + 1.0;
        let deep = deep * deep * (deep * deep);
        let exponent = exponent(simd, g, mu_s * clear);
        let near = exponent.simd_gt(-WIDE as f32) & g.simd_gt(0.0);
        let asked = at & (near | weight.simd_lt(deep * 0.5));
        if asked.any_true() {
            let towards = self.frame.against_light(simd, r, about);
            let lobe = Lobe { towards, wide: choose(g.simd_gt(0.0), exp(exponent), splat(simd, 0.0)), near };
            self.keep(asked, came, &lobe, deep);
        }
    }

    #[inline(always)]
    fn keep(&mut self, asked: M<S>, came: V<S>, lobe: &Lobe<S>, deep: F<S>) {
        let simd = self.simd;
        let PathLanes { w: own, weight, g, number, sample, pixel, material, .. } = self.path;
        let most = splat(simd, MOST_COPIES as f32);
        let narrow = asked & lobe.near & g.simd_ge(NARROW as f32);
        let mut random = U::splat(simd, 0);
        let mut left = weight;
        let least_own = deep / lobe.importance(simd, own);
        if (narrow | (asked & weight.simd_lt(least_own * 0.5))).any_true() {
            let [a, b, c, d] =
                philox(simd, number - 2, U::splat(simd, WINDOW | self.frame.channel), sample, pixel, &self.frame.keys);
            random = a;
            if narrow.any_true() {
                let phase = self.frame.phase_of_media(simd, g, material);
                let e = hg_sample(lobe.wide.sqrt(), lobe.towards, unit(b), unit(c));
                let inside = narrow & e.dot(lobe.towards).simd_gt(lobe.wide);
                let weight_there = weight * lobe.mis_weight(simd, &phase, came, e);
                let parts = weight_there * lobe.importance(simd, e) / deep;
                let count = (parts + unit(d)).min(most);
                let sent = inside & count.simd_ge(1.0);
                if sent.any_true() {
                    self.send(sent.to_bitmask(), e, weight_there / parts.min(most), &count.to_array());
                }
                left = choose(narrow, weight * lobe.mis_weight(simd, &phase, came, own), weight);
            }
        }
        let light = asked & left.simd_lt(least_own * 0.5);
        let survives = (unit(random) * least_own).simd_lt(left);
        self.path.weight = choose(light, least_own, left);
        self.alive &= !(light & !survives).to_bitmask();
        let heavy = asked & left.simd_ge(least_own * 2.0);
        if heavy.any_true() {
            let parts = (left / least_own).min(most);
            self.split(heavy.to_bitmask(), &parts.to_array());
        }
    }

    /// Copies along `e`, of the weight `weight`, so many of each lane.
    #[inline(never)]
    fn send(&mut self, lanes: u64, e: V<S>, weight: F<S>, counts: &[f32; LANES]) {
        self.aside.store(&self.path);
        let (e, weight) = ([e.x, e.y, e.z].map(|x| x.to_array()), weight.to_array());
        for lane in (0..LANES).filter(|lane| lanes >> lane & 1 == 1) {
            let copy = PathRow { w: e.map(|x| x[lane]), weight: weight[lane], ..self.aside.get(lane) };
            let numbers = MOST_COPIES..MOST_COPIES + counts[lane] as u32;
            self.copies.add(lane, copy, numbers, self.frame.stream(&copy));
        }
    }

    #[inline(never)]
    fn split(&mut self, lanes: u64, parts: &[f32; LANES]) {
        self.aside.store(&self.path);
        for lane in (0..LANES).filter(|lane| lanes >> lane & 1 == 1) {
            let (mut part, parts) = (self.aside.get(lane), parts[lane] as u32);
            part.weight /= parts as f32;
            self.aside.set(lane, &part);
            self.copies.add(lane, part, 1..parts, self.frame.stream(&part));
        }
        self.aside.load(self.simd, &mut self.path);
    }

    /// Puts copies into the lanes of their paths that have ended.
    #[inline(always)]
    pub(super) fn revive(&mut self) {
        let waiting = self.copies.lanes & !self.alive;
        if waiting != 0 {
            self.resume_copies(waiting);
        }
    }

    #[inline(never)]
    fn resume_copies(&mut self, waiting: u64) {
        self.aside.store(&self.path);
        for lane in (0..LANES).filter(|lane| waiting >> lane & 1 == 1) {
            self.aside.set(lane, &self.copies.pop(lane));
        }
        self.alive |= waiting;
        self.aside.load(self.simd, &mut self.path);
    }

    /// Takes over the copies of a lane's path that the scalar walker has made.
    pub(super) fn take_copies(&mut self, walker: &mut Walker<'_>, lane: usize) {
        take_copies(walker, self.frame, |row| self.copies.push(lane, row));
    }
}

/// Hands over the copies that the scalar walker has made; it walks those that lanes cannot take, where rounding has put them onto an interface.
fn take_copies(walker: &mut Walker<'_>, frame: &Frame<'_>, mut push: impl FnMut(PathRow)) {
    for copy in std::mem::take(&mut walker.copies) {
        if frame.body_at(&copy).is_some() {
            push(frame.row(&copy));
        } else {
            walker.finish(copy);
        }
    }
}
