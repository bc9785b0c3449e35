//! One row of readings becomes one row of the fit.

use turbid_contract::payload::Fit;
use turbid_contract::{Cells, Table};

use super::params::{FromParam, Params};
use super::source::Case;
use crate::experiment::Known;
use crate::{Error, Experiment, From, Measurement, solve_with_g};

/// One row of the result.
#[derive(Clone, Default)]
pub struct Found {
    mu_a: f64,
    mu_s_prime: f64,
    g: f64,
    /// Standard errors of mu_a, mu_s', g and the covariance of the first two.
    se: Option<[f64; 4]>,
    status: &'static str,
    /// What should be known of a fit that stands.
    remark: String,
}

impl Found {
    pub fn is_ambiguous(&self) -> bool {
        self.status == "ambiguous"
    }
}

pub fn solve<const N: usize>(params: &Params, case: &Case) -> Result<Found, Error> {
    let Case { slab, instrument, measured, m_u } = case;
    if let Some((m_u, m_u_se)) = *m_u {
        return solve_three::<N>(case, m_u, m_u_se);
    }
    let experiment = Experiment::<N>::new(slab, instrument)?;
    if let Some(known) = params.known() {
        let from = if params.from == Some(FromParam::MT) { From::MT } else { From::MR };
        let (x, se) = experiment.solve_one(measured, known, from)?;
        let found = match known {
            Known::MuA(mu_a) => Found { mu_a, mu_s_prime: x, se: Some([0.0, se, 0.0, 0.0]), ..Found::default() },
            Known::MuSPrime(s) => Found { mu_a: x, mu_s_prime: s, se: Some([se, 0.0, 0.0, 0.0]), ..Found::default() },
        };
        return Ok(Found { g: slab.g, status: "ok", ..found });
    }
    let solution = experiment.solve(measured)?;
    let flags = solution.fit.flags;
    let status = match (flags.conservative, flags.no_scatter) {
        (false, false) if flags.ambiguous => "ambiguous",
        (false, false) => "ok",
        (true, false) => "conservative",
        (false, true) => "no_scatter",
        (true, true) => "empty",
    };
    let remark = solution.other.map_or(String::new(), |[mu_a, mu_s_prime]| {
        format!("mu_a = {mu_a:.6} and mu_s' = {mu_s_prime:.6} mm^-1 give the same readings")
    });
    Ok(Found {
        mu_a: solution.fit.mu_a_per_mm,
        mu_s_prime: solution.fit.mu_s_prime_per_mm,
        g: slab.g,
        se: solution.covariance.map(|[a, s, both]| [a.sqrt(), s.sqrt(), 0.0, both]),
        status,
        remark,
    })
}

/// With M_U: errors from how the solution moves with each reading; lost light counts as exact there.
fn solve_three<const N: usize>(case: &Case, m_u: f64, m_u_se: f64) -> Result<Found, Error> {
    let Case { slab, instrument, measured, .. } = case;
    let at = |r: f64, t: f64, u: f64| -> Result<[f64; 3], Error> {
        let moved = Measurement { m_r: measured.m_r + r, m_t: measured.m_t + t, ..*measured };
        let found = solve_with_g::<N>(slab, instrument, &moved, m_u + u)?;
        Ok([found.fit.mu_a_per_mm, found.fit.mu_s_prime_per_mm, found.g])
    };
    let best = at(0.0, 0.0, 0.0)?;
    let slope = |r: f64, t: f64, u: f64| -> Option<[f64; 3]> {
        let (high, low) = (at(r, t, u).ok()?, at(-r, -t, -u).ok()?);
        Some(std::array::from_fn(|i| 0.5 * (high[i] - low[i]) / (r + t + u)))
    };
    // Small against the readings and what is left over for absorption, large against the 1e-8 of a fit.
    let h = 1e-5;
    let se = (|| {
        let (by_r, by_t) = (slope(h * measured.m_r, 0.0, 0.0)?, slope(0.0, h * measured.m_t, 0.0)?);
        let by_u = slope(0.0, 0.0, h * m_u)?;
        let (vr, vt, cov) = (measured.m_r_se * measured.m_r_se, measured.m_t_se * measured.m_t_se, measured.m_rt_cov);
        let product = |i: usize, j: usize| {
            by_r[i] * by_r[j] * vr
                + by_t[i] * by_t[j] * vt
                + (by_r[i] * by_t[j] + by_t[i] * by_r[j]) * cov
                + by_u[i] * by_u[j] * m_u_se * m_u_se
        };
        let root = |i: usize| product(i, i).max(0.0).sqrt();
        Some([root(0), root(1), root(2), product(0, 1)])
    })();
    Ok(Found { mu_a: best[0], mu_s_prime: best[1], g: best[2], se, status: "ok", ..Found::default() })
}

fn name(error: &Error) -> &'static str {
    match error {
        Error::NotFinite { .. } => "not_finite",
        Error::InvalidIndex { .. } => "invalid_index",
        Error::InvalidG { .. } => "invalid_g",
        Error::InvalidThickness { .. } => "invalid_thickness",
        Error::Range { .. } | Error::AbsorbingSlide { .. } => "out_of_range",
        Error::Unresolved { .. } => "unresolved",
        Error::TooMuchLight { .. } => "too_much_light",
        Error::BelowSpecular { .. } => "below_specular",
        Error::AboveMax { .. } => "above_max",
        Error::OutOfReach { .. } => "out_of_reach",
        Error::UnscatteredExceedsTotal { .. } => "unscattered_exceeds_total",
        Error::Inconsistent { .. } => "inconsistent",
        Error::Underdetermined { .. } => "underdetermined",
        Error::NotConverged { .. } => "not_converged",
    }
}

pub fn table(media: &[String], found: &[Result<Found, Error>]) -> Fit {
    let mut table = Table::default();
    table.push("medium", "", Cells::Text(media.to_vec()));
    let mut push = |name: &str, unit: &str, value: fn(&Found) -> f64| {
        let cells = found.iter().map(|f| f.as_ref().map_or(0.0, value)).collect();
        table.push(name, unit, Cells::F64(cells));
    };
    push("mu_a", "mm^-1", |f| f.mu_a);
    push("mu_a_se", "mm^-1", |f| f.se.unwrap_or_default()[0]);
    push("mu_s_prime", "mm^-1", |f| f.mu_s_prime);
    push("mu_s_prime_se", "mm^-1", |f| f.se.unwrap_or_default()[1]);
    push("mu_cov", "mm^-2", |f| f.se.unwrap_or_default()[3]);
    push("g", "1", |f| f.g);
    push("g_se", "1", |f| f.se.unwrap_or_default()[2]);
    let status = |f: &Result<Found, Error>| match f {
        Ok(found) if found.se.is_none() => format!("{}, no_se", found.status),
        Ok(found) => found.status.to_owned(),
        Err(error) => name(error).to_owned(),
    };
    table.push("status", "", Cells::Text(found.iter().map(status).collect()));
    let message = |f: &Result<Found, Error>| f.as_ref().map_or_else(ToString::to_string, |found| found.remark.clone());
    table.push("message", "", Cells::Text(found.iter().map(message).collect()));
    Fit(table)
}
