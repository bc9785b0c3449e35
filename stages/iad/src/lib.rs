//! Reflectance and transmittance of scattering slabs between slides, and the way back to mu_a and mu_s'.
//!
//! [`Plan`] is the forward model with N quadrature points, prepared once per slab; [`Inverse`] wraps it and turns
//! readings M_R, M_T into mu_a and mu_s'. Both are plain data without globals: share them between threads.
//!
//! ```
//! use turbid_iad::{Inverse, Reading, Slab};
//!
//! let inverse = Inverse::<16>::new(&Slab::bare(1.4, 0.8, 1.0))?;
//! let fit = inverse.invert(&Reading { m_r: 0.3, m_t: 0.2, sigma: 1e-3 })?;
//! let back = inverse.plan().forward(fit.mu_a_per_mm, fit.mu_s_prime_per_mm)?;
//! assert!((back.ur1 - 0.3).abs() < 1e-9 && (back.ut1 - 0.2).abs() < 1e-9);
//! # Ok::<(), turbid_iad::Error>(())
//! ```
//!
//! | | |
//! |---|---|
//! | [`Plan`], [`Incidence`] | forward model of one slab, under any light, with derivatives |
//! | [`Stack`] | forward model of layers |
//! | [`Inverse`] | mu_a and mu_s' from M_R and M_T |
//! | [`invert_with_g`], [`solve_with_g`] | g too, from M_U |
//! | [`Experiment`], [`Instrument`] | spheres, lost light, absorbing slides, standard errors, one coefficient known |
//! | [`Model`] | the way there behind an instrument, without the way back |
//! | [`Losses`] | light that leaves the sample beside the spheres' ports, by following photons |
//! | [`laboratory`] | readers of CSV and `.rxt` |
//!
//! Lengths mm, coefficients mm^-1, angles rad. Henyey-Greenstein scattering.
//! Only + - * / and square roots besides `libm`: the same bits on every machine.

/// The examples of the read-me file, run as tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
mod readme {}

mod angles;
mod anisotropy;
mod cholesky;
mod clear;
mod coupling;
mod differences;
mod error;
mod experiment;
mod folds;
mod forward;
mod incidence;
mod inverse;
pub mod laboratory;
mod layers;
mod lost;
mod matrix;
mod model;
mod modes;
mod rotations;
mod slab;
mod spheres;
#[cfg(feature = "stage")]
mod stage;
mod state;
mod tangent;

pub use anisotropy::{FitWithG, invert_with_g, solve_with_g};
pub use error::Error;
pub use experiment::{Experiment, From, Known, Measurement, Solution};
pub use forward::{Plan, Response};
pub use incidence::Incidence;
pub use inverse::{Fit, Flags, Inverse, Reading};
pub use layers::{Layer, Layered, Stack};
pub use lost::{Losses, Spot};
pub use model::Model;
pub use slab::{Slab, Slide, Surface, unscattered, unscattered_depth};
pub use spheres::{Instrument, Lost, Seen, Sphere, Spheres};
#[cfg(feature = "stage")]
pub use stage::{CalibrateIad, FromParam, In, LostLight, Out, Params, SlidesParams, SpheresChoice, SpheresParams};
