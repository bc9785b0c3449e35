//! Payload types: what ports carry. Two ports join only if their payload types are the same.

mod conditions;
mod estimate;
mod fit;
mod images;
mod lut;
mod mask;
mod metrics;
mod quantity;
mod readings;
mod relief;
mod scene;
mod sections;
mod stack;
mod transfer;

pub use conditions::{
    CONDITIONS, Conditions, INCIDENCE_LAYER, REFERENCE_CONDITIONS, SaidBy, Seen, THICKNESS_LAYER, Thickness, VIEW_LAYER,
};
pub use estimate::{Estimate, Expected};
pub use fit::Fit;
pub use images::{
    Concentrations, Covariance, Errors, Exposure, Frames, Maps, Modulation, Pattern, Phase, Preview, Reflectance,
    SurfaceFrequency, Truth, Validity, White,
};
pub use lut::{Convention, Lut};
pub use mask::MaskReason;
pub use metrics::{Metrics, Power};
pub use quantity::{COV, INCIDENCE, MASK, Quantity, THICKNESS, VIEW, in_own_unit, quantity, undeclared};
pub use readings::Readings;
pub use relief::Relief;
pub use scene::*;
pub use sections::{Section, Sections, Shares};
pub use stack::Stack;
pub use transfer::{CameraNoise, Transfer};

use crate::artifact::{Artifact, ArtifactKind};
use crate::error::Error;

/// Whether a picture of a payload shows a reader something: not of the covariances of every pair of quantities.
pub fn is_pictured(payload: &str) -> bool {
    payload != Covariance::NAME
}

/// A typed view of an artifact.
pub trait Payload: Clone + Send + Sync + Sized + 'static {
    /// Name that ports, `show` and error messages use.
    const NAME: &'static str;
    const KIND: ArtifactKind;
    /// Names of the payloads that a port of this type takes: this one, or those that it is one of.
    const ACCEPTS: &'static [&'static str] = &[Self::NAME];
    /// The layers or columns that an artifact of this payload may hold, with their units; empty where it is open to any.
    const HOLDS: &'static [Quantity] = &[];

    fn into_artifact(self) -> Artifact;

    /// Error: the artifact is not of this payload's shape (an older VERSION, or a bug).
    fn from_artifact(artifact: Artifact) -> Result<Self, Error>;
}
