//! The scene: media, objects, camera, projector, all in mm, mm^-1 and W.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::artifact::{Artifact, ArtifactKind, Record};
use crate::error::Error;
use crate::payload::Payload;

/// A checked scene. World coordinates in mm, z up; outside all objects there is void.
///
/// It holds what light sees and nothing of how it was written: densities became coefficients, a slab with a `size`
/// a box, a spheroid of equal diameters a sphere, media that no object uses are left out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scene {
    /// One entry per channel; empty for a single channel without a named wavelength.
    pub wavelengths_nm: Vec<f64>,
    pub media: BTreeMap<String, Medium>,
    /// By name; where solids overlap, the higher priority wins. Those of equal priority do not overlap.
    pub objects: BTreeMap<String, Object>,
    pub camera: Option<Camera>,
    pub projector: Option<Projector>,
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
    /// Mean cosine of the Henyey-Greenstein phase function, in (-1, 1).
    pub g: f64,
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

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// All points with bottom <= z <= top.
    Slab {
        top: f64,
        bottom: f64,
    },
    /// Axis-aligned.
    Box {
        size: [f64; 3],
        center: [f64; 3],
    },
    Sphere {
        diameter: f64,
        center: [f64; 3],
    },
    /// Axes along x, y, z.
    Spheroid {
        diameters: [f64; 3],
        center: [f64; 3],
    },
}

/// What light meets at the skin of an object.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Surface {
    /// A smooth boundary between the refractive indices of the two sides.
    #[default]
    Smooth,
    /// Opaque, diffusely reflecting this fraction of the light that falls on it.
    Lambertian(f64),
}

/// Whether light that never entered a medium is seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Specular {
    Include,
    Exclude,
}

/// A pinhole camera. Its image plane is parallel to the plane z = look_at.z (as behind a shift lens), so that `field`
/// is exactly the rectangle seen there, centred on `look_at`, and every pixel an equal part of it.
///
/// With right = forward x up: image x runs along the horizontal part of right, rows run downwards.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    pub position: [f64; 3],
    pub look_at: [f64; 3],
    pub up: [f64; 3],
    /// mm seen in the plane z = look_at.z.
    pub field: [f64; 2],
    /// Columns, rows.
    pub pixels: [u32; 2],
    pub specular: Option<Specular>,
}

/// How a projector spreads a pattern value of 1 over its field.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Profile {
    /// The same radiant intensity (W/sr) in every direction of the field.
    #[default]
    UniformIntensity,
    /// The same irradiance everywhere on the plane z = look_at.z.
    Flat,
}

/// A pinhole projector, framed like [`Camera`]; dark outside its field.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Projector {
    pub position: [f64; 3],
    pub look_at: [f64; 3],
    pub up: [f64; 3],
    /// mm lit in the plane z = look_at.z.
    pub field: [f64; 2],
    /// W inside the field at pattern value 1.
    pub power: f64,
    pub profile: Profile,
    /// Columns, rows; bounds the f_x that it can show.
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
