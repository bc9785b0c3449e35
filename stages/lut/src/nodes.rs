//! The nodes of a table axis as they stand in a pipeline file: a number, a list, `linspace` or `logspace`.

use std::borrow::Cow;
use std::fmt;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{self, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use turbid_contract::PerLength;

/// The most nodes of one axis: beyond, a table is not a table but a mistake.
const MOST: u64 = 10_000;

/// Nodes in mm^-1, as written; all spellings of the same nodes serialize alike.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(transparent)]
pub struct Nodes(pub Vec<f64>);

impl Nodes {
    /// `count` nodes from `first` to `last`, both included, in equal ratios.
    pub fn logspace(first: f64, last: f64, count: usize) -> Self {
        let (a, b) = (libm::log(first), libm::log(last));
        Self(spaced(count, first, last, |t| libm::exp(a + (b - a) * t)))
    }

    /// `count` nodes from `first` to `last`, both included, in equal steps.
    pub fn linspace(first: f64, last: f64, count: usize) -> Self {
        Self(spaced(count, first, last, |t| first + (last - first) * t))
    }
}

/// The ends are exactly those given, whatever the function rounds them to.
fn spaced(count: usize, first: f64, last: f64, at: impl Fn(f64) -> f64) -> Vec<f64> {
    (0..count)
        .map(|i| match i {
            0 => first,
            i if i + 1 == count => last,
            i => at(i as f64 / (count - 1) as f64),
        })
        .collect()
}

impl<'de> Deserialize<'de> for Nodes {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(Wanted)
    }
}

struct Wanted;

impl<'de> Visitor<'de> for Wanted {
    type Value = Nodes;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("nodes in mm^-1: a list, {logspace: [first, last, count]} or {linspace: [first, last, count]}")
    }

    fn visit_f64<E: de::Error>(self, v: f64) -> Result<Nodes, E> {
        Ok(Nodes(vec![v]))
    }

    fn visit_i64<E: de::Error>(self, v: i64) -> Result<Nodes, E> {
        self.visit_f64(v as f64)
    }

    fn visit_u64<E: de::Error>(self, v: u64) -> Result<Nodes, E> {
        self.visit_f64(v as f64)
    }

    fn visit_str<E: de::Error>(self, v: &str) -> Result<Nodes, E> {
        PerLength::deserialize(de::value::StrDeserializer::new(v)).map(|q| Nodes(vec![q.0]))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Nodes, A::Error> {
        let mut nodes = Vec::new();
        while let Some(PerLength(node)) = items.next_element()? {
            nodes.push(node);
        }
        Ok(Nodes(nodes))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Nodes, A::Error> {
        let spacing: Option<String> = map.next_key()?;
        let spacing = spacing.ok_or_else(|| de::Error::custom("{} names no nodes"))?;
        if spacing != "logspace" && spacing != "linspace" {
            return Err(de::Error::unknown_field(&spacing, &["logspace", "linspace"]));
        }
        let (PerLength(first), PerLength(last), count): (PerLength, PerLength, u64) = map.next_value()?;
        if let Some(other) = map.next_key::<String>()? {
            return Err(de::Error::custom(format!("`{spacing}` and `{other}` cannot stand together")));
        }
        if !(2..=MOST).contains(&count) {
            return Err(de::Error::custom(format!("count = {count} must lie in 2..={MOST}")));
        }
        if spacing == "linspace" {
            return Ok(Nodes::linspace(first, last, count as usize));
        }
        if first > 0.0 && last > 0.0 {
            return Ok(Nodes::logspace(first, last, count as usize));
        }
        Err(de::Error::custom(format!("logspace from {first} to {last} mm^-1: both ends must be > 0")))
    }
}

impl JsonSchema for Nodes {
    fn schema_name() -> Cow<'static, str> {
        "Nodes".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        let quantity = || json_schema!({"type": ["number", "string"], "unit": "mm^-1"});
        let spacing = json_schema!({
            "description": "[first, last, count], ends included",
            "type": "array", "prefixItems": [quantity(), quantity(), {"type": "integer", "minimum": 2}],
            "minItems": 3, "maxItems": 3
        });
        json_schema!({
            "description": "nodes in mm^-1",
            "anyOf": [
                quantity(),
                {"type": "array", "items": quantity()},
                {"type": "object", "properties": {"logspace": spacing}, "required": ["logspace"], "additionalProperties": false},
                {"type": "object", "properties": {"linspace": spacing}, "required": ["linspace"], "additionalProperties": false}
            ]
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(json: &str) -> Result<Vec<f64>, String> {
        serde_json::from_str::<Nodes>(json).map(|n| n.0).map_err(|e| e.to_string())
    }

    #[test]
    fn all_spellings_are_read() {
        assert_eq!(read("0.1"), Ok(vec![0.1]));
        assert_eq!(read("[0, \"1 cm^-1\"]"), Ok(vec![0.0, 0.1]));
        assert_eq!(read("{\"linspace\": [0, 1, 3]}"), Ok(vec![0.0, 0.5, 1.0]));
        let log = read("{\"logspace\": [1e-4, 0.5, 5]}").unwrap();
        assert_eq!((log[0], log[4]), (1e-4, 0.5));
        // Equal ratios, to rounding.
        assert!((log[1] / log[0] / (log[4] / log[3]) - 1.0).abs() < 1e-14);
    }

    #[test]
    fn mistakes_are_named() {
        for (json, word) in [
            ("{}", "names no nodes"),
            ("{\"logspce\": [1, 2, 3]}", "unknown field `logspce`"),
            ("{\"logspace\": [0, 2, 3]}", "both ends must be > 0"),
            ("{\"logspace\": [1, 2, 1]}", "count = 1 must lie in 2..=10000"),
            ("{\"linspace\": [1, 2]}", "invalid length 2"),
            ("{\"linspace\": [1, 2, 3], \"logspace\": [1, 2, 3]}", "cannot stand together"),
            ("[\"1 mm\"]", "has the dimension length"),
            ("true", "nodes in mm^-1"),
        ] {
            let error = read(json).unwrap_err();
            assert!(error.contains(word), "{json}: {error}");
        }
    }
}
