//! From maps of mu_a and mu_s' at several wavelengths to what the tissue is made of: haemoglobin with its oxygen saturation, water, lipid, melanin, or
//! chromophores of one's own, and the power law of scattering; each with its standard error.
//!
//! ```yaml
//! oxygen:
//!   use: chromophores
//!   in: {maps: maps}
//!   with:
//!     chromophores: [HbO2, Hb, water]
//!     fixed: {melanin: 1 %}          # absorbs besides, in a known amount
//!     scattering: true               # mu_s' = a (lambda / 500 nm)^-b
//!     design:                        # for the port `design`: which 3 of the maps' wavelengths tell StO2 best
//!       choose: 3
//!       typical: {HbO2: 40 uM, Hb: 20 uM, water: 70 %}
//! ```
//! Spectra of one's own: `spectra: [{file: dyes.csv, unit: molar_log10}]`, a table with the columns wavelength_nm and one for each name. Formulas, sources
//! and limits: `docs/theory/chromophores.md`.

pub mod amount;
mod channels;
pub mod condition;
pub mod design;
mod form;
pub mod least_squares;
pub mod oxygen;
mod params;
mod pass;
mod resolve;
pub mod scatter;
mod species;
mod stage;
pub mod unmix;

pub use design::Wavelengths;
pub use params::{DesignParams, Fit, Params, SpectraParams, SpectrumUnit};
pub use stage::{Chromophores, In, Out};
