//! Sections along a tube: which look-up table holds for which pixel, when light and view change with depth.
//!
//! ```yaml
//! sections:
//!   use: section_tube
//!   in: {modulation: reference_modulation, truth: frames.truth}
//!   with: {method: intensity_steps, count: 5, blend: 0.2}
//! ```
//! The limit without sections is `{method: equal_length, count: 25, blend: 1}`: then a table is linear in arc length between the
//! middles of its sections. Theory and measured figures: `docs/theory/section_tube.md`.

pub mod blend;
pub mod depth;
mod form;
mod params;
pub mod profile;
pub mod split;
mod stage;

pub use params::{Method, Params};
pub use stage::{In, Out, SectionTube};
