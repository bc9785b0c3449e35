//! The f32 lanes: paths walked sixteen abreast in single precision, where that holds the scene ([`Frame::of`]).
//!
//! What befalls a path beside flights inside one convex body is left to the scalar [`Walker`](crate::path::Walker), as in `flock.rs`;
//! random numbers are the same, so a path differs from the scalar one by rounding only.

mod bend;
mod deposit;
mod detour;
mod face;
mod facets;
pub mod frame;
pub mod ground;
pub mod lane;
pub mod limits;
mod look;
mod mesh;
mod picture;
mod prepare;
pub mod refusal;
mod round;
mod rows;
mod scout;
mod settle;
mod sight;
mod source;
mod start;
mod turns;
mod walk;
mod walls;

pub(crate) use bend::Detour;
pub use frame::Frame;
pub use walk::walk;
