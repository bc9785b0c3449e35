//! Values of one axis: a list, `linspace`, `logspace`, `range`; numbers come out as a person would write them.

use std::collections::HashSet;

use serde_json::{Number, Value};

use super::node::{Data, Node};
use super::parse::join;
use super::reader::{Meant, Reader};
use super::scalar::normal;
use super::source::Span;

/// More axes than this on one stage are a mistake.
pub const MAX_AXES: usize = 100;

/// More instances than this are a mistake.
pub const MAX_INSTANCES: usize = 1_000_000;

pub const SPACINGS: [&str; 3] = ["linspace", "logspace", "range"];

/// Values of all axes of a pipeline's instances together: more are a mistake, and would take gigabytes.
pub const MAX_VALUES: usize = 4_000_000;

/// How many values an axis is going to have, without making them; 0 where it is wrong, which [`values`] reports.
pub fn count(node: &Node) -> usize {
    match &node.data {
        Data::List(items) => items.len(),
        Data::Map(entries) => match entries.as_slice() {
            [one] if SPACINGS.contains(&one.key.as_str()) => {
                let Data::List(items) = &one.value.data else { return 0 };
                let number = |item: &Node| if let Data::Number(n) = &item.data { n.as_f64() } else { None };
                let numbers: Option<Vec<f64>> = items.iter().take(4).map(number).collect();
                let count = numbers.as_deref().and_then(|numbers| match (one.key.as_str(), numbers) {
                    ("range", &[first, last]) => steps(first, last, if last < first { -1.0 } else { 1.0 }).ok(),
                    ("range", &[first, last, step]) => steps(first, last, step).ok(),
                    ("linspace" | "logspace", &[_, _, count]) => Some(count),
                    _ => None,
                });
                count.map_or(0, |count| count as usize)
            }
            _ => 0,
        },
        _ => 0,
    }
}

/// Reads the values of an axis; `None` if they are wrong and reported.
pub fn values(node: &Node, key: Span, path: &str, reader: &mut Reader<'_>) -> Option<Vec<Value>> {
    let rule = "a list of values, or one of {linspace: [first, last, count]}, {logspace: [first, last, count]}, \
                {range: [first, last, step]}, {csv: file}";
    let found = match &node.data {
        Data::List(items) => {
            let scalars = items.iter().enumerate().map(|(i, item)| scalar(item, &join(path, &i.to_string()), reader));
            scalars.collect::<Vec<_>>().into_iter().collect::<Option<Vec<_>>>()?
        }
        Data::Map(entries) => match entries.as_slice() {
            [one] if SPACINGS.contains(&one.key.as_str()) => {
                let path = join(path, &one.key);
                let numbers = numbers(&one.value, one.at, &path, reader)?;
                match spaced(&one.key, &numbers) {
                    Ok(values) => values,
                    Err(message) => {
                        reader.error(one.value.span, &path, message, None);
                        return None;
                    }
                }
            }
            [one, ..] if one.key == "draw" => {
                let hint =
                    "write `foreach: {draw: {n: .., method: .., NAME: {uniform: [..]}}}`: all drawn names are one axis";
                reader.error(one.at, path, "`draw` is no value of an axis: it is an axis of its own", hint.to_owned());
                return None;
            }
            _ => {
                reader.known_keys(node, path, &["linspace", "logspace", "range", "csv"], "an axis");
                if entries.len() != 1 {
                    reader.error(key, path, format!("an axis takes one of {rule}"), None);
                }
                return None;
            }
        },
        _ => {
            reader.wrong(node, key, path, rule);
            return None;
        }
    };
    if found.is_empty() {
        reader.error(node.span, path, "an axis needs at least one value", None);
        return None;
    }
    Some(found)
}

/// Reports the first value that stands twice; whether all are distinct.
pub fn distinct(values: &[Value], node: &Node, key: Span, path: &str, reader: &mut Reader<'_>) -> bool {
    // Most are ranges.
    if values.is_sorted_by(|a, b| a.as_f64().zip(b.as_f64()).is_some_and(|(a, b)| a < b)) {
        return true;
    }
    let mut seen = HashSet::new();
    let Some(twice) = values.iter().find(|v| !seen.insert(v.to_string())) else { return true };
    let place = if node.span.len == 0 { key } else { node.span };
    reader.error(place, path, format!("the value {twice} stands twice on this axis"), None);
    false
}

/// One value of an axis: a number, a text, true or false.
pub fn scalar(node: &Node, path: &str, reader: &mut Reader<'_>) -> Option<Value> {
    match &node.data {
        Data::Bool(_) | Data::Text { .. } => Some(node.to_json()),
        Data::Number(n) => Some(normal(n)),
        _ => {
            let rule = "a number, a text, true or false (to sweep lists, pair axes of their numbers by `zip`)";
            reader.wrong(node, node.span, path, rule);
            None
        }
    }
}

/// Finite numbers from a list of them.
pub fn numbers(node: &Node, key: Span, path: &str, reader: &mut Reader<'_>) -> Option<Vec<f64>> {
    let Data::List(items) = &node.data else {
        reader.wrong(node, key, path, "a list of numbers");
        return None;
    };
    let mut found = Vec::new();
    for (i, item) in items.iter().enumerate() {
        match &item.data {
            Data::Number(n) => found.extend(n.as_f64()),
            _ => reader.wrong_as(item, node.span, &join(path, &i.to_string()), "a number", Meant::Number),
        }
    }
    (found.len() == items.len()).then_some(found)
}

