//! White Monte Carlo of a half-space: one set of paths through a medium that does not absorb, rescaled to every mu_a, mu_s' and f_x.
//!
//! A half-space knows no length but its own mean free path, so with a given phase function and index its reflectance is
//! T(alpha, kappa), alpha = mu_a / mu_s', kappa = f_x / mu_s' (Martelli, Zaccanti; "Monte Carlo's method of scaling"). A path scores
//! exp(-alpha l) J0(2 pi kappa rho), l its length and rho its lateral shift in units of 1 / mu_s', the azimuth averaged out.
//! `docs/theory/build_lut.md` derives the estimators.

use std::f64::consts::{PI, TAU};

use fearless_simd::{Level, Simd, dispatch};
use glam::DVec3;
use turbid_optics::elementary::{bessel_j0, exp, ln};
use turbid_optics::philox::{philox4x32, unit, unit_fine};
use turbid_optics::{PhaseFunction, fresnel};

use crate::table::Convention;

/// Light is looked for with probability min(1, (SURE / tau)^4) at optical depth tau.
const SURE: f64 = 3.0;
/// Beyond this length (in 1 / mu_s') a path plays roulette at every doubling ...
const LONG: f64 = 30.0;
/// ... and survives with this probability, 2^-3/4: paths that reach length l come back with a probability that falls like
/// l^-1/2, so neither their cost (l^-1/4) nor their variance grows.
const SURVIVES: f64 = 0.594_603_557_501_360_5;
/// e^-x is nothing beyond; [`exp`] needs a bound.
const DARK: f64 = 700.0;
/// Scores that are added at once.
const WAITING: usize = 256;

/// Half-space and what is asked of it.
#[derive(Clone, Debug, PartialEq)]
pub struct White {
    pub phase: PhaseFunction,
    pub n: f64,
    pub convention: Convention,
    /// mu_a / mu_s', increasing, >= 0.
    pub alpha: Vec<f64>,
    /// f_x / mu_s', >= 0.
    pub kappa: Vec<f64>,
}

/// Sums over paths.
#[derive(Clone, Debug)]
pub struct Tally {
    sums: Vec<f64>,
    paths: u64,
    level: Level,
    waiting: Vec<Score>,
    absorption: Vec<f64>,
    fringe: Vec<f64>,
}

/// Light that leaves: path length and lateral shift in units of 1 / mu_s'.
#[derive(Clone, Copy, Debug)]
struct Score {
    length: f64,
    rho: f64,
    value: f64,
}

impl Tally {
    /// T at each (kappa, alpha), alpha running fastest.
    pub fn mean(&self, white: &White) -> Vec<f64> {
        let factor = white.factor() / self.paths.max(1) as f64;
        self.sums.iter().map(|sum| factor * sum).collect()
    }
}

/// A path in units of the scattering mean free path.
struct Photon {
    /// z <= 0 inside.
    r: DVec3,
    w: DVec3,
    length: f64,
    weight: f64,
    /// Whether the next collision has been scored ahead, if no boundary comes first.
    ahead: bool,
}

impl White {
    pub fn tally(&self, level: Level) -> Tally {
        let (n_a, n_k) = (self.alpha.len(), self.kappa.len());
        Tally {
            sums: vec![0.0; n_a * n_k],
            paths: 0,
            level,
            waiting: Vec::with_capacity(WAITING),
            absorption: vec![0.0; n_a],
            fringe: vec![0.0; n_k],
        }
    }

    /// Adds the paths `first .. first + count`.
    pub fn trace(&self, key: [u32; 2], first: u64, count: u64, tally: &mut Tally) {
        for path in first..first + count {
            self.path(key, path, tally);
        }
        self.flush(tally);
        tally.paths += count;
    }

