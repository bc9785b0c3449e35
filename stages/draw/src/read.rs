//! Reading a draw from the map that a file states.

use std::collections::BTreeSet;

use serde_json::{Map, Value};

use crate::condition;
use crate::distribution::{Distribution, Kind};
use crate::draw::{Draw, Quantity, Source};
use crate::expression::Expression;
use crate::mistake::{At, Mistake};
use crate::sobol::DIMENSIONS;
use crate::unit::Method;

/// Keys of a draw that are no names.
const RESERVED: [&str; 3] = ["n", "method", "only"];
const DISTRIBUTIONS: [&str; 7] = ["uniform", "loguniform", "normal", "lognormal", "beta", "integer", "choice"];
const DISTRIBUTION: &str = "a distribution, such as {uniform: [0, 1]}, {loguniform: [0.01, 1]}, {normal: {mean: 0, \
    sigma: 1}}, {lognormal: {median: 1, sigma: 0.5}}, {beta: {alpha: 2, beta: 5}}, {integer: [1, 6]}, {choice: {a: 3, \
    b: 1}}; or {group: 400}, {product: [..]}, {sum: [..]}";

impl Draw {
    /// Reads and checks the entries of a draw, in the order of the file: it gives the dimensions of the Sobol sequence,
    /// so that what is added at the end leaves the others as they are. n is at most `most`.
    ///
    /// Error: every mistake, at its place below the draw.
    pub fn read(entries: &[(String, Value)], most: u64) -> Result<Self, Vec<Mistake>> {
        let mut mistakes = Vec::new();
        let at = At { path: Vec::new(), mistakes: &mut mistakes };
        let draw = read(entries, most, at);
        draw.filter(|_| mistakes.is_empty()).ok_or(mistakes)
    }
}

impl Distribution {
    /// Reads a distribution of its own, whose numbers name nothing. Error: every mistake, at its place below `value`.
    pub fn read(value: &Value) -> Result<Self, Vec<Mistake>> {
        let mut mistakes = Vec::new();
        let mut at = At { path: Vec::new(), mistakes: &mut mistakes };
        let read = value.as_object().and_then(|map| distribution(map, &mut at, &[]));
        if read.is_none() && at.mistakes.is_empty() {
            at.wrong::<()>(format!("{value} must be {DISTRIBUTION}"), None);
        }
        if let Some(distribution) = &read {
            constant(distribution, &mut at);
        }
        read.filter(|_| mistakes.is_empty()).ok_or(mistakes)
    }
}

fn read(entries: &[(String, Value)], most: u64, mut at: At<'_>) -> Option<Draw> {
    let get = |key: &str| entries.iter().find(|(name, _)| name == key).map(|(_, value)| value);
    let n = read_n(get("n"), most, &mut at);
    let method = read_method(get("method"), &mut at);
    let mut quantities = Vec::new();
    let mut dimension = 0;
    let mut complete = true;
    for (name, value) in entries.iter().filter(|(key, _)| !RESERVED.contains(&key.as_str())) {
        let source = source(value, &mut at.below(name), dimension);
        dimension += usize::from(matches!(source, Some(Source::Drawn { per: None, .. })));
        complete &= source.is_some();
        quantities.extend(source.map(|source| Quantity { name: name.clone(), source }));
    }
    if quantities.is_empty() && complete {
        return at.wrong("`draw` names nothing to draw", Some("add `mu_a: {uniform: [0.01, 0.1]}`"));
    }
    if method == Some(Method::Sobol) && dimension > DIMENSIONS {
        let message = format!("{dimension} drawn quantities are more than the Sobol sequence has ({DIMENSIONS})");
        at.wrong::<()>(message, Some("write `method: random`"));
    }
    let names: Vec<&str> = entries.iter().map(|(key, _)| key.as_str()).filter(|key| !RESERVED.contains(key)).collect();
    let only = match get("only") {
        None => Some(Vec::new()),
        Some(list) => condition::read_list(list, &names, at.below("only")),
    };
    // What follows from a quantity that could not be read is not wrong too.
    let order = if complete { order(&quantities, &mut at) } else { None };
    let draw = Draw { n: n?, method: method?, quantities, only: only?, order: order? };
    compared(&draw, &mut at);
    Some(draw)
}

fn read_n(value: Option<&Value>, most: u64, at: &mut At<'_>) -> Option<u64> {
    let Some(value) = value else { return at.wrong("`draw` needs `n`, the number of points", None) };
    match value.as_u64() {
        Some(n) if n > 0 && n <= most => Some(n),
        _ if value.is_number() => at.below("n").wrong(format!("n must lie in 1..{most}"), None),
        _ => at.below("n").wrong(format!("n is {value}, but must be a whole number from 1 to {most}"), None),
    }
}

