//! One row at one number of quadrature points: the medium, how it follows the readings, and what the model makes of it.

use std::sync::OnceLock;

use turbid_optics::PhaseFunction;

use super::line::{Constraint, Line, meet};
use super::source::Case;
use crate::{
    Error, Experiment, Fit, Flags, Incidence, Instrument, Losses, Lost, Measurement, Model, Slab, solve_with_g,
};

/// Why a row has no medium.
#[derive(Clone, Debug)]
pub enum Failure {
    Model(Error),
    /// What was read leaves a direction open, and the status that says so.
    Open(&'static str, String),
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        Self::Model(error)
    }
}

/// Slabs prepared for N points, each once: with its instrument by the number of a row's configuration, for the way there alone by that of its slab.
pub struct Level<const N: usize> {
    experiments: Vec<OnceLock<Result<Experiment<N>, Error>>>,
    models: Vec<OnceLock<Result<Model<N>, Error>>>,
}

impl<const N: usize> Level<N> {
    pub fn new(configs: usize) -> Self {
        Self {
            experiments: (0..configs).map(|_| OnceLock::new()).collect(),
            models: (0..configs).map(|_| OnceLock::new()).collect(),
        }
    }

    fn experiment(&self, case: &Case) -> Result<&Experiment<N>, Error> {
        let made = || Experiment::<N>::lit(&case.slab, &case.instrument, case.light);
        self.experiments[case.config].get_or_init(made).as_ref().map_err(|e| *e)
    }

    fn model(&self, case: &Case) -> Result<Model<N>, Error> {
        let made = || Model::<N>::new(&case.slab, &Instrument::NONE, case.light);
        self.models[case.slab_config].get_or_init(made).as_ref().map_err(|e| *e)?.within(&case.instrument)
    }

    /// M_R and M_T of a medium [mu_a, mu_s', g].
    pub fn readings(&self, case: &Case, medium: [f64; 3], lost: &Lost) -> Result<[f64; 2], Error> {
        let [mu_a, mu_s_prime, g] = medium;
        if g == case.slab.phase.g() {
            return self.model(case)?.readings(mu_a, mu_s_prime, lost);
        }
        Model::<N>::new(
            &Slab { phase: PhaseFunction::henyey_greenstein(g), ..case.slab },
            &case.instrument,
            case.light,
        )?
        .readings(mu_a, mu_s_prime, lost)
    }
}

/// A row's medium at one number of points.
#[derive(Clone, Debug)]
pub struct Answer {
    /// [mu_a, mu_s', g], mm^-1.
    pub medium: [f64; 3],
    /// d(mu_a, mu_s', g) / d(M_R, M_T, M_U); `None` where the readings leave a direction open.
    pub slopes: Option<[[f64; 3]; 3]>,
    /// What the model reads of the medium.
    pub readings: [f64; 2],
    pub lost: Lost,
    pub lost_se: Lost,
    pub status: &'static str,
    /// What should be known of a fit that stands.
    pub remark: String,
}

/// The medium behind a row.
pub fn answer<const N: usize>(case: &Case, level: &Level<N>, losses: &Losses) -> Result<Answer, Failure> {
    let Some(spot) = &case.spot else { return at_loss(case, level, case.measured.lost, case.measured.lost_se) };
    if spot.beam_mm > spot.ports_mm[0] {
        let must = "not be wider than the sample port: light beside the sample is no reading of it";
        return Err(Error::Range { name: "beam diameter (mm)", value: spot.beam_mm, must }.into());
    }
    // What is lost depends on the medium, and the medium on what is lost: both settle together.
    const ROUNDS: usize = 60;
    // Of the light; the standard errors of losses are a hundred times larger.
    const SETTLED: f64 = 1e-7;
    let (mut lost, mut se) = (Lost::default(), Lost::default());
    let mut last = at_loss(case, level, lost, se)?;
    let ports_let_out = |answer: &Answer| {
        let [mu_a, mu_s_prime, g] = answer.medium;
        losses.lost(&Slab { phase: PhaseFunction::henyey_greenstein(g), ..case.slab }, spot, mu_a, mu_s_prime)
    };
    for round in 0..ROUNDS {
        let (next, next_se) = ports_let_out(&last);
        let change = [0, 1].map(|i| (next.beam[i] - lost.beam[i]).abs().max((next.diffuse[i] - lost.diffuse[i]).abs()));
        se = next_se;
        if change[0].max(change[1]) <= SETTLED {
            let slopes = fed_back(case, level, &last, &ports_let_out);
            return Ok(Answer { slopes, lost_se: se, ..last });
        }
        // Plain steps settle where the loss follows the medium weakly; half steps where it does not.
        let share = if round < 12 { 1.0 } else { 0.5 };
        let towards = |a: [f64; 2], b: [f64; 2]| [0, 1].map(|i| a[i] + share * (b[i] - a[i]));
        lost = Lost { beam: towards(lost.beam, next.beam), diffuse: towards(lost.diffuse, next.diffuse) };
        last = at_loss(case, level, lost, se)?;
    }
    let [mu_a, mu_s_prime, _] = last.medium;
    let (next, _) = ports_let_out(&last);
    let residual = (next.beam[0] - lost.beam[0]).abs().max((next.beam[1] - lost.beam[1]).abs());
    Err(Error::NotConverged { best: [mu_a, mu_s_prime], residual }.into())
}

