//! Params from the JSON value of `with`; a mistake is told by what it is, so that nobody has to read its text to know.

use std::fmt;

use serde::de::value::StrDeserializer;
use serde::de::{
    self, DeserializeOwned, DeserializeSeed, Deserializer, EnumAccess, Error as _, Expected, IntoDeserializer,
    MapAccess, SeqAccess, Unexpected, VariantAccess, Visitor,
};
use serde_json::{Number, Value};

use crate::problem::{At, Problem};
use crate::suggest;

/// Why params could not be read: the field, and what is wrong with it.
#[derive(Clone, Debug, PartialEq)]
pub struct ParamError {
    /// Field path below `with`; empty for `with` itself. Where a key is unknown or missing, that of the map around it.
    pub path: Vec<String>,
    pub mistake: ParamMistake,
}

/// What can be wrong with the shape of params. What their values must hold is for `Stage::check`.
#[derive(Clone, Debug, PartialEq)]
pub enum ParamMistake {
    /// A key that the map does not have.
    UnknownKey {
        name: String,
        known: &'static [&'static str],
    },
    /// A word that is none of those to choose from.
    UnknownChoice {
        name: String,
        known: &'static [&'static str],
    },
    Missing(String),
    /// Another kind of value, or a number out of the range of its type.
    Type {
        found: Found,
        wanted: Wanted,
    },
    /// A list of another length: values found, values wanted.
    Length {
        found: usize,
        wanted: usize,
    },
    /// A quantity with an unknown unit, or one of another dimension: the whole message.
    Unit(String),
    /// Any other rule, in the words of the type that has it.
    Other(String),
}

/// What stands where something else is wanted.
#[derive(Clone, Debug, PartialEq)]
pub enum Found {
    Nothing,
    Bool(bool),
    Number(Number),
    Text(String),
    List,
    Map,
    Other(String),
}

/// What is wanted.
#[derive(Clone, Debug, PartialEq)]
pub enum Wanted {
    Bool,
    /// A whole number: the smallest and the largest that the type holds.
    Whole {
        least: i64,
        most: u64,
    },
    Number,
    Text,
    List,
    /// A list of so many values.
    ListOf(usize),
    Map,
    /// In the words of the type: `a number in mm, or text with a unit such as 2 mm`.
    Described(String),
}

/// Reads the value of `with` as the params of a stage.
///
/// Error: the first mistake, with its field. Structs are maps: lists of their fields in order are refused.
pub fn read_params<P: DeserializeOwned>(params: &Value) -> Result<P, ParamError> {
    use serde_path_to_error::Segment;
    serde_path_to_error::deserialize(Json(params)).map_err(|error| {
        let step = |segment: &Segment| match segment {
            Segment::Seq { index } => Some(index.to_string()),
            Segment::Map { key } => Some(key.clone()),
            Segment::Enum { variant } => Some(variant.clone()),
            Segment::Unknown => None,
        };
        ParamError { path: error.path().iter().filter_map(step).collect(), mistake: error.into_inner() }
    })
}

impl fmt::Display for Found {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nothing => f.write_str("empty"),
            Self::Bool(b) => write!(f, "{b}"),
            Self::Number(n) => write!(f, "{n}"),
            Self::Text(text) => write!(f, "the text {text:?}"),
            Self::List => f.write_str("a list"),
            Self::Map => f.write_str("a map"),
            Self::Other(what) => f.write_str(what),
        }
    }
}

