//! What `compare` takes: an estimate with its truth, as images or as a table of media; of concentrations the truth is in its params. Types of input ports; nothing makes them.

use crate::artifact::{Artifact, ArtifactKind};
use crate::error::Error;
use crate::payload::{Concentrations, Fit, Maps, Payload, Readings, Truth};

/// Optical properties that somebody found, or what absorbs.
#[derive(Clone, Debug, PartialEq)]
pub enum Estimate {
    Maps(Maps),
    Fit(Fit),
    Concentrations(Concentrations),
}

/// What they should have been.
#[derive(Clone, Debug, PartialEq)]
pub enum Expected {
    Truth(Truth),
    /// Found by others, or in another way, and taken for true.
    Maps(Maps),
    /// Of simulated readings, whose rows hold their medium.
    Readings(Readings),
}

impl Payload for Estimate {
    const NAME: &'static str = "maps, fit or concentrations";
    const KIND: ArtifactKind = ArtifactKind::Images;
    const ACCEPTS: &'static [&'static str] = &[Maps::NAME, Fit::NAME, Concentrations::NAME];

    fn into_artifact(self) -> Artifact {
        match self {
            Self::Maps(maps) => maps.into_artifact(),
            Self::Fit(fit) => fit.into_artifact(),
            Self::Concentrations(concentrations) => concentrations.into_artifact(),
        }
    }

    fn from_artifact(artifact: Artifact) -> Result<Self, Error> {
        match &artifact {
            Artifact::Table(_) => Fit::from_artifact(artifact).map(Self::Fit),
            // Only concentrations hold what they leave of mu_a.
            Artifact::Images(stack) if stack.find("residual", None).is_some() => {
                Concentrations::from_artifact(artifact).map(Self::Concentrations)
            }
            _ => Maps::from_artifact(artifact).map(Self::Maps),
        }
    }
}

impl Payload for Expected {
    const NAME: &'static str = "truth, maps or readings";
    const KIND: ArtifactKind = ArtifactKind::Images;
    const ACCEPTS: &'static [&'static str] = &[Truth::NAME, Maps::NAME, Readings::NAME];

    fn into_artifact(self) -> Artifact {
        match self {
            Self::Truth(truth) => truth.into_artifact(),
            Self::Maps(maps) => maps.into_artifact(),
            Self::Readings(readings) => readings.into_artifact(),
        }
    }

    fn from_artifact(artifact: Artifact) -> Result<Self, Error> {
        match &artifact {
            Artifact::Table(_) => Readings::from_artifact(artifact).map(Self::Readings),
            // Only a render tells which object a pixel shows.
            Artifact::Images(stack) if stack.find("object", None).is_none() => {
                Maps::from_artifact(artifact).map(Self::Maps)
            }
            _ => Truth::from_artifact(artifact).map(Self::Truth),
        }
    }
}
