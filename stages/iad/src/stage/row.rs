//! One row of readings becomes one row of the fit: as many quadrature points as it needs, and what is left uncertain.

use turbid_contract::payload::Fit;
use turbid_contract::{Cells, Table};

use super::params::Params;
use super::solve::{Answer, Failure, Level, answer, noise};
use super::source::Case;
use crate::{Error, Losses};

/// All that rows share.
pub struct Tools {
    pub losses: Losses,
    eight: Level<8>,
    sixteen: Level<16>,
    thirty_two: Level<32>,
    sixty_four: Level<64>,
}

impl Tools {
    pub fn new(cases: &[Case], seed: u64) -> Self {
        // There are no more slabs than slabs with their instruments.
        let configs = cases.iter().map(|case| case.config + 1).max().unwrap_or(0);
        Self {
            losses: Losses::new(seed),
            eight: Level::new(configs),
            sixteen: Level::new(configs),
            thirty_two: Level::new(configs),
            sixty_four: Level::new(configs),
        }
    }
}

/// One row of the result.
#[derive(Clone)]
pub struct Found {
    answer: Answer,
    points: u32,
    /// What the model itself leaves uncertain of mu_a, mu_s' and g: quadrature and the random numbers of lost light.
    model: Option<[f64; 3]>,
    /// Standard errors of mu_a, mu_s', g and the covariance of the first two; `None` where they are unknown.
    se: Option<[f64; 4]>,
    /// M_R and M_T of the fit, less those that were read.
    residuals: [Option<f64>; 2],
}

impl Found {
    pub fn status(&self) -> &'static str {
        self.answer.status
    }

    /// The change with twice as many points exceeds what is asked for, at the most points there are.
    pub fn is_coarse(&self) -> bool {
        self.answer.remark.ends_with(COARSE)
    }
}

/// Accepted where twice as many points change a coefficient by less than this share of it,
const TOLERANCE: f64 = 1e-3;
/// or by less than this share of its standard error.
const OF_ERROR: f64 = 0.2;
/// Error of N points over the change to 2N: errors fall at least by 3 per doubling (sharp peaks, n > 1), so what is left
/// at 2N is at most half the change,
const OF_COARSE: f64 = 1.5;
/// and that is also the error of 2N points.
const OF_FINE: f64 = 0.5;
const COARSE: &str = "64 quadrature points are few for this row";

/// A row's medium with as many points as it needs, or with those that the params ask for.
pub fn solve(params: &Params, case: &Case, tools: &Tools) -> Result<Found, Failure> {
    let Tools { losses, eight, sixteen, thirty_two, sixty_four } = tools;
    match params.points {
        Some(8) => Ok(checked(case, answer(case, eight, losses)?, eight, sixteen).1),
        Some(16) => Ok(checked(case, answer(case, sixteen, losses)?, sixteen, thirty_two).1),
        Some(32) => Ok(checked(case, answer(case, thirty_two, losses)?, thirty_two, sixty_four).1),
        Some(_) => {
            let answer = answer(case, sixty_four, losses)?;
            let change = change(case, &answer, sixty_four, thirty_two);
            Ok(found(case, answer, sixty_four, change.map(|c| c.map(|x| OF_FINE * x))))
        }
        None => {
            let first = answer(case, sixteen, losses);
            if let Ok(answer) = &first {
                let (settled, found) = checked(case, answer.clone(), sixteen, thirty_two);
                if settled {
                    return Ok(found);
                }
            } else if let Err(failure) = &first
                && !is_of_the_rule(failure)
            {
                return Err(failure.clone());
            }
            let second = answer(case, thirty_two, losses);
            if let Ok(answer) = &second {
                let (settled, found) = checked(case, answer.clone(), thirty_two, sixty_four);
                if settled {
                    return Ok(found);
                }
            }
            let mut last = match (answer(case, sixty_four, losses), &second) {
                (Ok(last), _) => last,
                // What 32 points answered and 64 do not is no answer.
                (Err(failure), _) => return Err(failure),
            };
            let change = second.ok().map(|second| std::array::from_fn(|i| (last.medium[i] - second.medium[i]).abs()));
            let mut remark = String::new();
            if change.is_none_or(|change| !is_small(&last, &change.map(|x| OF_FINE * x), None)) {
                remark = format!("32 and 64 points differ by more than a thousandth; {COARSE}");
            }
            last.remark = [std::mem::take(&mut last.remark), remark]
                .into_iter()
                .filter(|r| !r.is_empty())
                .collect::<Vec<_>>()
                .join("; ");
            Ok(found(case, last, sixty_four, change.map(|c: [f64; 3]| c.map(|x| OF_FINE * x))))
        }
    }
}

/// Failures that too few points may cause.
fn is_of_the_rule(failure: &Failure) -> bool {
    use Error::{BelowSpecular, Inconsistent, NotConverged, OutOfReach, Unresolved};
    matches!(
        failure,
        Failure::Model(
            BelowSpecular { .. }
                | Inconsistent { .. }
                | NotConverged { .. }
                | OutOfReach { .. }
                | Unresolved { .. }
                | Error::Underdetermined { .. }
        )
    )
}

/// An answer with its errors, and whether more points are of no use.
fn checked<const N: usize, const M: usize>(
    case: &Case,
    answer: Answer,
    level: &Level<N>,
    finer: &Level<M>,
) -> (bool, Found) {
    let change = change(case, &answer, level, finer);
    let found = found(case, answer, level, change.map(|c| c.map(|x| OF_COARSE * x)));
    let settled = change.is_some_and(|change| is_small(&found.answer, &change, found.se));
    (settled, found)
}

