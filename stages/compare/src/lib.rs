//! Comparison of maps with the truth: bias, scatter and masked share for each region and quantity.
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
//! ```
//! A region holds the pixels that meet all its conditions. Lengths are mm from the centre of the image, x to the right, y
//! up. Columns and formulas: `docs/theory/compare.md`.

pub mod region;
pub mod score;
mod stage;

pub use region::{Disk, Rect, Region};
pub use stage::{Compare, In, Out, Params};
