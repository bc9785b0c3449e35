//! Numbers made of other drawn numbers, without logic: products and sums.

use serde_json::Value;

use crate::mistake::At;

/// A number, a name, or a product or sum of such.
#[derive(Clone, Debug, PartialEq)]
pub enum Expression {
    Number(f64),
    Name(String),
    Product(Vec<Expression>),
    Sum(Vec<Expression>),
}

/// Deeper nesting is a mistake.
const DEEPEST: usize = 16;

impl Expression {
    pub(crate) fn read(value: &Value, at: At<'_>) -> Option<Self> {
        Self::read_below(value, at, DEEPEST)
    }

    fn read_below(value: &Value, mut at: At<'_>, depth: usize) -> Option<Self> {
        const RULE: &str = "a number, the name of a drawn number, {product: [..]} or {sum: [..]}";
        match value {
            Value::Number(n) => n.as_f64().filter(|n| n.is_finite()).map(Self::Number),
            Value::String(name) => Some(Self::Name(name.clone())),
            Value::Object(map) if map.len() == 1 && depth > 0 => {
                let (key, list) = map.iter().next().expect("it has one entry");
                let make = match key.as_str() {
                    "product" => Self::Product,
                    "sum" => Self::Sum,
                    _ => return at.wrong(format!("`{key}` is neither `product` nor `sum`"), Some(RULE)),
                };
                let mut at = at.below(key);
                let Some(items) = list.as_array().filter(|items| !items.is_empty()) else {
                    return at.wrong(format!("`{key}` takes a list of factors or terms"), Some(RULE));
                };
                let items = items.iter().enumerate().map(|(i, v)| Self::read_below(v, at.below(i), depth - 1));
                items.collect::<Vec<_>>().into_iter().collect::<Option<Vec<_>>>().map(make)
            }
            _ => at.wrong(format!("{value} must be {RULE}"), None),
        }
    }

    /// The names in it.
    pub fn names(&self) -> Vec<&str> {
        match self {
            Self::Number(_) => Vec::new(),
            Self::Name(name) => vec![name],
            Self::Product(items) | Self::Sum(items) => items.iter().flat_map(Self::names).collect(),
        }
    }

    /// Its value; `number` must know every name.
    pub(crate) fn value(&self, number: &dyn Fn(&str) -> f64) -> f64 {
        match self {
            Self::Number(n) => *n,
            Self::Name(name) => number(name),
            Self::Product(items) => items.iter().map(|item| item.value(number)).product(),
            Self::Sum(items) => items.iter().map(|item| item.value(number)).sum(),
        }
    }
}
