//! One joint set of points over named quantities.

use serde_json::Value;

use crate::condition::Condition;
use crate::distribution::{Distribution, Kind, finite};
use crate::expression::Expression;
use crate::hash;
use crate::unit::Method;
use turbid_optics::philox::unit;

/// `{n: 1000, method: sobol, mu_a: {loguniform: [1e-4, 0.5]}, only: [[mu_a, below, 0.4]]}`, read and checked.
#[derive(Clone, Debug, PartialEq)]
pub struct Draw {
    /// Raw indices run from 0 to below n; at most 2^32.
    pub n: u64,
    pub method: Method,
    pub(crate) quantities: Vec<Quantity>,
    pub only: Vec<Condition>,
    /// Quantities in an order in which each follows those that it is made of.
    pub(crate) order: Vec<usize>,
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Quantity {
    pub name: String,
    pub source: Source,
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Source {
    Drawn {
        distribution: Distribution,
        dimension: usize,
        per: Option<String>,
    },
    /// The number of a group, below this one.
    Group(u64),
    Derived(Expression),
}

/// Why an index has no point.
#[derive(Clone, Debug, PartialEq)]
pub enum Skipped {
    /// The condition at this place of `only` is not met.
    Condition(usize),
    /// A quantity (by its place) that its numbers make no distribution of, in words.
    Undrawn { quantity: usize, why: String },
}

/// What the values of a quantity are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Type {
    Float,
    Integer,
    Text,
}

impl Draw {
    /// What the values of each name are, in the order of [`Self::names`].
    pub fn types(&self) -> impl Iterator<Item = Type> {
        self.quantities.iter().map(|quantity| match &quantity.source {
            Source::Group(_) => Type::Integer,
            Source::Derived(_) => Type::Float,
            Source::Drawn { distribution, .. } => match &distribution.kind {
                Kind::Integer(_) => Type::Integer,
                Kind::Choice(values) if values.iter().all(|(value, _)| value.is_i64() || value.is_u64()) => {
                    Type::Integer
                }
                Kind::Choice(values) if values.iter().any(|(value, _)| !value.is_number()) => Type::Text,
                _ => Type::Float,
            },
        })
    }

    /// Names in the order in which they are written.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.quantities.iter().map(|quantity| quantity.name.as_str())
    }

    /// Names of the groups, in the order in which they are written.
    pub fn groups(&self) -> impl Iterator<Item = &str> {
        self.quantities.iter().filter(|q| matches!(q.source, Source::Group(_))).map(|q| q.name.as_str())
    }

    /// Whether every index has a point, whatever the seed.
    pub fn never_skips(&self) -> bool {
        let constant = |quantity: &Quantity| match &quantity.source {
            Source::Drawn { distribution, .. } => distribution.expressions().all(|e| e.names().is_empty()),
            Source::Group(_) => true,
            Source::Derived(_) => false,
        };
        self.only.is_empty() && self.quantities.iter().all(constant)
    }

    /// The values of point `index`, in the order of [`Self::names`]: a function of the seed, the index and the
    /// quantities alone (for a Latin hypercube of `n` too).
    pub fn point(&self, seed: u64, index: u64) -> Result<Vec<Value>, Skipped> {
        let values = self.values(|quantity, values| self.drawn(quantity, values, seed, index))?;
        match self.only.iter().position(|condition| !condition.holds(&|name| self.value(name, &values))) {
            Some(condition) => Err(Skipped::Condition(condition)),
            None => Ok(values),
        }
    }

    /// A point in the middle of every distribution, whether or not it meets the conditions.
    pub fn middle(&self) -> Result<Vec<Value>, Skipped> {
        self.values(|quantity, values| match &quantity.source {
            Source::Drawn { distribution, .. } => distribution.quantile(0.5, &|name| self.number(name, values)),
            Source::Group(_) => Ok(Value::from(0)),
            Source::Derived(expression) => finite(expression.value(&|name| self.number(name, values))),
        })
    }

    fn values(&self, value: impl Fn(&Quantity, &[Value]) -> Result<Value, String>) -> Result<Vec<Value>, Skipped> {
        let mut values = vec![Value::Null; self.quantities.len()];
        for &quantity in &self.order {
            values[quantity] =
                value(&self.quantities[quantity], &values).map_err(|why| Skipped::Undrawn { quantity, why })?;
        }
        Ok(values)
    }

    fn drawn(&self, quantity: &Quantity, values: &[Value], seed: u64, index: u64) -> Result<Value, String> {
        let name = hash::of_name(&quantity.name);
        match &quantity.source {
            Source::Drawn { distribution, dimension, per: None } => {
                let u = self.method.coordinate(seed, name, *dimension, index, self.n);
                distribution.quantile(u, &|name| self.number(name, values))
            }
            Source::Drawn { distribution, per: Some(group), .. } => {
                let group = self.number(group, values) as u64;
                distribution.quantile(unit(hash::bits(seed, name, group)[0]), &|name| self.number(name, values))
            }
            Source::Group(count) => Ok(Value::from(hash::below(*count, hash::bits(seed, name, index)))),
            Source::Derived(expression) => finite(expression.value(&|name| self.number(name, values))),
        }
    }

    fn value<'v>(&self, name: &str, values: &'v [Value]) -> Option<&'v Value> {
        self.quantities.iter().position(|quantity| quantity.name == name).map(|place| &values[place])
    }

    fn number(&self, name: &str, values: &[Value]) -> f64 {
        let number = self.value(name, values).and_then(Value::as_f64);
        number.unwrap_or_else(|| panic!("`{name}` is drawn before what is made of it, and is a number"))
    }
}