/// The slopes of an answer whose loss follows its medium: (1 + S Q L)^-1 S, with S those at a fixed loss, Q how the readings follow
/// the loss, and L how the loss follows mu_a and mu_s'.
fn fed_back<const N: usize>(
    case: &Case,
    level: &Level<N>,
    answer: &Answer,
    losses: &impl Fn(&Answer) -> (Lost, Lost),
) -> Option<[[f64; 3]; 3]> {
    let slopes = answer.slopes?;
    let by_loss = level.model(case).ok()?.slopes_by_loss(answer.medium[0], answer.medium[1], &answer.lost)?;
    let parts = |lost: Lost| [lost.beam[0], lost.beam[1], lost.diffuse[0], lost.diffuse[1]];
    let mut loop_gain = [[0.0; 2]; 2];
    for k in 0..2 {
        // A twentieth: across a good part of the interval between two nodes.
        let moved = |factor: f64| {
            let mut medium = answer.medium;
            medium[k] *= factor;
            parts(losses(&Answer { medium, ..answer.clone() }).0)
        };
        let x = answer.medium[k];
        if x == 0.0 {
            continue;
        }
        let (low, high) = (moved(0.95), moved(1.05));
        let by_medium: [f64; 4] = std::array::from_fn(|p| (high[p] - low[p]) / (0.1 * x));
        let read: [f64; 2] = std::array::from_fn(|i| (0..4).map(|p| by_loss[i][p] * by_medium[p]).sum());
        for i in 0..2 {
            loop_gain[i][k] = slopes[i][0] * read[0] + slopes[i][1] * read[1];
        }
    }
    let m = [[1.0 + loop_gain[0][0], loop_gain[0][1]], [loop_gain[1][0], 1.0 + loop_gain[1][1]]];
    let determinant = m[0][0] * m[1][1] - m[0][1] * m[1][0];
    let mut fed = slopes;
    for r in 0..3 {
        fed[0][r] = (m[1][1] * slopes[0][r] - m[0][1] * slopes[1][r]) / determinant;
        fed[1][r] = (m[0][0] * slopes[1][r] - m[1][0] * slopes[0][r]) / determinant;
    }
    fed.iter().flatten().all(|x| x.is_finite()).then_some(fed)
}

/// Less unscattered light than this is no reading: of 1e30 photons, which a kilowatt of light takes ten years to send, not one.
const FAINTEST: f64 = 1e-30;

/// The medium where this light is lost.
fn at_loss<const N: usize>(case: &Case, level: &Level<N>, lost: Lost, lost_se: Lost) -> Result<Answer, Failure> {
    let measured = Measurement { lost, lost_se, ..case.measured };
    if case.m_u.is_some() && case.light != Incidence::Normal {
        let at = "M_U is read along the normal; this row's beam is slanted: leave out M_U or the angle";
        return Err(Failure::Open("out_of_range", at.to_owned()));
    }
    if let Some((m_u, _)) = case.m_u
        && m_u < FAINTEST
    {
        let must = "be at least 1e-30: less is no light that can be seen; where none was, leave M_U out or write 0";
        return Err(Error::Range { name: "M_U", value: m_u, must }.into());
    }
    let read = case.read.iter().filter(|read| **read).count();
    match (case.known, case.m_u) {
        (Some(known), m_u) if read > 0 => on_line(case, level, &measured, known, m_u.map(|m| m.0)),
        (None, Some((m_u, _))) if read == 2 => with_g(case, level, &measured, m_u),
        (None, Some((m_u, _))) if read == 1 => {
            // M_U says mu_t, the other reading the albedo, for the g that is given.
            let tau = crate::unscattered_depth(&case.slab, m_u)?;
            on_line(case, level, &measured, Constraint::OpticalThickness(tau), None)
        }
        (None, None) if read == 2 => both(case, level, &measured),
        (None, None) if case.read[0] => {
            // A sample that nothing is known to come through: that of a half-space, its ratio.
            let error = level.experiment(case)?.solve(&Measurement { m_t: 0.0, lost: Lost::default(), ..measured });
            Err(error.map_or_else(Failure::from, |_| open("M_R alone has no answer here")))
        }
        (known, _) => {
            let with = known.map_or(String::new(), |known| format!(" and {}", known.name()));
            Err(open(&format!("one reading{with} cannot tell mu_a and mu_s'; read M_R and M_T, or give what is known")))
        }
    }
}

