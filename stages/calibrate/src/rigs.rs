//! Whether both arms were lit and seen by the same rig: only then does what they share cancel in their ratio.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use turbid_contract::Attributes;
use turbid_contract::payload::Rig;

/// Whether the arms must share camera, projector, lights and wavelength.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Rigs {
    /// They must, as far as both say what theirs is.
    #[default]
    Same,
    /// They need not: the ratio then holds the difference of the rigs too.
    MayDiffer,
}

/// The way out.
pub const SHARE: &str =
    "let both scenes take one rig, `in: {rig: STAGE}`, or write `rigs: may_differ` where the difference is meant";

/// What the rigs of two arms differ in, with both values; `None` where they are the same, may differ, or one is not known.
pub fn difference(rigs: Rigs, sample: &Attributes, reference: &Attributes) -> Option<String> {
    if rigs == Rigs::MayDiffer {
        return None;
    }
    let differences = Rig::of(sample)?.differences(&Rig::of(reference)?);
    (!differences.is_empty()).then(|| differences.join("; "))
}
