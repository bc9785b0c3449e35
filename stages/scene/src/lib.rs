//! Stage `scene`: media, objects, camera and projector, checked and brought to mm and mm^-1.
//!
//! ```yaml
//! use: scene
//! with:
//!   media:
//!     healthy: {A_rho: 25, S_rho: 4236, g: 0.8, n: 1.0}       # densities in m^-1, or
//!     scc: {mu_a: 0.12, mu_s_prime: 0.64, g: 0.8, n: 1.0}     # coefficients in mm^-1 (mu_s or mu_s_prime)
//!     # or what absorbs, and a power law, at the scene's wavelengths:
//!     # skin: {HbO2: 40 uM, Hb: 20 uM, water: 0.7, scattering: {a: 1.5, b: 1.2}, g: 0.8, n: 1.0}
//!     # peak: {mu_a: 0.05, mu_s: 10, phase: {two_term: {g_forward: 0.9, g_backward: -0.3, forward: 0.95}}, n: 1.0}   # in the place of g
//!   objects:
//!     tissue: {slab: {thickness: 2000, top: 0}, medium: healthy}
//!     polyp: {spheroid: {diameters: [40, 40, 80], center: [0, 0, 0]}, medium: scc, priority: 1}
//!   camera: {position: [0, 0, 500], look_at: [0, 0, 0], field: [64, 64], pixels: [64, 64]}
//!   projector: {position: [0, 35, 500], look_at: [0, 0, 0], field: [128, 128], power: 5}
//! ```
//! Camera, projector, lights and wavelengths may come from another scene instead, `in: {rig: STAGE}`, so that sample and phantom share
//! them as data; that scene may have no media and no objects.
//!
//! Only this stage knows the densities: mu_a = A_rho / 1000, mu_s = S_rho / 1000 mm^-1. Where objects overlap the higher
//! `priority` wins, so an object of a medium with mu_a = mu_s = 0 carves a hole.

pub mod assemble;
mod axis;
pub mod kept;
mod mesh;
pub mod overlap;
pub mod params;
mod path;
mod relief;
mod scatter;
mod sketch;
mod stage;

pub use stage::{Out, SceneStage};
