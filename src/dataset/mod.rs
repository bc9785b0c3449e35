//! Data sets: outputs of the drawn instances of a pipeline as shards that load in one line.
//!
//! [`plan`] joins what `datasets:` says with the graph, [`split`] gives each point its split and shard, [`feature`] takes
//! tensors out of artifacts, [`shard`] writes them as Parquet and [`webdataset`] as tar files, [`build`] does all of it, [`overview`] draws a picture,
//! [`verify`] looks at what is there, and with the feature `tables` polars makes quantiles, joins and counts (`tables`).

pub mod build;
mod card;
mod croissant;
pub mod feature;
pub mod folder;
mod format;
mod index;
pub mod manifest;
mod overview;
pub mod plan;
mod rows;
pub mod shard;
mod split;
mod statistics;
#[cfg(feature = "tables")]
pub mod tables;
pub mod verify;
pub mod webdataset;

pub use feature::Feature;
pub use folder::{Folder, Refused};
pub use format::Format;
pub use manifest::Manifest;
pub use plan::DatasetPlan;
