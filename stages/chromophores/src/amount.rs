//! An amount of a chromophore as it stands in a pipeline file.

use std::borrow::Cow;
use std::fmt;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::value::StrDeserializer;
use serde::de::{self, Deserialize, Deserializer, Visitor};
use serde::{Serialize, Serializer};
use turbid_contract::{Concentration, Ratio};

/// A number in the unit of the chromophore (uM, or a share of the volume), or text with a unit: `40 uM`, `70 %`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Amount {
    pub value: f64,
    /// The unit that was written: "uM" or "1"; none of a plain number.
    pub unit: Option<&'static str>,
}

impl Serialize for Amount {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        // -0.0 and 0.0 are the same amount and must have the same key.
        serializer.serialize_f64(if self.value == 0.0 { 0.0 } else { self.value })
    }
}

impl<'de> Deserialize<'de> for Amount {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Wanted;
        impl Visitor<'_> for Wanted {
            type Value = Amount;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a number in uM or a share of the volume, or text with a unit such as `40 uM` or `70 %`")
            }
            fn visit_f64<E: de::Error>(self, value: f64) -> Result<Amount, E> {
                if value.is_finite() {
                    Ok(Amount { value, unit: None })
                } else {
                    Err(E::custom(format!("{value} is not a finite number")))
                }
            }
            fn visit_i64<E: de::Error>(self, value: i64) -> Result<Amount, E> {
                self.visit_f64(value as f64)
            }
            fn visit_u64<E: de::Error>(self, value: u64) -> Result<Amount, E> {
                self.visit_f64(value as f64)
            }
            fn visit_str<E: de::Error>(self, text: &str) -> Result<Amount, E> {
                if text.trim_end().ends_with('%') {
                    let Ratio(value) = Ratio::deserialize(StrDeserializer::new(text))?;
                    return Ok(Amount { value, unit: Some("1") });
                }
                let Concentration(value) = Concentration::deserialize(StrDeserializer::new(text))?;
                Ok(Amount { value, unit: Some(Concentration::UNIT) })
            }
        }
        deserializer.deserialize_any(Wanted)
    }
}

impl JsonSchema for Amount {
    fn schema_name() -> Cow<'static, str> {
        "Amount".into()
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "description": "number in uM, or a share of the volume; or text with a unit such as `40 uM` or `70 %`",
            "type": ["number", "string"]
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn amounts_say_their_unit_or_leave_it_to_the_chromophore() {
        let read = |json: &str| serde_json::from_str::<Amount>(json).map(|amount| (amount.value, amount.unit));
        assert_eq!(read("40").unwrap(), (40.0, None));
        assert_eq!(read("\"0.04 mM\"").unwrap(), (40.0, Some("uM")));
        assert_eq!(read("\"75 %\"").unwrap(), (0.75, Some("1")));
        assert!(read("\"40 mm\"").unwrap_err().to_string().contains("dimension length"));
        assert!(read("\"much\"").is_err() && read("true").is_err());
        assert_eq!(
            serde_json::to_string(&read("-0.0").map(|(value, unit)| Amount { value, unit }).unwrap()).unwrap(),
            "0.0"
        );
    }
}
