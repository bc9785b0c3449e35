//! Stage `render`: what the camera of a scene sees under projected sinusoids, with standard errors.
//!
//! ```yaml
//! use: render
//! in: {scene: tissue}
//! with: {f_x: [0, 0.1], phases: 3, samples: 256}
//! ```
//! Unbiased volumetric path tracing, backward from the pixels. All spatial frequencies, phases and orientations come from the
//! same paths: a path carries the complex response to exp(i 2 pi f_x u), of which every frame is a linear combination.

pub mod batches;
pub mod camera;
mod caustic;
pub mod channels;
mod check;
mod conditions;
pub mod detector;
pub mod field;
pub mod finish;
pub mod flock;
pub mod forward;
pub mod lamp;
pub use turbid_optics::level;
mod lengths;
pub mod light;
pub mod link;
pub mod look;
mod mirrors;
pub mod moments;
pub mod nee;
mod outline;
pub mod path;
pub mod pictures;
pub mod response;
mod setting;
pub mod single;
pub mod strata;
pub mod texture;
mod walker;
mod way;
pub mod world;

mod allocation;
mod cautions;
mod detour;
mod fit;
mod form;
mod frames;
mod glint;
mod interval;
mod joints;
mod judge;
mod kernel;
mod memory;
mod method;
mod mirror;
mod neighbours;
mod params;
mod pilot;
mod plan;
mod plane_wave;
mod polynomials;
mod pooled;
mod power;
mod random;
mod reference;
mod referenced;
mod rig;
mod scout;
mod shown;
mod so_far;
mod stage;
mod state;
mod tail;
mod trace;
mod truth;
mod uniform;
mod unsure;

pub use params::{Method, Params};
pub use stage::{Out, RenderStage};
