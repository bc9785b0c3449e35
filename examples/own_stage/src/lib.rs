//! Modulation depth M_AC / M_DC of fringes on a sample, with its standard error: how much of the projected contrast comes back at each f_x.
//!
//! ```yaml
//! depth:
//!   use: modulation_depth
//!   in: {modulation: fringes}
//!   with: {least: 1 %}
//! ```
//! Source and projector cancel in the ratio, the modulation transfer of camera and projector does not.

mod depth;
mod layers;
mod payload;
mod stage;

pub use depth::{Noise, modulation_depth};
pub use payload::Depth;
pub use stage::{In, ModulationDepth, Out, Params};
