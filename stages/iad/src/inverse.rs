//! From measured reflectance and transmittance back to mu_a and mu_s'.
//!
//! Newton's method in (ln mu_a, ln mu_s') on two residuals that are nearly linear in them whatever the slab: the logit
//! of the absorbed fraction, and the logarithm of the reflectance beyond that of an unscattering slab with the same
//! transmittance, over the transmittance. The start comes from a table of the four-point model, followed by that
//! model's own solution.

use rayon::prelude::*;

use crate::clear::Clear;
use crate::forward::Plan;
use crate::modes::Depths;
use crate::{Error, Incidence, Slab};

/// Readings as fractions of the incident light (by default a beam along the normal); specular reflection included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    pub m_r: f64,
    pub m_t: f64,
    /// Standard error of either, >= 0: readings beyond a limit by no more than it count as lying on the limit.
    pub sigma: f64,
}

/// Limits on which a solution lies, and whether it is the only one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flags {
    /// All light comes back: mu_a = 0. The readings were scaled to M_R + M_T = 1, within their standard error.
    pub conservative: bool,
    /// The surfaces explain M_R: mu_s' = 0.
    pub no_scatter: bool,
    /// Another medium gives the same readings: behind spheres with walls that are nearly white.
    pub ambiguous: bool,
}

/// The medium that explains a reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    pub mu_a_per_mm: f64,
    pub mu_s_prime_per_mm: f64,
    /// Larger of the relative errors of M_R and M_T in the fit, below 1e-8; on a limit, beyond sigma.
    pub residual: f64,
    /// Newton steps at the full quadrature.
    pub iterations: usize,
    pub flags: Flags,
}

/// The inverse of [`Plan`]: prepared once per slab, then used for any number of readings, from any thread.
pub struct Inverse<const N: usize> {
    plan: Plan<N>,
    pub(crate) coarse: Plan<4>,
    /// (unknowns, residuals) of the coarse model.
    pub(crate) table: Vec<([f64; 2], [f64; 2])>,
    pub(crate) clear: Clear,
    pub(crate) coarse_clear: Clear,
}

/// Absorptions and scatterings in the table of starts.
pub(crate) const TABLE: usize = 16;

/// (ln mu_a d, ln mu_s' d) of one of them.
pub(crate) fn table_entry(absorption: usize, scattering: usize) -> [f64; 2] {
    [-18.0 + 1.4 * absorption as f64, -12.0 + 1.4 * scattering as f64]
}

/// A fit is one only if it meets both readings this well (relative).
pub(crate) const RESIDUAL: f64 = 1e-8;
/// Transmittance below this counts as none: its logarithms and ratios leave the range of numbers.
pub(crate) const DARK: f64 = 1e-290;
pub(crate) const ROUNDING: f64 = 8.0 * f64::EPSILON;

impl<const N: usize> Inverse<N> {
    /// As [`Plan::new`]; also fails on an infinite thickness and on slides that absorb.
    pub fn new(slab: &Slab) -> Result<Self, Error> {
        Self::lit(slab, Incidence::Normal)
    }

    /// For readings under this light.
    pub fn lit(slab: &Slab, light: Incidence) -> Result<Self, Error> {
        for tau in [slab.top.tau, slab.bottom.tau] {
            if tau > 0.0 {
                return Err(Error::AbsorbingSlide { tau });
            }
        }
        Self::prepare(slab, light)
    }

    pub(crate) fn prepare(slab: &Slab, light: Incidence) -> Result<Self, Error> {
        let plan = Plan::lit(slab, light)?;
        if !slab.thickness_mm.is_finite() {
            return Err(Error::InvalidThickness { value_mm: slab.thickness_mm });
        }
        let clear = Clear::new(&plan);
        let coarse = Plan::lit(slab, light)?;
        // The coarse model has its own directions, and with them its own light where that is not one beam.
        let coarse_clear = Clear::new(&coarse);
        let state = |x| model(&coarse, x).and_then(|read| residuals(&coarse_clear, read)).map(|f| (x, f));
        let table = (0..TABLE * TABLE).filter_map(|k| state(table_entry(k / TABLE, k % TABLE))).collect();
        Ok(Self { plan, coarse, table, clear, coarse_clear })
    }

    pub fn plan(&self) -> &Plan<N> {
        &self.plan
    }

    /// [`Self::invert`] of many, on all threads; the same bits as one by one.
    pub fn invert_batch(&self, readings: &[Reading]) -> Vec<Result<Fit, Error>> {
        readings.par_iter().map(|r| self.invert(r)).collect()
    }