fn spaced(kind: &str, numbers: &[f64]) -> Result<Vec<Value>, String> {
    match (kind, numbers) {
        ("range", &[first, last]) => range(first, last, if last < first { -1.0 } else { 1.0 }),
        ("range", &[first, last, step]) => range(first, last, step),
        ("range", _) => Err("range takes [first, last] or [first, last, step]".to_owned()),
        (_, &[first, last, count]) => {
            if count.fract() != 0.0 || count < 1.0 {
                return Err(format!("count = {count} must be a whole number, 1 or more"));
            }
            if count > MAX_INSTANCES as f64 {
                return Err(format!("{count} values are more than {MAX_INSTANCES} instances"));
            }
            if kind == "logspace" && !(first > 0.0 && last > 0.0) {
                return Err(format!(
                    "the ends of a logspace are values (not exponents) above 0, not {first} and {last}"
                ));
            }
            if (count == 1.0) != (first == last) {
                return Err(format!("{count} values cannot reach from {first} to {last}, both ends included"));
            }
            let n = count as usize;
            let value = |i: usize| match i {
                0 => first,
                _ if i + 1 == n => last,
                _ if kind == "linspace" => rounded(first + (last - first) * (i as f64 / (n - 1) as f64)),
                _ => rounded(first * libm::pow(last / first, i as f64 / (n - 1) as f64)),
            };
            (0..n).map(|i| finite(value(i))).collect()
        }
        _ => Err(format!("{kind} takes [first, last, count]")),
    }
}

/// [first, last): a last step that ends within 1e-9 steps of `last` is `last` and left out.
fn range(first: f64, last: f64, step: f64) -> Result<Vec<Value>, String> {
    let n = steps(first, last, step)?;
    if n > MAX_INSTANCES as f64 {
        return Err(format!("this range has {n} values, more than {MAX_INSTANCES} instances"));
    }
    (0..n as usize).map(|i| finite(if i == 0 { first } else { rounded(first + i as f64 * step) })).collect()
}

/// How many values there are in [first, last).
fn steps(first: f64, last: f64, step: f64) -> Result<f64, String> {
    let steps = (last - first) / step;
    if !(steps.is_finite() && steps > 0.0) {
        return Err(format!("range [{first}, {last}, {step}] never goes from its first to its last value"));
    }
    Ok((steps - 1e-9).ceil().max(1.0))
}

/// 15 significant digits: 0.3 rather than 0.30000000000000004, so that `where: {x: 0.3}` finds it.
fn rounded(x: f64) -> f64 {
    format!("{x:.14e}").parse().unwrap_or(x)
}

fn finite(x: f64) -> Result<Value, String> {
    Number::from_f64(x).map(|n| normal(&n)).ok_or_else(|| "the values leave the range of numbers".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn list(kind: &str, numbers: &[f64]) -> Value {
        spaced(kind, numbers).map_or_else(Value::String, Value::Array)
    }

    #[test]
    fn spacings_hold_the_values_a_person_would_write() {
        assert_eq!(list("linspace", &[0.0, 1.0, 11.0])[3], json!(0.3));
        assert_eq!(list("linspace", &[16.0, 64.0, 4.0]), json!([16, 32, 48, 64]));
        assert_eq!(list("logspace", &[1e-3, 1.0, 4.0]), json!([0.001, 0.01, 0.1, 1]));
        assert_eq!(list("logspace", &[1.0, 1e4, 5.0]), json!([1, 10, 100, 1000, 10000]));
        assert_eq!(list("range", &[0.0, 5.0]), json!([0, 1, 2, 3, 4]));
        assert_eq!(list("range", &[1.0, 1.3, 0.1]), json!([1, 1.1, 1.2]));
        assert_eq!(list("range", &[3.0, 0.0, -1.0]), json!([3, 2, 1]));
        assert_eq!(list("linspace", &[2.0, 2.0, 1.0]), json!([2]));
    }

    /// Both ends are exact, values rise, and there are as many as asked for.
    #[test]
    fn linspace_and_logspace_keep_their_ends() {
        for kind in ["linspace", "logspace"] {
            for (first, last, n) in [(0.1, 0.7, 7), (1e-9, 3e7, 1000), (5.0, 1e-3, 13)] {
                let Value::Array(values) = list(kind, &[first, last, f64::from(n)]) else { panic!("{kind}") };
                let x: Vec<f64> = values.iter().map(|v| v.as_f64().unwrap()).collect();
                assert_eq!((x[0], x[x.len() - 1], x.len()), (first, last, n as usize));
                assert!(x.windows(2).all(|w| (w[1] > w[0]) == (last > first)), "{kind} {first} {last}");
            }
        }
    }

    #[test]
    fn impossible_spacings_are_refused_without_being_made() {
        for (kind, numbers, says) in [
            ("linspace", vec![0.0, 1.0, 1e15], "more than 1000000"),
            ("range", vec![0.0, 1e300], "more than 1000000"),
            ("range", vec![0.0, 1.0, -0.1], "never goes"),
            ("range", vec![0.0, 1.0, 0.0], "never goes"),
            ("range", vec![0.0, 0.0], "never goes"),
            ("logspace", vec![0.0, 1.0, 3.0], "above 0"),
            ("linspace", vec![0.0, 1.0, 1.0], "both ends included"),
            ("linspace", vec![0.0, 1.0, 2.5], "whole number"),
            ("linspace", vec![-1e308, 1e308, 3.0], "leave the range"),
            ("linspace", vec![0.0, 1.0], "takes [first, last, count]"),
        ] {
            let found = list(kind, &numbers);
            assert!(found.as_str().is_some_and(|m| m.contains(says)), "{kind} {numbers:?}: {found}");
        }
    }
}
