//! A mesh in single precision, about its center: made for many short questions, asked from lanes.
//!
//! [`Cells`] says how far the surface is at least and what a ray crosses, [`Seen`] what lies between points and a fixed one. Both hold triangles in
//! [`Block`]s of eight, which are tested side by side. Rounding the vertices to f32 moves the surface by 6e-8 of the mesh's
//! size and leaves it closed; who crosses it is decided as in `mesh.rs`, exactly for the projected vertices.

mod block;
mod cells;
mod lanes;
mod march;
mod seen;

pub use block::Crossing;
pub use cells::Cells;
pub use lanes::{Crossings, LANES, Rays, V, bits};
pub use seen::Seen;
