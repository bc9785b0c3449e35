//! Comparison with the truth: bias, scatter and masked share of maps for each region, of a fit for each medium.
//!
//! ```yaml
//! score:
//!   use: compare
//!   in: {estimate: maps, truth: frames.truth}
//!   with:
//!     regions:                       # left out: `all`, and each object that the camera sees
//!       polyp: {object: polyp, erode_mm: 2}
//!       middle: {rect: {center: [0, 0], size: [20, 10]}}
//!       spot: {object: tissue, disk: {center: [-20, 5], diameter: 8}}
//!
//! fitted:
//!   use: compare
//!   in: {estimate: fit, truth: readings}       # calibrate_iad against the media of calibrate_dis
//! printed:
//!   use: compare
//!   in: {estimate: fit}
//!   with: {media: {healthy: {mu_a: 0.058, mu_s_prime: 0.75}}}
//!
//! mean:
//!   use: summarize
//!   in: {metrics: {from: score, over: [mu_a]}}   # mean |bias| over the instances of an axis
//!
//! levels:
//!   use: tabulate
//!   in: {values: frames, minus: dark, relative_to: white}     # means of images along axes
//!   with: {scale: 255, unit: grey levels}
//! ```
//! A region holds the pixels that meet all its conditions. Lengths are mm from the centre of the image, x to the right, y
//! up. Columns and formulas: `docs/theory/compare.md`.

mod fit;
mod form;
mod joints;
pub mod levels;
mod maps;
pub mod media;
mod over_axes;
mod params;
pub mod region;
pub mod score;
mod shared;
mod stage;
mod summarize;
pub mod summary;
mod tabulate;
mod written;

pub use params::{MediumParams, Params};
pub use region::{Disk, Rect, Region};
pub use stage::{Compare, In, Out};
pub use summarize::{Summarize, SummarizeIn, SummarizeOut, SummarizeParams};
pub use tabulate::{Tabulate, TabulateIn, TabulateOut, TabulateParams};
