//! Distributions of one drawn quantity, by their quantile functions.

use serde_json::{Number, Value};

use crate::expression::Expression;
use crate::{beta, normal};

/// A distribution whose numbers may depend on other drawn numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct Distribution {
    pub kind: Kind,
    /// Only what lies in [first, last] is drawn: the distribution is cut off there, not piled up.
    pub within: Option<[Expression; 2]>,
}

#[derive(Clone, Debug, PartialEq)]
pub enum Kind {
    /// [first, last]
    Uniform([Expression; 2]),
    /// Uniform in the logarithm; both above 0.
    Loguniform([Expression; 2]),
    /// Mean and standard deviation.
    Normal([Expression; 2]),
    /// Median and standard deviation of the natural logarithm.
    Lognormal([Expression; 2]),
    /// Shapes, and the ends of the interval that it lives on.
    Beta { shapes: [f64; 2], on: [Expression; 2] },
    /// Whole numbers, both ends included.
    Integer([Expression; 2]),
    /// Values with their weights (above 0).
    Choice(Vec<(Value, f64)>),
}

/// A smaller share of a distribution than this cannot be drawn: the digits of its quantiles run out.
const LEAST_SHARE: f64 = 1e-12;

impl Kind {
    /// What a file calls it.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Uniform(_) => "uniform",
            Self::Loguniform(_) => "loguniform",
            Self::Normal(_) => "normal",
            Self::Lognormal(_) => "lognormal",
            Self::Beta { .. } => "beta",
            Self::Integer(_) => "integer",
            Self::Choice(_) => "choice",
        }
    }
}

impl Distribution {
    /// The numbers that it is made of.
    pub fn expressions(&self) -> impl Iterator<Item = &Expression> {
        let own: &[Expression] = match &self.kind {
            Kind::Uniform(pair)
            | Kind::Loguniform(pair)
            | Kind::Normal(pair)
            | Kind::Lognormal(pair)
            | Kind::Integer(pair)
            | Kind::Beta { on: pair, .. } => pair,
            Kind::Choice(_) => &[],
        };
        own.iter().chain(self.within.iter().flatten())
    }

    /// Whether its values are numbers.
    pub fn is_numeric(&self) -> bool {
        match &self.kind {
            Kind::Choice(values) => values.iter().all(|(value, _)| value.is_number()),
            _ => true,
        }
    }

    /// The value below which the share `u` in (0, 1) lies; `number` must know every name in [`Self::expressions`].
    ///
    /// Error: numbers that make no distribution, in words.
    pub fn quantile(&self, u: f64, number: &dyn Fn(&str) -> f64) -> Result<Value, String> {
        let pair = |pair: &[Expression; 2]| [pair[0].value(number), pair[1].value(number)];
        let within = self.within.as_ref().map(pair);
        if let Some([first, last]) = within.filter(|[first, last]| !ordered(*first, *last)) {
            return Err(format!("within takes [first, last] with first < last, not [{first}, {last}]"));
        }
        let x = match &self.kind {
            Kind::Choice(values) => return Ok(choose(values, u).clone()),
            Kind::Integer(ends) => return integer(pair(ends), within, u),
            Kind::Uniform(ends) => {
                let [first, last] = cut(interval("uniform", pair(ends))?, within)?;
                first + u * (last - first)
            }
            Kind::Loguniform(ends) => {
                let [first, last] = pair(ends);
                if !(ordered(first, last) && first > 0.0) {
                    return Err("loguniform takes [first, last] with first < last, both above 0".to_owned());
                }
                let [first, last] = cut([first, last], within)?;
                let logs = [libm::log(first), libm::log(last)];
                libm::exp(logs[0] + u * (logs[1] - logs[0])).clamp(first, last)
            }
            Kind::Normal(params) => {
                let [mean, sigma] = pair(params);
                let sigma = deviation("normal", mean, sigma)?;
                match within {
                    None => mean + sigma * normal::quantile(u),
                    Some([first, last]) => {
                        let ends = [(first - mean) / sigma, (last - mean) / sigma];
                        holds(normal::share(ends[0], ends[1]))?;
                        (mean + sigma * normal::quantile_within(u, ends[0], ends[1])).clamp(first, last)
                    }
                }
            }
            Kind::Lognormal(params) => {
                let [median, sigma] = pair(params);
                let sigma = deviation("lognormal", median, sigma)?;
                if median <= 0.0 {
                    return Err(format!("the median of lognormal must lie above 0, not {median}"));
                }
                match within {
                    None => median * libm::exp(sigma * normal::quantile(u)),
                    Some([first, last]) => {
                        if last <= 0.0 {
                            return Err(format!("lognormal lies above 0, but within ends at {last}"));
                        }
                        let score = |x: f64| {
                            if x > 0.0 { libm::log(x / median) / sigma } else { f64::NEG_INFINITY }
                        };
                        let ends = [score(first), score(last)];
                        holds(normal::share(ends[0], ends[1]))?;
                        let x = median * libm::exp(sigma * normal::quantile_within(u, ends[0], ends[1]));
                        x.clamp(first, last)
                    }
                }
            }
            Kind::Beta { shapes: [alpha, beta], on } => {
                let [first, last] = interval("on", pair(on))?;
                let [from, to] = match within {
                    None => [0.0, 1.0],
                    Some(ends) => {
                        let ends = cut([first, last], Some(ends))?;
                        ends.map(|end| beta::below((end - first) / (last - first), *alpha, *beta))
                    }
                };
                holds(to - from)?;
                let x = first + (last - first) * beta::quantile(from + u * (to - from), *alpha, *beta);
                within.map_or(x, |[first, last]| x.clamp(first, last))
            }
        };
        finite(x)
    }
}

