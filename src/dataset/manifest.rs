//! `dataset.json`: what a folder holds, and what it was made from.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::format::Format;

/// Format of the folder.
pub const FORMAT: u32 = 1;

/// The whole file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    pub format: u32,
    pub turbid_version: String,
    pub pipeline: String,
    pub dataset: String,
    pub about: Option<String>,
    pub license: Option<String>,
    pub cite: Option<String>,
    /// YYYY-MM-DD, as the file says; never the day of a build.
    #[serde(default)]
    pub published: Option<String>,
    pub seed: u64,
    /// The pipeline file with everything that it includes, as it was resolved.
    pub resolved: Value,
    /// Columns of a shard in their order.
    pub columns: Vec<ColumnOf>,
    /// What the shards are.
    #[serde(default)]
    pub shard_format: Format,
    pub shards: Vec<ShardOf>,
    /// Samples that are left out, by reason.
    pub rejects: BTreeMap<String, u64>,
    /// The other files with their SHA-256.
    pub files: BTreeMap<String, FileOf>,
}

/// A column.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ColumnOf {
    pub name: String,
    /// `string`, `int64`, `float64`, `float32` or `float16`.
    pub dtype: String,
    /// Channels, rows, columns of a tensor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shape: Option<[usize; 3]>,
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub unit: String,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub channels: Vec<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pixel_mm: Option<[f64; 2]>,
    pub about: String,
}

/// A shard.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShardOf {
    pub file: String,
    pub split: String,
    pub number: usize,
    pub rows: u64,
    pub bytes: u64,
    pub sha256: String,
    /// CRC-32 of each row, eight hexadecimal digits a row.
    pub checks: String,
    /// What it was made from: a shard of this key need not be written again.
    pub key: String,
    /// Counts, means, spreads and ranges of its columns.
    #[serde(default)]
    pub moments: String,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FileOf {
    pub bytes: u64,
    pub sha256: String,
}

impl Manifest {
    /// Error: the folder in which this stands holds another data set than this one, in words.
    pub fn holds(&self, folder: &Path, pipeline: &str, dataset: &str) -> Result<(), String> {
        if self.pipeline == pipeline && self.dataset == dataset {
            return Ok(());
        }
        Err(format!(
            "{} holds the data set `{}` of pipeline `{}`, not `{dataset}` of `{pipeline}`",
            folder.display(),
            self.dataset,
            self.pipeline
        ))
    }
}

impl ColumnOf {
    /// One value a sample, without a unit.
    pub fn scalar(name: &str, dtype: &str, about: &str) -> Self {
        Self {
            name: name.to_owned(),
            dtype: dtype.to_owned(),
            shape: None,
            unit: String::new(),
            channels: Vec::new(),
            pixel_mm: None,
            about: about.to_owned(),
        }
    }

    /// `1 x 6 x 6, mm^-1`, for messages.
    pub fn form(&self) -> String {
        let form = match self.shape {
            Some([channels, rows, columns]) => format!("{channels} x {rows} x {columns}"),
            None => "a number".to_owned(),
        };
        let pitch = self.pixel_mm.map(|[x, y]| format!(", pixels of {x} x {y} mm")).unwrap_or_default();
        let channels = self.channels.join("; ");
        format!("{form} ({channels}), {}{pitch}", self.unit)
    }
}
