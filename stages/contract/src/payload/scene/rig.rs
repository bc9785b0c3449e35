//! The rig: what lights and sees. Two arms of a measurement are comparable only if they share it.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::{Camera, Lamp, Projector, Scene};
use crate::artifact::Attributes;
use crate::canonical::canonical_value;
use crate::error::Error;

/// Name of the attribute that frames, and all that is made of them, carry.
pub const RIG: &str = "rig";

/// Camera, projector, lights and wavelengths of a scene, or the name of a laboratory's bench whose parts nobody wrote down.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Rig {
    /// Of a bench: the same name is the same rig.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub wavelengths_nm: Vec<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<Camera>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub projector: Option<Projector>,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub lights: BTreeMap<String, Lamp>,
}

/// Differences that a message names; one moved camera has several.
const MOST_DIFFERENCES: usize = 3;

impl Scene {
    /// What lights and sees this scene; its media and objects have no part in it.
    pub fn rig(&self) -> Rig {
        Rig {
            name: None,
            wavelengths_nm: self.wavelengths_nm.clone(),
            camera: self.camera.clone(),
            projector: self.projector.clone(),
            lights: self.lights.clone(),
        }
    }
}

impl Rig {
    /// A laboratory's bench by its name.
    pub fn named(name: impl Into<String>) -> Self {
        Self { name: Some(name.into()), ..Self::default() }
    }

    /// What the attribute says; `None` where nobody said anything.
    pub fn of(attributes: &Attributes) -> Option<Self> {
        attributes.get(RIG).and_then(|value| serde_json::from_value(value.clone()).ok())
    }

    /// Writes the attribute: the parts, and `digest`.
    pub fn insert_into(&self, attributes: &mut Attributes) {
        let mut parts = self.parts();
        parts.as_object_mut().expect("a rig is a map").insert("digest".to_owned(), self.digest().into());
        attributes.insert(RIG.to_owned(), parts);
    }

    /// The first 16 hexadecimal digits of the BLAKE3 hash of the rig's JSON, in the order of the fields here.
    pub fn digest(&self) -> String {
        let text = serde_json::to_vec(self).expect("a rig holds finite numbers and text");
        blake3::hash(&text).to_hex()[..16].to_owned()
    }

    /// What differs from `other`, each with the field, both values and the unit (`projector.power 5 W against 6 W`);
    /// empty for the same rig.
    pub fn differences(&self, other: &Self) -> Vec<String> {
        if self.name.is_some() || other.name.is_some() {
            let said =
                |rig: &Self| rig.name.as_ref().map_or_else(|| "that of a scene".to_owned(), |n| format!("`{n}`"));
            return if self == other { Vec::new() } else { vec![format!("{} against {}", said(self), said(other))] };
        }
        let mut found = Vec::new();
        differences("", &self.parts(), &other.parts(), &mut found);
        if found.len() > MOST_DIFFERENCES {
            let more = found.len() - MOST_DIFFERENCES;
            found.truncate(MOST_DIFFERENCES);
            found.push(format!("{more} more"));
        }
        found
    }

    /// What was lit and seen by one rig may be divided and subtracted. Error: both say what theirs is, and it is another.
    pub fn shared(first: &Attributes, second: &Attributes) -> Result<(), Error> {
        let Some((first, second)) = Self::of(first).zip(Self::of(second)) else { return Ok(()) };
        let differences = first.differences(&second);
        if differences.is_empty() {
            return Ok(());
        }
        let what = format!("they were lit or seen by different rigs: {}", differences.join("; "));
        Err(Error::failed_with_hint(what, "let both scenes take one rig, `in: {rig: STAGE}`"))
    }

    fn parts(&self) -> Value {
        canonical_value(self).expect("a rig holds finite numbers and text")
    }
}

/// Adds every field in which two JSON values differ; a list is one value, and so is a part that only one of them has.
fn differences(path: &str, a: &Value, b: &Value, found: &mut Vec<String>) {
    match (a, b) {
        _ if a == b => {}
        (Value::Object(left), Value::Object(right)) => {
            let keys: BTreeSet<&String> = left.keys().chain(right.keys()).collect();
            for key in keys {
                let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
                let of = |map: &Map<String, Value>| map.get(key).cloned().unwrap_or_default();
                differences(&path, &of(left), &of(right), found);
            }
        }
        _ => found.push(format!("{path} {} against {}", said(path, a), said(path, b))),
    }
}

