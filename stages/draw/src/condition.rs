//! Conditions on drawn values: `[lesion_a, below, 0.4]`.

use serde_json::Value;

use crate::mistake::At;

/// One condition: a name, how it is compared, with what.
#[derive(Clone, Debug, PartialEq)]
pub struct Condition {
    pub name: String,
    pub relation: Relation,
    /// A number or a name; for [`Relation::Is`] any value; for [`Relation::In`] a list of values.
    pub other: Value,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Relation {
    Above,
    Below,
    Is,
    In,
}

impl Relation {
    pub const NAMES: [(&'static str, Self); 4] =
        [("above", Self::Above), ("below", Self::Below), ("is", Self::Is), ("in", Self::In)];

    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|(_, relation)| *relation == self).expect("every relation has a name").0
    }
}

impl std::fmt::Display for Condition {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let other = match &self.other {
            Value::String(text) => text.clone(),
            other => other.to_string(),
        };
        write!(f, "[{}, {}, {other}]", self.name, self.relation.name())
    }
}

impl Condition {
    /// Reads a list of conditions; `names` are those that may be compared.
    pub fn read_list(value: &Value, names: &[&str]) -> Result<Vec<Self>, Vec<crate::Mistake>> {
        let mut mistakes = Vec::new();
        let read = read_list(value, names, At { path: Vec::new(), mistakes: &mut mistakes });
        read.filter(|_| mistakes.is_empty()).ok_or(mistakes)
    }

    /// Whether the values meet it; `value` must know every name.
    pub fn holds<'v>(&self, value: &dyn Fn(&str) -> Option<&'v Value>) -> bool {
        let own = value(&self.name).expect("names were checked when the condition was read");
        let named = self.other.as_str().and_then(value);
        let other = named.unwrap_or(&self.other);
        match self.relation {
            // A text may be a name too; what is written comes first.
            Relation::Is => same(own, &self.other) || same(own, other),
            Relation::In => other.as_array().is_some_and(|list| list.iter().any(|other| same(own, other))),
            // What is no number is neither above nor below another.
            Relation::Above => own.as_f64().zip(other.as_f64()).is_some_and(|(own, other)| own > other),
            Relation::Below => own.as_f64().zip(other.as_f64()).is_some_and(|(own, other)| own < other),
        }
    }
}

/// Equal, 1 and 1.0 too.
fn same(a: &Value, b: &Value) -> bool {
    match (a.as_f64(), b.as_f64()) {
        (Some(a), Some(b)) => a == b,
        _ => a == b,
    }
}

pub(crate) fn read_list(value: &Value, names: &[&str], mut at: At<'_>) -> Option<Vec<Condition>> {
    let Some(list) = value.as_array() else {
        return at.wrong(format!("{value} must be a list of conditions"), Some(RULE));
    };
    let read = list.iter().enumerate().map(|(i, value)| read(value, names, at.below(i)));
    read.collect::<Vec<_>>().into_iter().collect()
}

const RULE: &str = "such as [[mu_a, below, 0.4], [shape, is, box], [shape, in, [box, none]]]";

fn read(value: &Value, names: &[&str], mut at: At<'_>) -> Option<Condition> {
    let Some([Value::String(name), Value::String(relation), other]) = value.as_array().map(Vec::as_slice) else {
        return at.wrong(format!("{value} must be [NAME, above | below | is | in, VALUE]"), Some(RULE));
    };
    if !names.contains(&name.as_str()) {
        let hint = format!("drawn are {}", names.join(", "));
        return at.below(0).wrong(format!("`{name}` is not drawn here"), Some(&hint));
    }
    let Some((_, relation)) = Relation::NAMES.iter().find(|(known, _)| known == relation) else {
        return at.below(1).wrong(format!("`{relation}` must be one of above, below, is, in"), None);
    };
    let fits = match relation {
        Relation::Above | Relation::Below => {
            other.is_number() || other.as_str().is_some_and(|other| names.contains(&other))
        }
        Relation::Is => !other.is_array() && !other.is_object(),
        Relation::In => other.as_array().is_some_and(|list| !list.is_empty()),
    };
    if !fits {
        let rule = match relation {
            Relation::Above | Relation::Below => "a number or the name of a drawn number",
            Relation::Is => "one value",
            Relation::In => "a list of values",
        };
        return at.below(2).wrong(format!("{other} must be {rule} after `{}`", relation.name()), None);
    }
    Some(Condition { name: name.clone(), relation: *relation, other: other.clone() })
}