/// How far the medium moves where the readings of another number of points count: -(its slopes) x (what these add to the readings).
fn change<const N: usize, const M: usize>(
    case: &Case,
    answer: &Answer,
    _: &Level<N>,
    other: &Level<M>,
) -> Option<[f64; 3]> {
    let slopes = answer.slopes?;
    let readings = other.readings(case, answer.medium, &answer.lost).ok()?;
    let change = slopes.map(|by| (0..2).map(|r| by[r] * (readings[r] - answer.readings[r])).sum::<f64>().abs());
    change.iter().all(|x| x.is_finite()).then_some(change)
}

/// mu_a and mu_s' are what is asked for; one that lies on the limit 0 has no share of itself.
fn is_small(answer: &Answer, change: &[f64; 3], se: Option<[f64; 4]>) -> bool {
    (0..2).all(|i| {
        let x = answer.medium[i];
        x == 0.0 || change[i] <= TOLERANCE * x || se.is_some_and(|se| change[i] <= OF_ERROR * se[i])
    })
}

fn found<const N: usize>(case: &Case, answer: Answer, level: &Level<N>, quadrature: Option<[f64; 3]>) -> Found {
    let variances = answer.slopes.zip(noise(case, level, &answer));
    let spread = |of: usize, i: usize, j: usize| {
        variances.map(|(slopes, noise)| {
            let pairs = (0..3).flat_map(|r| (0..3).map(move |s| (r, s)));
            pairs.map(|(r, s)| slopes[i][r] * noise[of][r][s] * slopes[j][s]).sum::<f64>()
        })
    };
    // A perfect correlation leaves a difference that rounding may turn negative.
    let variance = |of: usize, i: usize| spread(of, i, i).filter(|v| v.is_finite()).map(|v| v.max(0.0));
    let model = quadrature.and_then(|q| {
        let of = |i: usize| Some((q[i] * q[i] + variance(1, i)?).sqrt());
        Some([of(0)?, of(1)?, of(2)?])
    });
    let se = model.filter(|_| case.stated).and_then(|model| {
        let of = |i: usize| Some((model[i] * model[i] + variance(0, i)?).sqrt());
        Some([of(0)?, of(1)?, of(2)?, spread(0, 0, 1)? + spread(1, 0, 1)?])
    });
    let se = se.filter(|se| se.iter().all(|x| x.is_finite()));
    let wanted = [case.measured.m_r, case.measured.m_t];
    let residuals = [0, 1].map(|i| case.read[i].then(|| answer.readings[i] - wanted[i]));
    Found { answer, points: N as u32, model, se, residuals }
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

impl Failure {
    fn status(&self) -> &'static str {
        match self {
            Self::Model(error) => name(error),
            Self::Open(status, _) => status,
        }
    }

    fn message(&self) -> String {
        match self {
            Self::Model(error) => error.to_string(),
            Self::Open(_, message) => message.clone(),
        }
    }
}

pub fn table(media: &[String], found: &[Result<Found, Failure>]) -> Fit {
    let mut table = Table::default();
    table.push("medium", "", Cells::Text(media.to_vec()));
    // Of a row without a fit nothing is known.
    let number = |value: fn(&Found) -> f64| Cells::MaybeF64(found.iter().map(|f| f.as_ref().ok().map(value)).collect());
    let maybe = |value: fn(&Found) -> Option<f64>| {
        // What is no number is not known.
        Cells::MaybeF64(found.iter().map(|f| f.as_ref().ok().and_then(value).filter(|x| x.is_finite())).collect())
    };
    table.push("mu_a", "mm^-1", number(|f| f.answer.medium[0]));
    table.push("mu_a_se", "mm^-1", maybe(|f| f.se.map(|se| se[0])));
    table.push("mu_s_prime", "mm^-1", number(|f| f.answer.medium[1]));
    table.push("mu_s_prime_se", "mm^-1", maybe(|f| f.se.map(|se| se[1])));
    table.push("mu_cov", "mm^-2", maybe(|f| f.se.map(|se| se[3])));
    table.push("g", "1", number(|f| f.answer.medium[2]));
    table.push("g_se", "1", maybe(|f| f.se.map(|se| se[2])));
    table.push("mu_a_model_error", "mm^-1", maybe(|f| f.model.map(|m| m[0])));
    table.push("mu_s_prime_model_error", "mm^-1", maybe(|f| f.model.map(|m| m[1])));
    table.push("m_r_residual", "1", maybe(|f| f.residuals[0]));
    table.push("m_t_residual", "1", maybe(|f| f.residuals[1]));
    let ratio = |f: &Result<Found, Failure>| match f {
        Ok(found) => {
            let [mu_a, mu_s_prime, _] = found.answer.medium;
            (mu_s_prime > 0.0).then(|| mu_a / mu_s_prime)
        }
        Err(Failure::Model(Error::Underdetermined { ratio })) => Some(*ratio),
        Err(_) => None,
    };
    table.push("mu_a_over_mu_s_prime", "1", Cells::MaybeF64(found.iter().map(ratio).collect()));
    table.push("N", "1", number(|f| f64::from(f.points)));
    let status = |f: &Result<Found, Failure>| match f {
        Ok(found) if found.answer.slopes.is_none() => format!("{}, no_se", found.answer.status),
        Ok(found) => found.answer.status.to_owned(),
        Err(failure) => failure.status().to_owned(),
    };
    table.push("status", "", Cells::Text(found.iter().map(status).collect()));
    let message =
        |f: &Result<Found, Failure>| f.as_ref().map_or_else(Failure::message, |found| found.answer.remark.clone());
    table.push("message", "", Cells::Text(found.iter().map(message).collect()));
    Fit(table)
}