fn ordered(first: f64, last: f64) -> bool {
    first < last && first.is_finite() && last.is_finite()
}

fn interval(name: &str, [first, last]: [f64; 2]) -> Result<[f64; 2], String> {
    if ordered(first, last) && (last - first).is_finite() {
        return Ok([first, last]);
    }
    Err(format!("{name} takes [first, last] with first < last"))
}

/// What two intervals share.
fn cut([first, last]: [f64; 2], within: Option<[f64; 2]>) -> Result<[f64; 2], String> {
    let Some([from, to]) = within else { return Ok([first, last]) };
    let shared = [first.max(from), last.min(to)];
    if shared[0] < shared[1] {
        return Ok(shared);
    }
    Err(format!("[{first}, {last}] has nothing within [{from}, {to}]"))
}

fn deviation(name: &str, middle: f64, sigma: f64) -> Result<f64, String> {
    if sigma > 0.0 && sigma.is_finite() && middle.is_finite() {
        return Ok(sigma);
    }
    Err(format!("sigma of {name} must lie above 0, not {sigma}"))
}

fn holds(share: f64) -> Result<(), String> {
    if share >= LEAST_SHARE {
        return Ok(());
    }
    Err(format!("within holds a share of {share:e} of the distribution, less than {LEAST_SHARE:e}"))
}

fn integer(ends: [f64; 2], within: Option<[f64; 2]>, u: f64) -> Result<Value, String> {
    let [from, to] = within.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
    let [first, last] = [ends[0].max(from).ceil(), ends[1].min(to).floor()];
    // Beyond 2^53 neighbouring whole numbers are one double.
    const LARGEST: f64 = 9_007_199_254_740_992.0;
    if !(first <= last && first >= -LARGEST && last <= LARGEST) {
        return Err(format!("integer has no whole number from {} to {}", ends[0].max(from), ends[1].min(to)));
    }
    let drawn = first + (u * (last - first + 1.0)).floor().min(last - first);
    Ok(Value::from(drawn as i64))
}

fn choose(values: &[(Value, f64)], u: f64) -> &Value {
    let whole: f64 = values.iter().map(|(_, weight)| weight).sum();
    let mut left = u * whole;
    let found = values.iter().find(|(_, weight)| {
        left -= weight;
        left < 0.0
    });
    // Rounding may leave a trace behind the last.
    &found.or(values.last()).expect("a choice has values").0
}

pub(crate) fn finite(x: f64) -> Result<Value, String> {
    Number::from_f64(x).map(Value::Number).ok_or_else(|| format!("the value {x} is not finite"))
}
