//! Inversion: from the reflectance at two spatial frequencies to mu_a and mu_s' of each pixel, with standard errors.
//!
//! ```yaml
//! maps:
//!   use: invert
//!   in: {reflectance: r_d, lut: table}
//!   with: {method: table, outside: mask}
//! ```
//! `table` resamples the look-up table once to ln mu_a, ln mu_s' over uniform coordinates of the reflectance pair and then
//! fetches bilinearly; `nearest` takes the nearest node. Theory and measured figures: `docs/theory/invert.md`.

pub mod forward;
pub mod inverse;
pub mod nearest;
mod pass;
mod stage;

pub use stage::{In, Invert, Method, NoiseBias, Out, Outside, Params};
