//! What shards are: Parquet files, or tar files of WebDataset.

use serde::{Deserialize, Serialize};

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    #[default]
    Parquet,
    WebDataset,
}

impl Format {
    pub const NAMES: [(&'static str, Self); 2] = [("parquet", Self::Parquet), ("webdataset", Self::WebDataset)];

    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|(_, format)| *format == self).expect("every format has a name").0
    }

    /// How the names of shards end.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Parquet => "parquet",
            Self::WebDataset => "tar",
        }
    }

    pub fn media_type(self) -> &'static str {
        match self {
            Self::Parquet => "application/x-parquet",
            Self::WebDataset => "application/x-tar",
        }
    }

    /// Whether a file is called as a shard of some format is.
    pub fn is_shard(name: &str) -> bool {
        Self::NAMES.iter().any(|(_, format)| name.strip_suffix(format.extension()).is_some_and(|n| n.ends_with('.')))
    }
}
