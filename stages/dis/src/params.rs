//! Params of `calibrate_dis`.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use turbid_contract::{AngleDeg, Density, Length, PerLength, Ratio};

/// Params of `calibrate_dis`; only what stands in nature has no default.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Params {
    /// What is measured, one after the other, by name.
    pub media: BTreeMap<String, MediumParams>,
    pub spheres: SpheresParams,
    pub sample: SampleParams,
    pub beam: BeamParams,
    pub standard: StandardParams,
    /// Photons for each medium and for each normalising reading.
    pub samples: u64,
    #[serde(default)]
    pub method: MethodParam,
}

/// mu_a with mu_s or mu_s_prime (mm^-1), or the densities A_rho and S_rho (m^-1); g and n always.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MediumParams {
    /// Absorption coefficient, mm^-1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mu_a: Option<PerLength>,
    /// Scattering coefficient, mm^-1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mu_s: Option<PerLength>,
    /// Reduced scattering coefficient mu_s (1 - g), mm^-1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mu_s_prime: Option<PerLength>,
    /// Absorption density, m^-1: mu_a = A_rho / 1000.
    #[serde(default, rename = "A_rho", skip_serializing_if = "Option::is_none")]
    pub a_rho: Option<Density>,
    /// Scattering density, m^-1: mu_s = S_rho / 1000.
    #[serde(default, rename = "S_rho", skip_serializing_if = "Option::is_none")]
    pub s_rho: Option<Density>,
    /// Mean cosine of the Henyey-Greenstein phase function, in (-1, 1).
    pub g: Ratio,
    /// Refractive index, >= 1.
    pub n: Ratio,
}

/// Two equal spheres, the sample between them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SpheresParams {
    /// Inner diameter.
    pub diameter: Length,
    /// Of walls, necks and baffles, which all obey the cosine law; in [0, 1].
    pub wall_reflectance: Ratio,
    pub ports: PortsParams,
    /// Distance from the rim of the sample port to the sample; its side is white like the wall.
    #[serde(default)]
    pub neck: Length,
    /// Light that has left white surfaces so many times ends there, as in renderers that cut paths; left out: no limit, as in nature.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bounces: Option<u32>,
    /// In either sphere, between sample and detector.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub baffle: Option<BaffleParams>,
}

/// The holes in the walls of the spheres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PortsParams {
    /// Opposite the sample in the reflectance sphere.
    pub entrance: PortParams,
    pub sample: PortParams,
    /// In either sphere; what falls into it is the reading.
    pub detector: DetectorParams,
    /// Opposite the sample in the transmittance sphere; left out: wall.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exit: Option<PortParams>,
}

/// Exactly one of `round` and `square`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PortParams {
    /// A round hole.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub round: Option<RoundParams>,
    /// A square hole.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub square: Option<SquareParams>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DetectorParams {
    /// A round hole.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub round: Option<RoundParams>,
    /// A square hole.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub square: Option<SquareParams>,
    /// Angle at the centre of the sphere between sample and detector, 0 to 180.
    #[serde(default = "beside")]
    pub polar_deg: AngleDeg,
    #[serde(default)]
    pub sees: SeesParam,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RoundParams {
    /// Its diameter.
    pub diameter: Length,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SquareParams {
    /// Length of its sides.
    pub side: Length,
}

/// What a detector looks at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SeesParam {
    /// All that falls into its port.
    #[default]
    All,
    /// Wall only: light straight from the sample does not count, as behind a field stop or a baffle that takes no room.
    Wall,
}

/// A round plate across the line from the middle of the sample port to the middle of the detector.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BaffleParams {
    /// Its diameter.
    pub diameter: Length,
    /// Where on that line: 0 at the sample, 1 at the detector.
    #[serde(default = "halfway")]
    pub position: Ratio,
}

/// The plate that all media have the shape of.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SampleParams {
    /// Of the plate.
    pub thickness: Length,
    /// Extent along x and y; left out: without end.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size: Option<[Length; 2]>,
    /// Refractive index of clear slides on both faces; left out: none. They have no thickness.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slides: Option<Ratio>,
}

/// Exactly one of `collimated` and `conical`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BeamParams {
    /// Parallel to the line from entrance to sample.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub collimated: Option<CollimatedParams>,
    /// From a disc in the entrance port, even over the solid angle of a cone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub conical: Option<ConicalParams>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CollimatedParams {
    /// Evenly filled.
    pub diameter: Length,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ConicalParams {
    /// Of the disc in the entrance port.
    #[serde(default)]
    pub diameter: Length,
    /// Between the axis and the edge of the cone, above 0 and below 90.
    pub half_angle_deg: AngleDeg,
}

/// The plate that normalises M_R; opaque, obeys the cosine law.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StandardParams {
    /// What it truly reflects, in [0, 1].
    pub reflectance: Ratio,
    /// The reflectance that M_R is scaled with; left out: the true one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub taken_as: Option<Ratio>,
}

/// How light in the spheres is followed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MethodParam {
    /// `summed` without a baffle, else `traced`.
    #[default]
    Auto,
    /// All bounces on the wall in closed form; not with a baffle.
    Summed,
    /// Bounce by bounce, the detector's share of each as its expected value.
    Traced,
    /// Bounce by bounce, counting what falls into the detector; slow.
    Counted,
}

fn beside() -> AngleDeg {
    AngleDeg(90.0)
}

fn halfway() -> Ratio {
    Ratio(0.5)
}
