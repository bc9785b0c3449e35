//! `with:` of a stage, prepared once so that each of 10,000 instances only touches what holds `${axis}` or `when`.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::{Map, Value};
use turbid_contract::Axes;
use turbid_draw::Condition;

use super::node::{Data, Node};
use super::parse::join;
use super::reader::Reader;
use super::scalar::normal;
use super::source::Span;
use super::substitute::{Piece, fill, is_dynamic, pieces};
use super::vars::Vars;

/// Params with vars put in and a list of the places that wait for axes.
#[derive(Clone, Debug)]
pub struct Template {
    base: Value,
    slots: Vec<Slot>,
    conditional: Vec<Conditional>,
    /// Places whose value could not be made, and was reported; null stands there.
    broken: Vec<Vec<String>>,
}

#[derive(Clone, Debug)]
struct Slot {
    steps: Vec<Step>,
    cut: Vec<Piece>,
}

/// An entry of a map that is there only where its `when` is met.
#[derive(Clone, Debug)]
struct Conditional {
    steps: Vec<Step>,
    conditions: Vec<Condition>,
}

#[derive(Clone, Debug, PartialEq)]
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
        Self { base: Value::Object(Map::new()), slots: Vec::new(), conditional: Vec::new(), broken: Vec::new() }
    }
}

impl Template {
    /// Prepares `node`; `axes` are the names that any instance of the pipeline may carry.
    pub fn compile(node: &Node, path: &str, vars: &Vars, axes: &BTreeSet<String>, reader: &mut Reader<'_>) -> Self {
        let mut slots = Vec::new();
        let mut with = Build { path, vars, axes, conditional: Vec::new(), broken: Vec::new(), reader };
        let base = build(node, &mut Vec::new(), &mut slots, &mut with);
        Self { base, slots, conditional: with.conditional, broken: with.broken }
    }

    /// Whether a mistake at `path` follows from one that is reported: there, below it, or around it.
    pub fn is_broken<S: AsRef<str>>(&self, path: &[S]) -> bool {
        self.broken.iter().any(|broken| broken.iter().zip(path).all(|(a, b)| a == b.as_ref()))
    }

    /// The params of an instance with these axes.
    pub fn params(&self, axes: &Axes, vars: &BTreeMap<String, Value>) -> Result<Value, Vec<Unfilled>> {
        let mut params = self.base.clone();
        let mut wrong = Vec::new();
        let mut text = 0;
        let left_out = self.left_out(axes, vars, &mut wrong);
        for slot in self.slots.iter().filter(|slot| !left_out.iter().any(|out| slot.is_below(out))) {
            match slot.value(axes, vars) {
                Ok(value) => {
                    text += value.as_str().map_or(0, str::len);
                    if text > MAX_TEXTS {
                        let message = format!("the texts of this stage grow beyond {} MiB", MAX_TEXTS >> 20);
                        wrong.push(Unfilled { path: slot.path(), name: None, message });
                        break;
                    }
                    *place(&slot.steps, &mut params) = value;
                }
                Err((name, message)) => wrong.push(Unfilled { path: slot.path(), name, message }),
            }
        }
        // The inner first: an outer entry takes those below along.
        for out in left_out.iter().rev() {
            if let (Some(Step::Key(key)), Value::Object(map)) = (out.last(), place(&out[..out.len() - 1], &mut params))
            {
                map.remove(key);
            }
        }
        if wrong.is_empty() { Ok(params) } else { Err(wrong) }
    }

    /// The entries whose conditions are not met.
    fn left_out(&self, axes: &Axes, vars: &BTreeMap<String, Value>, wrong: &mut Vec<Unfilled>) -> Vec<&[Step]> {
        let find = |name: &str| axes.get(name).or_else(|| vars.get(name));
        let mut out = Vec::new();
        for Conditional { steps, conditions } in &self.conditional {
            match conditions.iter().find(|condition| find(&condition.name).is_none()) {
                Some(Condition { name, .. }) => {
                    let path = steps.iter().map(Step::text).chain(["when".to_owned(), name.clone()]).collect();
                    let message = format!("`{name}` is an axis that this stage does not carry");
                    wrong.push(Unfilled { path, name: Some(name.clone()), message });
                }
                None if conditions.iter().all(|condition| condition.holds(&find)) => {}
                None => out.push(steps.as_slice()),
            }
        }
        out
    }
}

/// The value at the end of `steps`.
fn place<'v>(steps: &[Step], params: &'v mut Value) -> &'v mut Value {
    steps.iter().fold(params, |at, step| match step {
        Step::Key(key) => &mut at[key.as_str()],
        Step::Index(i) => &mut at[*i],
    })
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

    fn is_below(&self, steps: &[Step]) -> bool {
        self.steps.starts_with(steps)
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
    conditional: Vec<Conditional>,
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
                // Of an entry of a map only: parameters themselves are no condition.
                if entry.key == WHEN && !steps.is_empty() {
                    let conditions = conditions(&entry.value, entry.at, steps, with);
                    with.conditional.push(Conditional { steps: steps.clone(), conditions });
                    continue;
                }
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

/// The key of an entry that says when the entry is there.
pub const WHEN: &str = "when";

/// `{shape: spheroid, width: {above: 3}}`: what must hold of axes, drawn names and vars.
fn conditions(node: &Node, key: Span, steps: &[Step], with: &mut Build<'_, '_, '_>) -> Vec<Condition> {
    let path = steps.iter().fold(with.path.to_owned(), |path, step| join(&path, &step.text()));
    let path = join(&path, WHEN);
    let rule = "a map of conditions, such as {shape: spheroid, width: {above: 3}}";
    let mut broken = !with.reader.is_map(node, key, &path, rule);
    if let Some(Step::Index(_)) = steps.last() {
        let hint = "write the list as `foreach`, or the parts as a map".to_owned();
        with.reader.error(key, &path, "an item of a list cannot be left out", hint);
        broken = true;
    }
    let node = with.vars.expand(node, &path, with.reader);
    broken |= node.holds_broken();
    let known: Vec<&str> = with.axes.iter().chain(with.vars.values.keys()).map(String::as_str).collect();
    let mut read = Vec::new();
    for entry in node.entries() {
        let path = join(&path, &entry.key);
        let piece = [Piece::Name(entry.key.clone())];
        let place = Node::new(entry.at, Data::Null);
        if !with.vars.check_names(&piece, with.axes, &place, &path, with.reader) {
            broken = true;
            continue;
        }
        let (relation, other) = match entry.value.entries() {
            [one] => (one.key.clone(), one.value.to_json()),
            _ => ("is".to_owned(), entry.value.to_json()),
        };
        let list = serde_json::json!([[entry.key, relation, other]]);
        match Condition::read_list(&list, &known) {
            Ok(conditions) => read.extend(conditions),
            Err(mistakes) => {
                for mistake in mistakes {
                    let place = if entry.value.span.len == 0 { entry.at } else { entry.value.span };
                    with.reader.error(place, &path, mistake.message, mistake.hint);
                }
                broken = true;
            }
        }
    }
    if broken {
        with.broken.push(steps.iter().map(Step::text).collect());
    }
    read
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
