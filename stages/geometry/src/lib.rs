//! From the scene that crosses between stages to geometry that a ray can meet: shapes as solids, camera and projector as views; and the
//! pictures that textures and patterns are read from.

mod conditions;
mod hit;
mod normals;
mod phase_function;
pub mod picture;
mod solid;
mod view;

pub use conditions::{Angles, Sights, conditions, lit_points};
pub use hit::{Bodies, Hit};
pub use normals::{Tangent, normal_of, tangent};
pub use phase_function::phase_function;
pub use solid::solid;
pub use view::{camera_view, projector_view};