fn read_method(value: Option<&Value>, at: &mut At<'_>) -> Option<Method> {
    let Some(value) = value else { return Some(Method::Sobol) };
    let named = Method::NAMES.iter().find(|(name, _)| value.as_str() == Some(name));
    match named {
        Some((_, method)) => Some(*method),
        None => at.below("method").wrong(format!("method is {value}, but must be one of sobol, lhs, random"), None),
    }
}

fn source(value: &Value, at: &mut At<'_>, dimension: usize) -> Option<Source> {
    let Some(map) = value.as_object().filter(|map| !map.is_empty()) else {
        return at.wrong(format!("{value} must be {DISTRIBUTION}"), None);
    };
    if let Some(count) = map.get("group") {
        if let Some(key) = map.keys().find(|key| *key != "group") {
            at.unknown_key(key, "a group", &["group"]);
            return None;
        }
        return match count.as_u64().filter(|count| *count > 0) {
            Some(count) => Some(Source::Group(count)),
            None => at.below("group").wrong(format!("{count} must be a number of groups, 1 or more"), None),
        };
    }
    if map.len() == 1 && (map.contains_key("product") || map.contains_key("sum")) {
        let at = At { path: at.path.clone(), mistakes: at.mistakes };
        return Expression::read(value, at).map(Source::Derived);
    }
    let per = match map.get("per") {
        None => None,
        Some(Value::String(group)) => Some(group.clone()),
        Some(other) => return at.below("per").wrong(format!("{other} must be the name of a group"), None),
    };
    let distribution = distribution(map, at, &["per"])?;
    Some(Source::Drawn { distribution, dimension, per })
}

/// A distribution with what may stand beside it: `within`, and `beside`.
fn distribution(map: &Map<String, Value>, at: &mut At<'_>, beside: &[&str]) -> Option<Distribution> {
    let mut kinds = map.iter().filter(|(key, _)| *key != "within" && !beside.contains(&key.as_str()));
    let (Some((key, value)), None) = (kinds.next(), kinds.next()) else {
        return at.wrong(format!("{} must be {DISTRIBUTION}", Value::from(map.clone())), None);
    };
    if !DISTRIBUTIONS.contains(&key.as_str()) {
        at.unknown_key(key, "a draw", &DISTRIBUTIONS);
        return None;
    }
    let outside = map.get("within");
    if let (Some(_), "choice") = (outside, key.as_str()) {
        return at.below("within").wrong("a choice has no ends to be within", Some("leave values out instead"));
    }
    let (kind, inside) = kind(key, value, &mut at.below(key))?;
    let within = match (outside, inside) {
        (Some(_), Some(_)) => return at.below("within").wrong("within stands in two places", None),
        (Some(ends), None) => Some(pair(ends, &mut at.below("within"), "within")?),
        (None, inside) => inside,
    };
    Some(Distribution { kind, within })
}

fn kind(key: &str, value: &Value, at: &mut At<'_>) -> Option<(Kind, Option<[Expression; 2]>)> {
    match key {
        "uniform" => Some((Kind::Uniform(pair(value, at, key)?), None)),
        "loguniform" => Some((Kind::Loguniform(pair(value, at, key)?), None)),
        "integer" => Some((Kind::Integer(pair(value, at, key)?), None)),
        "normal" => named(value, at, key, ["mean", "sigma"]).map(|(pair, within)| (Kind::Normal(pair), within)),
        "lognormal" => named(value, at, key, ["median", "sigma"]).map(|(pair, within)| (Kind::Lognormal(pair), within)),
        "beta" => beta(value, at),
        _ => choice(value, at).map(|values| (Kind::Choice(values), None)),
    }
}

fn pair(value: &Value, at: &mut At<'_>, name: &str) -> Option<[Expression; 2]> {
    let Some([first, last]) = value.as_array().map(Vec::as_slice) else {
        return at.wrong(format!("{name} is {value}, but takes [first, last]"), None);
    };
    let read = [Expression::read(first, at.below(0)), Expression::read(last, at.below(1))];
    let [Some(first), Some(last)] = read else { return None };
    Some([first, last])
}

