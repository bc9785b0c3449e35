//! Laws that a rendered image obeys, and promises of the stage.

mod adaptive;
mod channels;
mod control_variate;
mod coverage;
mod curved;
mod curved_lamp_reflections;
mod detectors;
mod extreme;
mod fit;
mod forms;
mod furnace;
mod golden;
mod grazing;
mod kernel;
mod lamp_reflections;
mod lanes;
mod laws;
mod lights;
mod mean_se;
mod meshes;
mod mirrors;
mod odd_worlds;
mod patterns;
mod peaked;
mod plane_wave;
mod power;
mod rough;
mod sensors;
mod setup;
#[path = "../../../optics/tests/shapes/mod.rs"]
mod shapes;
mod stage;
mod surfaces;
mod textures;
mod two_term;
mod unbiased;
