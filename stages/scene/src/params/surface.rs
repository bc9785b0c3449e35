//! Surfaces as they stand in a pipeline file.

use std::borrow::Cow;
use std::fmt;

use serde::de::value::{F64Deserializer, I64Deserializer, MapAccessDeserializer, StrDeserializer, U64Deserializer};
use serde::de::{self, Deserializer, MapAccess, Visitor};
use serde::{Deserialize, Serialize, Serializer};
use turbid_contract::schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use turbid_contract::{AngleDeg, Length, Ratio};

/// `smooth`; `{rough: alpha}`: a boundary of GGX microfacets, alpha in (0, 1]; `{lambertian: rho}`: opaque and diffusely reflecting
/// the fraction rho, a number or a texture; or `mirror`: opaque and reflecting all light.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(crate = "turbid_contract::schemars")]
pub enum SurfaceParams {
    #[default]
    Smooth,
    /// Roughness alpha of the microfacets, in (0, 1].
    Rough(Ratio),
    /// Fraction of the light that is reflected, in [0, 1]: a number or a texture.
    Lambertian(AlbedoParams),
    Mirror,
}

/// `0.4`, or `{sinusoid: {..}}` and the like.
#[derive(Clone, Debug, PartialEq)]
pub enum AlbedoParams {
    Even(Ratio),
    Textured(TextureParams),
}

/// A pattern wrapped around an object by its surface coordinates (u, v): on flat faces x and y; on round ones u runs
/// down along the axis and v around it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(crate = "turbid_contract::schemars")]
pub enum TextureParams {
    /// low + (high - low) (1 + cos(2 pi s / period)) / 2.
    Sinusoid(WaveParams),
    /// `high` over the half of each period around s = 0, else `low`.
    Stripes(WaveParams),
    /// Squares of `high` and `low` by turns.
    Checker(CheckerParams),
    /// A picture.
    Image(ImageParams),
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct WaveParams {
    /// Along s, on the surface.
    pub period: Length,
    /// Direction of s, turned from u towards v.
    #[serde(default)]
    pub orientation_deg: AngleDeg,
    /// Albedo where the pattern is 0 ...
    #[serde(default)]
    pub low: Ratio,
    /// ... and where it is 1; 1 where left out.
    #[serde(default = "one")]
    pub high: Ratio,
    /// (u, v) of s = 0; [0, 0] where left out.
    #[serde(default)]
    pub origin: [Length; 2],
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct CheckerParams {
    /// Of the squares.
    pub side: Length,
    /// Albedo of every second square ...
    #[serde(default)]
    pub low: Ratio,
    /// ... and of the one where u and v are above those of `origin`; 1 where left out.
    #[serde(default = "one")]
    pub high: Ratio,
    /// (u, v) of a corner; [0, 0] where left out.
    #[serde(default)]
    pub origin: [Length; 2],
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct ImageParams {
    /// PNG, grey, 8 or 16 bit; its values are taken as they are, linear between pixel centres.
    pub file: String,
    /// Width and height; repeated side by side. Left out, the picture covers each piece of the surface once.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size: Option<[Length; 2]>,
    /// Albedo where the picture is black ...
    #[serde(default)]
    pub low: Ratio,
    /// ... and where it is white; 1 where left out.
    #[serde(default = "one")]
    pub high: Ratio,
    /// (u, v) of the picture's middle; [0, 0] where left out.
    #[serde(default)]
    pub origin: [Length; 2],
}

fn one() -> Ratio {
    Ratio(1.0)
}

impl Serialize for AlbedoParams {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Even(rho) => rho.serialize(serializer),
            Self::Textured(texture) => texture.serialize(serializer),
        }
    }
}

// By hand: an untagged enum would lose the message of what is inside.
impl<'de> Deserialize<'de> for AlbedoParams {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Wanted;
        impl<'de> Visitor<'de> for Wanted {
            type Value = AlbedoParams;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a fraction, or a texture: {sinusoid: ..}, {stripes: ..}, {checker: ..} or {image: ..}")
            }
            fn visit_f64<E: de::Error>(self, v: f64) -> Result<Self::Value, E> {
                Ratio::deserialize(F64Deserializer::new(v)).map(AlbedoParams::Even)
            }
            fn visit_i64<E: de::Error>(self, v: i64) -> Result<Self::Value, E> {
                Ratio::deserialize(I64Deserializer::new(v)).map(AlbedoParams::Even)
            }
            fn visit_u64<E: de::Error>(self, v: u64) -> Result<Self::Value, E> {
                Ratio::deserialize(U64Deserializer::new(v)).map(AlbedoParams::Even)
            }
            fn visit_str<E: de::Error>(self, v: &str) -> Result<Self::Value, E> {
                Ratio::deserialize(StrDeserializer::new(v)).map(AlbedoParams::Even)
            }
            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
                TextureParams::deserialize(MapAccessDeserializer::new(map)).map(AlbedoParams::Textured)
            }
        }
        deserializer.deserialize_any(Wanted)
    }
}

impl JsonSchema for AlbedoParams {
    fn schema_name() -> Cow<'static, str> {
        "AlbedoParams".into()
    }
    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let even = generator.subschema_for::<Ratio>();
        let textured = generator.subschema_for::<TextureParams>();
        json_schema!({ "anyOf": [even, textured] })
    }
}
