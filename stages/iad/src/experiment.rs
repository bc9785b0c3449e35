//! The inverse behind an instrument: spheres, lost light, absorbing slides, standard errors, one coefficient known.
//!
//! The balance of the spheres is linear in UR1 and UT1, so every trial medium says which UR1 and UT1 the readings mean
//! if its URU and UTU are right; Newton's method runs on the same two residuals as without spheres, against that target.

use rayon::prelude::*;

use crate::forward::Plan;
use crate::inverse::{
    DARK, Fit, Flags, Inverse, RESIDUAL, ROUNDING, Reading, Step, TABLE, bisect, newton_on, parts, table_entry,
};
use crate::spheres::{Instrument, Lost, Seen, Spheres};
use crate::state::{State, state, state_with_slopes, state_with_slopes_per_depth};
use crate::{Error, Incidence, Slab};

/// What an instrument reports of one sample, with standard errors (0: exact).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Measurement {
    pub m_r: f64,
    pub m_t: f64,
    pub m_r_se: f64,
    pub m_t_se: f64,
    /// Covariance of M_R and M_T.
    pub m_rt_cov: f64,
    pub lost: Lost,
    pub lost_se: Lost,
    /// Readings beyond a limit by no more than this many standard errors count as lying on it.
    pub limit_sigmas: f64,
}

impl Measurement {
    pub fn exact(m_r: f64, m_t: f64) -> Self {
        Self { m_r, m_t, limit_sigmas: 1.0, ..Self::default() }
    }
}

/// The medium that explains a measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solution {
    pub fit: Fit,
    /// Covariance of mu_a and mu_s' in mm^-2: [aa, ss, as]; `None` where the readings leave a direction open. On a limit that of the
    /// unlimited fit.
    pub covariance: Option<[f64; 3]>,
    /// mu_a and mu_s', mm^-1, of another medium that gives the same readings; then the fit is flagged as ambiguous.
    pub other: Option<[f64; 2]>,
}

impl Solution {
    /// Standard errors of mu_a and mu_s', mm^-1.
    pub fn se(&self) -> Option<[f64; 2]> {
        self.covariance.map(|[a, s, _]| [a.sqrt(), s.sqrt()])
    }
}

/// The coefficient that is known beforehand, mm^-1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Known {
    MuA(f64),
    MuSPrime(f64),
}

/// The reading that a single unknown is found from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum From {
    MR,
    MT,
}

/// A slab in an instrument, prepared for any number of measurements, from any thread.
pub struct Experiment<const N: usize> {
    inverse: Inverse<N>,
    pub(crate) instrument: Instrument,
    /// The slab seen from below, where its sides differ.
    flipped: Option<Box<Plan<N>>>,
    coarse_flipped: Option<Box<Plan<4>>>,
    /// States of the coarse model, [`TABLE`] scatterings for each absorption.
    pub(crate) starts: Vec<Option<State>>,
}

impl<const N: usize> Experiment<N> {
    /// As [`Inverse::new`], but slides may absorb; also fails on an instrument that cannot be.
    pub fn new(slab: &Slab, instrument: &Instrument) -> Result<Self, Error> {
        Self::lit(slab, instrument, Incidence::Normal)
    }

    /// For readings under this light; `straight` of the instrument takes what is unscattered as one beam all the same.
    pub fn lit(slab: &Slab, instrument: &Instrument, light: Incidence) -> Result<Self, Error> {
        instrument.check()?;
        let inverse = Inverse::prepare(slab, light)?;
        let turned = Slab { top: slab.bottom, bottom: slab.top, ..*slab };
        let differs = slab.top != slab.bottom && instrument.spheres != Spheres::None;
        let flipped = differs.then(|| Plan::new(&turned).map(Box::new)).transpose()?;
        let coarse_flipped = differs.then(|| Plan::new(&turned).map(Box::new)).transpose()?;
        let starts = (0..TABLE * TABLE)
            .map(|k| {
                state(&inverse.coarse, coarse_flipped.as_deref(), table_entry(k / TABLE, k % TABLE).map(libm::exp))
            })
            .collect();
        Ok(Self { inverse, instrument: *instrument, flipped, coarse_flipped, starts })
    }