impl Wanted {
    /// What serde calls the types that its own `Deserialize`s want; in one place, since it has no other way to say it.
    fn of(expected: &dyn Expected) -> Self {
        let name = expected.to_string();
        let (bare, nonzero) = name.strip_prefix("a nonzero ").map_or((name.as_str(), false), |bare| (bare, true));
        let unsigned = |most| Self::Whole { least: i64::from(nonzero), most };
        match bare {
            "u8" => unsigned(u8::MAX.into()),
            "u16" => unsigned(u16::MAX.into()),
            "u32" => unsigned(u32::MAX.into()),
            "u64" | "usize" => unsigned(u64::MAX),
            "i8" => Self::Whole { least: i8::MIN.into(), most: i8::MAX as u64 },
            "i16" => Self::Whole { least: i16::MIN.into(), most: i16::MAX as u64 },
            "i32" => Self::Whole { least: i32::MIN.into(), most: i32::MAX as u64 },
            "i64" | "isize" => Self::Whole { least: i64::MIN, most: i64::MAX as u64 },
            "f32" | "f64" => Self::Number,
            "a string" => Self::Text,
            "a boolean" => Self::Bool,
            "a sequence" => Self::List,
            "a map" => Self::Map,
            _ => Self::Described(name),
        }
    }

    /// The rule, for something that breaks it: limits of a type are named to those who are beyond them.
    pub fn rule(&self, found: &Found) -> String {
        match (self, found) {
            (Self::Bool, _) => "true or false".to_owned(),
            (Self::Whole { least, most }, Found::Number(n)) if beyond(n, *least, *most) => {
                format!("a whole number from {least} to {most}")
            }
            (Self::Whole { least: least @ (0 | 1), .. }, _) => format!("a whole number, {least} or more"),
            (Self::Whole { .. }, _) => "a whole number".to_owned(),
            (Self::Number, _) => "a number".to_owned(),
            (Self::Text, _) => "a text".to_owned(),
            (Self::List, _) => "a list".to_owned(),
            (Self::ListOf(n), _) => format!("a list of {n} values"),
            (Self::Map, _) => "a map".to_owned(),
            (Self::Described(words), _) => words.clone(),
        }
    }
}

/// Whether a number is above the range of its type, or below that of one with negative numbers.
fn beyond(n: &Number, least: i64, most: u64) -> bool {
    n.as_f64().is_some_and(|x| x > most as f64 || (least < 0 && x < least as f64))
}

impl ParamMistake {
    /// The way out, where names are known: the one that was meant, or else all there are.
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::UnknownKey { name, known } | Self::UnknownChoice { name, known } => {
                suggest::hint(name, known.iter().copied())
            }
            _ => None,
        }
    }
}

impl From<ParamError> for Problem {
    fn from(error: ParamError) -> Self {
        let hint = error.mistake.hint();
        Self { at: At::With, path: error.path.join("."), message: error.mistake.to_string(), hint }
    }
}

impl fmt::Display for ParamMistake {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::UnknownKey { name, .. } => write!(f, "there is no key `{name}` here"),
            Self::UnknownChoice { name, .. } => write!(f, "there is no choice `{name}` here"),
            Self::Missing(name) => write!(f, "`{name}` is missing"),
            Self::Type { found, wanted } => write!(f, "{found} stands where {} is wanted", wanted.rule(found)),
            Self::Length { found, wanted } => write!(f, "there are {found} values, but must be {wanted}"),
            Self::Unit(text) | Self::Other(text) => f.write_str(text),
        }
    }
}

impl fmt::Display for ParamError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.path.as_slice() {
            [] => self.mistake.fmt(f),
            path => write!(f, "{}: {}", path.join("."), self.mistake),
        }
    }
}

impl std::error::Error for ParamMistake {}
impl std::error::Error for ParamError {}

impl de::Error for ParamMistake {
    fn custom<T: fmt::Display>(message: T) -> Self {
        Self::Other(message.to_string())
    }

    /// [`crate::quantity`] says by [`Unexpected::Other`] what is wrong with a unit.
    fn invalid_value(found: Unexpected<'_>, expected: &dyn Expected) -> Self {
        match found {
            Unexpected::Other(message) => Self::Unit(message.to_owned()),
            found => Self::invalid_type(found, expected),
        }
    }

