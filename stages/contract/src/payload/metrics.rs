//! Tables of figures: what `compare` found, and where power went.

use crate::artifact::{Artifact, ArtifactKind, Table};
use crate::error::Error;
use crate::payload::Payload;

/// Columns region, quantity, n, mean, mean_se, truth, bias_percent, rmse_percent, masked_percent, bias, rmse, p95, possible_shift_percent,
/// possible_shift, n_unknown, n_left_out, unit.
///
/// What is not known is null: all figures of a region of which every pixel is masked, percentages of a position (mm), standard errors that no pixel
/// states. bias, rmse, p95 and possible_shift are in the quantity's unit. Of a fit of media `region` is the medium or `all`, z and rms_log take the
/// place of the shifts and of n_left_out, and a medium without a fit has no figures. Means of images (`tabulate`) have region, quantity, one column
/// `axis NAME` for each axis, n, mean, mean_se, masked_percent, unit. A summary over instances (`summarize`) has region, quantity, instances, n,
/// mean_abs_error_percent, mean_abs_error_se_percent, noise_percent, bias_percent, rmse_percent, worst_percent, masked_percent, mean_abs_error,
/// mean_abs_error_se, unit.
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

/// Where the power of the lights went. Columns detector (`left upwards`, `left downwards`, `absorbed in OBJECT`, `through DETECTOR` or
/// `taken by DETECTOR`), wavelength_nm (where the scene names wavelengths), power (W) and share (of the power of all lights), each with _se (null
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
