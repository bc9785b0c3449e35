//! Paths split, and ended by roulette, to keep their weights in windows (`weight_window.rs`); their copies.

use std::ops::Range;

use glam::DVec3;
use turbid_optics::elementary::ln;
use turbid_optics::philox::{unit, unit_fine};

use crate::path::deep_weight;
use crate::random::{COPY, Purpose, Stream};
use crate::setting::Place;
use crate::walker::Walker;
use crate::weight_window::{Lobe, MOST_COPIES, NARROW, is_near};

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
        let g = material.phase.g_forward();
        let near = |clear: f64| is_near(g, material.mu_s * clear);
        if window > 0.0 {
            at.clear = world.clearance(at.r);
        }
        if !near(at.clear) && at.weight >= 0.5 * deep_weight(window, at.clear) {
            return true;
        }
        at.clear = at.clear.max(world.clearance(at.r));
        let (Some(source), Some(n)) = (self.sources().next(), self.peaked_index) else { return true };
        let lobe = Lobe::of(g, material.mu_s * at.clear, refracted(source.towards(at.r).0, n));
        let deep = deep_weight(window, at.clear);
        let [random, b, c, d] = stream.block(Purpose::WeightWindow(at.flight()));
        if g >= NARROW && near(at.clear) {
            if let Some(e) = lobe.sample(unit(b), unit(c)) {
                let weight = at.weight * lobe.mis_weight(&material.phase, came, e);
                let parts = weight * lobe.importance(e) / deep;
                let sent = Place { w: e, weight: weight / parts.min(f64::from(MOST_COPIES)), ..*at };
                let count = ((parts + unit(d)) as u32).min(MOST_COPIES);
                self.push_copies(&sent, MOST_COPIES..MOST_COPIES + count, stream);
            }
            at.weight *= lobe.mis_weight(&material.phase, came, at.w);
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
