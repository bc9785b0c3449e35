//! `vars:` — named values that may refer to each other — and their substitution into a tree.

use std::cell::Cell;
use std::collections::{BTreeMap, BTreeSet, HashMap};

use serde_json::Value;

use super::node::{Data, Entry, Node};
use super::parse::{MAX_DEPTH, MAX_NODES, depth, join};
use super::reader::Reader;
use super::substitute::{Piece, fill, is_dynamic, pieces};
use super::suggest;

/// The vars of a pipeline, resolved.
#[derive(Default)]
pub struct Vars {
    pub values: BTreeMap<String, Value>,
    /// Vars that are wrong and reported; what uses them stays silent.
    broken: BTreeSet<String>,
    /// Values made by substitution so far: lists of lists of vars would otherwise fill the memory.
    spent: Cell<usize>,
}

impl Vars {
    /// Resolves all vars; cycles and unknown names are reported.
    pub fn resolve(section: Option<&Entry>, reader: &mut Reader<'_>) -> Self {
        let mut vars = Self::default();
        let Some(section) = section else { return vars };
        if matches!(section.value.data, Data::Null)
            || !reader.is_map(&section.value, section.at, "vars", "a map of names and values")
        {
            return vars;
        }
        let all: HashMap<&str, &Entry> = section.value.entries().iter().map(|e| (e.key.as_str(), e)).collect();
        for entry in section.value.entries() {
            let path = join("vars", &entry.key);
            if reader.name(&entry.key, entry.at, &path, "a var") {
                vars.resolve_one(&all, entry, &mut Vec::new(), reader);
            }
        }
        vars
    }

    fn resolve_one<'n>(
        &mut self,
        all: &HashMap<&str, &'n Entry>,
        entry: &'n Entry,
        chain: &mut Vec<&'n str>,
        reader: &mut Reader<'_>,
    ) {
        let name = entry.key.as_str();
        if self.values.contains_key(name) || self.broken.contains(name) {
            return;
        }
        let path = join("vars", name);
        let from = chain.iter().position(|c| *c == name);
        if from.is_some() || chain.len() >= MAX_DEPTH {
            let message = match from {
                Some(from) => {
                    let cycle: Vec<&str> = chain[from..].iter().copied().chain([name]).collect();
                    format!("vars refer to each other in a circle: {}", cycle.join(" -> "))
                }
                None => format!("vars refer to each other in a chain of more than {MAX_DEPTH}"),
            };
            reader.error(entry.at, &path, message, None);
            self.broken.insert(name.to_owned());
            return;
        }
        chain.push(name);
        for wanted in names_in(&entry.value) {
            if let Some(other) = all.get(wanted.as_str()) {
                self.resolve_one(all, other, chain, reader);
            }
        }
        chain.pop();
        if self.broken.contains(name) {
            return;
        }
        let value = self.expand(&entry.value, &path, reader);
        if value.holds_broken() {
            self.broken.insert(name.to_owned());
        } else {
            self.values.insert(name.to_owned(), value.to_json());
        }
    }

    /// Whether a var of this name is reported as wrong already.
    pub fn is_broken(&self, name: &str) -> bool {
        self.broken.contains(name)
    }

    /// The tree with all vars put in; what cannot be is reported and becomes [`Data::Broken`].
    pub fn expand(&self, node: &Node, path: &str, reader: &mut Reader<'_>) -> Node {
        let data = match &node.data {
            Data::Text { text, .. } if is_dynamic(text) => {
                return match self.text(node, text, path, reader) {
                    Some(value) => Node::from_json(&value, node.span),
                    None => Node::new(node.span, Data::Broken),
                };
            }
            Data::List(items) => Data::List(
                items.iter().enumerate().map(|(i, n)| self.expand(n, &join(path, &i.to_string()), reader)).collect(),
            ),
            Data::Map(entries) => Data::Map(
                entries
                    .iter()
                    .map(|e| Entry { value: self.expand(&e.value, &join(path, &e.key), reader), ..e.clone() })
                    .collect(),
            ),
            other => other.clone(),
        };
        Node::new(node.span, data)
    }

    /// Whether substitution has made too much, which is reported: nothing more is made.
    pub fn exhausted(&self) -> bool {
        self.spent.get() > MAX_NODES
    }

    fn text(&self, node: &Node, text: &str, path: &str, reader: &mut Reader<'_>) -> Option<Value> {
        if self.exhausted() {
            return None;
        }
        let cut = match pieces(text) {
            Ok(cut) => cut,
            Err(message) => {
                reader.error(node.span, path, message, None);
                return None;
            }
        };
        if !self.check_names(&cut, &BTreeSet::new(), node, path, reader) {
            return None;
        }
        let filled = fill(&cut, |name| &self.values[name]).and_then(|value| self.pay(value, path));
        filled.map_err(|message| reader.error(node.span, path, message, None)).ok()
    }

    /// Reports names that are neither vars nor `axes`; whether all names can be used.
    pub fn check_names(
        &self,
        cut: &[Piece],
        axes: &BTreeSet<String>,
        node: &Node,
        path: &str,
        reader: &mut Reader<'_>,
    ) -> bool {
        let mut usable = true;
        for piece in cut {
            let Piece::Name(name) = piece else { continue };
            if self.values.contains_key(name) || axes.contains(name) {
                continue;
            }
            usable = false;
            // Beyond what is shown mistakes are only counted; what looks alike is not looked for among all names any more.
            if !self.is_broken(name) && reader.report.is_full() {
                reader.report.count();
            } else if !self.is_broken(name) {
                let known = self.values.keys().map(String::as_str).chain(axes.iter().map(String::as_str));
                let hint = suggest::hint(name, known)
                    .or_else(|| Some("this pipeline has no vars and no axes of that name".to_owned()));
                let what = if axes.is_empty() { "a var" } else { "a var or an axis" };
                reader.error(node.span, path, format!("`${{{name}}}` is not {what}"), hint);
            }
        }
        usable
    }

    /// Counts what substitution makes, and refuses to make too much of it.
    pub fn pay(&self, value: Value, path: &str) -> Result<Value, String> {
        let as_node = Node::from_json(&value, Default::default());
        self.spent.set(self.spent.get() + as_node.weight());
        if self.exhausted() {
            return Err(format!(
                "`${{}}` makes more than {MAX_NODES} values (64 bytes of a text count as one) in this file"
            ));
        }
        if depth(&as_node) + path.matches('.').count() > MAX_DEPTH {
            return Err(format!("`${{}}` nests lists and maps more than {MAX_DEPTH} deep"));
        }
        Ok(value)
    }
}

/// The names in every `${}` of a tree.
pub(super) fn names_in(node: &Node) -> Vec<String> {
    let names = |text: &String| {
        let cut = pieces(text).unwrap_or_default();
        cut.into_iter().filter_map(|p| if let Piece::Name(name) = p { Some(name) } else { None }).collect()
    };
    match &node.data {
        Data::Text { text, .. } if is_dynamic(text) => names(text),
        Data::List(items) => items.iter().flat_map(names_in).collect(),
        Data::Map(entries) => entries.iter().flat_map(|e| names_in(&e.value)).collect(),
        _ => Vec::new(),
    }
}
