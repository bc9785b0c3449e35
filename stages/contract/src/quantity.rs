//! Physical quantities as they stand in pipeline files: a number in the house unit, or a string with a unit.

use std::fmt;

use serde::de::{self, Deserialize, Deserializer, Unexpected, Visitor};
use serde::{Serialize, Serializer};

/// Unit name, dimension, factor to the house unit of that dimension.
const UNITS: &[(&str, &str, f64)] = &[
    ("mm", "length", 1.0),
    ("um", "length", 1e-3),
    ("µm", "length", 1e-3),
    ("nm", "length", 1e-6),
    ("cm", "length", 10.0),
    ("m", "length", 1e3),
    ("mm^-1", "inverse length", 1.0),
    ("1/mm", "inverse length", 1.0),
    ("/mm", "inverse length", 1.0),
    ("cm^-1", "inverse length", 0.1),
    ("1/cm", "inverse length", 0.1),
    ("/cm", "inverse length", 0.1),
    ("m^-1", "inverse length", 1e-3),
    ("1/m", "inverse length", 1e-3),
    ("/m", "inverse length", 1e-3),
    ("deg", "angle", 1.0),
    ("°", "angle", 1.0),
    ("rad", "angle", 180.0 / std::f64::consts::PI),
    ("mrad", "angle", 0.18 / std::f64::consts::PI),
    ("W", "power", 1.0),
    ("mW", "power", 1e-3),
    ("uW", "power", 1e-6),
    ("µW", "power", 1e-6),
    ("s", "time", 1.0),
    ("ms", "time", 1e-3),
    ("min", "time", 60.0),
    ("h", "time", 3600.0),
    ("%", "ratio", 0.01),
    ("uM", "concentration", 1.0),
    ("µM", "concentration", 1.0),
    ("umol/l", "concentration", 1.0),
    ("nM", "concentration", 1e-3),
    ("mM", "concentration", 1e3),
    ("M", "concentration", 1e6),
];

/// Why a text is no quantity.
enum Wrong {
    /// It does not begin with a number.
    NoNumber,
    /// What is wrong with its unit, as a whole message.
    Unit(String),
}

/// Parses `"0.5 m"` into the house unit of `dimension`; `scale` converts that to the unit of the type.
fn parse_quantity(text: &str, dimension: &str, unit: &str, scale: f64) -> Result<f64, Wrong> {
    let text = text.trim();
    if meant_number(text).is_some() {
        return Err(Wrong::NoNumber);
    }
    let split = number_end(text, "+-._");
    let (number, name) = (text[..split].trim(), text[split..].trim());
    let value: f64 = number.parse().map_err(|_| Wrong::NoNumber)?;
    if name.is_empty() {
        return Err(Wrong::NoNumber);
    }
    match UNITS.iter().find(|(known, _, _)| *known == name) {
        Some(&(_, found, factor)) if found == dimension => Ok(value * factor * scale),
        Some((_, found, _)) => {
            let wanted = if unit == "1" { "a number without one".to_owned() } else { format!("{dimension} in {unit}") };
            Err(Wrong::Unit(format!("`{text}` has the dimension {found}; {wanted} is wanted")))
        }
        None => {
            let known: Vec<&str> = UNITS.iter().filter(|u| u.1 == dimension).map(|u| u.0).collect();
            Err(Wrong::Unit(format!("unit `{name}` is not known; for {dimension} write {}", known.join(", "))))
        }
    }
}

/// Where the number at the begin of a text ends; `signs` are the characters but digits that it may hold.
fn number_end(text: &str, signs: &str) -> usize {
    let other = |&(i, c): &(usize, char)| !(c.is_ascii_digit() || signs.contains(c) || is_exponent(text, i, c));
    text.char_indices().find(other).map_or(text.len(), |(i, _)| i)
}

/// `0,1`, `1_000 mm`, `1,000,000`: numbers to somebody, but neither to YAML nor here; as they are to be written.
pub fn meant_number(text: &str) -> Option<String> {
    let (number, unit) = text.split_at(number_end(text, "+-._,"));
    if !number.contains([',', '_']) {
        return None;
    }
    let plain = number.replace('_', "");
    let tried = [plain.replacen(',', ".", 1), plain.replace(',', "")];
    tried.into_iter().find(|t| t.parse::<f64>().is_ok_and(f64::is_finite)).map(|meant| format!("{meant}{unit}"))
}

fn is_exponent(text: &str, i: usize, c: char) -> bool {
    (c == 'e' || c == 'E') && i > 0 && text[i + 1..].starts_with(|d: char| d.is_ascii_digit() || d == '-' || d == '+')
}

/// What a quantity may be written as.
fn described(unit: &str) -> String {
    match unit {
        "1" => "number without a unit".to_owned(),
        _ => format!("number in {unit}, or text with a unit such as `2 {unit}`"),
    }
}

