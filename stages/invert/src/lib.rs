//! Inversion: from the reflectance at two spatial frequencies to mu_a and mu_s' of each pixel, with standard errors.
//!
//! ```yaml
//! maps:
//!   use: invert
//!   in: {reflectance: r_d, lut: table}
//!   with: {method: table, outside: mask}
//! ```
//! `table` resamples the look-up table once to ln mu_a, ln mu_s' over uniform coordinates of the reflectance pair and then
//! fetches bilinearly; `bicubic` solves for each pixel, `linear` and `nearest` are the plain ways; `least_squares` takes
//! all f_x at once. With the heights of the surface and the scene's camera and projector it also takes off what distance and slope do (`profile`). Theory and measured figures: `docs/theory/invert.md`.

mod cells;
mod choice;
mod conditions;
mod coordinates;
mod exposure;
mod form;
pub mod forward;
pub mod inverse;
mod joints;
mod lanes;
mod least_squares;
mod linear;
mod lut;
mod memory;
pub mod nearest;
mod pair;
mod params;
mod pass;
mod profile;
mod sectioned;
mod seeds;
mod single;
mod stage;
mod surface;
mod uncertain;
mod unknown;

pub use params::{Method, NoiseBias, Outside, Params};
pub use profile::Profile;
pub use stage::{In, Invert, Out};
