//! A slab that absorbs but does not scatter, under the light of a plan: the limit that every reading is held against.

use crate::forward::Plan;
use crate::slab::Surface;

/// The surfaces as each direction of the light meets them.
pub struct Clear {
    beams: Vec<Beam>,
}

#[derive(Clone, Copy)]
struct Beam {
    /// Of the incident flux.
    share: f64,
    cos: f64,
    top: Surface,
    bottom: Surface,
}

impl Beam {
    /// (transmittance, reflectance) for the fraction `pass` that one passage leaves.
    fn at(&self, pass: f64) -> (f64, f64) {
        let rounds = 1.0 / (1.0 - self.top.inside * self.bottom.inside * pass * pass);
        let back = self.top.through * self.top.through * self.bottom.inside * pass * pass * rounds;
        (self.top.through * self.bottom.through * pass * rounds, self.top.outside + back)
    }

    /// Their derivatives by `pass`.
    fn slopes(&self, pass: f64) -> (f64, f64) {
        let echo = self.top.inside * self.bottom.inside * pass * pass;
        let rounds = 1.0 / ((1.0 - echo) * (1.0 - echo));
        let r = 2.0 * self.top.through * self.top.through * self.bottom.inside * pass * rounds;
        (self.top.through * self.bottom.through * (1.0 + echo) * rounds, r)
    }

    /// The passage that leaves this transmittance.
    fn pass(&self, transmittance: f64) -> f64 {
        let through = self.top.through * self.bottom.through;
        let echo = self.top.inside * self.bottom.inside;
        2.0 * transmittance / (through + (through * through + 4.0 * echo * transmittance * transmittance).sqrt())
    }
}

impl Clear {
    pub fn new<const N: usize>(plan: &Plan<N>) -> Self {
        Self { beams: plan.beams().map(|(share, cos, top, bottom)| Beam { share, cos, top, bottom }).collect() }
    }

    /// (transmittance, reflectance) at this optical thickness, and their derivatives by it.
    fn at(&self, tau: f64) -> ((f64, f64), (f64, f64)) {
        let (mut value, mut slope) = ((0.0, 0.0), (0.0, 0.0));
        for beam in &self.beams {
            let pass = libm::exp(-tau / beam.cos);
            let ((t, r), (t_slope, r_slope)) = (beam.at(pass), beam.slopes(pass));
            value = (value.0 + beam.share * t, value.1 + beam.share * r);
            let by_tau = -pass / beam.cos * beam.share;
            slope = (slope.0 + by_tau * t_slope, slope.1 + by_tau * r_slope);
        }
        (value, slope)
    }

    /// (transmittance, reflectance) of the empty slab.
    pub fn empty(&self) -> (f64, f64) {
        self.beams.iter().fold((0.0, 0.0), |(t, r), beam| {
            let one = beam.at(1.0);
            (t + beam.share * one.0, r + beam.share * one.1)
        })
    }

    /// What the top alone reflects.
    pub fn outside(&self) -> f64 {
        self.beams.iter().fold(0.0, |sum, beam| sum + beam.share * beam.top.outside)
    }

    /// The optical thickness that leaves this transmittance; below 0 for more than the empty slab lets through.
    pub fn tau(&self, transmittance: f64) -> f64 {
        if let [beam] = self.beams[..] {
            return -libm::log(beam.pass(transmittance)) * beam.cos;
        }
        // ln T is convex in tau, so Newton's steps from the thin side never pass the root.
        let shallowest = self.beams.first().map_or(1.0, |beam| beam.cos);
        let mut tau = (libm::log(self.empty().0 / transmittance) * shallowest).max(0.0);
        for _ in 0..100 {
            let ((t, _), (slope, _)) = self.at(tau);
            let step = libm::log(t / transmittance) * t / slope;
            tau -= step;
            if step.abs() <= 1e-15 * tau.abs() || step.is_nan() {
                break;
            }
        }
        tau
    }

    /// The reflectance at this transmittance, and its derivative by it.
    pub fn reflectance(&self, transmittance: f64) -> (f64, f64) {
        if let [beam] = self.beams[..] {
            let pass = beam.pass(transmittance);
            let (by_t, by_r) = beam.slopes(pass);
            return (beam.at(pass).1, by_r / by_t);
        }
        let ((_, r), (by_t, by_r)) = self.at(self.tau(transmittance));
        // No light through: none comes back from the bottom, either.
        (r, if by_t == 0.0 { 0.0 } else { by_r / by_t })
    }
}
