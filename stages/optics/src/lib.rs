//! Shared physics as plain functions of `f64`: geometry, media, random numbers, diffusion and transport models of
//! reflectance, interpolation of their tables. Knows no stage and no file.
//!
//! Lengths mm, coefficients and spatial frequencies mm^-1. Transcendental functions come from `libm` or are our own
//! and sums have a fixed order, so results have the same bits on every machine.

pub mod chromophore;
pub mod diffusion;
pub mod distortion;
pub mod elementary;
mod error;
pub mod fresnel;
pub mod henyey_greenstein;
pub mod level;
pub mod log_grid;
pub mod medium;
pub mod misreading;
pub mod phase_function;
pub mod philox;
pub mod quadrature;
pub mod ray_differential;
pub mod refraction;
pub mod rough;
pub mod rte;
pub mod sinusoid;
pub mod solid;
pub mod spectra;
pub mod spectrum;
pub mod view;

pub use chromophore::Chromophore;
pub use error::Error;
pub use log_grid::LogGrid;
pub use medium::{Medium, Reflectance};
pub use phase_function::PhaseFunction;
pub use spectrum::Spectrum;
