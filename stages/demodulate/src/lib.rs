//! Demodulation: from the frames of shifted sinusoids to M_DC, M_AC and the phase of each pixel, with their errors.
//!
//! ```yaml
//! fringes:
//!   use: demodulate
//!   in: {frames: frames, covariance: frames.covariance}
//!   with: {method: phase_shift, low_signal: 3}
//! ```
//! Frames are told apart by what their layers say (f_x, phase, orientation, wavelength), never by their names. Each
//! f_x > 0 needs three phases or more that differ; the steps may be unequal. A frame at f_x = 0 is M_DC itself;
//! three or more of them with phases are an amplitude: M_DC without black level and room light, which stand beside it as `ambient`.
//! Theory and measured figures: `docs/theory/demodulate.md`.

mod acquisition;
mod ambient;
pub mod diagnostics;
mod doubts;
mod errors;
mod form;
pub mod fourier;
pub mod fused;
mod given;
mod joints;
mod layers;
pub mod level;
pub mod local_fit;
mod masked;
mod memory;
pub mod noise;
mod params;
mod pass;
pub mod phase_shift;
mod robust;
mod set;
mod signal;
pub mod single_shot;
mod snapshot;
pub mod speckle;
mod speckled;
mod stage;
mod unknown;
pub mod unknown_steps;

pub use params::{Filter, Method, NoiseBias, Params, Steps};
pub use stage::{Demodulate, In, Out};
