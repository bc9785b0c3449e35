//! Nice ticks: multiples of 1, 2, 2.5 or 5 times a power of ten inside a range, and their labels.

use super::number::{decimal, exponent_of};

/// Ticks of an axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Ticks {
    /// Ascending, inside the range.
    pub values: Vec<f64>,
    /// One per value: the value divided by 10^exponent, all with the same number of decimals.
    pub labels: Vec<String>,
    /// Common power of ten of the labels; 0 where the plain numbers are short.
    pub exponent: i32,
}

/// At most `most` (>= 2) ticks in [low, high], finite and low < high.
pub fn ticks(low: f64, high: f64, most: usize) -> Ticks {
    assert!(low.is_finite() && high.is_finite() && low < high && most >= 2, "ticks from {low} to {high}");
    // A range that only some tens of units in the last place wide holds no more digits than those.
    let first_power = exponent_of((high - low) / most as f64) - 2;
    let (mantissas, power) = (first_power..)
        .flat_map(|power| [10, 20, 25, 50].map(|step| (step, power)))
        .find_map(|(step, power)| {
            let size = scaled(step, power);
            let (first, last) = ((low / size).floor(), (high / size).ceil());
            if last - first > 2.0 * most as f64 {
                return None;
            }
            // The divisions may have rounded across a tick: the ticks themselves decide.
            let inside = |m: &i64| (low..=high).contains(&scaled(*m, power));
            let all: Vec<i64> = (first as i64..=last as i64).map(|i| i * step).filter(inside).collect();
            (all.len() <= most).then_some((all, power))
        })
        .expect("steps grow until few enough ticks are left");
    let largest = exponent_of(low.abs().max(high.abs()));
    let exponent = if (-3..5).contains(&largest) { 0 } else { largest };
    let places = mantissas.iter().map(|&m| decimals(m, power - exponent)).max().unwrap_or(0);
    Ticks {
        values: mantissas.iter().map(|&m| scaled(m, power)).collect(),
        labels: mantissas.iter().map(|&m| decimal(m, power - exponent, places)).collect(),
        exponent,
    }
}

/// mantissa x 10^power, rounded once.
fn scaled(mantissa: i64, power: i32) -> f64 {
    format!("{mantissa}e{power}").parse().expect("a whole number with an exponent is a number")
}

/// Digits behind the point that mantissa x 10^power needs.
fn decimals(mut mantissa: i64, mut power: i32) -> usize {
    while power < 0 && mantissa % 10 == 0 {
        mantissa /= 10;
        power += 1;
    }
    usize::try_from(-power).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const RANGES: [(f64, f64); 13] = [
        (0.0, 1.0),
        (0.021, 0.0263),
        (-12.5, 40.0),
        (-1e-30, 1e-30),
        (1e-45, 3e-45),
        (-3.4e38, 3.4e38),
        (1.0, 1.000_000_2),
        (16_777_216.0, 16_777_218.0),
        (99.0, 101.0),
        (0.1, 0.3),
        (-0.5, -0.1),
        (0.0, 7e4),
        (123_456.0, 654_321.0),
    ];

    /// Inside, equally spaced by a nice step, neither too few nor too many.
    #[test]
    fn ticks_are_nice_and_inside() {
        for (low, high) in RANGES {
            for most in [2, 3, 5, 8] {
                let t = ticks(low, high, most);
                assert!(t.values.len() <= most && t.values.len() * 5 >= most * 2 - 4, "{low}..{high}, {most}: {t:?}");
                assert!(t.values.iter().all(|v| (low..=high).contains(v)), "{low}..{high}: {t:?}");
                for pair in t.values.windows(2) {
                    let step = pair[1] - pair[0];
                    let digits = step / scaled(1, exponent_of(step));
                    let ulp = f64::EPSILON * pair[1].abs().max(pair[0].abs()) / step;
                    let nice = [1.0, 2.0, 2.5, 5.0, 10.0];
                    let near = |n: &&f64| (*n - digits).abs() < 20.0 * (ulp + f64::EPSILON);
                    assert!(nice.iter().any(|n| near(&n)), "{low}..{high}: step {step}");
                }
            }
        }
    }

    /// Label x 10^exponent is the tick, to the last digit.
    #[test]
    fn labels_say_the_value() {
        for (low, high) in RANGES {
            let t = ticks(low, high, 6);
            for (value, label) in t.values.iter().zip(&t.labels) {
                let read: f64 = format!("{}e{}", label.replace('−', "-"), t.exponent).parse().unwrap();
                assert_eq!(read, *value, "{low}..{high}: {label}");
            }
        }
        // As a reader sees them: one zero is enough.
        assert_eq!(ticks(0.0, 70.0, 5).labels, ["0", "20", "40", "60"]);
        assert_eq!(ticks(-300.0, 300.0, 5).labels, ["−200", "0", "200"]);
        assert_eq!(ticks(0.0, 7e4, 5).labels, ["0", "20000", "40000", "60000"]);
        assert_eq!(ticks(0.0, 1.0, 6).labels, ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(ticks(-2e-5, 2e-5, 5).labels, ["−2", "−1", "0", "1", "2"]);
    }
}
