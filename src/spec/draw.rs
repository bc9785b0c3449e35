//! `draw:` — one joint set of points over named distributions, on one axis `draw`.

use std::collections::BTreeMap;

use rayon::prelude::*;
use serde_json::Value;
use turbid_contract::{Axes, suggest};
use turbid_draw::{Method, Mistake as DrawMistake, Skipped, Type, stream};

use super::axis::MAX_INSTANCES;
use super::diagnostic::Diagnostic;
use super::mistake::{Kind, Mistake};
use super::node::Node;
use super::parse::join;
use super::reader::Reader;
use super::source::Span;

/// The axis that all drawn names share: the raw index of a point.
pub const AXIS: &str = "draw";

/// A smaller share of points that meet the conditions is a mistake.
const LEAST_ACCEPTED: f64 = 0.01;

/// The points of a stage, with those indices that have one.
#[derive(Clone, Debug)]
pub struct Draw {
    points: turbid_draw::Draw,
    seed: u64,
    /// Raw indices with a point, ascending.
    pub indices: Vec<u64>,
    /// How many indices have none, by reason.
    pub skipped: BTreeMap<String, u64>,
}

impl Draw {
    /// Reads the section (vars put in); `None` if it is wrong and reported. Points follow from the pipeline's `seed`
    /// and the name of the stage.
    pub fn parse(node: &Node, key: Span, path: &str, of: (u64, &str), reader: &mut Reader<'_>) -> Option<Self> {
        if !reader.is_map(node, key, path, "a map {n: .., method: sobol | lhs | random, NAME: {uniform: [..]}}") {
            return None;
        }
        let mut named = true;
        for entry in node.entries().iter().filter(|entry| !["n", "method", "only"].contains(&entry.key.as_str())) {
            named &= reader.name(&entry.key, entry.at, &join(path, &entry.key), "a drawn quantity");
            if entry.key == AXIS {
                let message = "`draw` is the axis of the points, and no name of a quantity";
                reader.error(entry.at, &join(path, &entry.key), message, None);
                named = false;
            }
        }
        if node.holds_broken() {
            return None;
        }
        let entries: Vec<(String, Value)> = node.entries().iter().map(|e| (e.key.clone(), e.value.to_json())).collect();
        let points = match turbid_draw::Draw::read(&entries, MAX_INSTANCES as u64) {
            Ok(points) => points,
            Err(mistakes) => {
                mistakes.into_iter().for_each(|mistake| report(mistake, node, key, path, reader));
                return None;
            }
        };
        if points.method == Method::Lhs {
            let message = "another n moves every point of a Latin hypercube";
            let hint = "`sobol` and `random` keep the points that are there".to_owned();
            let warning = Diagnostic::at(reader.sources, key, path, Mistake::new(Kind::WrongValue, message));
            reader.report.push(warning.hint(hint).warning());
        }
        let (seed, stage) = of;
        let draw = Self { points, seed: stream(seed, stage), indices: Vec::new(), skipped: BTreeMap::new() };
        draw.accept(key, path, reader).filter(|_| named)
    }

    /// Finds the indices that have a point.
    fn accept(mut self, key: Span, path: &str, reader: &mut Reader<'_>) -> Option<Self> {
        let n = self.points.n;
        if self.points.never_skips() {
            self.indices = (0..n).collect();
            return Some(self);
        }
        let found: Vec<Result<u64, Skipped>> =
            (0..n).into_par_iter().map(|i| self.points.point(self.seed, i).map(|_| i)).collect();
        for found in found {
            match found {
                Ok(index) => self.indices.push(index),
                Err(skipped) => *self.skipped.entry(self.reason(&skipped)).or_default() += 1,
            }
        }
        // A handful of points says little of a share.
        if self.indices.is_empty() || (self.acceptance() < LEAST_ACCEPTED && n >= 1000) {
            let reasons: Vec<String> =
                self.skipped.iter().map(|(reason, count)| format!("{count} by {reason}")).collect();
            let message = format!("of {n} points {} meet the conditions: {}", self.indices.len(), reasons.join(", "));
            let hint = "draw from narrower distributions, or ask for less by `only`".to_owned();
            reader.error(key, path, message, hint);
            return None;
        }
        Some(self)
    }

    fn reason(&self, skipped: &Skipped) -> String {
        match skipped {
            Skipped::Condition(place) => self.points.only[*place].to_string(),
            Skipped::Undrawn { quantity, .. } => {
                format!("{} whose bounds leave nothing", self.names().nth(*quantity).unwrap_or_default())
            }
        }
    }

    /// How many indices there are, with a point or without.
    pub fn n(&self) -> u64 {
        self.points.n
    }

    pub fn method(&self) -> Method {
        self.points.method
    }

    /// The share of indices that have a point.
    pub fn acceptance(&self) -> f64 {
        self.indices.len() as f64 / self.points.n as f64
    }

    /// Drawn names in the order of the file.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.points.names()
    }

    /// What their values are.
    pub fn types(&self) -> impl Iterator<Item = Type> {
        self.points.types()
    }

    /// Names of the groups among them.
    pub fn groups(&self) -> impl Iterator<Item = &str> {
        self.points.groups()
    }

    /// The values of the point of this index in the order of [`Self::names`], or why it has none.
    pub fn point(&self, index: u64) -> Result<Vec<Value>, String> {
        self.points.point(self.seed, index).map_err(|skipped| self.reason(&skipped))
    }

    /// Adds the values of the point that `axes` names by its index.
    pub fn put_into(&self, axes: &mut Axes) {
        let index = axes.get(AXIS).and_then(Value::as_u64).expect("the axis `draw` holds an index");
        let values = self.points.point(self.seed, index).expect("only indices that have a point are instances");
        axes.extend(self.names().map(str::to_owned).zip(values));
    }
}

/// Reports a mistake at the deepest part of its path that stands in the file.
fn report(mistake: DrawMistake, node: &Node, key: Span, path: &str, reader: &mut Reader<'_>) {
    let mut place = if node.span.len == 0 { key } else { node.span };
    let mut at = Some(node);
    let mut full = path.to_owned();
    let last = mistake.path.len().saturating_sub(1);
    let unknown = !mistake.known_keys.is_empty();
    for (i, step) in mistake.path.iter().enumerate() {
        full = join(&full, step);
        at = at.and_then(|node| node.step(step)).map(|(key, next)| {
            place = if next.span.len == 0 || (i == last && unknown) { key } else { next.span };
            next
        });
    }
    if mistake.path.is_empty() {
        place = key;
    }
    let kind = if unknown { Kind::UnknownKey } else { Kind::WrongValue };
    let key = mistake.path.last().map(String::as_str).unwrap_or_default();
    let nearest = suggest::hint(key, mistake.known_keys.iter().map(String::as_str));
    reader.error(place, &full, Mistake::new(kind, mistake.message), nearest.or(mistake.hint));
}
