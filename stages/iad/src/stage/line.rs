//! One unknown: the media that a known coefficient leaves, and the one of them that explains the readings.

use crate::{Error, Slab, unscattered_depth};

/// What is known of a sample beforehand; coefficients in mm^-1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Constraint {
    MuA(f64),
    MuSPrime(f64),
    MuS(f64),
    Albedo(f64),
    /// (mu_a + mu_s) x thickness.
    OpticalThickness(f64),
}

impl Constraint {
    pub fn value(&self) -> f64 {
        let (Self::MuA(x) | Self::MuSPrime(x) | Self::MuS(x) | Self::Albedo(x) | Self::OpticalThickness(x)) = self;
        *x
    }

    pub fn name(&self) -> &'static str {
        match self {
            Self::MuA(_) => "mu_a",
            Self::MuSPrime(_) => "mu_s_prime",
            Self::MuS(_) => "mu_s",
            Self::Albedo(_) => "albedo",
            Self::OpticalThickness(_) => "optical_thickness",
        }
    }

    pub fn unit(&self) -> &'static str {
        match self {
            Self::MuA(_) | Self::MuSPrime(_) | Self::MuS(_) => "mm^-1",
            Self::Albedo(_) | Self::OpticalThickness(_) => "",
        }
    }

    /// The rule that the value breaks.
    pub fn check(&self) -> Result<(), &'static str> {
        let x = self.value();
        match self {
            Self::Albedo(_) if !(0.0..=1.0).contains(&x) => Err("lie in [0, 1]"),
            Self::OpticalThickness(_) if !(x > 0.0 && x.is_finite()) => Err("be a finite number > 0"),
            _ if !(x >= 0.0 && x.is_finite()) => Err("be a finite number >= 0"),
            _ => Ok(()),
        }
    }
}

/// The media that are left, as a curve: (mu_a, mu_s', g) over a parameter along which light comes back ever more, or ever less.
#[derive(Clone, Copy, Debug)]
pub struct Line {
    known: Constraint,
    g: f64,
    /// From M_U, mm^-1; then g is unknown, too.
    mu_t: Option<f64>,
    thickness_mm: f64,
}

/// ln of the smallest and of the largest optical depth that is looked for.
const DEPTHS: [f64; 2] = [-40.0, 10.0];
/// ln(1 - g) at the ends of what is looked for, as in the search with M_U.
const ANISOTROPY: [f64; 2] = [-20.723_265_836_946_41, 0.683_096_844_706_443_9];

impl Line {
    pub fn new(slab: &Slab, known: Constraint, m_u: Option<f64>) -> Result<Self, Error> {
        let mu_t = m_u.map(|m_u| unscattered_depth(slab, m_u).map(|tau| tau / slab.thickness_mm)).transpose()?;
        let line = Self { known, g: slab.phase.g(), mu_t, thickness_mm: slab.thickness_mm };
        if let Some(mu_t) = mu_t {
            let used = match known {
                Constraint::MuA(x) | Constraint::MuS(x) => x,
                Constraint::MuSPrime(x) => x / 1.98,
                Constraint::Albedo(_) | Constraint::OpticalThickness(_) => 0.0,
            };
            if used >= mu_t {
                let [mu_a, mu_s_prime] = match known {
                    Constraint::MuA(x) => [x, 0.0],
                    Constraint::MuS(x) | Constraint::MuSPrime(x) => [0.0, x],
                    _ => [0.0; 2],
                };
                return Err(Error::Inconsistent {
                    mu_t_per_mm: mu_t,
                    mu_a_per_mm: mu_a,
                    mu_s_prime_per_mm: mu_s_prime,
                });
            }
        }
        Ok(line)
    }

    /// The ends of its parameter.
    pub fn ends(&self) -> [f64; 2] {
        let ln_d = libm::log(self.thickness_mm);
        match (self.known, self.mu_t) {
            (Constraint::MuSPrime(s), Some(mu_t)) => [DEPTHS[0] - ln_d, libm::log(mu_t - s / 1.98)],
            (Constraint::OpticalThickness(_), _) => [DEPTHS[0], 0.0],
            (_, Some(_)) => ANISOTROPY,
            (_, None) => DEPTHS.map(|x| x - ln_d),
        }
    }

