//! Readings: what a double-sphere instrument reports of each medium.

use crate::artifact::{Artifact, ArtifactKind, Table};
use crate::error::Error;
use crate::payload::Payload;

/// One row per medium; fractions of the incident light where no unit is named.
///
/// Columns `medium` (text); `m_r`, `m_t` with `m_r_se`, `m_t_se` and their covariance `m_rt_cov`; `lost_r`, `lost_t`, `lost_r_diffuse`,
/// `lost_t_diffuse` and `_se` of each: what a slab without sides would reflect and transmit, of the beam and of diffuse light,
/// beyond what came into the spheres. Null is what is not known: the error of what no photon showed, the loss of light that there was not.
/// Where the readings are simulated also the medium: `mu_a`, `mu_s_prime` (mm^-1), `g`, `n`.
///
/// Attributes: `thickness` (mm), `slides` (index, or null), `r_standard`, and `spheres`: `diameter` (mm), `wall_reflectance`, the shares of a
/// sphere's surface that `sample`, `entrance` (reflectance sphere), `detector` (both) and `exit` (transmittance sphere) take,
/// `neck` (mm), `bounces` (their limit, or null), `baffle` (true or false) and `sees_sample` (whether light falls straight from the sample into a detector).
#[derive(Clone, Debug, PartialEq)]
pub struct Readings(pub Table);

impl Payload for Readings {
    const NAME: &'static str = "readings";
    const KIND: ArtifactKind = ArtifactKind::Table;

    fn into_artifact(self) -> Artifact {
        Artifact::Table(self.0)
    }

    fn from_artifact(artifact: Artifact) -> Result<Self, Error> {
        match artifact {
            Artifact::Table(table) => Ok(Self(table)),
            other => Err(Error::failed(format!("readings must be a table, not {:?}", other.kind()))),
        }
    }
}
