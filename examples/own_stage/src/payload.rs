//! What the stage makes: a payload of its own, which joins to ports of stages that know it.

use turbid_contract::payload::{INCIDENCE, MASK, Quantity, THICKNESS, VIEW, quantity};
use turbid_contract::{Artifact, ArtifactKind, Error, ImageStack, Payload};

/// Layers `modulation_depth` (1) for each f_x > 0, `modulation_depth_se`, and `mask`.
#[derive(Clone, Debug, PartialEq)]
pub struct Depth(pub ImageStack);

impl Payload for Depth {
    const NAME: &'static str = "modulation_depth";
    const KIND: ArtifactKind = ArtifactKind::Images;
    const HOLDS: &'static [Quantity] = &[
        quantity("modulation_depth", "1", "M_AC / M_DC: the share of the projected contrast that comes back"),
        MASK,
        VIEW,
        INCIDENCE,
        THICKNESS,
    ];

    fn into_artifact(self) -> Artifact {
        Artifact::Images(self.0)
    }

    fn from_artifact(artifact: Artifact) -> Result<Self, Error> {
        match artifact {
            Artifact::Images(stack) => Ok(Self(stack)),
            other => Err(Error::failed(format!("modulation_depth must be an image stack, not {:?}", other.kind()))),
        }
    }
}