    /// Light that enters straight down, until it has left or is not worth following.
    fn path(&self, key: [u32; 2], path: u64, tally: &mut Tally) {
        let block = |step: u32, of: u32| philox4x32([path as u32, (path >> 32) as u32, step, of], key);
        let camera = self.convention == Convention::Camera;
        // The rest of the way is drawn against the faintest absorption; scores weigh the others against it.
        let [a, b, c, _] = block(0, 1);
        let life = if self.alpha[0] > 0.0 { -ln(unit_fine(a, b)) / self.alpha[0] } else { f64::INFINITY };
        let mut photon = Photon { r: DVec3::ZERO, w: DVec3::NEG_Z, length: 0.0, weight: 1.0, ahead: camera };
        if camera {
            // Single scattering: s from 2 exp(-2 s), and back the same way.
            let s = -0.5 * ln(unit(c));
            self.score(tally, 2.0 * s, 0.0, 0.5 * self.phase.density(-1.0), life);
        }
        let mut next_long = LONG / (1.0 - self.phase.g());
        let mut step = 0;
        loop {
            let [a, b, c, d] = block(step, 0);
            let [choice, e, f, u] = block(step, 2);
            step += 1;
            let mut s = -ln(unit_fine(a, d));
            let mut crossed = false;
            // Up to the surface, and back where it reflects.
            while photon.w.z > 0.0 && -photon.r.z <= s * photon.w.z {
                let t = -photon.r.z / photon.w.z;
                s -= t;
                photon.r += t * photon.w;
                photon.r.z = 0.0;
                photon.length += t;
                let reflects = fresnel::reflectance(self.n, photon.w.z);
                if !camera {
                    let rho = across(photon.r);
                    self.score(tally, photon.length, rho, photon.weight * (1.0 - reflects), life);
                }
                let [u, ..] = block(step, 3);
                if unit(u) >= reflects {
                    return;
                }
                photon.w.z = -photon.w.z;
                crossed = true;
            }
            photon.r += s * photon.w;
            photon.length += s;
            if photon.length * (1.0 - self.phase.g()) > life {
                return;
            }
            while photon.length > next_long {
                next_long *= 2.0;
                let [u, ..] = block((next_long.to_bits() >> 32) as u32, 4);
                if unit(u) >= SURVIVES {
                    return;
                }
                photon.weight /= SURVIVES;
            }
            let roulette = unit(d);
            let depth = -photon.r.z;
            let rarity = rarity(depth);
            let seen = camera && roulette * rarity < 1.0;
            if seen && (crossed || !photon.ahead) {
                let p = self.phase.density(photon.w.z);
                let rho = across(photon.r);
                let value = photon.weight * rarity * p * exp(-depth.min(DARK));
                self.score(tally, photon.length + depth, rho, value, life);
            }
            let own = self.phase.sample(photon.w, unit(b), unit(c));
            if seen {
                self.look_ahead(tally, &photon, own, rarity, [choice, e, f, u], life);
            }
            photon.ahead = camera;
            photon.w = own;
        }
    }

    /// The next collision, if no surface comes before it, by one point on one of two lines: the path's own, or one from the phase
    /// function around the normal.
    fn look_ahead(&self, tally: &mut Tally, photon: &Photon, own: DVec3, rarity: f64, random: [u32; 4], life: f64) {
        let e = if random[0] >> 31 == 0 { own } else { self.phase.sample(DVec3::Z, unit(random[1]), unit(random[2])) };
        let balance = 2.0 * self.phase.balance(photon.w.dot(e), e.z);
        let depth = -photon.r.z;
        let farthest = if e.z > 0.0 { depth / e.z } else { f64::INFINITY };
        // Going s along e and then straight up takes depth + (1 - e.z) s: its exponential is the density of s.
        let rate = 1.0 - e.z;
        let u = unit(random[3]);
        let steep = rate * farthest;
        let (s, mass) = if steep < 1e-6 {
            (u * farthest, farthest)
        } else {
            let left = exp(-steep.min(DARK));
            (-ln(1.0 - u * (1.0 - left)) / rate, (1.0 - left) / rate)
        };
        let s = s.min(farthest);
        let p = photon.r + s * e;
        let value = photon.weight * rarity * balance * exp(-depth.min(DARK)) * mass * self.phase.density(e.z);
        self.score(tally, photon.length + s - p.z, across(p), value, life);
    }

    /// Enters light that left after `length` at distance `rho`, in scattering mean free paths, of a path that ends at `life`.
    fn score(&self, tally: &mut Tally, length: f64, rho: f64, value: f64, life: f64) {
        let reduced = 1.0 - self.phase.g();
        // A look goes beyond the point where its path is, and may outlive it.
        if length * reduced <= life {
            tally.waiting.push(Score { length: length * reduced, rho: rho * reduced, value });
            if tally.waiting.len() == WAITING {
                self.flush(tally);
            }
        }
    }

    /// Adds the scores that wait.
    fn flush(&self, tally: &mut Tally) {
        dispatch!(tally.level, simd => simd.vectorize(#[inline(always)] || self.add(tally)));
        tally.waiting.clear();
    }

    #[inline(always)]
    fn add(&self, tally: &mut Tally) {
        let base = self.alpha[0];
        for score in &tally.waiting {
            for (a, &alpha) in tally.absorption.iter_mut().zip(&self.alpha) {
                *a = score.value * exp(-((alpha - base) * score.length).min(DARK));
            }
            for (fringe, &kappa) in tally.fringe.iter_mut().zip(&self.kappa) {
                *fringe = bessel_j0(TAU * kappa * score.rho);
            }
            for (row, &fringe) in tally.sums.chunks_exact_mut(self.alpha.len()).zip(&tally.fringe) {
                for (sum, a) in row.iter_mut().zip(&tally.absorption) {
                    *sum += fringe * a;
                }
            }
        }
    }

    /// What a mean score stands for: reflectance per score, by convention.
    fn factor(&self) -> f64 {
        let through = 1.0 - fresnel::normal_reflectance(self.n);
        match self.convention {
            // In and out along the normal; radiance spreads by n^2.
            Convention::Camera => PI * through * through / (self.n * self.n),
            Convention::HemisphericalIncident => through,
            Convention::HemisphericalEntered => 1.0,
        }
    }
}

/// Distance from the z axis.
fn across(r: DVec3) -> f64 {
    (r.x * r.x + r.y * r.y).sqrt()
}

/// One over the probability of looking.
fn rarity(tau: f64) -> f64 {
    let x = (tau * (1.0 / SURE)).max(1.0);
    x * x * x * x
}