macro_rules! quantity {
    ($(#[$doc:meta])* $name:ident, $dimension:literal, $unit:literal, $scale:expr) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
        pub struct $name(pub f64);

        impl $name {
            /// The unit of the number inside.
            pub const UNIT: &'static str = $unit;
        }

        impl From<f64> for $name {
            fn from(value: f64) -> Self {
                Self(value)
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "{} {}", self.0, $unit)
            }
        }

        impl Serialize for $name {
            fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                // -0.0 and 0.0 are the same quantity and must have the same key.
                serializer.serialize_f64(if self.0 == 0.0 { 0.0 } else { self.0 })
            }
        }

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                struct Wanted;
                impl Visitor<'_> for Wanted {
                    type Value = f64;
                    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                        write!(f, "a {}", described($unit))
                    }
                    fn visit_f64<E: de::Error>(self, v: f64) -> Result<f64, E> {
                        if v.is_finite() { Ok(v) } else { Err(E::custom(format!("{v} is not a finite number"))) }
                    }
                    fn visit_i64<E: de::Error>(self, v: i64) -> Result<f64, E> {
                        Ok(v as f64)
                    }
                    fn visit_u64<E: de::Error>(self, v: u64) -> Result<f64, E> {
                        Ok(v as f64)
                    }
                    fn visit_str<E: de::Error>(self, v: &str) -> Result<f64, E> {
                        match parse_quantity(v, $dimension, $unit, $scale) {
                            Ok(value) => self.visit_f64(value),
                            Err(Wrong::NoNumber) => Err(E::invalid_type(Unexpected::Str(v), &self)),
                            // What `crate::read` knows a wrong unit by.
                            Err(Wrong::Unit(message)) => Err(E::invalid_value(Unexpected::Other(&message), &self)),
                        }
                    }
                }
                deserializer.deserialize_any(Wanted).map($name)
            }
        }

        impl schemars::JsonSchema for $name {
            fn schema_name() -> std::borrow::Cow<'static, str> {
                stringify!($name).into()
            }
            fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
                schemars::json_schema!({
                    "description": described($unit),
                    "type": ["number", "string"],
                    "unit": $unit
                })
            }
        }
    };
}

quantity!(
    /// A length in mm.
    Length, "length", "mm", 1.0
);
quantity!(
    /// A coefficient or a spatial frequency in mm^-1.
    PerLength, "inverse length", "mm^-1", 1.0
);
quantity!(
    /// One of the paper's densities in m^-1; only `scene` knows them.
    Density, "inverse length", "m^-1", 1e3
);
quantity!(
    /// A wavelength in nm.
    Wavelength, "length", "nm", 1e6
);
quantity!(
    /// An angle in degrees (keys end in `_deg`).
    AngleDeg, "angle", "deg", 1.0
);
quantity!(
    /// A power in W.
    Power, "power", "W", 1.0
);
quantity!(
    /// A span of time in s.
    Seconds, "time", "s", 1.0
);
quantity!(
    /// An amount of substance in a volume, in uM (umol/l).
    Concentration, "concentration", "uM", 1.0
);
quantity!(
    /// A pure number; `"1 %"` is 0.01.
    Ratio, "ratio", "1", 1.0
);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::read::read_params;

    fn length(json: &str) -> Result<f64, String> {
        let value = serde_json::from_str(json).expect("the test writes JSON");
        read_params::<Length>(&value).map(|l| l.0).map_err(|e| e.to_string())
    }

    #[test]
    fn units_convert_and_wrong_dimensions_are_named() {
        assert_eq!(length("3"), Ok(3.0));
        assert_eq!(length("\"0.5 m\""), Ok(500.0));
        assert_eq!(length("\"1e2 um\""), Ok(0.1));
        assert_eq!(length("\"-2cm\""), Ok(-20.0));
        let wrong = |text: &str| length(&format!("\"{text}\"")).unwrap_err();
        assert_eq!(wrong("4 deg"), "`4 deg` has the dimension angle; length in mm is wanted");
        assert_eq!(wrong("4 furlong"), "unit `furlong` is not known; for length write mm, um, µm, nm, cm, m");
        let rule = "a number in mm, or text with a unit such as `2 mm` is wanted";
        for text in ["4", "0,1", "five", "", "1_000 um"] {
            assert_eq!(wrong(text), format!("the text \"{text}\" stands where {rule}"));
        }
        assert_eq!(serde_json::from_str::<Density>("\"0.1 mm^-1\"").unwrap().0, 100.0);
        assert_eq!(serde_json::to_string(&Length(-0.0)).unwrap(), "0.0");
    }

    #[test]
    fn numbers_written_otherwise_are_known() {
        for (text, meant) in
            [("0,1", "0.1"), ("1_000 um", "1000 um"), ("1,000,000", "1000000"), ("-2,5e-3 mm", "-2.5e-3 mm")]
        {
            assert_eq!(meant_number(text).as_deref(), Some(meant));
        }
        assert!(["0.1", "tissue", "", ",", "1.2,3.4.5"].iter().all(|text| meant_number(text).is_none()));
    }
}