/// `{mean: 0, sigma: 1, within: [-1, 1]}`, or `[0, 1]`.
fn named(
    value: &Value,
    at: &mut At<'_>,
    name: &str,
    keys: [&str; 2],
) -> Option<([Expression; 2], Option<[Expression; 2]>)> {
    let Some(map) = value.as_object() else {
        if value.is_array() {
            return pair(value, at, name).map(|pair| (pair, None));
        }
        return at.wrong(format!("{name} is {value}, but takes {{{}: .., {}: ..}}", keys[0], keys[1]), None);
    };
    let known = [keys[0], keys[1], "within"];
    if let Some(key) = map.keys().find(|key| !known.contains(&key.as_str())) {
        at.unknown_key(key, name, &known);
        return None;
    }
    let mut read = |key: &str| match map.get(key) {
        Some(value) => Expression::read(value, at.below(key)),
        None => at.wrong(format!("{name} needs `{key}`"), None),
    };
    let ([Some(first), Some(second)], within) = ([read(keys[0]), read(keys[1])], map.get("within")) else {
        return None;
    };
    match within {
        None => Some(([first, second], None)),
        Some(ends) => Some(([first, second], Some(pair(ends, &mut at.below("within"), "within")?))),
    }
}

fn beta(value: &Value, at: &mut At<'_>) -> Option<(Kind, Option<[Expression; 2]>)> {
    let mut map = value.as_object().cloned().unwrap_or_default();
    let on = match map.remove("on") {
        None => [Expression::Number(0.0), Expression::Number(1.0)],
        Some(ends) => pair(&ends, &mut at.below("on"), "on")?,
    };
    let shapes = if value.is_object() { Value::Object(map) } else { value.clone() };
    let (shapes, within) = named(&shapes, at, "beta", ["alpha", "beta"])?;
    // Beyond that the bell is narrower than doubles resolve the sum that gives its share.
    match shapes {
        [Expression::Number(alpha), Expression::Number(beta)]
            if [alpha, beta].iter().all(|shape| (1e-3..=1e5).contains(shape)) =>
        {
            Some((Kind::Beta { shapes: [alpha, beta], on }, within))
        }
        _ => at.wrong("alpha and beta must be numbers from 0.001 to 100000", None),
    }
}

/// `[a, b]` (equal weights), or `{a: 3, b: 1}`, whose names that read as numbers are numbers.
fn choice(value: &Value, at: &mut At<'_>) -> Option<Vec<(Value, f64)>> {
    let values: Vec<(Value, f64)> = match value {
        Value::Array(list) => list.iter().map(|value| (value.clone(), 1.0)).collect(),
        Value::Object(map) => {
            let mut values = Vec::new();
            for (name, weight) in map {
                let Some(weight) = weight.as_f64().filter(|weight| *weight >= 0.0 && weight.is_finite()) else {
                    return at.below(name).wrong(format!("{weight} must be a weight, 0 or more"), None);
                };
                values.push((named_value(name), weight));
            }
            values
        }
        _ => return at.wrong(format!("choice is {value}, but takes [a, b] or {{a: 3, b: 1}}"), None),
    };
    if let Some((value, _)) = values.iter().find(|(value, _)| value.is_array() || value.is_object() || value.is_null())
    {
        return at.wrong(format!("{value} cannot be chosen: a choice is of numbers, texts and truth values"), None);
    }
    let texts: BTreeSet<String> = values.iter().map(|(value, _)| value.to_string()).collect();
    if texts.len() < values.len() {
        return at.wrong("choice names one value twice", Some("give it a weight: {a: 2, b: 1}"));
    }
    let values: Vec<_> = values.into_iter().filter(|(_, weight)| *weight > 0.0).collect();
    if values.is_empty() {
        return at.wrong("choice has nothing to choose from", None);
    }
    Some(values)
}

fn named_value(name: &str) -> Value {
    let number = serde_json::from_str::<Value>(name).ok().filter(Value::is_number);
    number.unwrap_or_else(|| Value::from(name))
}

