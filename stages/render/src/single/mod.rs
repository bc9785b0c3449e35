//! The f32 lanes: paths walked sixteen abreast in single precision, where that holds the scene ([`Frame::of`]).
//!
//! What befalls a path beside flights inside one convex body is left to the scalar [`Walker`](crate::path::Walker);
//! random numbers are the same, so a path differs from the scalar one by rounding only.

mod bend;
mod copies;
mod crossing;
mod deposit;
mod face;
mod facet_refraction;
mod facets;
mod flight;
pub mod frame;
mod free_flight;
pub mod ground;
mod image_lookup;
mod in_flight;
mod interfaces;
pub mod lane;
mod light_branch;
pub mod limits;
mod mesh;
mod next_event;
mod phase_function;
mod prepare;
pub mod refusal;
mod resting;
mod round;
mod rows;
mod scalar_connections;
mod scalar_fallback;
mod source;
mod start;
mod turns;
mod visibility;
mod walk;
mod weight_window;
mod within;

pub(crate) use bend::{FoundInLanes, ScalarConnection};
pub use frame::Frame;
pub use walk::walk;