    fn invalid_type(found: Unexpected<'_>, expected: &dyn Expected) -> Self {
        let found = match found {
            Unexpected::Unit | Unexpected::Option => Found::Nothing,
            Unexpected::Bool(b) => Found::Bool(b),
            Unexpected::Unsigned(n) => Found::Number(n.into()),
            Unexpected::Signed(n) => Found::Number(n.into()),
            Unexpected::Float(x) => Number::from_f64(x).map_or_else(|| Found::Other(x.to_string()), Found::Number),
            Unexpected::Char(c) => Found::Text(c.to_string()),
            Unexpected::Str(text) => Found::Text(text.to_owned()),
            Unexpected::Seq => Found::List,
            Unexpected::Map => Found::Map,
            other => Found::Other(other.to_string()),
        };
        Self::Type { found, wanted: Wanted::of(expected) }
    }

    fn invalid_length(found: usize, expected: &dyn Expected) -> Self {
        Self::Other(format!("there are {found} values, but must be {expected}"))
    }

    fn unknown_variant(name: &str, known: &'static [&'static str]) -> Self {
        Self::UnknownChoice { name: name.to_owned(), known }
    }

    fn unknown_field(name: &str, known: &'static [&'static str]) -> Self {
        Self::UnknownKey { name: name.to_owned(), known }
    }

    fn missing_field(name: &'static str) -> Self {
        Self::Missing(name.to_owned())
    }

    fn duplicate_field(name: &'static str) -> Self {
        Self::Other(format!("`{name}` stands twice"))
    }
}

/// A JSON value as serde reads it.
#[derive(Clone, Copy)]
struct Json<'v>(&'v Value);

impl Json<'_> {
    fn instead_of(self, wanted: Wanted) -> ParamMistake {
        let found = match self.0 {
            Value::Null => Found::Nothing,
            Value::Bool(b) => Found::Bool(*b),
            Value::Number(n) => Found::Number(n.clone()),
            Value::String(text) => Found::Text(text.clone()),
            Value::Array(_) => Found::List,
            Value::Object(_) => Found::Map,
        };
        ParamMistake::Type { found, wanted }
    }
}

impl<'de> Json<'de> {
    /// The values of a list; `must` of them, where that is fixed.
    fn list<V: Visitor<'de>>(self, must: Option<usize>, visitor: V) -> Result<V::Value, ParamMistake> {
        let Value::Array(items) = self.0 else {
            return Err(self.instead_of(must.map_or(Wanted::List, Wanted::ListOf)));
        };
        let mut list = List { items: items.iter(), ended: false };
        let read = visitor.visit_seq(&mut list);
        match must {
            // Too few: the type asked for more than there are. Too many: it did not take all.
            Some(wanted) if items.len() < wanted && list.ended || items.len() > wanted && read.is_ok() => {
                Err(ParamMistake::Length { found: items.len(), wanted })
            }
            _ => read,
        }
    }

    fn map<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ParamMistake> {
        match self.0 {
            Value::Object(map) => visitor.visit_map(Entries { entries: map.iter(), value: None }),
            _ => Err(self.instead_of(Wanted::Map)),
        }
    }
}

impl<'de> Deserializer<'de> for Json<'de> {
    type Error = ParamMistake;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ParamMistake> {
        match self.0 {
            Value::Null => visitor.visit_unit(),
            Value::Bool(b) => visitor.visit_bool(*b),
            Value::Number(n) => match (n.as_u64(), n.as_i64(), n.as_f64()) {
                (Some(n), _, _) => visitor.visit_u64(n),
                (_, Some(n), _) => visitor.visit_i64(n),
                (_, _, Some(x)) => visitor.visit_f64(x),
                _ => Err(ParamMistake::custom(format!("{n} is no number of 64 bits"))),
            },
            Value::String(text) => visitor.visit_borrowed_str(text),
            Value::Array(_) => self.list(None, visitor),
            Value::Object(_) => self.map(visitor),
        }
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ParamMistake> {
        if self.0.is_null() { visitor.visit_none() } else { visitor.visit_some(self) }
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        visitor: V,
    ) -> Result<V::Value, ParamMistake> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_seq<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ParamMistake> {
        self.list(None, visitor)
    }

    fn deserialize_tuple<V: Visitor<'de>>(self, len: usize, visitor: V) -> Result<V::Value, ParamMistake> {
        self.list(Some(len), visitor)
    }

    fn deserialize_tuple_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        len: usize,
        visitor: V,
    ) -> Result<V::Value, ParamMistake> {
        self.list(Some(len), visitor)
    }

    fn deserialize_map<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ParamMistake> {
        self.map(visitor)
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ParamMistake> {
        self.map(visitor)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ParamMistake> {
        match self.0 {
            Value::String(name) => visitor.visit_enum(Choice { name, content: None }),
            Value::Object(map) if map.len() == 1 => {
                let (name, content) = map.iter().next().expect("it has one entry");
                visitor.visit_enum(Choice { name, content: Some(content) })
            }
            _ => Err(self.instead_of(Wanted::Described(format!("one of {}", variants.join(", "))))),
        }
    }

    serde::forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf unit unit_struct identifier ignored_any
    }
}