    /// mu_a and mu_s' from M_R and M_T.
    pub fn invert(&self, reading: &Reading) -> Result<Fit, Error> {
        let Reading { m_r, m_t, sigma } = *reading;
        for (name, value) in [("M_R", m_r), ("M_T", m_t), ("sigma", sigma)] {
            if !value.is_finite() {
                return Err(Error::NotFinite { name });
            }
        }
        if sigma < 0.0 {
            return Err(Error::Range { name: "sigma", value: sigma, must: "be >= 0" });
        }
        if m_t < 0.0 {
            return Err(Error::Range { name: "M_T", value: m_t, must: "be >= 0" });
        }
        if m_r < 0.0 {
            return Err(Error::BelowSpecular { min: self.clear.outside() });
        }
        let within = sigma.max(ROUNDING);
        let excess = (m_r - 1.0) + m_t;
        if excess > within {
            return Err(Error::TooMuchLight { excess });
        }
        let conservative = excess >= -within;
        if m_t < DARK {
            return Err(self.opaque(m_r, conservative));
        }

        let (t_empty, r_empty) = self.clear.empty();
        if m_t > t_empty + within {
            return Err(Error::AboveMax { max: t_empty });
        }
        // Within the error of an empty slab.
        let is_empty = m_t >= t_empty;
        let r_clear = if is_empty { r_empty } else { self.clear.reflectance(m_t).0 };
        if m_r < r_clear - within {
            return Err(Error::BelowSpecular { min: r_clear });
        }
        let flags = Flags { conservative, no_scatter: m_r <= r_clear + within, ambiguous: false };
        if flags.no_scatter {
            let tau = if conservative || is_empty { 0.0 } else { self.clear.tau(m_t) };
            return Ok(self.fit(reading, [tau, 0.0], 0, flags));
        }
        if conservative {
            let total = m_r + m_t;
            return self.conservative(&Reading { m_r: (m_r / total).max(r_empty), m_t: m_t / total, sigma }, flags);
        }
        self.search(reading, flags)
    }

    fn search(&self, reading: &Reading, flags: Flags) -> Result<Fit, Error> {
        let Reading { m_r, m_t, .. } = *reading;
        let absorbed = (1.0 - m_t) - m_r;
        let Some(wanted) = residuals(&self.clear, [m_r, m_t, absorbed]) else {
            return Err(Error::NotConverged { best: [0.0; 2], residual: f64::INFINITY });
        };
        let distance = |f: &[f64; 2]| {
            let [a, b] = [f[0] - wanted[0], f[1] - wanted[1]];
            a * a + b * b
        };
        let nearest = self.table.iter().min_by(|a, b| distance(&a.1).total_cmp(&distance(&b.1)));
        let start = nearest.map_or([-3.0, 0.0], |entry| entry.0);
        let (polished, _) = newton_on(|x| step(&self.coarse, &self.coarse_clear, wanted, x), start, 1e-4);
        let mut best = ([0.0; 2], f64::INFINITY);
        // Where scattering is faint the coarse model may have no such medium; the table still has a neighbour.
        for start in [polished, start] {
            let (found, iterations) = newton_on(|x| step(&self.plan, &self.clear, wanted, x), start, 1e-13);
            let fit = self.fit(reading, found.map(libm::exp), iterations, flags);
            if fit.residual <= RESIDUAL {
                return Ok(fit);
            }
            if fit.residual <= best.1 {
                best = ([fit.mu_a_per_mm, fit.mu_s_prime_per_mm], fit.residual);
            }
        }
        Err(Error::NotConverged { best: best.0, residual: best.1 })
    }

    /// Without absorption M_R / M_T alone decides; it grows with mu_s', so halving finds it.
    fn conservative(&self, reading: &Reading, flags: Flags) -> Result<Fit, Error> {
        let wanted = reading.m_r / reading.m_t;
        let found = bisect(-40.0, 40.0, |x| {
            self.plan.respond_to_beam(self.plan.depths_of(0.0, libm::exp(x))).is_some_and(|[r, t, _]| r / t < wanted)
        });
        let fit = self.fit(reading, [0.0, libm::exp(found)], 0, flags);
        if fit.residual <= RESIDUAL {
            return Ok(fit);
        }
        Err(Error::NotConverged { best: [0.0, fit.mu_s_prime_per_mm], residual: fit.residual })
    }

    /// What a slab without transmittance tells: the ratio of a half-space.
    fn opaque(&self, m_r: f64, conservative: bool) -> Error {
        let min = self.clear.outside();
        if m_r < min {
            return Error::BelowSpecular { min };
        }
        if conservative {
            return Error::Underdetermined { ratio: 0.0 };
        }
        let found = bisect(-80.0, 40.0, |x| {
            self.plan.respond_to_beam(self.plan.half_space(libm::exp(x))).is_some_and(|[r, ..]| r > m_r)
        });
        Error::Underdetermined { ratio: libm::exp(found) }
    }

