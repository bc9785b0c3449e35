//! `with:` of a stage, prepared once so that each of 10,000 instances only touches what holds `${axis}`.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::{Map, Value};
use turbid_contract::Axes;

use super::node::{Data, Node};
use super::parse::join;
use super::reader::Reader;
use super::scalar::normal;
use super::substitute::{Piece, fill, is_dynamic, pieces};
use super::vars::Vars;

/// Params with vars put in and a list of the places that wait for axes.
#[derive(Clone, Debug)]
pub struct Template {
    base: Value,
    slots: Vec<Slot>,
    /// Places whose value could not be made, and was reported; null stands there.
    broken: Vec<Vec<String>>,
}

#[derive(Clone, Debug)]
struct Slot {
    steps: Vec<Step>,
    cut: Vec<Piece>,
}

#[derive(Clone, Debug)]
enum Step {
    Key(String),
    Index(usize),
}

impl Step {
    fn text(&self) -> String {
        match self {
            Self::Key(key) => key.clone(),
            Self::Index(i) => i.to_string(),
        }
    }
}

/// A name that an instance does not know.
pub struct Unfilled {
    /// Below `with`.
    pub path: Vec<String>,
    pub name: Option<String>,
    pub message: String,
}

impl Default for Template {
    fn default() -> Self {
        Self { base: Value::Object(Map::new()), slots: Vec::new(), broken: Vec::new() }
    }
}

impl Template {
    /// Prepares `node`; `axes` are the names that any instance of the pipeline may carry.
    pub fn compile(node: &Node, path: &str, vars: &Vars, axes: &BTreeSet<String>, reader: &mut Reader<'_>) -> Self {
        let mut slots = Vec::new();
        let mut with = Build { path, vars, axes, broken: Vec::new(), reader };
        let base = build(node, &mut Vec::new(), &mut slots, &mut with);
        Self { base, slots, broken: with.broken }
    }

    /// Whether a mistake at `path` follows from one that is reported: there, below it, or around it.
    pub fn is_broken<S: AsRef<str>>(&self, path: &[S]) -> bool {
        self.broken.iter().any(|broken| broken.iter().zip(path).all(|(a, b)| a == b.as_ref()))
    }

    /// The params of an instance with these axes.
    pub fn params(&self, axes: &Axes, vars: &BTreeMap<String, Value>) -> Result<Value, Vec<Unfilled>> {
        let mut params = self.base.clone();
        self.refill(&mut params, axes, vars)?;
        Ok(params)
    }

    /// Turns the params of one instance into those of another; `params` comes from [`Self::params`].
    pub fn refill(&self, params: &mut Value, axes: &Axes, vars: &BTreeMap<String, Value>) -> Result<(), Vec<Unfilled>> {
        let mut wrong = Vec::new();
        let mut text = 0;
        for slot in &self.slots {
            match slot.value(axes, vars) {
                Ok(value) => {
                    text += value.as_str().map_or(0, str::len);
                    if text > MAX_TEXTS {
                        let message = format!("the texts of this stage grow beyond {} MiB", MAX_TEXTS >> 20);
                        wrong.push(Unfilled { path: slot.path(), name: None, message });
                        break;
                    }
                    *slot.place(params) = value;
                }
                Err((name, message)) => wrong.push(Unfilled { path: slot.path(), name, message }),
            }
        }
        if wrong.is_empty() { Ok(()) } else { Err(wrong) }
    }
}

impl Slot {
    fn value(&self, axes: &Axes, vars: &BTreeMap<String, Value>) -> Result<Value, (Option<String>, String)> {
        let find = |name: &str| axes.get(name).or_else(|| vars.get(name));
        for piece in &self.cut {
            if let Piece::Name(name) = piece
                && find(name).is_none()
            {
                return Err((Some(name.clone()), format!("`${{{name}}}` is an axis that this stage does not carry")));
            }
        }
        let filled = fill(&self.cut, |name| find(name).expect("all names were looked up above"));
        filled.map(normalised).map_err(|message| (None, message))
    }

    fn place<'v>(&self, params: &'v mut Value) -> &'v mut Value {
        self.steps.iter().fold(params, |at, step| match step {
            Step::Key(key) => &mut at[key.as_str()],
            Step::Index(i) => &mut at[*i],
        })
    }

    fn path(&self) -> Vec<String> {
        self.steps.iter().map(Step::text).collect()
    }
}

/// Bytes of all texts of one instance that axes are put into.
const MAX_TEXTS: usize = 16 << 20;

/// `samples: 1e3` is a whole number too: 1000.0 becomes 1000, which every number field takes.
fn normalised(value: Value) -> Value {
    match value {
        Value::Number(n) => normal(&n),
        Value::Array(items) => items.into_iter().map(normalised).collect(),
        Value::Object(map) => Value::Object(map.into_iter().map(|(key, v)| (key, normalised(v))).collect()),
        other => other,
    }
}

struct Build<'a, 'r, 's> {
    /// Of the whole; that of a part is made only for a message.
    path: &'a str,
    vars: &'a Vars,
    axes: &'a BTreeSet<String>,
    broken: Vec<Vec<String>>,
    reader: &'r mut Reader<'s>,
}

fn build(node: &Node, steps: &mut Vec<Step>, slots: &mut Vec<Slot>, with: &mut Build<'_, '_, '_>) -> Value {
    match &node.data {
        Data::Text { text, .. } if is_dynamic(text) => {
            build_text(node, text, steps, slots, with).unwrap_or_else(|| {
                with.broken.push(steps.iter().map(Step::text).collect());
                Value::Null
            })
        }
        Data::List(items) => {
            let mut values = Vec::with_capacity(items.len());
            for (i, item) in items.iter().enumerate() {
                steps.push(Step::Index(i));
                values.push(build(item, steps, slots, with));
                steps.pop();
            }
            Value::Array(values)
        }
        Data::Map(entries) => {
            let mut map = Map::new();
            for entry in entries {
                steps.push(Step::Key(entry.key.clone()));
                let value = build(&entry.value, steps, slots, with);
                map.insert(entry.key.clone(), value);
                steps.pop();
            }
            Value::Object(map)
        }
        _ => normalised(node.to_json()),
    }
}

/// A text with `${}`; `None` if it is wrong and reported.
fn build_text(
    node: &Node,
    text: &str,
    steps: &[Step],
    slots: &mut Vec<Slot>,
    with: &mut Build<'_, '_, '_>,
) -> Option<Value> {
    let path = steps.iter().fold(with.path.to_owned(), |path, step| join(&path, &step.text()));
    let mut value = || {
        let cut = pieces(text)?;
        if !with.vars.check_names(&cut, with.axes, node, &path, with.reader) {
            return Ok(None);
        }
        if cut.iter().any(|p| matches!(p, Piece::Name(name) if with.axes.contains(name))) {
            slots.push(Slot { steps: steps.to_vec(), cut });
            return Ok(Some(Value::Null));
        }
        if with.vars.exhausted() {
            return Ok(None);
        }
        let value = fill(&cut, |name| &with.vars.values[name])?;
        with.vars.pay(value, &path).map(|value| Some(normalised(value)))
    };
    value().unwrap_or_else(|message: String| {
        with.reader.error(node.span, &path, message, None);
        None
    })
}
