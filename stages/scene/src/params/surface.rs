//! Surfaces as they stand in a pipeline file.

use serde::{Deserialize, Serialize};
use turbid_contract::Ratio;
use turbid_contract::schemars::JsonSchema;

/// `smooth`; `{rough: alpha}`: a boundary of GGX microfacets, alpha in (0, 1]; or `{lambertian: rho}`: opaque and diffusely reflecting
/// the fraction rho.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(crate = "turbid_contract::schemars")]
pub enum SurfaceParams {
    #[default]
    Smooth,
    Rough(Ratio),
    Lambertian(Ratio),
}