struct List<'v> {
    items: std::slice::Iter<'v, Value>,
    /// Whether more was asked for than there is.
    ended: bool,
}

impl<'de> SeqAccess<'de> for &mut List<'de> {
    type Error = ParamMistake;

    fn next_element_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<Option<T::Value>, ParamMistake> {
        let next = self.items.next();
        self.ended |= next.is_none();
        next.map(|value| seed.deserialize(Json(value))).transpose()
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.items.len())
    }
}

struct Entries<'v> {
    entries: serde_json::map::Iter<'v>,
    value: Option<&'v Value>,
}

impl<'de> MapAccess<'de> for Entries<'de> {
    type Error = ParamMistake;

    fn next_key_seed<K: DeserializeSeed<'de>>(&mut self, seed: K) -> Result<Option<K::Value>, ParamMistake> {
        let Some((key, value)) = self.entries.next() else { return Ok(None) };
        self.value = Some(value);
        let key: StrDeserializer<'_, ParamMistake> = key.as_str().into_deserializer();
        seed.deserialize(key).map(Some)
    }

    fn next_value_seed<V: DeserializeSeed<'de>>(&mut self, seed: V) -> Result<V::Value, ParamMistake> {
        seed.deserialize(Json(self.value.take().expect("serde asks for a value after its key")))
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.entries.len())
    }
}

/// `name`, or `name: content`.
struct Choice<'v> {
    name: &'v str,
    content: Option<&'v Value>,
}

impl<'de> EnumAccess<'de> for Choice<'de> {
    type Error = ParamMistake;
    type Variant = Content<'de>;

    fn variant_seed<V: DeserializeSeed<'de>>(self, seed: V) -> Result<(V::Value, Content<'de>), ParamMistake> {
        let name: StrDeserializer<'_, ParamMistake> = self.name.into_deserializer();
        Ok((seed.deserialize(name)?, Content(self.content)))
    }
}

struct Content<'v>(Option<&'v Value>);

impl<'de> Content<'de> {
    fn given(&self) -> Json<'de> {
        Json(self.0.unwrap_or(&Value::Null))
    }
}

impl<'de> VariantAccess<'de> for Content<'de> {
    type Error = ParamMistake;

    fn unit_variant(self) -> Result<(), ParamMistake> {
        match self.given() {
            Json(Value::Null) => Ok(()),
            content => Err(content.instead_of(Wanted::Described("nothing".to_owned()))),
        }
    }

    fn newtype_variant_seed<T: DeserializeSeed<'de>>(self, seed: T) -> Result<T::Value, ParamMistake> {
        seed.deserialize(self.given())
    }

    fn tuple_variant<V: Visitor<'de>>(self, len: usize, visitor: V) -> Result<V::Value, ParamMistake> {
        self.given().list(Some(len), visitor)
    }

    fn struct_variant<V: Visitor<'de>>(self, _: &'static [&'static str], visitor: V) -> Result<V::Value, ParamMistake> {
        self.given().map(visitor)
    }
}

#[cfg(test)]
mod tests;
