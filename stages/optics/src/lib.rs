//! Shared physics as plain functions of `f64`: geometry, media, random numbers. Knows no stage and no file.

pub mod solid;
pub mod view;
