//! The scene: media, objects, camera, projector, lights, all in mm, mm^-1 and W.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::artifact::{Artifact, ArtifactKind, Record};
use crate::error::Error;
use crate::payload::Payload;

mod detector;
mod lamp;
mod lens;
mod mesh;
mod phase_function;
mod rig;
mod shape;
mod surface;
mod texture;
mod view;

pub use detector::{Detector, Outline};
pub use lamp::Lamp;
pub use lens::{Aperture, Distortion, Projection};
pub use mesh::Mesh;
pub use phase_function::PhaseFunction;
pub use rig::{RIG, Rig};
pub use shape::{Port, Shape};
pub use surface::Surface;
pub use texture::{Motif, Picture, Texture};
pub use view::{Camera, Profile, Projector, Specular};

/// A checked scene. World coordinates in mm, z up; outside all objects there is void.
///
/// It holds what light sees and nothing of how it was written: densities became coefficients, a slab with a `size`
/// a box, a spheroid of equal diameters a sphere, media that no object uses are left out. Its record has a field more, `rig`:
/// the digest of its [`Rig`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scene {
    /// One entry per channel; empty for a single channel without a named wavelength.
    pub wavelengths_nm: Vec<f64>,
    pub media: BTreeMap<String, Medium>,
    /// By name; where solids overlap, the higher priority wins. Those of equal priority do not overlap.
    pub objects: BTreeMap<String, Object>,
    pub camera: Option<Camera>,
    pub projector: Option<Projector>,
    /// Steady lights, by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub lights: BTreeMap<String, Lamp>,
    /// By name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub detectors: BTreeMap<String, Detector>,
}

impl Scene {
    /// How many channels every medium describes; at least 1.
    pub fn channels(&self) -> usize {
        self.wavelengths_nm.len().max(1)
    }
}

/// A homogeneous turbid medium.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Medium {
    /// Absorption coefficient, mm^-1, >= 0, one value per channel.
    pub mu_a: Vec<f64>,
    /// Scattering coefficient, mm^-1, >= 0, one value per channel.
    pub mu_s: Vec<f64>,
    /// How it scatters: a field `g`, or that of another kind.
    #[serde(flatten)]
    pub phase: PhaseFunction,
    /// Refractive index, >= 1.
    pub n: f64,
}

impl Medium {
    /// Neither absorbs nor scatters in any channel, and has the index of the surroundings.
    pub fn is_void(&self) -> bool {
        self.n == 1.0 && self.mu_a.iter().chain(&self.mu_s).all(|&mu| mu == 0.0)
    }
}

/// A solid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Object {
    pub shape: Shape,
    /// Name of its medium; `None` only below an opaque surface.
    pub medium: Option<String>,
    pub priority: i32,
    pub surface: Surface,
}

impl Payload for Scene {
    const NAME: &'static str = "scene";
    const KIND: ArtifactKind = ArtifactKind::Record;

    fn into_artifact(self) -> Artifact {
        let rig = self.rig().digest();
        match serde_json::to_value(&self) {
            Ok(serde_json::Value::Object(map)) => {
                let mut fields: BTreeMap<String, serde_json::Value> = map.into_iter().collect();
                // For people and readers: scenes of one digest were lit and seen by the same rig.
                fields.insert(RIG.to_owned(), rig.into());
                Artifact::Record(Record { fields })
            }
            other => unreachable!("a scene is a map of finite numbers and text: {other:?}"),
        }
    }

    fn from_artifact(artifact: Artifact) -> Result<Self, Error> {
        let Artifact::Record(record) = artifact else {
            return Err(Error::failed(format!("a scene must be a record, not {:?}", artifact.kind())));
        };
        let map: serde_json::Map<_, _> = record.fields.into_iter().collect();
        serde_json::from_value(map.into()).map_err(|e| Error::failed(format!("the stored scene cannot be read: {e}")))
    }
}