    pub fn inverse(&self) -> &Inverse<N> {
        &self.inverse
    }

    /// M_R and M_T of the medium, mm^-1.
    pub fn readings(&self, mu_a: f64, mu_s_prime: f64, lost: &Lost) -> Result<[f64; 2], Error> {
        self.inverse.plan().forward(mu_a, mu_s_prime)?;
        let d = self.inverse.plan().slab().thickness_mm;
        let state = self.state([mu_a * d, mu_s_prime * d]).ok_or(Error::Unresolved { points: N })?;
        Ok(self.instrument.readings(&state.seen, lost))
    }

    /// mu_a and mu_s' with their standard errors.
    pub fn solve(&self, measured: &Measurement) -> Result<Solution, Error> {
        check(measured)?;
        let slab = self.inverse.plan().slab();
        let clear = slab.top.tau == 0.0 && slab.bottom.tau == 0.0;
        let limit = self.limits(measured);
        let (fit, other) = if self.instrument == Instrument::NONE && measured.lost == Lost::default() && clear {
            let sigma = limit[0].max(limit[1]);
            (self.inverse.invert(&Reading { m_r: measured.m_r, m_t: measured.m_t, sigma })?, None)
        } else {
            self.search(measured, limit)?
        };
        Ok(Solution { fit, covariance: self.covariance(measured, &fit), other })
    }

    /// The same for many, on all threads; the same bits as one by one.
    pub fn solve_batch(&self, measured: &[Measurement]) -> Vec<Result<Solution, Error>> {
        measured.par_iter().map(|m| self.solve(m)).collect()
    }

    fn state(&self, depths: [f64; 2]) -> Option<State> {
        state(self.inverse.plan(), self.flipped.as_deref(), depths)
    }

    fn limits(&self, m: &Measurement) -> [f64; 2] {
        [m.m_r_se, m.m_t_se].map(|se| (m.limit_sigmas * se).max(ROUNDING))
    }

    fn search(&self, measured: &Measurement, limit: [f64; 2]) -> Result<(Fit, Option<[f64; 2]>), Error> {
        let m = [measured.m_r, measured.m_t];
        if measured.m_t < -limit[1] {
            return Err(Error::Range { name: "M_T", value: measured.m_t, must: "be >= 0" });
        }
        if measured.m_t < DARK {
            return Err(self.opaque(measured));
        }
        let size = |f: &[f64; 2]| f[0] * f[0] + f[1] * f[1];
        let entry = |k: usize| {
            let miss = self.miss(self.starts[k].as_ref()?, measured, true)?;
            Some((table_entry(k / TABLE, k % TABLE), size(&miss)))
        };
        let nearest = (0..TABLE * TABLE).filter_map(entry).min_by(|a, b| a.1.total_cmp(&b.1));
        let mut best = None;
        if let Some((start, _)) = nearest {
            let start = self.coarse_root(start, measured);
            let mut fit = self.full_root(start, measured);
            if fit.residual <= RESIDUAL {
                let other = self.other(&fit, measured);
                fit.flags.ambiguous = other.is_some();
                return Ok((fit, other));
            }
            best = Some(fit);
        }
        // No medium between the limits: one on them, if the standard errors allow it.
        let target = |x: [f64; 2]| self.state(x).map(|s| (s, self.instrument.slab(m, &s.seen, &measured.lost)));
        let scattering = bisect(-40.0, 40.0, |x| {
            target([0.0, libm::exp(x)]).is_some_and(|(s, [r, t])| s.seen.beam[0] * t < r * s.seen.beam[1])
        });
        let conservative = [0.0, libm::exp(scattering)];
        let absorption =
            bisect(-40.0, 10.0, |x| target([libm::exp(x), 0.0]).is_some_and(|(s, [_, t])| s.seen.beam[1] > t));
        let clear = [libm::exp(absorption), 0.0];
        for (x, flags) in [
            (conservative, Flags { conservative: true, ..Flags::default() }),
            (clear, Flags { no_scatter: true, ..Flags::default() }),
            ([0.0, 0.0], Flags { conservative: true, no_scatter: true, ..Flags::default() }),
        ] {
            let Some(state) = self.state(x) else { continue };
            let read = self.instrument.readings(&state.seen, &measured.lost);
            if (0..2).all(|i| (read[i] - m[i]).abs() <= limit[i]) {
                return Ok((self.fit(read, measured, x, 0, flags), None));
            }
        }
        if let Some((s, [r, t])) = target(conservative) {
            let excess = (r - 1.0) + t + s.slides;
            if excess > 0.0 {
                return Err(Error::TooMuchLight { excess });
            }
        }
        if let Some((s, [r, _])) = target(clear)
            && r < s.seen.beam[0]
        {
            return Err(Error::BelowSpecular { min: self.instrument.readings(&s.seen, &measured.lost)[0] });
        }
        let (best, residual) =
            best.map_or(([0.0; 2], f64::INFINITY), |f| ([f.mu_a_per_mm, f.mu_s_prime_per_mm], f.residual));
        Err(Error::NotConverged { best, residual })
    }