/// Reports names that nothing draws, texts where numbers are wanted, values per group that change within it, circles,
/// distributions of constants that are none. The order in which values are made.
fn order(quantities: &[Quantity], at: &mut At<'_>) -> Option<Vec<usize>> {
    let place = |name: &str| quantities.iter().position(|quantity| quantity.name == name);
    let names: Vec<&str> = quantities.iter().map(|quantity| quantity.name.as_str()).collect();
    let mut sources: Vec<Vec<usize>> = Vec::new();
    let mut complete = true;
    for quantity in quantities {
        let mut at = at.below(&quantity.name);
        let mut used = Vec::new();
        for name in names_in(&quantity.source) {
            let hint = format!("drawn are {}", names.join(", "));
            match place(name) {
                None => {
                    complete = false;
                    at.wrong::<()>(format!("`{name}` is not drawn here"), Some(&hint));
                }
                Some(other) if !is_number(&quantities[other].source) => {
                    complete = false;
                    at.wrong::<()>(format!("`{name}` is no number"), None);
                }
                Some(other) => used.push(other),
            }
        }
        if let Source::Drawn { per: Some(group), distribution, .. } = &quantity.source {
            match place(group).map(|group| &quantities[group].source) {
                // The group's number is known first.
                Some(Source::Group(_)) => used.extend(place(group)),
                _ => {
                    complete = false;
                    let hint = "add `patient: {group: 100}`";
                    at.below("per").wrong::<()>(format!("`{group}` is no group of this draw"), Some(hint));
                }
            }
            let changes = |name: &&str| place(name).is_some_and(|other| !is_per(quantities, other, group, 0));
            if let Some(name) = distribution.expressions().flat_map(Expression::names).find(changes) {
                complete = false;
                let message = format!("it is drawn once per {group}, but `{name}` changes within a {group}");
                at.wrong::<()>(message, Some(&format!("draw `{name}` per {group} too")));
            }
        }
        if let Source::Drawn { distribution, .. } = &quantity.source {
            complete &= constant(distribution, &mut at);
        }
        sources.push(used);
    }
    if !complete {
        return None;
    }
    sorted(quantities, &sources, at)
}

fn names_in(source: &Source) -> Vec<&str> {
    match source {
        Source::Drawn { distribution, .. } => distribution.expressions().flat_map(Expression::names).collect(),
        Source::Group(_) => Vec::new(),
        Source::Derived(expression) => expression.names(),
    }
}

fn is_number(source: &Source) -> bool {
    match source {
        Source::Drawn { distribution, .. } => distribution.is_numeric(),
        Source::Group(_) | Source::Derived(_) => true,
    }
}

/// Whether a quantity has one value per group.
fn is_per(quantities: &[Quantity], at: usize, group: &str, depth: usize) -> bool {
    match &quantities[at].source {
        Source::Drawn { per, .. } => per.as_deref() == Some(group),
        Source::Group(_) => quantities[at].name == group,
        Source::Derived(expression) => expression.names().iter().all(|name| {
            let other = quantities.iter().position(|quantity| quantity.name == *name);
            depth < quantities.len() && other.is_none_or(|other| is_per(quantities, other, group, depth + 1))
        }),
    }
}

/// Whether a distribution of constants can be drawn; one of other drawn numbers is tried at each point.
fn constant(distribution: &Distribution, at: &mut At<'_>) -> bool {
    if distribution.expressions().any(|expression| !expression.names().is_empty()) {
        return true;
    }
    match distribution.quantile(0.5, &|name| unreachable!("{name} in an expression without names")) {
        Ok(_) => true,
        Err(why) => {
            at.below(distribution.kind.name()).wrong::<()>(why, None);
            false
        }
    }
}

/// Reports conditions that compare a text with a number.
fn compared(draw: &Draw, at: &mut At<'_>) {
    use crate::condition::Relation;
    for (i, condition) in draw.only.iter().enumerate() {
        let text = |name: &str| {
            let quantity = draw.quantities.iter().find(|quantity| quantity.name == name);
            quantity.is_some_and(|quantity| !is_number(&quantity.source))
        };
        let names = [Some(condition.name.as_str()), condition.other.as_str()];
        if matches!(condition.relation, Relation::Above | Relation::Below)
            && let Some(name) = names.into_iter().flatten().find(|name| text(name))
        {
            let message = format!("`{name}` is no number: it is neither above nor below another");
            at.below("only").below(i).wrong::<()>(message, Some("compare it by `is` or `in`"));
        }
    }
}

/// Each after those that it is made of, else in the order of the file.
fn sorted(quantities: &[Quantity], sources: &[Vec<usize>], at: &mut At<'_>) -> Option<Vec<usize>> {
    let mut order = Vec::new();
    let mut left: Vec<usize> = (0..quantities.len()).collect();
    while !left.is_empty() {
        let ready: Vec<usize> =
            left.iter().copied().filter(|&q| sources[q].iter().all(|source| order.contains(source))).collect();
        if ready.is_empty() {
            let names: Vec<&str> = left.iter().map(|&q| quantities[q].name.as_str()).collect();
            let message = format!("these are made of each other in a circle: {}", names.join(", "));
            return at.below(names[0]).wrong(message, None);
        }
        left.retain(|q| !ready.contains(q));
        order.extend(ready);
    }
    Some(order)
}
