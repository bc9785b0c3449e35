//! Tables of figures: what `compare` found, and where power went.

use crate::artifact::{Artifact, ArtifactKind, Table};
use crate::error::Error;
use crate::payload::Payload;

/// Columns region, quantity, n, mean, mean_se, truth, bias_percent, rmse_percent, masked_percent, bias, rmse, p95, unit.
///
/// The last four are in the quantity's unit; of a position (mm) only they say something, and the percentages are 0. Of a fit of media `region` is
/// the medium or `all`, and two more columns are there: z and rms_log. Means of images (`tabulate`) have region, quantity, one column `axis NAME` for
/// each axis, n, mean, mean_se, masked_percent, unit.
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

/// Where the power of the lights went. Columns detector (`left upwards`, `left downwards`, `absorbed in OBJECT`, `lost between facets` where walls are
/// rough, `through DETECTOR` or `taken by DETECTOR`), wavelength_nm (where the scene names wavelengths), power (W) and share (of the power of all lights), each with _se (null
/// where nothing or all was counted), _low and _high: the interval that holds the truth with the probability that the attribute `confidence` says. The attribute `photons` says
/// how many were walked for each wavelength.
#[derive(Clone, Debug, PartialEq)]
pub struct Power(pub Table);

impl Payload for Power {
    const NAME: &'static str = "power";
    const KIND: ArtifactKind = ArtifactKind::Table;

    fn into_artifact(self) -> Artifact {
        Artifact::Table(self.0)
    }

    fn from_artifact(artifact: Artifact) -> Result<Self, Error> {
        match artifact {
            Artifact::Table(table) => Ok(Self(table)),
            other => Err(Error::failed(format!("power must be a table, not {:?}", other.kind()))),
        }
    }
}