fn open(message: &str) -> Failure {
    Failure::Open("underdetermined", message.to_owned())
}

/// mu_a and mu_s' from M_R and M_T.
fn both<const N: usize>(case: &Case, level: &Level<N>, measured: &Measurement) -> Result<Answer, Failure> {
    let experiment = level.experiment(case)?;
    let solution = experiment.solve(measured)?;
    let Fit { mu_a_per_mm, mu_s_prime_per_mm, flags, .. } = solution.fit;
    let Flags { conservative, no_scatter, ambiguous } = flags;
    let status = match (conservative, no_scatter) {
        (false, false) if ambiguous => "ambiguous",
        (false, false) => "ok",
        (true, false) => "conservative",
        (false, true) => "no_scatter",
        (true, true) => "empty",
    };
    let remark = solution.other.map_or(String::new(), |[mu_a, mu_s_prime]| {
        format!("mu_a = {mu_a:.6} and mu_s' = {mu_s_prime:.6} mm^-1 give the same readings")
    });
    let slopes = solution.covariance.and(experiment.responses(measured, &solution.fit));
    let medium = [mu_a_per_mm, mu_s_prime_per_mm, case.slab.phase.g()];
    Ok(Answer {
        medium,
        slopes: slopes.map(|[a, s]| [[a[0], a[1], 0.0], [s[0], s[1], 0.0], [0.0; 3]]),
        readings: experiment.readings(mu_a_per_mm, mu_s_prime_per_mm, &measured.lost)?,
        lost: measured.lost,
        lost_se: measured.lost_se,
        status,
        remark,
    })
}

/// mu_a, mu_s' and g from M_R, M_T and M_U: slopes from how the solution moves with each reading.
fn with_g<const N: usize>(case: &Case, level: &Level<N>, measured: &Measurement, m_u: f64) -> Result<Answer, Failure> {
    let at = |g: f64, r: f64, t: f64, u: f64| -> Result<[f64; 3], Error> {
        let moved = Measurement { m_r: measured.m_r + r, m_t: measured.m_t + t, ..*measured };
        let found = solve_with_g::<N>(
            &Slab { phase: PhaseFunction::henyey_greenstein(g), ..case.slab },
            &case.instrument,
            &moved,
            m_u + u,
        )?;
        Ok([found.fit.mu_a_per_mm, found.fit.mu_s_prime_per_mm, found.g])
    };
    let medium = at(case.slab.phase.g(), 0.0, 0.0, 0.0)?;
    // What moves little is found from where it was.
    let at = |r: f64, t: f64, u: f64| at(medium[2], r, t, u);
    let slope = |r: f64, t: f64, u: f64| -> Option<[f64; 3]> {
        let (high, low) = (at(r, t, u).ok()?, at(-r, -t, -u).ok()?);
        let slope: [f64; 3] = std::array::from_fn(|i| 0.5 * (high[i] - low[i]) / (r + t + u));
        slope.iter().all(|x| x.is_finite()).then_some(slope)
    };
    // Small against the readings and what is left over for absorption, large against the 1e-8 of a fit.
    let h = 1e-5;
    let columns =
        (|| Some([slope(h * measured.m_r, 0.0, 0.0)?, slope(0.0, h * measured.m_t, 0.0)?, slope(0.0, 0.0, h * m_u)?]))(
        );
    Ok(Answer {
        medium,
        slopes: columns.map(|by| std::array::from_fn(|i| std::array::from_fn(|r| by[r][i]))),
        readings: level.readings(case, medium, &measured.lost)?,
        lost: measured.lost,
        lost_se: measured.lost_se,
        status: "ok",
        remark: String::new(),
    })
}

/// Readings without standard errors disagree beyond this: the last digit that laboratories write.
const DIGIT: f64 = 1e-3;

