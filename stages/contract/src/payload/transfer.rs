//! Transfer: what a camera's noise is, by the variance of its numbers at many levels.

use serde::{Deserialize, Serialize};

use crate::artifact::{Artifact, ArtifactKind, Attributes, Table};
use crate::error::Error;
use crate::payload::{Payload, Quantity, quantity};

/// One row per level of a burst.
///
/// Columns `burst` (its number from 1, 0 of frames without light), `level` (numbers above black), `variance`, `variance_se`, `fitted` (squares of a number), `pixels`.
/// Attribute `noise`: [`CameraNoise`].
#[derive(Clone, Debug, PartialEq)]
pub struct Transfer(pub Table);

/// What the line through the levels says of the camera.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CameraNoise {
    pub electrons_per_number: f64,
    pub electrons_per_number_se: f64,
    /// Electrons.
    pub read_noise: f64,
    pub read_noise_se: f64,
    /// Number without light.
    pub black_level: f64,
    /// Highest number of the camera, where the file tells.
    pub highest: Option<f64>,
    /// Electrons at the highest number.
    pub full_well: Option<f64>,
}

impl CameraNoise {
    const NAME: &'static str = "noise";

    pub fn insert_into(&self, attributes: &mut Attributes) {
        attributes.insert(Self::NAME.to_owned(), serde_json::to_value(self).expect("numbers are JSON values"));
    }

    /// Error: there is none, as of an older version.
    pub fn of(attributes: &Attributes) -> Result<Self, Error> {
        let value = attributes.get(Self::NAME).cloned().unwrap_or_default();
        serde_json::from_value(value).map_err(|error| Error::failed(format!("the transfer holds no `noise`: {error}")))
    }
}

impl Payload for Transfer {
    const NAME: &'static str = "transfer";
    const KIND: ArtifactKind = ArtifactKind::Table;
    const HOLDS: &'static [Quantity] = &[
        quantity("burst", "1", "number of the burst; 0 without light"),
        quantity("level", "1", "numbers above black"),
        quantity("variance", "1", "of a number, over frames"),
        quantity("fitted", "1", "variance by the fitted line"),
        quantity("pixels", "1", "pixels of the level"),
    ];

    fn into_artifact(self) -> Artifact {
        Artifact::Table(self.0)
    }

    fn from_artifact(artifact: Artifact) -> Result<Self, Error> {
        match artifact {
            Artifact::Table(table) => Ok(Self(table)),
            other => Err(Error::failed(format!("a transfer must be a table, not {:?}", other.kind()))),
        }
    }
}
