//! Sections of a surface along its length: which table holds for which pixel.

use serde::{Deserialize, Serialize};

use crate::artifact::{Artifact, ArtifactKind, ImageStack};
use crate::error::Error;
use crate::payload::quantity::MASK;
use crate::payload::{Payload, Quantity, quantity};

/// Camera pixels by sections along a surface: layers `section` (place in the list of sections), `neighbour` (that of the section whose
/// share is 1 - weight), `weight` (share of the own section, in (0, 1]; 1 where it stands alone and `neighbour` is `section`),
/// `arc_length` (mm along the surface), and `mask`.
///
/// The attribute `sections` lists them in the order of arc length, as [`Section`].
#[derive(Clone, Debug, PartialEq)]
pub struct Sections(pub ImageStack);

/// What one section is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Section {
    /// Arc length where it begins, mm.
    pub from_mm: f64,
    /// Arc length where it ends, mm: where the next begins.
    pub to_mm: f64,
    pub pixels: u64,
    /// Mean of M_DC over its pixels, in the unit of the modulation.
    pub m_dc: f64,
}

/// Two sections with the shares of a pixel that they have.
pub type Shares = [(usize, f64); 2];

impl Sections {
    /// The sections in order.
    ///
    /// Error: the attribute is missing or is no such list.
    pub fn list(&self) -> Result<Vec<Section>, Error> {
        let list = self.0.attributes.get("sections").ok_or_else(|| Error::failed("the sections say no bounds"))?;
        serde_json::from_value(list.clone()).map_err(|e| Error::failed(format!("the sections cannot be read: {e}")))
    }

    /// Per pixel the shares of sections: the own one with its weight and, where the weight is below 1, the neighbour with the rest;
    /// `None` where the mask is set.
    ///
    /// Error: a layer is missing, or names a section that is not in the list.
    pub fn shares(&self) -> Result<Vec<Option<Shares>>, Error> {
        let pixels = |name: &str| {
            let layer = self.0.find(name, None).ok_or_else(|| Error::failed(format!("the sections lack `{name}`")))?;
            Ok::<_, Error>(layer.pixels())
        };
        let count = self.list()?.len();
        let (section, neighbour, weight) = (pixels("section")?, pixels("neighbour")?, pixels("weight")?);
        let mask = pixels("mask")?;
        let share = |i: usize| {
            let (own, other, weight) = (section[i] as usize, neighbour[i] as usize, f64::from(weight[i]));
            if mask[i] != 0.0 {
                return Ok(None);
            }
            if own.max(other) >= count || !(weight > 0.0 && weight <= 1.0) {
                let what = format!("pixel {i} is {weight} of section {own} beside {other}, of {count} sections");
                return Err(Error::failed(what));
            }
            Ok(Some([(own, weight), (other, 1.0 - weight)]))
        };
        (0..mask.len()).map(share).collect()
    }
}

impl Payload for Sections {
    const NAME: &'static str = "sections";
    const KIND: ArtifactKind = ArtifactKind::Images;
    const HOLDS: &'static [Quantity] = &[
        quantity("section", "1", "place in the list of sections"),
        quantity("neighbour", "1", "that of the section that has the rest of the pixel"),
        quantity("weight", "1", "share of the own section"),
        quantity("arc_length", "mm", "along the surface"),
        MASK,
    ];

    fn into_artifact(self) -> Artifact {
        Artifact::Images(self.0)
    }

    fn from_artifact(artifact: Artifact) -> Result<Self, Error> {
        match artifact {
            Artifact::Images(stack) => Ok(Self(stack)),
            other => Err(Error::failed(format!("sections must be an image stack, not {:?}", other.kind()))),
        }
    }
}