/// One unknown from the readings that are used.
fn on_line<const N: usize>(
    case: &Case,
    level: &Level<N>,
    measured: &Measurement,
    known: Constraint,
    m_u: Option<f64>,
) -> Result<Answer, Failure> {
    let wanted = [measured.m_r, measured.m_t];
    let ses = [measured.m_r_se, measured.m_t_se];
    let used = [0, 1].map(|i| case.used[i] && case.read[i]);
    if used == [false; 2] {
        return Err(open("the reading that `from` names was not taken"));
    }
    let weighs_errors = case.stated && (0..2).all(|i| !used[i] || ses[i] > 0.0);
    // Without errors deviations count relative to the reading, faint ones to a hundredth of the light.
    let weight = |i: usize| {
        let unit = if weighs_errors { ses[i] } else { wanted[i].abs().max(0.01) };
        if used[i] { 1.0 / (unit * unit) } else { 0.0 }
    };
    let weights = [weight(0), weight(1)];
    let line = Line::new(&case.slab, known, m_u)?;
    let read = |line: &Line, at: f64| level.readings(case, line.medium(at), &measured.lost);
    let met = meet(line.ends(), wanted, weights, |at| read(&line, at))?;
    let medium = line.medium(met.at);
    let readings = read(&line, met.at)?;
    let residuals = [0, 1].map(|i| readings[i] - wanted[i]);

    // Along the line, and with the line itself as M_U moves it.
    const H: f64 = 1e-5;
    let [low, high] = [-H, H].map(|h| line.medium(met.at + h));
    let along: [f64; 3] = std::array::from_fn(|i| (high[i] - low[i]) / (2.0 * H));
    let mut slopes = along.map(|x| [x * met.slopes[0], x * met.slopes[1], 0.0]);
    let mut complete = true;
    if let Some(m_u) = m_u {
        let moved = |by: f64| -> Result<[f64; 3], Failure> {
            let line = Line::new(&case.slab, known, Some(m_u + by))?;
            let met = meet(line.ends(), wanted, weights, |at| read(&line, at))?;
            Ok(line.medium(met.at))
        };
        match (moved(-H * m_u), moved(H * m_u)) {
            (Ok(low), Ok(high)) => (0..3).for_each(|i| slopes[i][2] = (high[i] - low[i]) / (2.0 * H * m_u)),
            _ => complete = false,
        }
    }
    let finite = slopes.iter().flatten().all(|x| x.is_finite());

    let beyond = if weighs_errors {
        let square: f64 = (0..2).map(|i| weights[i] * residuals[i] * residuals[i]).sum();
        square.sqrt() > measured.limit_sigmas
    } else {
        (0..2).any(|i| used[i] && residuals[i].abs() > DIGIT)
    };
    let disagree = beyond && used == [true; 2];
    let remark = if disagree {
        let alone = |name: &str, at: Option<f64>| {
            at.map_or(format!("{name} alone has no answer"), |at| {
                let [a, s, g] = line.medium(at);
                format!("{name} alone means mu_a = {a:.5}, mu_s' = {s:.5} mm^-1, g = {g:.4}")
            })
        };
        format!(
            "no medium with {} = {} gives both readings: this one misses M_R by {:+.4}, M_T by {:+.4}; {}, {}",
            known.name(),
            known.value(),
            residuals[0],
            residuals[1],
            alone("M_R", met.alone[0]),
            alone("M_T", met.alone[1])
        )
    } else {
        String::new()
    };
    Ok(Answer {
        medium,
        slopes: (finite && complete).then_some(slopes),
        readings,
        lost: measured.lost,
        lost_se: measured.lost_se,
        status: if disagree { "disagree" } else { "ok" },
        remark,
    })
}

/// Variances and covariances of (M_R, M_T, M_U) that the readings state, and those of the lost light.
pub fn noise<const N: usize>(case: &Case, level: &Level<N>, answer: &Answer) -> Option<[[[f64; 3]; 3]; 2]> {
    let Measurement { m_r_se, m_t_se, m_rt_cov, .. } = case.measured;
    let m_u_se = case.m_u.map_or(0.0, |m| m.1);
    let stated = [[m_r_se * m_r_se, m_rt_cov, 0.0], [m_rt_cov, m_t_se * m_t_se, 0.0], [0.0, 0.0, m_u_se * m_u_se]];
    let mut lost = [[0.0; 3]; 3];
    let se = answer.lost_se;
    if se != Lost::default() {
        let ses = [se.beam[0], se.beam[1], se.diffuse[0], se.diffuse[1]];
        let by = level.model(case).ok()?.slopes_by_loss(answer.medium[0], answer.medium[1], &answer.lost)?;
        for i in 0..2 {
            for j in 0..2 {
                lost[i][j] = (0..4).map(|p| by[i][p] * by[j][p] * ses[p] * ses[p]).sum();
            }
        }
    }
    Some([stated, lost])
}
