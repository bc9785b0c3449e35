//! What the readers of all sections share: reporting at a place, and "this must be a text, a map, a whole number".

use super::diagnostic::Diagnostic;
use super::mistake::{Kind, Mistake};
use super::node::{Data, Node};
use super::parse::join;
use super::report::Report;
use super::scalar::{look_alike, normal};
use super::source::{SourceFile, Span};
use super::suggest;

/// The sources that places refer to, and the mistakes found so far.
pub struct Reader<'a> {
    pub sources: &'a [SourceFile],
    pub report: &'a mut Report,
}

/// What a text that stands in a wrong place may be meant as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Meant {
    Number,
    Bool,
    Other,
}

impl Reader<'_> {
    pub fn error(&mut self, span: Span, path: &str, mistake: impl Into<Mistake>, hint: impl Into<Option<String>>) {
        // Beyond that they are counted only: in a huge line each excerpt costs a walk along it.
        if self.report.is_full() {
            return self.report.count();
        }
        self.report.push(Diagnostic::at(self.sources, span, path, mistake).hint(hint));
    }

    /// `path = FOUND must RULE`, unless what stands there was reported already.
    pub fn wrong(&mut self, node: &Node, key: Span, path: &str, rule: &str) {
        self.wrong_as(node, key, path, rule, Meant::Other);
    }

    /// The same where a number or a truth value is wanted, which a text may be meant as.
    pub fn wrong_as(&mut self, node: &Node, key: Span, path: &str, rule: &str, meant: Meant) {
        if node.is_broken() {
            return;
        }
        let hint = match &node.data {
            Data::Text { text, .. } if meant != Meant::Other => look_alike(text, meant == Meant::Bool),
            _ => None,
        };
        let name = path.rsplit('.').find(|step| step.parse::<usize>().is_err()).unwrap_or(path);
        let place = if node.span.len == 0 { key } else { node.span };
        let message = format!("`{name}` is {}, but must be {rule}", node.described());
        self.error(place, path, Mistake::new(Kind::WrongType, message), hint);
    }

    pub fn text<'n>(&mut self, node: &'n Node, key: Span, path: &str, rule: &str) -> Option<&'n str> {
        match &node.data {
            Data::Text { text, .. } if !text.is_empty() => Some(text),
            _ => {
                self.wrong(node, key, path, rule);
                None
            }
        }
    }

    /// A name of a stage, pipeline, axis or var: it becomes part of paths and of `${}`.
    pub fn name(&mut self, name: &str, at: Span, path: &str, what: &str) -> bool {
        if is_name(name) {
            return true;
        }
        let rule = "must be made of letters, digits, `_` and `-`, at most 80 of them";
        self.error(at, path, format!("the name of {what} {rule}"), None);
        false
    }

    pub const WHOLE_NUMBER: &'static str = "a whole number from 0 to 18446744073709551615";

    pub fn whole_number(&mut self, node: &Node, key: Span, path: &str) -> Option<u64> {
        self.whole_number_as(node, key, path, Self::WHOLE_NUMBER)
    }

    /// A whole number where `rule` says that, and what else could stand there.
    pub fn whole_number_as(&mut self, node: &Node, key: Span, path: &str, rule: &str) -> Option<u64> {
        if let Data::Number(n) = &node.data
            && let Some(n) = normal(n).as_u64()
        {
            return Some(n);
        }
        self.wrong_as(node, key, path, rule, Meant::Number);
        None
    }

    pub fn is_map(&mut self, node: &Node, key: Span, path: &str, rule: &str) -> bool {
        let holds = matches!(node.data, Data::Map(_));
        if !holds {
            self.wrong(node, key, path, rule);
        }
        holds
    }

    /// Reports the keys of a map that are not in `known`; whether there were none.
    pub fn known_keys(&mut self, node: &Node, path: &str, known: &[&str], what: &str) -> bool {
        let mut all_known = true;
        for entry in node.entries().iter().filter(|e| !known.contains(&e.key.as_str())) {
            all_known = false;
            if self.report.is_full() {
                self.report.count();
                continue;
            }
            let hint = suggest::hint(&entry.key, known.iter().copied());
            let message = format!("{what} has no key `{}`", super::parse::shortened(&entry.key));
            self.error(entry.at, &join(path, &entry.key), Mistake::new(Kind::UnknownKey, message), hint);
        }
        all_known
    }
}

pub fn is_name(name: &str) -> bool {
    let fits = |c: char| c.is_alphanumeric() || c == '_' || c == '-';
    !name.is_empty() && name.chars().count() <= 80 && name.chars().all(fits) && !name.starts_with('-')
}
