//! What `compare` takes: an estimate with its truth, as images or as a table of media. Types of input ports; nothing makes them.

use crate::artifact::{Artifact, ArtifactKind};
use crate::error::Error;
use crate::payload::{Fit, Maps, Payload, Readings, Truth};

/// Optical properties that somebody found.
#[derive(Clone, Debug, PartialEq)]
pub enum Estimate {
    Maps(Maps),
    Fit(Fit),
}

/// What they should have been.
#[derive(Clone, Debug, PartialEq)]
pub enum Expected {
    Truth(Truth),
    /// Of simulated readings, whose rows hold their medium.
    Readings(Readings),
}

impl Payload for Estimate {
    const NAME: &'static str = "maps or fit";
    const KIND: ArtifactKind = ArtifactKind::Images;
    const ACCEPTS: &'static [&'static str] = &[Maps::NAME, Fit::NAME];

    fn into_artifact(self) -> Artifact {
        match self {
            Self::Maps(maps) => maps.into_artifact(),
            Self::Fit(fit) => fit.into_artifact(),
        }
    }

    fn from_artifact(artifact: Artifact) -> Result<Self, Error> {
        match artifact.kind() {
            ArtifactKind::Table => Fit::from_artifact(artifact).map(Self::Fit),
            _ => Maps::from_artifact(artifact).map(Self::Maps),
        }
    }
}

impl Payload for Expected {
    const NAME: &'static str = "truth or readings";
    const KIND: ArtifactKind = ArtifactKind::Images;
    const ACCEPTS: &'static [&'static str] = &[Truth::NAME, Readings::NAME];

    fn into_artifact(self) -> Artifact {
        match self {
            Self::Truth(truth) => truth.into_artifact(),
            Self::Readings(readings) => readings.into_artifact(),
        }
    }

    fn from_artifact(artifact: Artifact) -> Result<Self, Error> {
        match artifact.kind() {
            ArtifactKind::Table => Readings::from_artifact(artifact).map(Self::Readings),
            _ => Truth::from_artifact(artifact).map(Self::Truth),
        }
    }
}
