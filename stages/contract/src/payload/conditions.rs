//! How what was seen was lit and looked at: what a model that reads it has to share.

use serde::{Deserialize, Serialize};

use crate::artifact::{Attributes, ImageStack, LayerKind};
use crate::payload::PhaseFunction;

/// Who says what the conditions are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SaidBy {
    /// Computed from a scene.
    Scene,
    /// Stated by whoever took the frames.
    User,
}

/// How thick what was seen is, along the normal of its surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Thickness {
    HalfSpace,
    /// Least, median and most over what is seen, mm.
    Mm([f64; 3]),
}

/// One object that the camera sees, or all that it sees; what is `None` is not known.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Seen {
    /// Its name; empty for all that is seen.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub object: String,
    /// mm^-1, one value per channel; empty where they are not known.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub mu_a: Vec<f64>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub mu_s_prime: Vec<f64>,
    /// As in a [`super::Medium`]: a field `g`, or that of another kind.
    #[serde(flatten)]
    pub phase: Option<PhaseFunction>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub n: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub thickness: Option<Thickness>,
    /// Between the normal of the surface and the way to the camera: least, median and most, degrees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub view_deg: Option<[f64; 3]>,
    /// The same to the projector; beyond 90 the light falls on the other side.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub incidence_deg: Option<[f64; 3]>,
}

/// The conditions of frames and of all that is made of them: attribute `conditions`, that of a calibrated reflectance's
/// other arm `reference_conditions`. Known before anything runs where a scene or the user says them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Conditions {
    pub said_by: SaidBy,
    /// By how much of the image they fill, most first.
    pub seen: Vec<Seen>,
}

/// Name of the attribute.
pub const CONDITIONS: &str = "conditions";
/// That of the reference arm, in a reflectance.
pub const REFERENCE_CONDITIONS: &str = "reference_conditions";
/// Layers of kind condition, by pixels of the camera, 0 where nothing is seen: angles to the normal of the surface (degrees) and what lies below it (mm).
pub const VIEW_LAYER: &str = "view_deg";
pub const INCIDENCE_LAYER: &str = "incidence_deg";
pub const THICKNESS_LAYER: &str = "thickness";

impl Conditions {
    /// What the attribute `name` says; `None` where nobody said anything.
    pub fn of(attributes: &Attributes, name: &str) -> Option<Self> {
        attributes.get(name).and_then(|value| serde_json::from_value(value.clone()).ok())
    }

    pub fn insert_into(&self, attributes: &mut Attributes, name: &str) {
        attributes.insert(name.to_owned(), serde_json::to_value(self).expect("names and finite numbers are JSON"));
    }
}

impl ImageStack {
    /// Takes over what another stack of the same camera says of how it was lit and looked at, pixel by pixel.
    pub fn carry_conditions(&mut self, from: &ImageStack) {
        for layer in from.layers.iter().filter(|l| l.info.kind == LayerKind::Condition) {
            if self.find(&layer.info.name, None).is_none() {
                self.push(layer.info.clone(), layer.data.clone());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is said before a run is what a file says after it; what is unknown stays unknown.
    #[test]
    fn conditions_survive_as_an_attribute() {
        let seen = Seen {
            object: "block".to_owned(),
            thickness: Some(Thickness::Mm([2.0, 2.0, 2.5])),
            view_deg: Some([44.0, 45.0, 46.0]),
            ..Seen::default()
        };
        let said = Conditions { said_by: SaidBy::Scene, seen: vec![seen] };
        let mut attributes = Attributes::new();
        said.insert_into(&mut attributes, CONDITIONS);
        assert_eq!(Conditions::of(&attributes, CONDITIONS), Some(said));
        assert_eq!(Conditions::of(&attributes, REFERENCE_CONDITIONS), None);
    }
}
