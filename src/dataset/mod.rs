//! Data sets: outputs of the drawn instances of a pipeline as shards that load in one line.
//!
//! [`plan`] joins what `datasets:` says with the graph, [`split`] gives each point its split and shard, [`feature`] takes
//! tensors out of artifacts, [`shard`] writes them as Parquet, [`build`] does all of it, [`verify`] looks at what is there,
//! and with the feature `tables` polars makes quantiles, joins and counts (`tables`).

pub mod build;
mod card;
mod croissant;
mod feature;
mod folder;
mod index;
mod manifest;
pub mod plan;
mod rows;
mod shard;
mod split;
mod statistics;
#[cfg(feature = "tables")]
pub mod tables;
pub mod verify;

pub use feature::Feature;
pub use manifest::Manifest;
pub use plan::DatasetPlan;