    /// How far a trial medium is from the UR1 and UT1 that the readings mean with it.
    fn miss(&self, state: &State, measured: &Measurement, coarse: bool) -> Option<[f64; 2]> {
        let clear = if coarse { &self.inverse.coarse_clear } else { &self.inverse.clear };
        let [r, t] = self.instrument.slab([measured.m_r, measured.m_t], &state.seen, &measured.lost);
        let wanted = parts(clear, [r, t, (1.0 - t) - r - state.slides]);
        let [r, own_t] = state.seen.beam;
        let have = parts(clear, [r, own_t, state.absorbed]);
        if t <= 0.0 || have.iter().any(|x| *x <= 0.0) {
            return None;
        }
        let miss = [0, 1].map(|i| -extended_log(wanted[i] / have[i] * (own_t / t)));
        miss.iter().all(|x| x.is_finite()).then_some(miss)
    }

    /// The coarse model's own solution, from a state nearby; both in (ln mu_a d, ln mu_s' d).
    fn coarse_root(&self, start: [f64; 2], measured: &Measurement) -> [f64; 2] {
        let (plan, flipped) = (&self.inverse.coarse, self.coarse_flipped.as_deref());
        newton_on(|x| self.step(state_with_slopes(plan, flipped, x)?, measured, true), start, 1e-4).0
    }

    pub(crate) fn full_root(&self, start: [f64; 2], measured: &Measurement) -> Fit {
        let (plan, flipped) = (self.inverse.plan(), self.flipped.as_deref());
        let (found, iterations) =
            newton_on(|x| self.step(state_with_slopes(plan, flipped, x)?, measured, false), start, 1e-13);
        self.fit([measured.m_r, measured.m_t], measured, found.map(libm::exp), iterations, Flags::default())
    }

    fn step(&self, at: (State, [State; 2]), measured: &Measurement, coarse: bool) -> Option<Step> {
        // The balance is plain algebra: its own differences are exact to the square of this.
        const H: f64 = 1e-6;
        let (state, slopes) = at;
        let miss = self.miss(&state, measured, coarse)?;
        let mut jacobian = [[0.0; 2]; 2];
        for (j, slope) in slopes.iter().enumerate() {
            let moved = |h: f64| self.miss(&state.moved(slope, h), measured, coarse);
            let (low, high) = (moved(-H)?, moved(H)?);
            for i in 0..2 {
                jacobian[i][j] = (high[i] - low[i]) / (2.0 * H);
            }
        }
        Some(Step { miss, jacobian })
    }

    /// `allowed` are the readings that the fit should give back.
    fn fit(&self, allowed: [f64; 2], measured: &Measurement, x: [f64; 2], iterations: usize, flags: Flags) -> Fit {
        let read = self.state(x).map(|s| self.instrument.readings(&s.seen, &measured.lost));
        let miss = |read: [f64; 2]| {
            (0..2)
                .map(|i| if read[i] == allowed[i] { 0.0 } else { ((read[i] - allowed[i]) / allowed[i]).abs() })
                .fold(0.0, f64::max)
        };
        let d = self.inverse.plan().slab().thickness_mm;
        Fit {
            mu_a_per_mm: x[0] / d,
            mu_s_prime_per_mm: x[1] / d,
            residual: read.map_or(f64::INFINITY, miss),
            iterations,
            flags,
        }
    }

