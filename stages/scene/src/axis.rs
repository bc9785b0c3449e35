//! A direction: `x`, `y`, `z`, `-x`, `-y`, `-z`, or a vector.

use std::borrow::Cow;
use std::fmt;

use glam::DVec3;
use serde::de::value::SeqAccessDeserializer;
use serde::de::{self, Deserialize, Deserializer, SeqAccess, Visitor};
use serde::{Serialize, Serializer};
use turbid_contract::schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};

const NAMES: [(&str, [f64; 3]); 6] = [
    ("x", [1.0, 0.0, 0.0]),
    ("y", [0.0, 1.0, 0.0]),
    ("z", [0.0, 0.0, 1.0]),
    ("-x", [-1.0, 0.0, 0.0]),
    ("-y", [0.0, -1.0, 0.0]),
    ("-z", [0.0, 0.0, -1.0]),
];

/// z where nothing is said.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis(pub [f64; 3]);

impl Axis {
    /// The unit vector; `None` where it has no direction.
    pub fn unit(&self) -> Option<[f64; 3]> {
        // -0.0 and 0.0 are the same place and must give the same bytes.
        DVec3::from(self.0).try_normalize().map(|v| v.to_array().map(|x| x + 0.0))
    }
}

impl Default for Axis {
    fn default() -> Self {
        Self([0.0, 0.0, 1.0])
    }
}

impl Serialize for Axis {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.0.map(|x| x + 0.0).serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Axis {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Wanted;
        impl<'de> Visitor<'de> for Wanted {
            type Value = Axis;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a direction: x, y, z, -x, -y, -z, or a vector of three numbers")
            }
            fn visit_str<E: de::Error>(self, v: &str) -> Result<Axis, E> {
                let known = NAMES.iter().find(|(name, _)| *name == v);
                known.map(|(_, axis)| Axis(*axis)).ok_or_else(|| {
                    E::custom(format!("`{v}` is no direction; write x, y, z, -x, -y, -z, or a vector of three numbers"))
                })
            }
            fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<Axis, A::Error> {
                <[f64; 3]>::deserialize(SeqAccessDeserializer::new(seq)).map(Axis)
            }
        }
        deserializer.deserialize_any(Wanted)
    }
}

impl JsonSchema for Axis {
    fn schema_name() -> Cow<'static, str> {
        "Axis".into()
    }
    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let vector = generator.subschema_for::<[f64; 3]>();
        let names: Vec<&str> = NAMES.iter().map(|(name, _)| *name).collect();
        json_schema!({ "description": "a direction: a name, or a vector", "anyOf": [{"enum": names}, vector] })
    }
}