    fn fit(&self, reading: &Reading, depths: [f64; 2], iterations: usize, flags: Flags) -> Fit {
        let read = self.plan.respond_to_beam(self.plan.depths_of(depths[0], depths[1]));
        // On a limit the reading was moved within its error, which is no residual.
        let on_limit = flags.conservative || flags.no_scatter;
        let allowed = if on_limit { reading.sigma.max(ROUNDING) } else { 0.0 };
        let relative = |value: f64, read: f64| {
            let miss = (value - read).abs() - allowed;
            if miss <= 0.0 { 0.0 } else { miss / read.abs() }
        };
        let d = self.plan.slab().thickness_mm;
        Fit {
            mu_a_per_mm: depths[0] / d,
            mu_s_prime_per_mm: depths[1] / d,
            residual: read.map_or(f64::INFINITY, |[r, t, _]| relative(r, reading.m_r).max(relative(t, reading.m_t))),
            iterations,
            flags,
        }
    }
}

impl<const N: usize> Plan<N> {
    /// From mu_a d and mu_s' d.
    pub(crate) fn depths_of(&self, absorption: f64, scattering: f64) -> Depths {
        let d = self.slab().thickness_mm;
        self.depths(absorption / d, scattering / d)
    }
}

/// [R, T, absorbed] at (ln mu_a d, ln mu_s' d).
fn model<const N: usize>(plan: &Plan<N>, unknowns: [f64; 2]) -> Option<[f64; 3]> {
    let [absorption, scattering] = unknowns.map(libm::exp);
    plan.respond_to_beam(plan.depths_of(absorption, scattering))
}

/// The two residual functions of [R, T, absorbed]; `None` where they have no logarithm.
fn residuals(clear: &Clear, read: [f64; 3]) -> Option<[f64; 2]> {
    let f = parts(clear, read).map(|x| libm::log(x / read[1]));
    f.iter().all(|x| x.is_finite()).then_some(f)
}

/// What is absorbed, and what is reflected beyond an unscattering slab of the same transmittance.
pub(crate) fn parts(clear: &Clear, [r, t, absorbed]: [f64; 3]) -> [f64; 2] {
    [absorbed, r - clear.reflectance(t).0]
}

/// How far a trial medium misses, and how fast that changes with the logarithms of its coefficients.
pub(crate) struct Step {
    pub miss: [f64; 2],
    /// Rows: residuals, columns: unknowns.
    pub jacobian: [[f64; 2]; 2],
}

fn step<const N: usize>(plan: &Plan<N>, clear: &Clear, wanted: [f64; 2], x: [f64; 2]) -> Option<Step> {
    let [absorption, scattering] = x.map(libm::exp);
    let beam = plan.beam_with_slopes(plan.depths_of(absorption, scattering))?;
    let [r, t, absorbed] = beam.read;
    let (r_clear, r_slope) = clear.reflectance(t);
    let f = [absorbed, r - r_clear].map(|x| libm::log(x / t));
    if !f.iter().all(|x| x.is_finite()) {
        return None;
    }
    let [a, s] = beam.by_logarithms;
    let column = |[by_r, by_t, by_absorbed]: [f64; 3]| {
        [by_absorbed / absorbed - by_t / t, (by_r - r_slope * by_t) / (r - r_clear) - by_t / t]
    };
    let [a, s] = [column(a), column(s)];
    Some(Step { miss: [f[0] - wanted[0], f[1] - wanted[1]], jacobian: [[a[0], s[0]], [a[1], s[1]]] })
}

/// Newton's method with halved steps on two residuals of two logarithms; returns where it could not come closer, and the
/// steps taken.
pub(crate) fn newton_on(step: impl Fn([f64; 2]) -> Option<Step>, start: [f64; 2], tolerance: f64) -> ([f64; 2], usize) {
    const STEPS: usize = 60;
    let size = |f: [f64; 2]| f[0].abs().max(f[1].abs());
    let mut x = start;
    let Some(mut at) = step(x) else { return (x, 0) };
    for count in 0..STEPS {
        let Step { miss, jacobian } = at;
        if size(miss) <= tolerance {
            return (x, count);
        }
        let determinant = jacobian[0][0] * jacobian[1][1] - jacobian[0][1] * jacobian[1][0];
        let mut move_by = [
            -(miss[0] * jacobian[1][1] - miss[1] * jacobian[0][1]) / determinant,
            -(miss[1] * jacobian[0][0] - miss[0] * jacobian[1][0]) / determinant,
        ];
        let longest = size(move_by);
        if !longest.is_finite() {
            return (x, count);
        }
        // A factor of 20 in either coefficient is as far as one tangent is trusted.
        let limit = (3.0 / longest).min(1.0);
        move_by = move_by.map(|m| m * limit);
        let mut better = None;
        for _ in 0..12 {
            let next = [x[0] + move_by[0], x[1] + move_by[1]];
            if let Some(found) = step(next).filter(|found| size(found.miss) < size(miss)) {
                better = Some((next, found));
                break;
            }
            move_by = move_by.map(|m| 0.5 * m);
        }
        let Some(found) = better else { return (x, count) };
        (x, at) = found;
    }
    (x, STEPS)
}

/// The x in [low, high] where `below` turns from true to false, to the last bit.
pub(crate) fn bisect(mut low: f64, mut high: f64, below: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..64 {
        let middle = 0.5 * (low + high);
        if below(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}