    fn opaque(&self, measured: &Measurement) -> Error {
        let plan = self.inverse.plan();
        let found = bisect(-80.0, 40.0, |x| {
            plan.respond(plan.half_space(libm::exp(x))).is_some_and(|r| {
                let seen =
                    Seen { beam: [r.ur1, 0.0], unscattered: [r.ur1_unscattered, 0.0], uru: [r.uru; 2], utu: 0.0 };
                self.instrument.readings(&seen, &measured.lost)[0] > measured.m_r
            })
        });
        Error::Underdetermined { ratio: libm::exp(found) }
    }

    /// M_R and M_T, and d(M_R, M_T) / d(mu_a d, mu_s' d); columns are the unknowns.
    pub(crate) fn readings_with_slopes(&self, depths: [f64; 2], lost: &Lost) -> Option<([f64; 2], [[f64; 2]; 2])> {
        const H: f64 = 1e-6;
        let (state, slopes) = state_with_slopes_per_depth(self.inverse.plan(), self.flipped.as_deref(), depths)?;
        let slopes = slopes.map(|slope| {
            let [low, high] = [-H, H].map(|h| self.instrument.readings(&state.moved(&slope, h).seen, lost));
            std::array::from_fn(|i| (high[i] - low[i]) / (2.0 * H))
        });
        Some((self.instrument.readings(&state.seen, lost), slopes))
    }

    fn covariance(&self, measured: &Measurement, fit: &Fit) -> Option<[f64; 3]> {
        let [to_a, to_s] = self.responses(measured, fit)?;
        let d = self.inverse.plan().slab().thickness_mm;
        let [rr, tt, rt] = self.noise(measured, [fit.mu_a_per_mm * d, fit.mu_s_prime_per_mm * d])?;
        let product = |u: [f64; 2], v: [f64; 2]| u[0] * v[0] * rr + u[1] * v[1] * tt + (u[0] * v[1] + u[1] * v[0]) * rt;
        // A perfect correlation leaves a difference that rounding may turn negative.
        let found = [product(to_a, to_a).max(0.0), product(to_s, to_s).max(0.0), product(to_a, to_s)];
        found.iter().all(|x| x.is_finite()).then_some(found)
    }

    /// d(mu_a, mu_s') / d(M_R, M_T) at a solution, mm^-1; rows are mu_a and mu_s'.
    pub fn responses(&self, measured: &Measurement, fit: &Fit) -> Option<[[f64; 2]; 2]> {
        let d = self.inverse.plan().slab().thickness_mm;
        let x = [fit.mu_a_per_mm * d, fit.mu_s_prime_per_mm * d];
        let (_, [a, s]) = self.readings_with_slopes(x, &measured.lost)?;
        let determinant = a[0] * s[1] - s[0] * a[1];
        // Rows of the inverse: the response of mu_a and of mu_s' to M_R and M_T.
        let to_a = [s[1] / determinant / d, -s[0] / determinant / d];
        let to_s = [-a[1] / determinant / d, a[0] / determinant / d];
        Some([to_a, to_s])
    }

    /// Variances of M_R, M_T and their covariance, that of the lost light included.
    pub(crate) fn noise(&self, measured: &Measurement, x: [f64; 2]) -> Option<[f64; 3]> {
        let Measurement { m_r_se, m_t_se, m_rt_cov, lost, lost_se, .. } = measured;
        let mut noise = [m_r_se * m_r_se, m_t_se * m_t_se, *m_rt_cov];
        if *lost_se == Lost::default() {
            return Some(noise);
        }
        let seen = self.state(x)?.seen;
        const H: f64 = 1e-6;
        for part in 0..4 {
            let moved = |by: f64| {
                let mut lost = *lost;
                *if part < 2 { &mut lost.beam[part] } else { &mut lost.diffuse[part - 2] } += by;
                self.instrument.readings(&seen, &lost)
            };
            let se = if part < 2 { lost_se.beam[part] } else { lost_se.diffuse[part - 2] };
            let (low, high) = (moved(-H), moved(H));
            let [r, t] = [0, 1].map(|i| se * (high[i] - low[i]) / (2.0 * H));
            noise[0] += r * r;
            noise[1] += t * t;
            noise[2] += r * t;
        }
        Some(noise)
    }

