//! How a medium spreads directions.

use serde::{Deserialize, Serialize};

/// The phase function of a medium. It stands among the fields of its medium: `g`, or the name of another kind with its parameters.
///
/// `turbid_geometry::phase_function` makes of it what can be evaluated and sampled.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum PhaseFunction {
    /// Henyey and Greenstein's function of this mean cosine, in (-1, 1).
    #[serde(rename = "g")]
    HenyeyGreenstein(f64),
    /// forward HG(g_forward) + (1 - forward) HG(g_backward), -1 < g_backward < g_forward < 1, 0 < forward < 1.
    #[serde(rename = "two_term")]
    TwoTermHenyeyGreenstein { g_forward: f64, g_backward: f64, forward: f64 },
}
