//! Laws that a rendered image obeys, and promises of the stage.

mod fit;
mod golden;
mod lanes;
mod laws;
mod lights;
mod patterns;
mod power;
mod sensors;
mod setup;
mod stage;
mod unbiased;
