//! Blocks with a random skin as they stand in a pipeline file.

use serde::{Deserialize, Serialize};
use turbid_contract::Length;
use turbid_contract::schemars::JsonSchema;

/// A block whose upper face is a random height field: Gaussian, with the covariance amplitude^2 exp(-(r / correlation_length)^2).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub struct ReliefParams {
    /// Extent along x and y.
    pub size: [Length; 2],
    /// From the mean height of its upper face to its flat lower one.
    pub thickness: Length,
    /// Root mean square of the height about its mean.
    pub amplitude: Length,
    /// Where the covariance has fallen to 1/e. The mesh has squares of an eighth of it or less.
    pub correlation_length: Length,
    /// World z of the mean height.
    pub top: Length,
    /// World x and y of its middle; [0, 0] where left out.
    #[serde(default)]
    pub center: [Length; 2],
    /// The heights are a function of it and of the object's name; 0 where left out.
    #[serde(default)]
    pub seed: u64,
}