    /// The other coefficient and its standard error, mm^-1, where one is known.
    pub fn solve_one(&self, measured: &Measurement, known: Known, from: From) -> Result<(f64, f64), Error> {
        check(measured)?;
        let d = self.inverse.plan().slab().thickness_mm;
        let (name, value) = match known {
            Known::MuA(x) => ("mu_a", x),
            Known::MuSPrime(x) => ("mu_s'", x),
        };
        if !(value >= 0.0 && value.is_finite()) {
            return Err(Error::Range { name, value, must: "be a finite number >= 0" });
        }
        let (i, m, se) = match from {
            From::MR => (0, measured.m_r, measured.m_r_se),
            From::MT => (1, measured.m_t, measured.m_t_se),
        };
        let unknowns = |x: f64| match known {
            Known::MuA(a) => [a * d, x],
            Known::MuSPrime(s) => [x, s * d],
        };
        let read = |x: f64| self.state(unknowns(x)).map(|s| self.instrument.readings(&s.seen, &measured.lost)[i]);
        let ends = [0.0, libm::exp(LARGEST)].map(read);
        let [Some(first), Some(last)] = ends else { return Err(Error::Unresolved { points: N }) };
        let [min, max] = [first.min(last), first.max(last)];
        if !(min..=max).contains(&m) {
            return Err(Error::OutOfReach { name: ["M_R", "M_T"][i], value: m, min, max });
        }
        let rises = last > first;
        let x = if m == first {
            0.0
        } else {
            libm::exp(bisect(-40.0, LARGEST, |x| read(libm::exp(x)).is_some_and(|v| (v < m) == rises)))
        };
        let (_, slope) =
            self.readings_with_slopes(unknowns(x), &measured.lost).ok_or(Error::Unresolved { points: N })?;
        let unknown = usize::from(matches!(known, Known::MuA(_)));
        Ok((x / d, (se / slope[unknown][i]).abs() / d))
    }
}

/// The logarithm, and below 0.1 its tangent: far from the solution the readings may mean less than no absorption.
fn extended_log(x: f64) -> f64 {
    const KNEE: f64 = 0.1;
    if x > KNEE { libm::log(x) } else { libm::log(KNEE) + (x - KNEE) / KNEE }
}

/// ln of the largest optical depth that one unknown is looked for.
const LARGEST: f64 = 10.0;

fn check(m: &Measurement) -> Result<(), Error> {
    for (name, value) in [("M_R", m.m_r), ("M_T", m.m_t), ("covariance of M_R and M_T", m.m_rt_cov)] {
        if !value.is_finite() {
            return Err(Error::NotFinite { name });
        }
    }
    for (name, value) in [("lost light", m.lost.beam), ("lost light", m.lost.diffuse)] {
        if value.iter().any(|x| !x.is_finite()) {
            return Err(Error::NotFinite { name });
        }
        if let Some(&value) = value.iter().find(|x| x.abs() > 1.0) {
            return Err(Error::Range { name, value, must: "be a fraction of the light" });
        }
    }
    let errors = [m.m_r_se, m.m_t_se, m.limit_sigmas].into_iter().chain(m.lost_se.beam).chain(m.lost_se.diffuse);
    for value in errors {
        if !(value >= 0.0 && value.is_finite()) {
            return Err(Error::Range { name: "standard error", value, must: "be a finite number >= 0" });
        }
    }
    if m.m_r < 0.0 {
        return Err(Error::BelowSpecular { min: 0.0 });
    }
    Ok(())
}
