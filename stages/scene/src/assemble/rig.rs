//! The input `rig`: camera, projector, lights and wavelengths that a scene takes from another one.

use std::collections::BTreeSet;
use std::sync::Arc;

use turbid_contract::payload::{Lamp, Scene};
use turbid_contract::{Problem, Problems};

use crate::params::Params;

/// What the input `rig` holds.
pub enum RigInput {
    /// Nothing is connected: the parameters say all.
    None,
    /// It is connected, and its scene could not be made yet.
    Unknown,
    /// `producer`: the stage that gives it, for messages.
    Known { scene: Arc<Scene>, producer: String },
}

/// The keys that were taken from the rig: mistakes in them are not mistakes of a field here.
#[derive(Default)]
pub struct Taken {
    keys: BTreeSet<&'static str>,
    producer: String,
}

const REMOVE_ONE: &str = "remove one of the two";

impl RigInput {
    /// Fills in what the rig gives; a key that both give is a mistake.
    pub fn complete(&self, scene: &mut Scene, params: &Params, problems: &mut Problems) -> Taken {
        let mut taken = BTreeSet::new();
        let Self::Known { scene: rig, producer } = self else { return Taken::default() };
        let channels = scene.channels();
        let given = [
            ("wavelength_nm", !params.wavelength_nm.is_empty(), !rig.wavelengths_nm.is_empty()),
            ("camera", params.camera.is_some(), rig.camera.is_some()),
            ("projector", params.projector.is_some(), rig.projector.is_some()),
            ("lights", !params.lights.is_empty(), !rig.lights.is_empty()),
        ];
        for (key, here, there) in given {
            if here && there {
                let message = format!("`{key}` stands here, and in the rig `{producer}` (in: rig) too");
                problems.push_with_hint(key, message, REMOVE_ONE);
            } else if there {
                taken.insert(key);
            }
        }
        // A rig without wavelengths has one power for all.
        let spread = |values: &mut Vec<f64>| {
            if let [one] = values[..] {
                *values = vec![one; channels];
            }
        };
        if taken.contains("camera") {
            scene.camera.clone_from(&rig.camera);
        }
        if taken.contains("projector") {
            scene.projector.clone_from(&rig.projector);
            scene.projector.iter_mut().for_each(|p| spread(&mut p.power));
        }
        if taken.contains("lights") {
            scene.lights.clone_from(&rig.lights);
            scene.lights.values_mut().for_each(|lamp| match lamp {
                Lamp::Point { power, .. } | Lamp::Spot { power, .. } | Lamp::Collimated { power, .. } => spread(power),
                Lamp::Ambient { radiance } => spread(radiance),
            });
        }
        Taken { keys: taken, producer: producer.clone() }
    }
}

impl Taken {
    /// Reports what was found in the whole scene. A field of the rig does not stand among the parameters here: its mistakes are
    /// told of the input.
    pub fn replace(&self, mut found: Problems, problems: &mut Problems) {
        let of_rig = |path: &str| self.keys.contains(path.split('.').next().unwrap_or_default());
        let said = |path: &str, message: String| format!("{path} of the rig `{}`: {message}", self.producer);
        for (Problem { path, message, hint, .. }, size) in found.take_ranked() {
            let hint = hint.unwrap_or_default();
            if of_rig(&path) {
                problems.warn_ranked(size, "", said(&path, message), hint);
            } else {
                problems.warn_ranked(size, path, message, hint);
            }
        }
        let (mistakes, warnings) = found.into_parts();
        for Problem { path, message, hint, .. } in mistakes {
            match hint {
                Some(hint) if of_rig(&path) => problems.at_input("rig", said(&path, message), hint),
                None if of_rig(&path) => problems.at_input("rig", said(&path, message), "change it there"),
                Some(hint) => problems.push_with_hint(path, message, hint),
                None => problems.push(path, message),
            }
        }
        for Problem { path, message, .. } in warnings {
            if of_rig(&path) {
                problems.warn("", said(&path, message));
            } else {
                problems.warn(path, message);
            }
        }
    }
}
