//! A quantity that is one number for all channels (wavelengths), or a list with one number for each.

use std::borrow::Cow;
use std::fmt;
use std::marker::PhantomData;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::value::{F64Deserializer, I64Deserializer, SeqAccessDeserializer, StrDeserializer, U64Deserializer};
use serde::de::{self, Deserialize, Deserializer, SeqAccess, Visitor};
use serde::{Serialize, Serializer};

/// `0.1` or `[0.1, 0.2]`.
#[derive(Clone, Debug, PartialEq)]
pub enum PerChannel<T> {
    One(T),
    Each(Vec<T>),
}

impl<T> PerChannel<T> {
    /// How many channels are told apart; `None` where one value holds for all.
    pub fn channels(&self) -> Option<usize> {
        match self {
            Self::One(_) => None,
            Self::Each(values) => Some(values.len()),
        }
    }

    /// The value of a channel; `None` beyond the end of a list.
    pub fn of(&self, channel: usize) -> Option<&T> {
        match self {
            Self::One(value) => Some(value),
            Self::Each(values) => values.get(channel),
        }
    }

    /// Each value with where it stands below `path`.
    pub fn entries(&self, path: &str) -> Vec<(String, &T)> {
        match self {
            Self::One(value) => vec![(path.to_owned(), value)],
            Self::Each(values) => values.iter().enumerate().map(|(i, value)| (format!("{path}.{i}"), value)).collect(),
        }
    }
}

impl<T: Serialize> Serialize for PerChannel<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::One(value) => value.serialize(serializer),
            Self::Each(values) => values.serialize(serializer),
        }
    }
}

// By hand: an untagged enum would lose the message of the quantity inside.
impl<'de, T: Deserialize<'de>> Deserialize<'de> for PerChannel<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Wanted<T>(PhantomData<T>);
        impl<'de, T: Deserialize<'de>> Visitor<'de> for Wanted<T> {
            type Value = PerChannel<T>;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a quantity, or a list with one per channel")
            }
            fn visit_f64<E: de::Error>(self, v: f64) -> Result<Self::Value, E> {
                T::deserialize(F64Deserializer::new(v)).map(PerChannel::One)
            }
            fn visit_i64<E: de::Error>(self, v: i64) -> Result<Self::Value, E> {
                T::deserialize(I64Deserializer::new(v)).map(PerChannel::One)
            }
            fn visit_u64<E: de::Error>(self, v: u64) -> Result<Self::Value, E> {
                T::deserialize(U64Deserializer::new(v)).map(PerChannel::One)
            }
            fn visit_str<E: de::Error>(self, v: &str) -> Result<Self::Value, E> {
                T::deserialize(StrDeserializer::new(v)).map(PerChannel::One)
            }
            fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<Self::Value, A::Error> {
                Vec::deserialize(SeqAccessDeserializer::new(seq)).map(PerChannel::Each)
            }
        }
        deserializer.deserialize_any(Wanted(PhantomData))
    }
}

impl<T: JsonSchema> JsonSchema for PerChannel<T> {
    fn schema_name() -> Cow<'static, str> {
        format!("{}PerChannel", T::schema_name()).into()
    }
    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let one = generator.subschema_for::<T>();
        let each = generator.subschema_for::<Vec<T>>();
        json_schema!({ "anyOf": [one, each] })
    }
}
