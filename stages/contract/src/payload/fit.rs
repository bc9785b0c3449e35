//! Fit: what inverse adding-doubling found behind readings.

use crate::artifact::{Artifact, ArtifactKind, Table};
use crate::error::Error;
use crate::payload::{Payload, Quantity, quantity};

/// One row per medium.
///
/// Columns `medium` (text); `mu_a`, `mu_s_prime` and `mu_a_se`, `mu_s_prime_se` (mm^-1), `mu_cov` (their covariance, mm^-2), `g`, `g_se`:
/// errors are null where the readings state none. `mu_a_model_error`, `mu_s_prime_model_error` (mm^-1): what the model itself leaves
/// uncertain (quadrature, lost light), part of the standard errors. `m_r_residual`, `m_t_residual`: reading of the fit less that of the
/// instrument, null where it was not read. `mu_a_over_mu_s_prime`: known also where only M_R was read. `N`: quadrature points.
/// `status` (text): `ok`, `conservative` (mu_a = 0 within the standard errors), `no_scatter` (mu_s' = 0 likewise), `empty` (both),
/// `ambiguous` (the row holds one of two media with these readings, `message` names the other), `disagree` (no medium with what is known
/// gives both readings: the row holds the nearest), or the name of what failed, with the reason in `message`. Of a row that failed all
/// numbers are null, but `mu_a_over_mu_s_prime` where the readings tell it. Where the readings do not determine an error `status` ends in `, no_se`.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit(pub Table);

impl Payload for Fit {
    const NAME: &'static str = "fit";
    const KIND: ArtifactKind = ArtifactKind::Table;
    const HOLDS: &'static [Quantity] = &[
        quantity("medium", "", "name of the medium"),
        quantity("mu_a", "mm^-1", "absorption coefficient"),
        quantity("mu_s_prime", "mm^-1", "reduced scattering coefficient"),
        quantity("mu_cov", "mm^-2", "their covariance"),
        quantity("g", "1", "anisotropy of scattering"),
        quantity("mu_a_model_error", "mm^-1", "what the model itself leaves uncertain"),
        quantity("mu_s_prime_model_error", "mm^-1", "what the model itself leaves uncertain"),
        quantity("m_r_residual", "1", "reading of the fit less that of the instrument"),
        quantity("m_t_residual", "1", "reading of the fit less that of the instrument"),
        quantity("mu_a_over_mu_s_prime", "1", "known also where only M_R was read"),
        quantity("N", "1", "quadrature points"),
        quantity("status", "", "how the fit of the row ended"),
        quantity("message", "", "why"),
    ];

    fn into_artifact(self) -> Artifact {
        Artifact::Table(self.0)
    }

    fn from_artifact(artifact: Artifact) -> Result<Self, Error> {
        match artifact {
            Artifact::Table(table) => Ok(Self(table)),
            other => Err(Error::failed(format!("a fit must be a table, not {:?}", other.kind()))),
        }
    }
}
