//! The shape of what a camera sees. Type of an input port; nothing makes it.

use crate::artifact::{Artifact, ArtifactKind, ImageStack};
use crate::error::Error;
use crate::payload::{Maps, Payload, Truth};

/// Heights by pixels of the camera: layer `height` (world z, mm) with `height_se` where it is known, `normal_x|y|z` where they are, `mask`. As
/// `profilometry` measures them, or as they truly are.
#[derive(Clone, Debug, PartialEq)]
pub struct Relief(pub ImageStack);

impl Payload for Relief {
    const NAME: &'static str = "maps or truth";
    const KIND: ArtifactKind = ArtifactKind::Images;
    const ACCEPTS: &'static [&'static str] = &[Maps::NAME, Truth::NAME];

    fn into_artifact(self) -> Artifact {
        Artifact::Images(self.0)
    }

    fn from_artifact(artifact: Artifact) -> Result<Self, Error> {
        match artifact {
            Artifact::Images(stack) => Ok(Self(stack)),
            other => Err(Error::failed(format!("heights must be an image stack, not {:?}", other.kind()))),
        }
    }
}
