//! `draw:` — one joint set of points over named distributions. Read and checked here; drawing comes later.

use serde_json::Value;

use super::axis::{MAX_INSTANCES, numbers};
use super::node::Node;
use super::parse::join;
use super::reader::Reader;
use super::scalar::normal;
use super::source::Span;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DrawMethod {
    Sobol,
    Lhs,
    Random,
}

#[derive(Clone, Debug, PartialEq)]
pub enum Distribution {
    Uniform(f64, f64),
    Loguniform(f64, f64),
}

/// `{n: 1000, method: sobol, mu_a: {loguniform: [1e-4, 0.5]}}`
#[derive(Clone, Debug, PartialEq)]
pub struct Draw {
    pub n: usize,
    pub method: DrawMethod,
    pub names: Vec<(String, Distribution)>,
}

impl Distribution {
    /// The middle of the distribution, which stands for all points while a pipeline is only checked.
    pub fn median(&self) -> f64 {
        match *self {
            Self::Uniform(first, last) => first + (last - first) / 2.0,
            Self::Loguniform(first, last) => first.sqrt() * last.sqrt(),
        }
    }
}

impl Draw {
    pub fn parse(node: &Node, key: Span, path: &str, reader: &mut Reader<'_>) -> Option<Self> {
        if !reader.is_map(node, key, path, "a map {n: .., method: sobol | lhs | random, NAME: {uniform: [..]}}") {
            return None;
        }
        let n = match node.entry("n") {
            Some(entry) => {
                let path = join(path, "n");
                let n = reader.whole_number(&entry.value, entry.at, &path);
                if n.is_some_and(|n| n == 0 || n > MAX_INSTANCES as u64) {
                    reader.error(entry.value.span, &path, format!("n must lie in 1..{MAX_INSTANCES}"), None);
                }
                n
            }
            None => {
                reader.error(key, path, "`draw` needs `n`, the number of points", None);
                None
            }
        };
        let method = match node.entry("method") {
            None => Some(DrawMethod::Sobol),
            Some(entry) => {
                let rule = "one of sobol, lhs, random";
                let path = join(path, "method");
                let name = reader.text(&entry.value, entry.at, &path, rule);
                let method = name.and_then(|name| match name {
                    "sobol" => Some(DrawMethod::Sobol),
                    "lhs" => Some(DrawMethod::Lhs),
                    "random" => Some(DrawMethod::Random),
                    _ => None,
                });
                if name.is_some() && method.is_none() {
                    reader.wrong(&entry.value, entry.at, &path, rule);
                }
                method
            }
        };
        let mut names = Vec::new();
        let drawn = node.entries().iter().filter(|e| e.key != "n" && e.key != "method");
        for entry in drawn.clone() {
            let path = join(path, &entry.key);
            if reader.name(&entry.key, entry.at, &path, "a drawn quantity")
                && let Some(distribution) = distribution(&entry.value, entry.at, &path, reader)
            {
                names.push((entry.key.clone(), distribution));
            }
        }
        if drawn.clone().count() == 0 {
            reader.error(key, path, "`draw` names nothing to draw", "add `mu_a: {uniform: [0.01, 0.1]}`".to_owned());
            return None;
        }
        let complete = names.len() == drawn.count();
        Some(Self { n: usize::try_from(n?).ok()?, method: method?, names }).filter(|_| complete)
    }

    /// Names and values of the one point that stands for all of them in `turbid check`.
    pub fn representative(&self) -> (Vec<String>, Vec<Value>) {
        let median = |d: &Distribution| serde_json::Number::from_f64(d.median()).map_or(Value::Null, |n| normal(&n));
        let named = self.names.iter().map(|(name, d)| (name.clone(), median(d)));
        std::iter::once(("draw".to_owned(), Value::from(0))).chain(named).unzip()
    }
}

fn distribution(node: &Node, key: Span, path: &str, reader: &mut Reader<'_>) -> Option<Distribution> {
    let rule = "one of {uniform: [first, last]}, {loguniform: [first, last]}";
    let [entry] = node.entries() else {
        reader.wrong(node, key, path, rule);
        return None;
    };
    if !reader.known_keys(node, path, &["uniform", "loguniform"], "a distribution") {
        return None;
    }
    let path = join(path, &entry.key);
    let ends = numbers(&entry.value, entry.at, &path, reader)?;
    let log = entry.key == "loguniform";
    match ends[..] {
        [first, last] if first < last && (!log || first > 0.0) => {
            Some(if log { Distribution::Loguniform(first, last) } else { Distribution::Uniform(first, last) })
        }
        _ => {
            let above = if log { ", both above 0" } else { "" };
            let message = format!("{} takes [first, last] with first < last{above}", entry.key);
            reader.error(entry.value.span, &path, message, None);
            None
        }
    }
}
