//! YAML values that know where they stand.

use serde_json::{Map, Number, Value};

use super::source::Span;

/// A value with its place.
#[derive(Clone, Debug)]
pub struct Node {
    /// Of the value; length 0 for what has no text of its own (block lists and maps, empty values).
    pub span: Span,
    pub data: Data,
}

#[derive(Clone, Debug)]
pub enum Data {
    Null,
    Bool(bool),
    Number(Number),
    /// `plain`: written without quotes.
    Text {
        text: String,
        plain: bool,
    },
    List(Vec<Node>),
    Map(Vec<Entry>),
    /// Something wrong that has been reported already; whoever meets it stays silent.
    Broken,
}

/// A key with its value.
#[derive(Clone, Debug)]
pub struct Entry {
    pub key: String,
    pub at: Span,
    pub value: Node,
}

impl Node {
    pub fn new(span: Span, data: Data) -> Self {
        Self { span, data }
    }

    pub fn is_broken(&self) -> bool {
        matches!(self.data, Data::Broken)
    }

    pub fn entries(&self) -> &[Entry] {
        match &self.data {
            Data::Map(entries) => entries,
            _ => &[],
        }
    }

    pub fn entry(&self, key: &str) -> Option<&Entry> {
        self.entries().iter().find(|e| e.key == key)
    }

    pub fn get(&self, key: &str) -> Option<&Node> {
        self.entry(key).map(|e| &e.value)
    }

    /// One step down: a key of a map or an index of a list, with the place of the key (of the item, in a list).
    pub fn step(&self, step: &str) -> Option<(Span, &Node)> {
        match &self.data {
            Data::Map(_) => self.entry(step).map(|e| (e.at, &e.value)),
            Data::List(items) => step.parse::<usize>().ok().and_then(|i| items.get(i)).map(|n| (n.span, n)),
            _ => None,
        }
    }

    /// Whether this value, or one below it, is wrong and reported.
    pub fn holds_broken(&self) -> bool {
        match &self.data {
            Data::Broken => true,
            Data::List(items) => items.iter().any(Self::holds_broken),
            Data::Map(entries) => entries.iter().any(|e| e.value.holds_broken()),
            _ => false,
        }
    }

    /// Number of values in this tree, itself included.
    pub fn size(&self) -> usize {
        1 + match &self.data {
            Data::List(items) => items.iter().map(Self::size).sum(),
            Data::Map(entries) => entries.iter().map(|e| e.value.size()).sum(),
            _ => 0,
        }
    }

    /// [`size`](Self::size), where long texts count for what they take: what copies are paid with.
    pub fn weight(&self) -> usize {
        /// Bytes of a text that take as much as a value.
        const VALUE: usize = 64;
        1 + match &self.data {
            Data::Text { text, .. } => text.len() / VALUE,
            Data::List(items) => items.iter().map(Self::weight).sum(),
            Data::Map(entries) => entries.iter().map(|e| e.key.len() / VALUE + e.value.weight()).sum(),
            _ => 0,
        }
    }

    /// What stands here, in words: `the text "abc"`, `a list`.
    pub fn described(&self) -> String {
        match &self.data {
            Data::Null => "empty".to_owned(),
            Data::Bool(b) => format!("{b}"),
            Data::Number(n) => format!("{n}"),
            Data::Text { text, .. } if text.chars().count() <= 60 => format!("the text \"{text}\""),
            Data::Text { .. } => "a long text".to_owned(),
            Data::List(_) => "a list".to_owned(),
            Data::Map(_) => "a map".to_owned(),
            Data::Broken => "something wrong".to_owned(),
        }
    }

    /// The value without places; what is broken becomes null.
    pub fn to_json(&self) -> Value {
        match &self.data {
            Data::Null | Data::Broken => Value::Null,
            Data::Bool(b) => Value::Bool(*b),
            Data::Number(n) => Value::Number(n.clone()),
            Data::Text { text, .. } => Value::String(text.clone()),
            Data::List(items) => items.iter().map(Self::to_json).collect(),
            Data::Map(entries) => {
                Value::Object(entries.iter().map(|e| (e.key.clone(), e.value.to_json())).collect::<Map<_, _>>())
            }
        }
    }

    /// The same place with another value: what a `${name}` stands for.
    pub fn from_json(value: &Value, span: Span) -> Self {
        let data = match value {
            Value::Null => Data::Null,
            Value::Bool(b) => Data::Bool(*b),
            Value::Number(n) => Data::Number(n.clone()),
            Value::String(text) => Data::Text { text: text.clone(), plain: false },
            Value::Array(items) => Data::List(items.iter().map(|v| Self::from_json(v, span)).collect()),
            Value::Object(map) => Data::Map(
                map.iter()
                    .map(|(key, v)| Entry { key: key.clone(), at: span, value: Self::from_json(v, span) })
                    .collect(),
            ),
        };
        Self { span, data }
    }
}
