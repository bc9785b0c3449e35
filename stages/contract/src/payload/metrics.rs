//! Metrics: what `compare` found, one row per region and quantity.

use crate::artifact::{Artifact, ArtifactKind, Table};
use crate::error::Error;
use crate::payload::Payload;

/// Columns region, quantity, n, mean, mean_se, truth, bias_percent, rmse_percent, masked_percent.
#[derive(Clone, Debug, PartialEq)]
pub struct Metrics(pub Table);

impl Payload for Metrics {
    const NAME: &'static str = "metrics";
    const KIND: ArtifactKind = ArtifactKind::Table;

    fn into_artifact(self) -> Artifact {
        Artifact::Table(self.0)
    }

    fn from_artifact(artifact: Artifact) -> Result<Self, Error> {
        match artifact {
            Artifact::Table(table) => Ok(Self(table)),
            other => Err(Error::failed(format!("metrics must be a table, not {:?}", other.kind()))),
        }
    }
}
