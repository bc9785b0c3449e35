//! `in:` — which outputs feed the ports of a stage.

use std::collections::BTreeMap;

use serde_json::Value;

use super::axis;
use super::node::{Data, Entry, Node};
use super::parse::join;
use super::reader::{Reader, is_name};
use super::source::Span;
use super::vars::Vars;

/// What is connected to one port.
#[derive(Clone, Debug, PartialEq)]
pub struct InputSpec {
    pub port: String,
    /// Several for a port that takes many.
    pub sources: Vec<SourceRef>,
}

/// `stage`, `stage.port` or `{from: .., where: .., over: ..}`.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceRef {
    pub stage: String,
    pub port: Option<String>,
    /// `where`: only instances with these values of these axes.
    pub filter: BTreeMap<String, Value>,
    /// `over`: the axes that a "many" port gathers.
    pub over: Option<Vec<String>>,
}

impl InputSpec {
    /// Reads the section; the flag says whether all of it could be read.
    pub fn parse_all(section: &Entry, path: &str, vars: &Vars, reader: &mut Reader<'_>) -> (Vec<Self>, bool) {
        let rule = "a map of ports and stages, such as {scene: tissue}";
        if !reader.is_map(&section.value, section.at, path, rule) {
            return (Vec::new(), false);
        }
        let mut found = Vec::new();
        let mut complete = true;
        for entry in section.value.entries() {
            let path = join(path, &entry.key);
            let sources = match &entry.value.data {
                Data::List(items) if items.is_empty() => {
                    reader.error(entry.at, &path, "an empty list connects nothing", "take the port out".to_owned());
                    None
                }
                Data::List(items) => {
                    let each = items
                        .iter()
                        .enumerate()
                        .map(|(i, item)| SourceRef::parse(item, item.span, &join(&path, &i.to_string()), vars, reader));
                    each.collect::<Vec<_>>().into_iter().collect()
                }
                _ => SourceRef::parse(&entry.value, entry.at, &path, vars, reader).map(|one| vec![one]),
            };
            complete &= sources.is_some();
            found.extend(sources.map(|sources| Self { port: entry.key.clone(), sources }));
        }
        (found, complete)
    }
}

impl SourceRef {
    fn parse(node: &Node, key: Span, path: &str, vars: &Vars, reader: &mut Reader<'_>) -> Option<Self> {
        let Data::Map(_) = &node.data else {
            return Self::parse_name(node, key, path, reader);
        };
        let known = reader.known_keys(node, path, &["from", "where", "over"], "an input");
        let Some(from) = node.entry("from") else {
            if known {
                reader.error(key, path, "`from` is missing: the stage or stage.port to read", None);
            }
            return None;
        };
        let mut source = Self::parse_name(&from.value, from.at, &join(path, "from"), reader)?;
        if let Some(filter) = node.entry("where") {
            source.filter = parse_filter(filter, &join(path, "where"), vars, reader)?;
        }
        if let Some(over) = node.entry("over") {
            source.over = Some(parse_over(over, &join(path, "over"), reader)?);
        }
        known.then_some(source)
    }

    fn parse_name(node: &Node, key: Span, path: &str, reader: &mut Reader<'_>) -> Option<Self> {
        let rule = "the name of a stage, or stage.port";
        let text = reader.text(node, key, path, rule)?;
        let (stage, port) = match text.split_once('.') {
            Some((stage, port)) => (stage, Some(port)),
            None => (text, None),
        };
        if !is_name(stage) || port.is_some_and(|p| !is_name(p)) {
            reader.wrong(node, key, path, rule);
            return None;
        }
        let port = port.map(str::to_owned);
        Some(Self { stage: stage.to_owned(), port, filter: BTreeMap::new(), over: None })
    }
}

fn parse_filter(section: &Entry, path: &str, vars: &Vars, reader: &mut Reader<'_>) -> Option<BTreeMap<String, Value>> {
    if !reader.is_map(&section.value, section.at, path, "a map of axes and values, such as {mu_a: 0.1}") {
        return None;
    }
    let values = vars.expand(&section.value, path, reader);
    let each = values.entries().iter().map(|e| {
        let value = axis::scalar(&e.value, &join(path, &e.key), reader)?;
        Some((e.key.clone(), value))
    });
    each.collect::<Vec<_>>().into_iter().collect()
}

fn parse_over(section: &Entry, path: &str, reader: &mut Reader<'_>) -> Option<Vec<String>> {
    let rule = "a list of axes, such as [mu_a]";
    let Data::List(items) = &section.value.data else {
        reader.wrong(&section.value, section.at, path, rule);
        return None;
    };
    let each = items.iter().enumerate().map(|(i, item)| {
        reader.text(item, section.at, &join(path, &i.to_string()), "the name of an axis").map(str::to_owned)
    });
    each.collect::<Vec<_>>().into_iter().collect()
}
