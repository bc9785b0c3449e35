//! Readings: what a double-sphere instrument reports of each medium.

use crate::artifact::{Artifact, ArtifactKind, Table};
use crate::error::Error;
use crate::payload::{Payload, Quantity, quantity};

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
    const HOLDS: &'static [Quantity] = &[
        quantity("medium", "", "name of the medium"),
        quantity("m_r", "1", "reading of the reflectance sphere"),
        quantity("m_t", "1", "reading of the transmittance sphere"),
        quantity("m_rt_cov", "1", "covariance of both"),
        quantity("lost_r", "1", "reflected light of the beam that misses the sphere"),
        quantity("lost_t", "1", "transmitted light of the beam that misses the sphere"),
        quantity("lost_r_diffuse", "1", "the same of diffuse light"),
        quantity("lost_t_diffuse", "1", "the same of diffuse light"),
        quantity("mu_a", "mm^-1", "of the medium, where it is simulated"),
        quantity("mu_s_prime", "mm^-1", "of the medium, where it is simulated"),
        quantity("g", "1", "of the medium"),
        quantity("n", "1", "refractive index of the medium"),
    ];

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
