//! What `tabulate` takes: any stack of images whose layers are quantities. A type of input ports; nothing makes it.

use crate::artifact::{Artifact, ArtifactKind, ImageStack};
use crate::error::Error;
use crate::payload::{Concentrations, Frames, Maps, Modulation, Payload, Phase, Reflectance, White};

/// Images of quantities with their standard errors.
#[derive(Clone, Debug, PartialEq)]
pub struct Stack(pub ImageStack);

impl Payload for Stack {
    const NAME: &'static str = "frames, modulation, phase, reflectance, maps, concentrations or white";
    const KIND: ArtifactKind = ArtifactKind::Images;
    const ACCEPTS: &'static [&'static str] = &[
        Frames::NAME,
        Modulation::NAME,
        Phase::NAME,
        Reflectance::NAME,
        Maps::NAME,
        Concentrations::NAME,
        White::NAME,
    ];

    fn into_artifact(self) -> Artifact {
        Artifact::Images(self.0)
    }

    fn from_artifact(artifact: Artifact) -> Result<Self, Error> {
        match artifact {
            Artifact::Images(stack) => Ok(Self(stack)),
            other => Err(Error::failed(format!("the input must be an image stack, not {:?}", other.kind()))),
        }
    }
}
