//! Quantities that are drawn: read, checked, and drawn.

use serde_json::Value;
use turbid_contract::Problems;
use turbid_draw::Distribution;
use turbid_optics::philox::unit;

use crate::params::{Drawn, Quantity};

/// What a quantity is drawn from.
pub enum Source {
    One(f64),
    From(Distribution),
}

/// Reads what stands at `path`; `above_zero`: a size. `None` where a mistake was found.
pub fn source<T: Quantity>(path: &str, drawn: &Drawn<T>, above_zero: bool, problems: &mut Problems) -> Option<Source> {
    let name = path.rsplit('.').find(|part| part.parse::<usize>().is_err()).unwrap_or(path);
    let map = match drawn {
        Drawn::One(one) => {
            let one = one.number();
            let holds = !above_zero || one > 0.0;
            problems.require(holds, path, one, T::UNIT, "be > 0");
            return holds.then_some(Source::One(one + 0.0));
        }
        Drawn::From(map) => map,
    };
    let distribution = match Distribution::read(&Value::Object(map.clone())) {
        Ok(distribution) => distribution,
        Err(mistakes) => {
            for mistake in mistakes {
                let path = [path.to_owned()].into_iter().chain(mistake.path).collect::<Vec<_>>().join(".");
                match mistake.hint {
                    Some(hint) => problems.push_with_hint(path, mistake.message, hint),
                    None => problems.push(path, mistake.message),
                }
            }
            return None;
        }
    };
    if let Some(other) = distribution.expressions().flat_map(|e| e.names()).next() {
        let message = format!("`{other}` is no number: nothing is drawn beside it here");
        problems.push_with_hint(path, message, format!("a name that `draw` gives is written \"${{{other}}}\""));
        return None;
    }
    if !distribution.is_numeric() {
        problems.push(path, format!("{name} may be drawn as a text, but must be a number in {}", T::UNIT));
        return None;
    }
    // The least that a number of 32 bits can draw: quantiles rise.
    let source = Source::From(distribution);
    let least = source.at(unit(0));
    if above_zero && least <= 0.0 {
        problems.push_with_hint(
            path,
            format!("{name} may be drawn as {least} {}, but must be > 0", T::UNIT),
            "cut it off: add `within: [least, most]` with `least` above 0",
        );
        return None;
    }
    Some(source)
}

impl Source {
    /// The value below which the share `u` lies.
    pub fn at(&self, u: f64) -> f64 {
        match self {
            Self::One(one) => *one,
            Self::From(distribution) => {
                let value = distribution.quantile(u, &|name| unreachable!("`{name}` was refused"));
                // Reading has drawn one value of constants, which does not depend on u in whether it can be.
                value.ok().and_then(|value| value.as_f64()).unwrap_or(f64::NAN) + 0.0
            }
        }
    }
}
