//! Profilometry: from the phase of projected fringes to the height of the surface that bends them, with its error.
//!
//! ```yaml
//! shape:
//!   use: profilometry
//!   in: {sample: fringes.phase, reference: flat_fringes.phase, scene: tissue}
//!   with: {method: triangulation, unwrap: auto, heights: [-5, 45]}
//! ```
//! The scene tells camera and projector; what it holds besides is not looked at. The reference is a flat phantom in the
//! pattern's plane (or on `reference_surface`); without it the phase of that surface is computed from the geometry.
//! Theory and measured figures: `docs/theory/profilometry.md`.

pub mod form;
mod formula;
pub mod geometry;
mod params;
mod phase;
mod solve;
mod stage;
pub mod unwrap;

pub use params::{Method, Params, ReferenceSurface, Tube, Unwrap};
pub use stage::{In, Out, Profilometry};