/// A value with its unit, which its field tells.
fn said(path: &str, value: &Value) -> String {
    let unit = match path.rsplit('.').next().unwrap_or(path) {
        "position" | "look_at" | "field" | "diameter" | "focus" => " mm",
        "power" => " W",
        "radiance" => " W mm^-2 sr^-1",
        "angle_deg" => " deg",
        "wavelengths_nm" => " nm",
        _ => "",
    };
    match value {
        Value::Null => "none".to_owned(),
        // An absent part against a whole one: its fields are in the scene's own record.
        Value::Object(_) => "given".to_owned(),
        Value::Array(items) if items.len() == 1 => said(path, &items[0]),
        Value::Array(items) => {
            let items: Vec<String> = items.iter().map(|item| said("", item)).collect();
            format!("[{}]{unit}", items.join(", "))
        }
        // 5.0 W is 5 W.
        Value::Number(number) => number.as_f64().map_or_else(|| number.to_string(), |x| format!("{x}{unit}")),
        Value::String(text) => text.clone(),
        Value::Bool(_) => value.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bench(power: f64) -> Rig {
        let parts = serde_json::json!({
            "camera": {"position": [0.0, 0.0, 500.0], "look_at": [0.0, 0.0, 0.0], "up": [0.0, 1.0, 0.0],
                "field": [64.0, 64.0], "pixels": [64, 64], "specular": null},
            "projector": {"position": [0.0, 35.0, 500.0], "look_at": [0.0, 0.0, 0.0], "up": [0.0, 1.0, 0.0],
                "field": [128.0, 128.0], "power": [power], "profile": "flat", "pixels": null},
        });
        serde_json::from_value(parts).unwrap()
    }

    /// What goes into a file comes out of it; the digest is there for people and changes with the rig.
    #[test]
    fn a_rig_survives_as_an_attribute() {
        let mut attributes = Attributes::new();
        bench(5.0).insert_into(&mut attributes);
        assert_eq!(Rig::of(&attributes), Some(bench(5.0)));
        assert_eq!(attributes[RIG]["digest"], Value::from(bench(5.0).digest()));
        assert_ne!(bench(5.0).digest(), bench(6.0).digest());
        assert_eq!(Rig::of(&Attributes::new()), None);
        // An attribute of another kind is not a rig.
        assert_eq!(Rig::of(&Attributes::from([(RIG.to_owned(), Value::from("bench"))])), None);
    }

    /// Every difference with field, both values and unit; long lists of them are cut.
    #[test]
    fn differences_are_named() {
        assert_eq!(bench(5.0).differences(&bench(5.0)), Vec::<String>::new());
        assert_eq!(bench(5.0).differences(&bench(6.0)), ["projector.power 5 W against 6 W"]);
        let dark = Rig { projector: None, ..bench(5.0) };
        assert_eq!(bench(5.0).differences(&dark), ["projector given against none"]);
        let mut moved = bench(5.5);
        moved.wavelengths_nm = vec![635.0];
        let camera = moved.camera.as_mut().unwrap();
        (camera.position, camera.pixels, camera.up) = ([0.0, 0.5, 400.0], [32, 32], [1.0, 0.0, 0.0]);
        let wanted = [
            "camera.pixels [64, 64] against [32, 32]",
            "camera.position [0, 0, 500] mm against [0, 0.5, 400] mm",
            "camera.up [0, 1, 0] against [1, 0, 0]",
            "2 more",
        ];
        assert_eq!(bench(5.0).differences(&moved), wanted);
        assert_eq!(Rig::named("a").differences(&Rig::named("a")), Vec::<String>::new());
        assert_eq!(Rig::named("a").differences(&Rig::named("b")), ["`a` against `b`"]);
        assert_eq!(Rig::named("a").differences(&bench(5.0)), ["`a` against that of a scene"]);
    }
}
