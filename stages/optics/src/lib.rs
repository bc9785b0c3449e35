//! Shared physics as plain functions of `f64`: geometry, media, random numbers. Knows no stage and no file.

pub mod elementary;
pub mod henyey_greenstein;
pub mod philox;
pub mod solid;
pub mod view;