    /// [mu_a, mu_s', g] there.
    pub fn medium(&self, at: f64) -> [f64; 3] {
        let x = libm::exp(at);
        let scattered = |mu_s: f64| mu_s * (1.0 - self.g);
        match (self.known, self.mu_t) {
            (Constraint::MuA(a), None) => [a, x, self.g],
            (Constraint::MuSPrime(s), None) => [x, s, self.g],
            (Constraint::MuS(s), None) => [x, scattered(s), self.g],
            (Constraint::Albedo(w), None) => [(1.0 - w) * x, scattered(w * x), self.g],
            (Constraint::OpticalThickness(b), _) => {
                let mu_t = b / self.thickness_mm;
                [x * mu_t, scattered(-libm::expm1(at) * mu_t), self.g]
            }
            (Constraint::MuA(a), Some(mu_t)) => [a, (mu_t - a) * x, 1.0 - x],
            (Constraint::MuS(s), Some(mu_t)) => [mu_t - s, s * x, 1.0 - x],
            (Constraint::Albedo(w), Some(mu_t)) => [(1.0 - w) * mu_t, w * mu_t * x, 1.0 - x],
            (Constraint::MuSPrime(s), Some(mu_t)) => [x, s, 1.0 - s / (mu_t - x)],
        }
    }
}

/// Where on a line readings are met.
#[derive(Clone, Copy, Debug)]
pub struct Met {
    pub at: f64,
    /// Where each reading alone would be met; `None` for one that is not used or out of reach.
    pub alone: [Option<f64>; 2],
    /// d(at) / d(M_R, M_T).
    pub slopes: [f64; 2],
}

/// The place on `ends` whose readings are nearest to `wanted`, squares weighted by `weights` (0: not used).
///
/// Each reading is monotonic along the line, so the best place lies between those of the single readings.
pub fn meet(
    ends: [f64; 2],
    wanted: [f64; 2],
    weights: [f64; 2],
    readings: impl Fn(f64) -> Result<[f64; 2], Error>,
) -> Result<Met, Error> {
    const NAMES: [&str; 2] = ["M_R", "M_T"];
    let [first, last] = [readings(ends[0])?, readings(ends[1])?];
    let mut failure = Ok(());
    let mut alone = [None; 2];
    let mut nearest = [None; 2];
    for i in (0..2).filter(|&i| weights[i] > 0.0) {
        let (min, max) = (first[i].min(last[i]), first[i].max(last[i]));
        let rises = last[i] > first[i];
        if !(min..=max).contains(&wanted[i]) {
            failure = failure.and(Err(Error::OutOfReach { name: NAMES[i], value: wanted[i], min, max }));
            nearest[i] = Some(if (wanted[i] > max) == rises { ends[1] } else { ends[0] });
            continue;
        }
        let [mut low, mut high] = ends;
        for _ in 0..64 {
            let middle = 0.5 * (low + high);
            if readings(middle).is_ok_and(|m| (m[i] < wanted[i]) == rises) {
                low = middle;
            } else {
                high = middle;
            }
        }
        alone[i] = Some(0.5 * (low + high));
        nearest[i] = alone[i];
    }
    if alone == [None; 2] {
        failure?;
    }
    let at = match nearest {
        [Some(a), Some(b)] => least_squares(a.min(b), a.max(b), |at| {
            readings(at).map_or(f64::INFINITY, |m| {
                (0..2).map(|i| weights[i] * (m[i] - wanted[i]) * (m[i] - wanted[i])).sum::<f64>()
            })
        }),
        [a, b] => a.or(b).unwrap_or(ends[0]),
    };
    // A central difference: its error is the square of this.
    const H: f64 = 1e-5;
    let around = [(at - H).max(ends[0]), (at + H).min(ends[1])];
    let [low, high] = [readings(around[0])?, readings(around[1])?];
    let by: [f64; 2] = std::array::from_fn(|i| (high[i] - low[i]) / (around[1] - around[0]));
    let sum = (0..2).map(|i| weights[i] * by[i] * by[i]).sum::<f64>();
    Ok(Met { at, alone, slopes: std::array::from_fn(|i| weights[i] * by[i] / sum) })
}

/// The place of the least value between two others, by golden sections.
fn least_squares(mut low: f64, mut high: f64, value: impl Fn(f64) -> f64) -> f64 {
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    let mut inner = [high - GOLDEN * (high - low), low + GOLDEN * (high - low)];
    let mut values = inner.map(&value);
    for _ in 0..60 {
        if values[0] < values[1] {
            high = inner[1];
            inner = [high - GOLDEN * (high - low), inner[0]];
            values = [value(inner[0]), values[0]];
        } else {
            low = inner[0];
            inner = [inner[1], low + GOLDEN * (high - low)];
            values = [values[1], value(inner[1])];
        }
    }
    0.5 * (low + high)
}
