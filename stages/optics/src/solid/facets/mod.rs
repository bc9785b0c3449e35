//! A mesh in single precision, about its center: made for many short questions, asked from lanes.
//!
//! [`Cells`] says how far the surface is at least and what a ray crosses, [`ItemBuffer`] what lies between points and a fixed one. Both hold triangles in
//! [`Block`](block::Block)s of eight, which are tested side by side. Rounding the vertices to f32 moves the surface by 6e-8 of the mesh's
//! size and leaves it closed; who crosses it is decided as in `mesh.rs`, exactly for the projected vertices.

mod block;
mod cells;
mod item_buffer;
mod lanes;
mod march;

pub use block::Crossing;
pub use cells::Cells;
pub use item_buffer::ItemBuffer;
pub use lanes::{Crossings, LANES, Rays, V, bits};
pub(super) use lanes::{F, dot};
