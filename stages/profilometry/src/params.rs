//! The params of `profilometry`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use turbid_contract::{AngleDeg, Length, PerLength};

/// How a phase becomes a height.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// The camera's ray meets the projector's plane of that phase: any known geometry, with lens distortion.
    #[default]
    Triangulation,
    /// h = l_0 dphi / (dphi - 2 pi f_0 d): both pupils equally high over the plane, phase linear on it.
    Formula,
    /// The shift along a reference plane whose phase is measured (or computed): any pupils, any phase that rises.
    ReferenceMap,
}

/// How whole turns of the phase difference are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Unwrap {
    /// `none` where `heights` leave no room for another turn, else `quality`.
    #[default]
    Auto,
    /// |dphi| < pi is known.
    None,
    /// In space, most reliable neighbours first.
    Quality,
    /// Through the f_x of the phase, from the lowest, which must be free of turns.
    Temporal,
}

/// The surface whose phase is the reference.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ReferenceSurface {
    /// World z, mm.
    Plane(Length),
    /// The inside of a straight tube along z.
    Tube(Tube),
}

/// The bore of a straight tube along z with open ends.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Tube {
    /// Of its bore.
    pub inner_diameter: Length,
    /// From end to end.
    pub length: Length,
    /// World z of its upper end.
    pub top: Length,
    /// World x and y of its axis; [0, 0] where left out.
    #[serde(default)]
    pub center: [Length; 2],
}

/// Params of `profilometry`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    pub method: Method,
    pub unwrap: Unwrap,
    /// Which fringes to use; the highest f_x if left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub f_x: Option<PerLength>,
    /// Which orientation to use, where the phase has several.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub orientation_deg: Option<AngleDeg>,
    /// World z between which the surface is known to lie, mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub heights: Option<[Length; 2]>,
    /// Where the reference is; the pattern's plane if left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference_surface: Option<ReferenceSurface>,
}
