//! What projectors show: fringes of any orientation, square and dithered ones, speckle; and fringes that are uniform along a surface.
//!
//! ```yaml
//! flat:
//!   use: pattern
//!   in: {scene: tube}
//!   with: {f_x: [0, 0.05], phases: 3}
//! uniform:
//!   use: predistort
//!   in: {scene: tube}
//!   with: {surface: wall, f_x: [0, 0.05], phases: 3, method: trace}
//! frames:
//!   use: render
//!   in: {scene: tube, pattern: uniform}
//!   with: {samples: 256}
//! ```
//! Theory and measured figures: `docs/theory/pattern.md`.

pub mod analytic;
pub mod capture;
pub mod dither;
mod form;
pub mod frequency;
mod fringes;
pub mod image;
mod params;
mod sample;
pub mod screen;
pub mod speckle;
mod stage;
mod trace;
mod wall;

pub use params::pattern::{Params as PatternParams, Wave};
pub use params::predistort::{Method, Params as PredistortParams};
pub use stage::{PatternIn, PatternOut, PatternStage, Predistort, PredistortIn, PredistortOut};
