//! The laws of the simulated double-sphere experiment.

mod balance;
mod plate;
mod spheres;
mod stage;
mod statistics;
