//! Calibration: the modulation of a sample over that of a reference phantom, times what the phantom is known to reflect.
//!
//! ```yaml
//! r_d:
//!   use: calibrate
//!   in: {sample: fringes, reference: phantom_fringes}
//!   with: {reference: {mu_a: 0.026, mu_s_prime: 4.75, g: 0.8, n: 1.0}, model: rte, convention: camera, smooth: 0}
//! ```
//! The reference may also be `{table: block.csv, g: 0.8, n: 1.4}`, a phantom over wavelength; `{object: block}`, what a rendered arm shows; or
//! `{reflectance: 0.99}`, a plate.
//!
//! R_d(f_x) = M_sample(f_x) / M_reference(f_x) x R_model(f_x), pixel by pixel: source profile, vignetting, carrier phase,
//! MTF and exposure cancel. Theory and measured figures: `docs/theory/calibrate.md`.

mod form;
pub mod gauss;
mod memory;
mod model;
mod params;
pub mod plane;
mod quantity;
mod ratio;
mod reference;
mod resolve;
mod rigs;
pub mod smooth;
mod stage;
mod table;

pub use model::Model;
pub use params::{NoiseBias, Params};
pub use ratio::{Arm, calibrate};
pub use reference::{CoefficientUnit, Reference};
pub use rigs::Rigs;
pub use stage::{Calibrate, In, Out};
