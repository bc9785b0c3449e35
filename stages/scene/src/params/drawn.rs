//! A quantity that is one number, or drawn anew for each body.

use std::borrow::Cow;
use std::fmt;
use std::marker::PhantomData;

use serde::de::value::{F64Deserializer, I64Deserializer, MapAccessDeserializer, StrDeserializer, U64Deserializer};
use serde::de::{self, Deserialize, Deserializer, MapAccess, Visitor};
use serde::{Serialize, Serializer};
use serde_json::{Map, Value};
use turbid_contract::schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use turbid_contract::{AngleDeg, Length};

/// `2`, `2 mm`, or a distribution, `{uniform: [1, 4]}`, whose numbers are in mm or degrees.
#[derive(Clone, Debug, PartialEq)]
pub enum Drawn<T> {
    One(T),
    /// As it stands in the file: what is wrong with it is told with its place.
    From(Map<String, Value>),
}

/// A quantity as a number in its unit.
pub trait Quantity: Copy {
    const UNIT: &'static str;
    fn number(self) -> f64;
}

impl Quantity for Length {
    const UNIT: &'static str = "mm";
    fn number(self) -> f64 {
        self.0
    }
}

impl Quantity for AngleDeg {
    const UNIT: &'static str = "deg";
    fn number(self) -> f64 {
        self.0
    }
}

impl<T: Default> Default for Drawn<T> {
    fn default() -> Self {
        Self::One(T::default())
    }
}

impl<T: Serialize> Serialize for Drawn<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::One(value) => value.serialize(serializer),
            Self::From(distribution) => distribution.serialize(serializer),
        }
    }
}

// By hand: an untagged enum would lose the message of the quantity inside.
impl<'de, T: Deserialize<'de>> Deserialize<'de> for Drawn<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Wanted<T>(PhantomData<T>);
        impl<'de, T: Deserialize<'de>> Visitor<'de> for Wanted<T> {
            type Value = Drawn<T>;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a quantity, or a distribution such as {uniform: [1, 4]}")
            }
            fn visit_f64<E: de::Error>(self, v: f64) -> Result<Self::Value, E> {
                T::deserialize(F64Deserializer::new(v)).map(Drawn::One)
            }
            fn visit_i64<E: de::Error>(self, v: i64) -> Result<Self::Value, E> {
                T::deserialize(I64Deserializer::new(v)).map(Drawn::One)
            }
            fn visit_u64<E: de::Error>(self, v: u64) -> Result<Self::Value, E> {
                T::deserialize(U64Deserializer::new(v)).map(Drawn::One)
            }
            fn visit_str<E: de::Error>(self, v: &str) -> Result<Self::Value, E> {
                T::deserialize(StrDeserializer::new(v)).map(Drawn::One)
            }
            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
                Map::deserialize(MapAccessDeserializer::new(map)).map(Drawn::From)
            }
        }
        deserializer.deserialize_any(Wanted(PhantomData))
    }
}

impl<T: JsonSchema> JsonSchema for Drawn<T> {
    fn schema_name() -> Cow<'static, str> {
        format!("Drawn_{}", T::schema_name()).into()
    }
    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let one = generator.subschema_for::<T>();
        let kinds = ["uniform", "loguniform", "normal", "lognormal", "beta", "integer", "choice", "within"];
        let properties: Map<String, Value> =
            kinds.into_iter().map(|kind| (kind.to_owned(), Value::Bool(true))).collect();
        let distribution = json_schema!({
            "description": "a distribution, drawn anew for each body: `{uniform: [1, 4]}`",
            "type": "object",
            "properties": properties,
            "additionalProperties": false,
            "minProperties": 1,
        });
        json_schema!({ "anyOf": [one, distribution] })
    }
}
