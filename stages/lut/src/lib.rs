//! `build_lut`: a look-up table of reflectance over (mu_a, mu_s') for one or more spatial frequencies.
//!
//! ```yaml
//! use: build_lut
//! with:
//!   model: rte                        # or diffusion, monte_carlo (with samples: paths), empirical (phantoms on the ports)
//!   f_x: [0, 0.1]                     # mm^-1, increasing
//!   g: 0.8
//!   n: 1.4
//!   mu_a: {logspace: [1e-4, 0.5, 28]} # default; also {linspace: ..} or a list, mm^-1
//!   mu_s_prime: {logspace: [0.1, 5, 18]}
//!   thickness: 10                     # mm; left out: a half-space
//!   # wavelengths_nm: [660, 850]      # with g and n as lists, one for each: a table for each pair of them
//!   convention: camera                # default; or hemispherical_incident, hemispherical_entered
//! ```
//!
//! With `model: empirical` and `wanted: [{mu_a: 0.05, mu_s_prime: 1.2}]` the port `design` says which densities (the axes of the phantoms) make such media.
//!
//! The table is read by bicubic interpolation of ln R over (ln mu_a, ln mu_s'): with the default nodes its error stays
//! below 0.1 % (`docs/theory/build_lut.md`); column `r_d_bound` says what the solver itself leaves uncertain of a row. `validity` maps the noise gains and the sign of the Jacobian.

mod bound;
pub mod design;
pub mod empirical;
mod form;
pub mod monte_carlo;
mod nodes;
mod params;
pub mod phantoms;
mod pilot;
mod stage;
mod surface;
mod table;
mod validity;
mod white;

pub use nodes::Nodes;
pub use params::{Interpolation, Model, Params, ReferenceMedium};
pub use stage::{BuildLut, In, Out};
pub use surface::Surface;
pub use table::{Convention, Recipe};
pub use validity::{Report, examine};
pub use white::{Tally, White};
