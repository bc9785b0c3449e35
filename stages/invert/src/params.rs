//! Params of `invert`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use turbid_contract::{AngleDeg, PerLength, Ratio};

use crate::profile::Profile;

/// How a pair of reflectances becomes a pair of properties.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Bilinear in a table that was resampled once to uniform coordinates of the reflectance.
    #[default]
    Table,
    /// The nearest node of the look-up table in whitened ln R.
    Nearest,
    /// Linear in ln R over the two triangles of each cell of the nodes.
    Linear,
    /// The exact inverse of the bicubic surface through the nodes, pixel by pixel.
    Bicubic,
    /// The best fit to all f_x, by the surfaces of `bicubic`, weighted by the standard errors.
    LeastSquares,
}

impl Method {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Table => "table",
            Self::Nearest => "nearest",
            Self::Linear => "linear",
            Self::Bicubic => "bicubic",
            Self::LeastSquares => "least_squares",
        }
    }
}

/// What becomes of a pixel whose reflectance the table does not hold.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Outside {
    /// Masked, with the side on which the table ended.
    #[default]
    Mask,
    /// The nearest node; the layer `outside` names the side for each such pixel, since the mask calls it good.
    Nearest,
}

/// What becomes of the part of the mean that noise adds: p(R) is curved, so noise that is zero in the mean of R is not
/// zero in the mean of mu_a.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum NoiseBias {
    /// Taken off pixel by pixel, to second order in the standard errors; pixels with more than 20 % of noise are read along the tangent at the mean of
    /// their 7 x 7 neighbours. Without standard errors nothing changes.
    #[default]
    Correct,
    /// Left in: each pixel that the table holds has exactly the properties that have its reflectance.
    Keep,
}

/// Params of `invert`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Params {
    pub method: Method,
    pub outside: Outside,
    pub noise_bias: NoiseBias,
    /// The spatial frequencies to use, increasing: two; for `least_squares` two or more. If left out the lowest and the highest of the
    /// reflectance; for `least_squares` all.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub f_x: Option<Vec<PerLength>>,
    /// Which orientation to use, where the reflectance has several.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub orientation_deg: Option<AngleDeg>,
    /// How the shape is taken into account, where `height` and `scene` are connected.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub profile: Option<Profile>,
    /// A pixel is masked where mu_a or mu_s' is off by more than this share because it was lit or looked at in another way than the table
    /// takes for granted (angles, thickness, g, n). Left out: a warning, and no mask.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub largest_misreading: Option<Ratio>,
}
