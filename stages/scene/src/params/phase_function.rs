//! A phase function as it stands in a pipeline file, where it is not that of Henyey and Greenstein with one g.

use serde::{Deserialize, Serialize};
use turbid_contract::Ratio;
use turbid_contract::schemars::JsonSchema;

/// How light is scattered, in the place of `g`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
#[schemars(crate = "turbid_contract::schemars")]
pub enum PhaseParams {
    /// Two terms of Henyey and Greenstein: p = forward HG(g_forward) + (1 - forward) HG(g_backward).
    TwoTerm {
        /// Mean cosine of the forward term, in (-1, 1).
        g_forward: Ratio,
        /// Mean cosine of the other term, in (-1, 1) and less than g_forward.
        g_backward: Ratio,
        /// Share of the forward term, in (0, 1).
        forward: Ratio,
    },
}
