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
pub mod bsdf;
pub mod camera;
mod caustic;
pub mod channels;
mod check;
mod conditions;
pub mod detector;
pub mod field;
pub mod forward;
pub mod image_part;
pub mod lamp;
pub mod packet;
pub use turbid_optics::level;
pub mod connect;
mod connection;
mod lengths;
pub mod light;
mod mirrors;
pub mod moments;
pub mod next_event;
mod outline;
pub mod path;
pub mod projected_images;
pub mod response;
mod setting;
pub mod single;
pub mod strata;
pub mod texture;
mod walker;
mod weight_window;
pub mod world;

mod ahead;
mod allocation;
mod blocks;
mod cautions;
mod chart;
mod coefficient_errors;
mod control_variate;
mod controlled;
mod fit;

mod form;
mod frames;
mod fringe_shape;
mod fringes;
mod group_fits;
mod guide;
mod interval;
mod joints;
mod kernel;
mod lamp_reflection;
mod light_branch;
mod memory;
mod method;
mod mirror;
mod misfit;
mod neighbours;
mod orthonormal;
mod parallel;
mod params;
mod pilot;
mod plan;
mod plane_wave;
mod polynomials;
mod power;
mod projected;
mod random;
mod reduced;
mod reflected_chain;
mod regions;
mod residuals;
mod rig;
mod served;
mod smooth;
mod so_far;
mod splitting;
mod stage;
mod state;
mod stopping;
mod stopping_criterion;
mod surfaces;
mod tail;
mod trace;
mod trial;
mod truth;
mod uniform;
mod unsure;
mod variance_model;
mod variance_smoothing;

pub use params::{Method, Params};
pub use stage::{Out, RenderStage};
