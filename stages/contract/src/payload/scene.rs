//! The scene: media, objects, camera, projector, lights, all in mm and mm^-1.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::artifact::{Artifact, ArtifactKind, Record};
use crate::error::Error;
use crate::payload::Payload;

/// A checked scene. World coordinates, z up.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scene {
    /// One entry per channel; empty for a single channel without a named wavelength.
    pub wavelengths_nm: Vec<f64>,
    pub media: BTreeMap<String, Medium>,
    pub objects: BTreeMap<String, Object>,
    pub camera: Option<Camera>,
    pub projector: Option<Projector>,
}

/// A homogeneous turbid medium; mu_a and mu_s in mm^-1 hold one value per channel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Medium {
    pub mu_a: Vec<f64>,
    pub mu_s: Vec<f64>,
    pub g: f64,
    pub n: f64,
}

/// A solid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Object {
    pub shape: Shape,
    pub medium: String,
    pub priority: i32,
    pub surface: Surface,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// Infinite sideways unless `size` is given.
    Slab {
        thickness: f64,
        top: f64,
        size: Option<[f64; 2]>,
        center: [f64; 2],
    },
    Box {
        size: [f64; 3],
        center: [f64; 3],
    },
    Sphere {
        diameter: f64,
        center: [f64; 3],
    },
    Spheroid {
        diameters: [f64; 3],
        center: [f64; 3],
    },
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Surface {
    #[default]
    Smooth,
    Lambertian(f64),
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    pub position: [f64; 3],
    pub look_at: [f64; 3],
    pub up: [f64; 3],
    /// mm seen in the plane z = look_at.z.
    pub field: [f64; 2],
    pub pixels: [u32; 2],
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Projector {
    pub position: [f64; 3],
    pub look_at: [f64; 3],
    pub up: [f64; 3],
    pub field: [f64; 2],
    /// W inside the field at pattern value 1.
    pub power: f64,
    pub pixels: Option<[u32; 2]>,
}

impl Payload for Scene {
    const NAME: &'static str = "scene";
    const KIND: ArtifactKind = ArtifactKind::Record;

    fn into_artifact(self) -> Artifact {
        match serde_json::to_value(&self) {
            Ok(serde_json::Value::Object(map)) => Artifact::Record(Record { fields: map.into_iter().collect() }),
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
